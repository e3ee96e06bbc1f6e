"""Worker processes of one item at a time, which may begin before anybody knows what they are to do.

Question answered: how does a process come to its work, and what becomes of it?  It finds its function in a file when
its first item comes: until then it can be started, and made to import what it will need, while this process has other
things to do.  It leaves Ctrl-C to this one, which ends it, and it ends by itself when this one is killed.

joblib's own process pool, loky, is used with one worker each, so that a death names its item: joblib.Parallel gives up
all that is under way instead.  Called by `lab.execution` and by the command line.
"""

import os
import signal
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Future
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cloudpickle
from loky import ProcessPoolExecutor
from loky.backend import resource_tracker as loky_tracker


class Crew:
    """Workers of the same function, for one use; a context that ends them.

    Parameters
    ----------
    module : str, optional
        What each imports at its start.
    """

    def __init__(self, module: str | None = None) -> None:
        self._module = module
        self._folder = TemporaryDirectory(prefix="lab-")
        self._file = Path(self._folder.name) / "function"
        self.workers: list[Worker] = []

    def call(self, n: int) -> "Crew":
        """Start workers until there are n."""
        with _deaf_to_interrupts():
            while len(self.workers) < n:
                self.workers.append(Worker(self._file, self._module))
        return self

    def instruct(self, pickled: bytes) -> None:
        """Say, once and before the first item, what all are to do with their items."""
        self._file.write_bytes(pickled)

    def __enter__(self) -> "Crew":
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End all, whatever they do, and forget the function."""
        while self.workers:
            self.workers.pop().kill()
        self._folder.cleanup()


class Worker:
    """A pool of one process, started at once and again when it has died; finds its function in a file.

    A pipe that a function does not fit in would keep this process waiting until the worker has started.
    """

    def __init__(self, file: Path, module: str | None) -> None:
        self._initial = (file, module, os.getpid())
        self._start()

    def _start(self) -> None:
        self._pool: Any = ProcessPoolExecutor(max_workers=1, initializer=_begin, initargs=self._initial)
        self._pool.submit(int)

    def submit(self, item: Any) -> "Future[Any]":
        """Give it one more item."""
        try:
            future: Future[Any] = self._pool.submit(_call, item)
        except BrokenExecutor:
            self.kill()
            self._start()
            future = self._pool.submit(_call, item)
        return future

    def end(self) -> None:
        """Let it finish, and wait for that."""
        self._pool.shutdown()

    def kill(self) -> None:
        """End it, whatever it does."""
        self._pool.shutdown(kill_workers=True)


_file: Path  # of a worker process
_function: Callable[[Any], Any] | None = None


def _begin(file: Path, module: str | None, parent: int) -> None:
    """Begin a worker: also one by which loky replaces another that has grown, so nothing of it can come later."""
    global _file
    _file = file
    threading.Thread(target=_end_with_parent, args=(parent,), daemon=True).start()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # in a worker that replaces another
    if module is not None:
        import_module(module)


def _end_with_parent(parent: int) -> None:
    """End this worker soon after the process that started it was killed: nobody else would, in a long run."""
    while os.getppid() == parent:
        time.sleep(1)
    os._exit(1)


def _call(item: Any) -> Any:
    global _function
    if _function is None:
        try:
            _function = cloudpickle.loads(_file.read_bytes())
        except BaseException:  # no item's fault: this worker is of no use
            traceback.print_exc()
            os._exit(1)
    return _function(item)


@contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """Start processes that leave Ctrl-C to this one, which ends them; otherwise each would print its own traceback.

    They inherit the blocked signal; here, one that comes meanwhile is delivered afterwards.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows, where `_begin` must do
        yield
        return
    from multiprocessing import resource_tracker

    # with the first worker there come two processes that unblock the signal here, unless they are there before
    resource_tracker.ensure_running()
    loky_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
