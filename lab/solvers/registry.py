"""From what a person types to a solver.

Question answered: which function does ``low=sir:ess_threshold=0.2`` or ``mine=my_filters.py:my_sir`` mean?

    [LABEL=]NAME[:OPTION=VALUE]...            a solver of the laboratory
    [LABEL=]FILE.py:FUNCTION[:OPTION=VALUE]... a student's function, in the same slot

Called by the command line; in Python, functions are handed over directly and options bound with functools.partial.
"""

import ast
import hashlib
import importlib.util
import inspect
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from types import ModuleType
from typing import Any

from lab.result import Filtered
from lab.solvers.particle import guided, rbpf, sir, sis
from lab.solvers.protocol import Solver
from lab.validation import InputError

SOLVERS: dict[str, Solver] = {"sis": sis, "sir": sir, "guided": guided, "rbpf": rbpf}

LABEL = r"[A-Za-z0-9_.-]+"
SPECIFICATION = re.compile(
    rf"((?P<label>{LABEL})=)?((?P<file>.+\.py):(?P<function>\w+)|(?P<name>{LABEL}))(?P<options>(:\w+=[^:]*)*)"
)


@dataclass(frozen=True)
class FileSolver:
    """A function in a student's file, found again by name in every worker process.

    Attributes
    ----------
    path : str
        Absolute, so that a worker finds it from any folder.
    function : str
        Name in that file.
    sha256 : str
        Of the file when it was named: a worker that finds another text there refuses it.
    """

    path: str
    function: str
    sha256: str

    def __call__(self, *args: Any, **options: Any) -> Filtered:
        """Call the function."""
        function = self.load()
        with _neighbours(Path(self.path)):  # for imports inside the function
            return function(*args, **options)

    def load(self) -> Callable[..., Filtered]:
        """Return the function itself.

        Raises
        ------
        InputError
            The file is missing or fails when imported, or has no such function.
        """
        if _sha256(self.path) != self.sha256:
            raise InputError(f"{self.path} is not the file with which this began: it has changed since.")
        function = getattr(_import_file(self.path, self.sha256), self.function, None)
        if not callable(function):
            raise InputError(f"{self.path} has no function named {self.function}.")
        return function  # type: ignore[no-any-return]


def resolve(text: str) -> tuple[str, Solver]:
    """Return the label and the solver that a specification stands for.

    Parameters
    ----------
    text : str
        As in the module's docstring; without LABEL= the label is what follows it.

    Returns
    -------
    label : str
    solver : Solver
        Options bound.

    Raises
    ------
    InputError
        The text cannot be read, the solver or an option is not known, or the file cannot be used.
    """
    match = SPECIFICATION.fullmatch(text.strip())
    if not match:
        raise InputError(f"Cannot read {text!r}; write NAME or FILE.py:FUNCTION, then :OPTION=VALUE for each option.")
    label = match["label"] or text.strip()
    if match["file"]:
        label = match["label"] or match["function"] + match["options"]
        path = str(Path(match["file"]).resolve())
        solver: Any = FileSolver(path, match["function"], _sha256(path))
        signature = inspect.signature(solver.load())
    else:
        if match["name"] not in SOLVERS:
            raise InputError(
                f"Unknown solver {match['name']!r}; known are {', '.join(SOLVERS)}, or your own as FILE.py:FUNCTION."
            )
        solver = SOLVERS[match["name"]]
        signature = inspect.signature(solver)
    pairs = [part.split("=", 1) for part in match["options"].split(":")[1:]]
    options = dict(pairs)
    if len(options) < len(pairs):
        raise InputError(f"{text}: an option is given twice.")
    if "n_particles" in options:
        raise InputError(f"{text}: n_particles is no option here, --particles sets it.")
    _check_call(text, signature, options)
    return label, partial(solver, **{name: _value(given) for name, given in options.items()}) if options else solver


def _check_call(text: str, signature: inspect.Signature, options: dict[str, str]) -> None:
    try:
        signature.bind(None, None, n_particles=1, **options)
    except TypeError as error:
        own = [name for name in list(signature.parameters)[2:] if name != "n_particles"]
        raise InputError(
            f"{text}: {error}; it is called as solver(problem, rng, n_particles=..., option=...)"
            f" and its options are {', '.join(own) or 'none'}."
        ) from None


def _value(given: str) -> Any:
    """Return the number, boolean or None that the text spells, else the text itself."""
    try:
        return ast.literal_eval(given)
    except (ValueError, SyntaxError):
        return given


def _sha256(path: str) -> str:
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()
    except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
        raise InputError(f"{path} does not exist.") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}.") from None


@cache
def _import_file(path: str, sha256: str) -> ModuleType:
    """Import a file whose text has this hash: a process that outlives an edit imports it anew."""
    file = Path(path)
    place = hashlib.sha256(f"{path} {sha256}".encode()).hexdigest()[:8]
    name = f"{file.stem}-{place}"  # a file may be called random.py
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up there
    try:
        with _neighbours(file, keep=name):
            spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        raise InputError(f"{path} cannot be imported: {type(error).__name__}: {error}.") from None
    return module


@contextmanager
def _neighbours(file: Path, keep: str = "") -> Iterator[None]:
    """Let a student's file import what lies beside it, and forget that afterwards.

    Two students may both have a utils.py: the next one's must not find the first one's, on the path or in sys.modules.
    """
    folder, before = str(file.parent), set(sys.modules)
    added = folder not in sys.path
    if added:
        sys.path.append(folder)
        importlib.invalidate_caches()
    try:
        yield
    finally:
        if added and folder in sys.path:
            sys.path.remove(folder)
        for name in set(sys.modules) - before - {keep}:
            origin = getattr(sys.modules[name], "__file__", None)
            if origin and Path(origin).is_relative_to(file.parent):
                del sys.modules[name]
