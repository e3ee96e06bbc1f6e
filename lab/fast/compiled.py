"""The compiled loop as a function: built at its first call, kept on disk where a folder can be written to.

Question answered: when must kernels be compiled anew?  numba keeps machine code beside the source (in `__pycache__`, or
in the user's cache folder, or where NUMBA_CACHE_DIR says) and looks at one file alone.  So the hash of all
sources of the package, and of numba's version, is in the name under which a function is kept: with any of them changed
it is another function.  Where no folder can be written to, or none has room, every process compiles for itself, in a
quarter of a minute or more.
Imported by `lab.fast.load` only, since it imports numba.
"""

import hashlib
import threading
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from types import FunctionType
from typing import Any

import numba
from numba.core.ccallback import CFunc

from lab.fast import loop
from lab.fast.keeping import has_room, keep
from lab.fast.kernel import kernel
from lab.fast.normals import normals, seed, uniforms
from lab.fast.offspring import SCHEMES
from lab.fast.parts import Part, parts_for
from lab.fast.room import room

__all__ = ["KEPT", "SCHEMES", "compile_loop", "compile_parts", "is_cold", "normals", "room", "run", "seed", "uniforms"]


def _fingerprint() -> str:
    files = sorted(Path(__file__).parent.glob("*.py"))
    contents = [file.read_bytes() for file in files]
    return hashlib.sha256(b"".join([*contents, numba.__version__.encode()])).hexdigest()[:12]


FINGERPRINT = _fingerprint()
_compiling = threading.Lock()


def _named(function: Any) -> Any:
    """Return a function under a name that says from which sources it is made: what is kept on disk is kept by name."""
    same = FunctionType(function.__code__, function.__globals__, function.__name__)
    same.__qualname__ = f"{function.__name__}_{FINGERPRINT}"
    return same


def _are_kept(schemes: Iterable[str]) -> bool:
    """Whether all functions that runs with these schemes need are on disk, be it for another kind of processor."""
    functions = [loop.run, *(part.kernel.py_func for scheme in schemes for part in parts_for(scheme))]
    needed = {f"{Path(each.__code__.co_filename).stem}.{_named(each).__qualname__}" for each in functions}
    return needed <= {path.name.split("-")[0] for path in Path(_run.stats.cache_path).glob("*.nbc")}


_run = kernel(from_python=True)(_named(loop.run))
KEPT = keep(_run, _run.py_func) and (_are_kept(["systematic"]) or has_room(_run.stats.cache_path))


def run(resample: str, *arguments: Any) -> int:
    """Run a filter with one of SCHEMES: `lab.fast.loop.run` without the addresses."""
    return _run(*(_made(part).address for part in parts_for(resample)), *arguments)  # type: ignore[no-any-return]


def _made(part: Part) -> Any:
    """Return the C function of a part, made once: another one would be at another address."""
    with _compiling:
        return _make(part)


@cache
def _make(part: Part) -> Any:
    function, (taken, returned) = _named(part.kernel.py_func), (part.signature.args, part.signature.return_type)
    made = CFunc(function, (taken, returned), {}, part.kernel.targetoptions)
    keep(made, function)
    made.compile()
    return made


def is_cold(schemes: Iterable[str]) -> bool:
    """Whether a function that runs with these schemes need is not kept yet, though it could be.

    What is kept for another kind of processor counts, too, although it has to be compiled anew.
    """
    return KEPT and not _are_kept(schemes)


def compile_loop(*arguments: Any) -> None:
    """Compile the loop, but not its parts, for arguments of these types."""
    _run.compile((numba.int64,) * len(parts_for("systematic")) + tuple(map(numba.typeof, arguments)))


def compile_parts(schemes: Iterable[str]) -> None:
    """Compile what `compile_loop` does not, as runs with these schemes need it."""
    for scheme in schemes:
        for part in parts_for(scheme):
            _made(part)
