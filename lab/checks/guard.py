"""Calling a function that is not trusted: what it did, whatever it did.

Question answered: what came of ``answer(*args)``, if it may raise, hang, print, edit its arguments, draw from the
global generators, or hand the work over to the laboratory?  `call` always comes back with an `Outcome`.  Time is
limited by an interval timer where the platform has one and the main thread runs; elsewhere the limit is inactive,
which `limits` says.  A child process (`lab.checks.grading`) limits what no timer can.
"""

import copy
import functools
import inspect
import io
import random
import re
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from types import FrameType, TracebackType
from typing import Any

import numpy as np

SECONDS = 20.0  # for one call
KEPT = 200  # characters of what was printed, or of a message
SMALL = 9  # entries: a global array with no more is a constant, such as an identity
STAND_INS = "lab.checks.stand_ins"  # whose calls are not the answer's own
OURS = (
    *("lab.solvers", "lab.gaussian", "lab.weights", "lab.resampling", "lab.theory", "lab.ekfslam"),
    *("lab.compare", "lab.units", "lab.work"),
)


class TimeUp(BaseException):
    """The time of a call is over; no Exception, so that ``except Exception`` does not stop it."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """What one call did.

    Attributes
    ----------
    value : object
        What was returned.
    error : BaseException or None
        What was raised.
    line : int
        Line of the answer's own code where it was raised, counted from the top of its file or cell; 0 if unknown.
    changed : tuple of str
        Arguments that were edited in place.
    printed : str
        The beginning of what was printed.
    drew : bool
        Whether a global random generator was used.
    ours : str
        A function of the laboratory that was called, such as "lab.solvers.kalman"; empty when none, or not looked for.
    """

    value: Any = None
    error: BaseException | None = None
    line: int = 0
    changed: tuple[str, ...] = ()
    printed: str = ""
    drew: bool = False
    ours: str = ""


def call(
    answer: Callable[..., Any],
    args: Sequence[Any],
    names: Sequence[str] = (),
    options: dict[str, Any] | None = None,
    *,
    seconds: float = SECONDS,
    watch: Callable[[str, str], bool] | None = None,
) -> Outcome:
    """Call `answer` on copies of `args` and say what it did.

    Parameters
    ----------
    answer : function
    args : sequence
        Positional arguments; arrays and generators are copied, so that they can be used again.
    names : sequence of str
        Their names, for `Outcome.changed`.
    options : dict, optional
        Keyword arguments.
    seconds : float
        Time limit.
    watch : function, optional
        (module, function) -> whether a call to it counts as `Outcome.ours`; this slows the call down.  For an answer
        that is given (`lab.given`) it is asked about `STAND_INS` and the answer's name, and not about what that calls.
    """
    given = [_copied(argument) for argument in args]
    before = [_copied(argument) for argument in args]
    state, python_state = np.random.get_state(), random.getstate()  # noqa: NPY002
    sink, seen = Sink(), list[str]()
    value, error, line = None, None, 0
    with redirect_stdout(sink), warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            with time_limit(seconds), _watched(watch, seen):
                value = answer(*given, **_copied(options or {}))
        except KeyboardInterrupt:
            raise
        except BaseException as raised:
            error, line = raised, _line(raised.__traceback__, answer)
    labels = list(names) + [f"argument {i}" for i in range(len(names), len(args))]
    changed = tuple(label for label, old, new in zip(labels, before, given, strict=True) if not _same(old, new))
    drew = not _same_state(state, np.random.get_state()) or python_state != random.getstate()  # noqa: NPY002
    if drew:  # a check leaves no trace
        np.random.set_state(state)  # noqa: NPY002
        random.setstate(python_state)
    return Outcome(value, error, line, changed, sink.text, drew, seen[0] if seen else "")


def limits(seconds: float = SECONDS) -> tuple[str, ...]:
    """Return a sentence for each limit that is inactive here."""
    if _has_timer():
        return ()
    return (f"the time limit of {seconds:g} s is inactive here: this platform, or thread, has no interval timer",)


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Raise `TimeUp` in the block after so many seconds, where the platform can."""
    if not _has_timer():
        yield
        return

    def ring(number: int, frame: FrameType | None) -> None:
        raise TimeUp

    handler = signal.signal(signal.SIGALRM, ring)
    # it rings again, because a bare except swallows the first
    outer = signal.setitimer(signal.ITIMER_REAL, seconds, 0.05)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, *outer)
        signal.signal(signal.SIGALRM, handler)


