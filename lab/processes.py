"""Worker processes: how they are started so that Ctrl-C ends the work in one sentence and not in many tracebacks."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def deaf_to_interrupts() -> Iterator[None]:
    """Start processes that leave Ctrl-C to this one, which ends them; otherwise each would print its own traceback."""
    if threading.current_thread() is not threading.main_thread():  # elsewhere Python sets no handlers
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # processes inherit no other handler than this
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
