"""The command line: ``slam-lab``, or ``python -m lab``.

Bad input is one sentence on standard error and status 2; a run that failed inside a comparison is status 1; Ctrl-C is
130.  Heavy packages are imported by the commands that need them, so that ``--help`` is quick.
"""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any

AGAIN = 0.05  # seconds until an interrupt that was ignored is repeated
IMPATIENCE = 1.0  # seconds: a second Ctrl-C this soon must not stop the tidying up after the first


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and leave with its status.

    Parameters
    ----------
    arguments : sequence of str, optional
        Without the program's name; by default those of the process.
    """
    _open_streams()
    with _noting_signals() as received:
        try:
            from lab.cli.app import INTERRUPTED, execute

            status, message = execute(arguments)
            if message and received and status != INTERRUPTED:
                raise KeyboardInterrupt
        except BaseException as error:
            # inside an import an interrupt comes out as any error
            if not received and not isinstance(error, KeyboardInterrupt):
                raise
            status = 128 + signal.SIGINT
            message = "stopped; no half-written result remains."
        if received and message:
            status = 128 + received[0]
        if message:
            print(f"slam-lab: {message}", file=sys.stderr)
    sys.exit(status)


def _open_streams() -> None:
    """Open what whoever started this has closed (>&-), as if nobody listened: other processes need it, too."""
    for number, name in ((1, "stdout"), (2, "stderr")):
        if getattr(sys, name) is None:
            os.dup2(os.open(os.devnull, os.O_WRONLY), number)
            os.set_inheritable(number, True)
            setattr(sys, name, os.fdopen(number, "w", encoding="utf-8", closefd=False))


@contextmanager
def _noting_signals() -> Iterator[list[int]]:
    """Turn Ctrl-C, and the polite end that batch systems ask for, into KeyboardInterrupt; list what was received.

    One that comes while Python tidies up (in a ``__del__``, or in a callback from C) would be ignored: it comes again.
    """
    received: list[int] = []
    last = -IMPATIENCE

    def interrupt(number: int, _: object) -> None:
        nonlocal last
        hurry, last = time.monotonic() - last < IMPATIENCE, time.monotonic()
        received.append(number)
        if not hurry:
            raise KeyboardInterrupt

    def repeat(ignored: Any) -> None:
        nonlocal last
        if not isinstance(ignored.exc_value, KeyboardInterrupt) or not received:
            hook(ignored)
            return
        last = -IMPATIENCE
        repeats.append(threading.Timer(AGAIN, again, (received[-1],)))
        repeats[-1].start()

    repeats: list[threading.Timer] = []
    before, hook = {}, sys.unraisablehook
    again: Callable[[int], None] = signal.raise_signal
    if hasattr(signal, "pthread_kill"):  # another thread's signal would not wake this one where it waits
        again = partial(signal.pthread_kill, threading.get_ident())
    if threading.current_thread() is threading.main_thread():  # elsewhere Python sets no handlers
        for number in (signal.SIGINT, signal.SIGTERM):
            if signal.getsignal(number) is not signal.SIG_IGN:  # as under nohup
                before[number] = signal.signal(number, interrupt)
        sys.unraisablehook = repeat
    try:
        yield received
    finally:
        sys.unraisablehook = hook
        for timer in repeats:
            timer.cancel()
        for number, handler in before.items():
            signal.signal(number, handler)