def of_the_laboratory(answer: Any) -> str:
    """Return the dotted name when `answer` itself is a function of the laboratory, or one with options bound."""
    while isinstance(answer, functools.partial):
        answer = answer.func
    module = getattr(answer, "__module__", None) or type(answer).__module__
    name = getattr(answer, "__qualname__", type(answer).__qualname__)
    return f"{module}.{name}" if str(module).split(".")[0] == "lab" else ""


def is_ours(module: str, function: str) -> bool:
    """Whether a call to this function leaves the answer to the laboratory."""
    return module.startswith((*OURS, "lab.consistency", "lab.checks"))


def describe(error: BaseException, line: int, seconds: float = SECONDS) -> str:
    """Return one sentence about what a function raised."""
    if isinstance(error, TimeUp):
        return f"it did not come back within {seconds:g} s"
    if isinstance(error, RecursionError):
        return "it calls itself without end (RecursionError)"
    if isinstance(error, SystemExit):
        return "it leaves Python (SystemExit) instead of returning"
    text = message(error)
    if isinstance(error, ValueError) and "read-only" in text:
        text += ": it tries to write into the problem or the model"
    where = f" (line {line})" if line else ""
    return f"it raises {type(error).__name__}{': ' + text if text else ''}{where}"


def message(error: BaseException) -> str:
    """Return what an error says on one line, the beginning of it; some have a message that raises itself."""
    try:
        text = " ".join(str(error).split())
    except Exception:
        return ""
    text = "".join(letter for letter in text if letter.isprintable())
    return text if len(text) <= KEPT else f"{text[:KEPT]} ..."


_NUMPY = dict(vars(np))


def replaced_in_numpy() -> list[str]:
    """Return the functions of numpy that somebody has exchanged, and put the right ones back.

    The checks compute with numpy themselves, and so would come to any result.
    """
    found = [name for name, was in _NUMPY.items() if callable(was) and vars(np).get(name) is not was]
    for name in found:
        setattr(np, name, _NUMPY[name])
    return found


def data_names(answer: Callable[..., Any]) -> list[str]:
    """Return the global variables holding data that a function reads, through the functions of its own file, too.

    Such a function answers for the data of its notebook only.
    """
    found: dict[str, None] = {}
    visited = set[int]()

    def visit(function: Any) -> None:
        function = inspect.unwrap(function.func if isinstance(function, functools.partial) else function)
        code, scope = getattr(function, "__code__", None), getattr(function, "__globals__", {})
        if code is None or id(code) in visited:
            return
        visited.add(id(code))
        codes = [code]
        while codes:
            one = codes.pop()
            codes += [constant for constant in one.co_consts if hasattr(constant, "co_names")]
            for name in one.co_names:
                value = scope.get(name)
                if inspect.isfunction(value) and value.__globals__ is scope:
                    visit(value)
                elif (isinstance(value, np.ndarray) and value.size > SMALL) or type(value).__name__ in _DATA:
                    found[name] = None
        for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
            if isinstance(getattr(cell, "cell_contents", None), np.ndarray):
                found[name] = None

    visit(answer)
    return list(found)


_TYPES = {"Problem", "LinearGaussianModel", "Filtered"}
_DATA = {"Experiment", "Problem", "LinearGaussianModel", "Simulation"}


