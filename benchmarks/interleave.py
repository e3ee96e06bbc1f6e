"""Peers measured in turns: one process each, one processor, one thread, medians over the rounds.

Speed drifts on every machine (other work, heat, memory), so figures of different sessions do not compare.  Here all
peers are alive at once and act one after the other, round by round; a ratio of medians then means something.  A peer
without environment, that fails, or that is slower than the cap is left out and the reason kept.  Called by the drivers.
"""

import contextlib
import json
import os
import queue
import subprocess
import sys
import threading
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from environments import python_of

HERE = Path(__file__).resolve().parent
ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"
)
ONE_THREAD |= {
    "JAX_PLATFORMS": "cpu",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
}
OWN = "lab"  # the environment of the laboratory itself


@dataclass
class Peer:
    """One competitor.

    Attributes
    ----------
    name : str
        As tables and figures call it.
    environment : str
        Of environments.py, or "lab".
    script : str
        In peers/; called with the data file, the file for its answer, and `arguments`.
    """

    name: str
    environment: str
    script: str
    arguments: tuple[str, ...] = ()
    variables: dict[str, str] = field(default_factory=dict)


@dataclass
class Measured:
    """What came of a peer: times [s], the first call's, peak memory [MB], its answer; or why there is none."""

    seconds: list[float] = field(default_factory=list)
    first: float = float("nan")
    before: float = float("nan")
    peak: float = float("nan")
    answer: dict[str, np.ndarray] = field(default_factory=dict)
    reason: str = ""

    @property
    def median(self) -> float:
        """Median time [s]; NaN where nothing was measured."""
        return float(np.median(self.seconds)) if self.seconds else float("nan")


def measure(peers: list[Peer], data: Path, rounds: int, cap: float) -> dict[str, Measured]:
    """Let the peers act in turns.

    Parameters
    ----------
    peers : list of Peer
    data : Path
        The .npz that they read; answers are written beside it.
    rounds : int
        Times measured for each.
    cap : float
        Seconds that one call may take, the first with its compilation included.

    Returns
    -------
    dict of Measured
        By name.
    """
    results = {peer.name: Measured() for peer in peers}
    running: dict[str, _Process] = {}
    try:
        for peer in peers:  # one after the other: the first call must not be disturbed either
            python = Path(sys.executable) if peer.environment == OWN else python_of(peer.environment)
            if python is None:
                results[peer.name].reason = f"no environment {peer.environment!r}"
                continue
            answer = data.with_name(f"answer-{len(running)}.npz")
            process = running[peer.name] = _Process(peer, python, data, answer)
            _ask(process, results[peer.name], cap, running, peer.name)
            if peer.name in running:
                with np.load(answer) as arrays:
                    results[peer.name].answer = dict(arrays)
        for _ in range(rounds):
            for name in list(running):
                running[name].go()
                _ask(running[name], results[name], cap, running, name)
    finally:
        for process in running.values():
            process.end()
    return results


def _ask(process: "_Process", result: Measured, cap: float, running: dict[str, "_Process"], name: str) -> None:
    try:
        told = process.line(cap)
    except TimeoutError:
        result.reason = f"a call took more than {cap:g} s"
    except (EOFError, ValueError):
        result.reason = process.last_words()
    else:
        result.peak = told["peak"] or float("nan")
        if "first" in told:
            result.first, result.before = told["first"], told["before"] or float("nan")
        else:
            result.seconds.append(told["seconds"])
        return
    result.seconds.clear()
    running.pop(name).end()


class _Process:
    """A worker and the lines that it prints."""

    def __init__(self, peer: Peer, python: Path, data: Path, answer: Path) -> None:
        environment = {**os.environ, **ONE_THREAD, **peer.variables, "PYTHONPATH": ""}
        command = [str(python), str(HERE / "peers" / peer.script), str(data), str(answer), *peer.arguments]
        self._words = data.with_name(f"{answer.stem}.txt")
        with self._words.open("w", encoding="utf-8") as words:
            self._process = subprocess.Popen(
                command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=words, text=True
            )
        if hasattr(
            os, "sched_setaffinity"
        ):  # libraries that ignore every variable share the one processor all the same
            os.sched_setaffinity(self._process.pid, {max(os.sched_getaffinity(0))})
        self._lines: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line)
        self._lines.put("")

    def go(self) -> None:
        """Ask for one more call."""
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):  # it has died, which its next line says
            self._process.stdin.write("go\n")
            self._process.stdin.flush()

    def line(self, cap: float) -> dict[str, float]:
        """Return what it says next; TimeoutError after `cap` seconds, EOFError when it has ended."""
        try:
            line = self._lines.get(timeout=cap)
        except queue.Empty:
            raise TimeoutError from None
        if not line:
            raise EOFError
        found: dict[str, float] = json.loads(line)
        return found

    def last_words(self) -> str:
        """Return the last line of its errors."""
        lines = [line.strip() for line in self._words.read_text(encoding="utf-8").splitlines() if line.strip()]
        return lines[-1] if lines else f"ended with status {self._process.wait()}"

    def end(self) -> None:
        """End this process, and wait for it."""
        self._process.kill()
        self._process.wait()
