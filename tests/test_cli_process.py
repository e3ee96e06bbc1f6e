"""The program as a process: signals, terminals, pipes, workers that die, and what it imports."""

import os
import re
import shutil
import signal
import struct
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest
from program import command, everything_in, interruptible, start

posix = pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals and terminals")

SLOW = """
import pathlib, time

def slow(problem, rng, *, n_particles):
    pathlib.Path(f"started-{rng.integers(10**9)}").touch()
    time.sleep(100)
"""
SLOW_TO_IMPORT = """
import pathlib, time

pathlib.Path("started").touch()
try:
    time.sleep(100)
except BaseException:
    raise ImportError("initialization failed") from None  # what becomes of an interrupt inside numpy or scipy
"""
INTERRUPTING = """
import os, signal
from lab.solvers import sir

def interrupting(problem, rng, *, n_particles):
    os.kill(os.getpid(), signal.SIGINT)
    return sir(problem, rng, n_particles=n_particles)
"""

SWALLOWING = """
import os, signal, time

class Tidying:
    def __del__(self):  # whose errors Python ignores
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.1)

def swallowing(problem, rng, *, n_particles):
    Tidying()
    time.sleep(100)
"""


def members(group):
    """Return the processes of a group, those left out that have ended and wait to be noticed."""
    if not shutil.which("ps"):
        return []
    table = subprocess.run(["ps", "-A", "-o", "pid=,pgid=,stat="], capture_output=True, text=True, check=True).stdout
    return [row[0] for row in map(str.split, table.splitlines()) if row[1] == str(group) and not row[2].startswith("Z")]