class Sink(io.TextIOBase):
    """A stream that keeps the beginning of what is written."""

    def __init__(self) -> None:
        """Start empty."""
        self.text = ""

    def write(self, text: str) -> int:
        """Keep what fits."""
        self.text = (self.text + text)[:KEPT] if len(self.text) < KEPT else self.text
        return len(text)

    def writable(self) -> bool:
        """Say yes."""
        return True


@contextmanager
def _watched(watch: Callable[[str, str], bool] | None, seen: list[str]) -> Iterator[None]:
    if watch is None:
        yield
        return

    standing_in: list[FrameType] = []

    def note(frame: FrameType, event: str, argument: Any) -> None:
        if standing_in:
            if event == "return" and frame is standing_in[0]:
                standing_in.clear()
        elif event == "call" and not seen:
            module = str(frame.f_globals.get("__name__", ""))
            name = frame.f_code.co_qualname
            if module == STAND_INS:
                given = str(frame.f_locals.get("name", ""))
                if watch(module, given):
                    seen.append(f"lab.given.{given}")
                standing_in.append(frame)
                return
            if module.startswith("lab.") and not name.startswith("<") and module != __name__ and watch(module, name):
                seen.append(f"{module}.{name}")

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        yield
    finally:
        sys.setprofile(before)


def _has_timer() -> bool:
    return hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread()


def _copied(value: Any) -> Any:
    """Return a copy of arrays, generators and the laboratory's types, which are shared by many checks."""
    if isinstance(value, np.ndarray):
        return value.copy()
    if type(value).__name__ in _TYPES:
        twin = object.__new__(type(value))
        for name, part in vars(value).items():
            copied = _copied(part)
            if isinstance(copied, np.ndarray):
                copied.flags.writeable = part.flags.writeable  # read-only stays read-only
            twin.__dict__[name] = copied
        return twin
    if isinstance(value, np.random.Generator | list | dict):
        return copy.deepcopy(value)
    return value


def _same(old: Any, new: Any) -> bool:
    if isinstance(old, np.ndarray):
        return bool(old.shape == new.shape and np.array_equal(old, new, equal_nan=True))
    if type(old).__name__ in _TYPES:
        return all(name in vars(new) and _same(part, vars(new)[name]) for name, part in vars(old).items())
    return isinstance(old, np.random.Generator) or not isinstance(old, list | dict) or bool(old == new)


def _same_state(old: Any, new: Any) -> bool:
    return bool(old[2] == new[2] and np.array_equal(old[1], new[1]))


def _line(traceback: TracebackType | None, answer: Any) -> int:
    """Return the last line of a traceback that lies in the file of the answer."""
    code = getattr(inspect.unwrap(answer), "__code__", None) if inspect.isfunction(answer) else None
    line = 0
    while traceback is not None:
        if code is not None and traceback.tb_frame.f_code.co_filename == code.co_filename:
            line = traceback.tb_lineno
        traceback = traceback.tb_next
    return line


def numbers_in(text: str) -> tuple[str, ...]:
    """Return the numbers in a message: two errors of one kind with the same shapes in them have the same cause."""
    return tuple(re.findall(r"\d+", text))


def used_names(answer: Any) -> set[str]:
    """Return the global names that a function uses, through the functions of its own file, too."""
    names = set[str]()
    waiting, visited = [answer], set[int]()
    while waiting:
        function = waiting.pop()
        function = inspect.unwrap(function.func if isinstance(function, functools.partial) else function)
        code, scope = getattr(function, "__code__", None), getattr(function, "__globals__", {})
        if code is None or id(code) in visited:
            continue
        visited.add(id(code))
        codes = [code]
        while codes:
            one = codes.pop()
            codes += [constant for constant in one.co_consts if hasattr(constant, "co_names")]
            names.update(one.co_names)
            waiting += [scope[name] for name in one.co_names if inspect.isfunction(scope.get(name))]
    return names
