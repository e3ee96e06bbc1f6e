"""One function over many items: here, in threads or in worker processes, one result after the other.

Question answered: who computes what, and what becomes of an item whose worker dies?  Every way yields results as they
end, in no fixed order, and goes on when a worker is killed: that item's result is what `lost` makes of it.

    execute(function, items, lost) -> iterator of results

joblib's own process pool, loky, is used with one worker each, so that a death names its item: joblib.Parallel gives up
all that is under way instead.  Knows no filters; called by `lab.compare`.  Other machines: `lab.cluster`.
"""

import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, ThreadPoolExecutor, as_completed, wait
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol, TypeVar

import cloudpickle
import joblib
from loky import ProcessPoolExecutor

from lab.validation import InputError

Item = TypeVar("Item")
Result = TypeVar("Result")
DIED = "its worker process died: it was killed, ran out of memory, or the solver ended Python itself"


class Execute(Protocol):
    """The way units are run; see the module's docstring."""

    def __call__(
        self, function: Callable[[Item], Result], items: Sequence[Item], lost: Callable[[Item, str], Result]
    ) -> Iterator[Result]:
        """Yield one result for each item, in any order."""
        ...


def here(
    function: Callable[[Item], Result], items: Sequence[Item], lost: Callable[[Item, str], Result]
) -> Iterator[Result]:
    """Run one item after the other in this process, which nothing can outlive."""
    return map(function, items)


def threads(
    function: Callable[[Item], Result], items: Sequence[Item], lost: Callable[[Item, str], Result], *, jobs: int
) -> Iterator[Result]:
    """Run items in `jobs` threads of this process (-1: one per processor), which nothing can outlive.

    For functions that leave Python alone most of the time: they start at once and share what they load.  One that is
    stopped waits for the items under way.
    """
    pool = ThreadPoolExecutor(max_workers=_count(jobs))
    try:
        for future in as_completed([pool.submit(function, item) for item in items]):
            yield future.result()
    finally:
        pool.shutdown(cancel_futures=True)


def processes(
    function: Callable[[Item], Result],
    items: Sequence[Item],
    lost: Callable[[Item, str], Result],
    *,
    jobs: int,
    beside: bool = False,
) -> Iterator[Result]:
    """Run items in `jobs` processes (-1: one per processor), each with one item at a time.

    Parameters
    ----------
    function : function of an item
        Sent to each worker process.
    items : sequence
        Given out in this order.
    lost : function of item and str
        Makes the result of an item whose worker died, given the reason; the worker is replaced.
    jobs : int
    beside : bool
        Whether this process is one of them: it works while the others start, which pays when they take long to.  They
        have one item more in hand, since this process may be busy when they end one; so a death may lose two.

    Raises
    ------
    InputError
        The function cannot be pickled.

    Yields
    ------
    object
        Results, in the order in which they end.
    """
    try:
        pickled = cloudpickle.dumps(function)
    except Exception as error:
        raise InputError(f"The work cannot be sent to other processes ({error}); run it in this one, jobs=1.") from None
    waiting = deque(items)
    workers: list[_Worker] = []
    with TemporaryDirectory(prefix="lab-") as folder:
        file = Path(folder) / "function"
        file.write_bytes(pickled)
        try:
            with _deaf_to_interrupts():
                for _ in range(min(_count(jobs), len(items)) - beside):
                    workers.append(_Worker(file))
            running: dict[Future[Any], tuple[_Worker, Item]] = {}
            for worker in workers * (1 + beside):
                if len(waiting) > beside:  # one is left for this process
                    item = waiting.popleft()
                    running[worker.submit(item)] = (worker, item)
            while waiting or running:
                if beside and waiting:
                    yield function(waiting.popleft())
                at_once = 0 if beside and waiting else None
                for future in wait(running, at_once, FIRST_COMPLETED).done:
                    worker, item = running.pop(future)
                    try:
                        result = future.result()
                    except BrokenExecutor:
                        result = lost(item, DIED)
                    if waiting:  # before the result is looked at, so that the worker has work
                        following = waiting.popleft()
                        running[worker.submit(following)] = (worker, following)
                    yield result
            for worker in workers:
                worker.end()
        finally:
            for worker in workers:
                worker.kill()


def _count(jobs: int) -> int:
    return int(joblib.cpu_count()) if jobs == -1 else jobs


_function: Callable[[Any], Any]  # of a worker process, where `_install` puts it


def _install(file: Path) -> None:
    """Begin a worker: also one by which loky replaces another that has grown, so nothing of it can come later."""
    global _function
    threading.Thread(target=_end_with_parent, args=(os.getppid(),), daemon=True).start()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # in a worker that replaces another
    _function = cloudpickle.loads(file.read_bytes())


def _end_with_parent(parent: int) -> None:
    """End this worker soon after the process that started it was killed: nobody else would, in a long run."""
    while os.getppid() == parent:
        time.sleep(1)
    os._exit(1)


def _call(item: Any) -> Any:
    return _function(item)


class _Worker:
    """A pool of one process, started at once and again when it has died; finds its function in a file.

    A pipe that a function does not fit in would keep this process waiting until the worker has started.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._start()

    def _start(self) -> None:
        self._pool: Any = ProcessPoolExecutor(max_workers=1, initializer=_install, initargs=(self._file,))
        self._pool.submit(int)

    def submit(self, item: Any) -> "Future[Any]":
        try:
            future: Future[Any] = self._pool.submit(_call, item)
        except BrokenExecutor:
            self.kill()
            self._start()
            future = self._pool.submit(_call, item)
        return future

    def end(self) -> None:
        self._pool.shutdown()

    def kill(self) -> None:
        self._pool.shutdown(kill_workers=True)


@contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """Start processes that leave Ctrl-C to this one, which ends them; otherwise each would print its own traceback.

    They inherit the blocked signal; here, one that comes meanwhile is delivered afterwards.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows, where `_install` must do
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