def interrupt(arguments, n_started, *, whole_group):
    """Start the program, interrupt it when `n_started` files say that it is at work, and check how it ends."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(command(*arguments), start_new_session=True, preexec_fn=interruptible, **pipes)
    try:
        while len(list(Path.cwd().glob("started*"))) < n_started:
            assert process.poll() is None
            time.sleep(0.05)
        sent = time.monotonic()
        (os.killpg if whole_group else os.kill)(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=100)
        assert time.monotonic() - sent < 10
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    assert process.returncode in (130, -signal.SIGINT)  # a shell calls both 130
    assert (out, err) == ("", "slam-lab: stopped; no half-written result remains.\n")
    deadline = time.monotonic() + 10
    while members(process.pid) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not members(process.pid)


@posix
@pytest.mark.parametrize(("jobs", "whole_group"), [(1, False), (2, True)])
def test_an_interrupt_ends_everything_at_once(here, jobs, whole_group):
    """A terminal sends Ctrl-C to the whole group, workers included; `kill -INT` to the one process."""
    (here / "slow.py").write_text(SLOW)
    arguments = ("compare", "--solvers", "slow.py:slow", "--runs", "4", "--jobs", jobs, "--out", "a/b")
    interrupt(arguments, jobs, whole_group=whole_group)
    assert not (here / "a").exists()


@posix
def test_an_interrupt_inside_an_import(here):
    """There it comes out as any error, and is no reason to blame the file."""
    (here / "slow.py").write_text(SLOW_TO_IMPORT)
    interrupt(("run", "slow.py:slow", "--out", "a"), 1, whole_group=False)
    assert not (here / "a").exists()


@posix
def test_an_interrupt_that_python_ignores_comes_again(here):
    (here / "own.py").write_text(SWALLOWING)
    begun = time.monotonic()
    done = start("run", "own.py:swallowing", "--particles", "5", cwd=here, preexec_fn=interruptible)
    assert (done.status, done.err) == (130, "slam-lab: stopped; no half-written result remains.\n")
    assert time.monotonic() - begun < 60


@posix
@pytest.mark.parametrize(("handler", "status"), [(signal.SIG_IGN, 0), (signal.SIG_DFL, 130)])
def test_a_job_in_the_background_goes_on(here, handler, status):
    """A shell starts it with interrupts ignored."""
    (here / "own.py").write_text(INTERRUPTING)
    inherited = partial(signal.signal, signal.SIGINT, handler)
    done = start("run", "own.py:interrupting", "--particles", "5", cwd=here, preexec_fn=inherited)
    assert done.status == status
    assert ("log-evidence" in done.out) == (status == 0)


@posix
def test_a_terminal_of_80_columns_sees_a_bar_with_the_time_left_and_a_table_that_fits(here):
    import fcntl
    import pty
    import termios

    terminal, end = pty.openpty()
    fcntl.ioctl(end, termios.TIOCSWINSZ, struct.pack("HHHH", 30, 80, 0, 0))
    environment = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "LINES", "CI")}
    arguments = command("compare", "--solvers", f"{'long' * 8}=sir", "--particles", "2000", "--runs", "15")
    streams = {"stdin": end, "stdout": end, "stderr": end}
    process = subprocess.Popen(arguments, **streams, env=environment | {"TERM": "xterm"})
    os.close(end)
    seen = b""
    while True:
        try:
            seen += os.read(terminal, 65536)
        except OSError:  # how Linux says that the other end is closed
            break
    os.close(terminal)
    assert process.wait(timeout=100) == 0
    text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", seen.decode())
    bars = [frame for frame in re.split(r"[\r\n]+", text) if frame.startswith("comparing")]
    percents = [int(re.search(r"(\d+)%", bar)[1]) for bar in bars]
    assert percents == sorted(percents)
    assert percents[-1] > 50
    assert any(re.search(r"\d:\d\d:\d\d$", bar.rstrip()) for bar in bars)
    after = re.split(r"[\r\n]+", text[text.rindex("comparing") :])[1:]
    assert max(map(len, after)) <= 80
    assert any("no room for: s per run" in line for line in after)
    assert any(re.match(r"long+\w*\s+2000\s", line) for line in after)


@posix
def test_a_reader_that_stops_reading_does_not_cost_the_result(here):
    """As in `slam-lab run kalman --out DIR | head -1`."""
    reading, writing = os.pipe()
    os.close(reading)
    arguments = command("run", "kalman", "--scenario", "two-landmarks", "--out", "result")
    done = subprocess.run(arguments, stdout=writing, stderr=subprocess.PIPE, text=True, timeout=100)
    os.close(writing)
    assert (done.returncode, done.stderr) == (0, "")
    assert {"config.json", "moments.csv", "map.png"} <= {*everything_in(here / "result")}


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is always full")
def test_a_full_device_is_one_sentence(here):
    with open("/dev/full", "w") as full:
        done = subprocess.run(command("simulate"), stdout=full, stderr=subprocess.PIPE, text=True, timeout=100)
    assert done.returncode == 2
    assert done.stderr == "slam-lab: The output cannot be written: No space left on device.\n"


def test_a_terminal_that_knows_no_accents(here):
    ascii_only = os.environ | {"PYTHONIOENCODING": "ascii"}
    (here / "own.py").write_text(
        "def f(problem, rng, *, n_particles):\n    raise ValueError('raté')\n", encoding="utf-8"
    )
    done = start("compare", "--solvers", "own.py:f", "--particles", "5", "--runs", "1", cwd=here, env=ascii_only)
    assert (done.status, done.err) == (1, "")
    assert "rat\\xe9" in done.out


def test_help_imports_nothing_heavy():
    code = (
        "import runpy, sys; sys.argv = ['lab', '--help']\n"
        "try: runpy.run_module('lab', run_name='__main__')\n"
        "finally:\n"
        "    heavy = {'matplotlib', 'pandas', 'scipy', 'filterpy', 'numba'} & {*sys.modules}\n"
        "    print(sorted(heavy), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "Usage: slam-lab" in done.stdout
    assert done.stderr == "[]\n"


@pytest.mark.parametrize(
    ("ran", "not_needed"),
    [
        ("import lab.work", {"pandas", "filterpy", "scipy.stats", "joblib", "matplotlib"}),  # a worker process
        (
            "from lab.cli.app import app; app(['compare', '--particles', '5', '--runs', '1'], standalone_mode=False)",
            {"filterpy", "scipy.stats", "joblib", "matplotlib", "pandas", "pyarrow"},
        ),
        # runs in threads; where they end in processes, or files of the original lab are read, these come later
        ("import lab.warming, lab.compare", {"scipy.special", "scipy.sparse", "scipy.io", "cloudpickle", "loky"}),
    ],
)
def test_a_comparison_imports_what_it_needs(here, ran, not_needed):
    code = f"import sys; {ran}; print(sorted({not_needed} & {{*sys.modules}}), file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], cwd=here, capture_output=True, text=True, check=True)
    assert done.stderr.splitlines()[-1] == "[]"


@posix
@pytest.mark.parametrize("jobs", [1, 2])
def test_a_comparison_that_nobody_listens_to(here, jobs):
    """As a shell starts it with >&- 2>&-."""
    arguments = ("compare", "--solvers", "sir", "--particles", "5", "--runs", "2", "--jobs", jobs, "--out", "a")
    process = subprocess.Popen(command(*arguments), preexec_fn=lambda: os.closerange(1, 3))
    assert process.wait(100) == 0
    assert (here / "a" / "report.html").exists()
    assert not list((here / "a").glob(".*"))
