"""The compiled loop as a function: built at its first call, kept on disk where a folder can be written to.

Question answered: when must kernels be compiled anew?  numba keeps machine code beside the source (in `__pycache__`, or
in the user's cache folder, or where NUMBA_CACHE_DIR says) and looks at one file alone.  So the hash of all
sources of the package, and of numba's version, is in the name under which a function is kept: with any of them changed
it is another function.  Where no folder can be written to, every process compiles for itself, in a quarter of a minute
or more.
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

from lab.fast import loop
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


def _kept(function: Any) -> Any:
    """Return a function under a name that says from which sources it is made: what is kept on disk is kept by name."""
    same = FunctionType(function.__code__, function.__globals__, function.__name__)
    same.__qualname__ = f"{function.__name__}_{FINGERPRINT}"
    return same


_run = kernel(from_python=True)(_kept(loop.run))
try:
    _run.enable_caching()
    KEPT = True
except RuntimeError:  # no folder can be written to
    KEPT = False


def run(resample: str, *arguments: Any) -> int:
    """Run a filter with one of SCHEMES: `lab.fast.loop.run` without the addresses."""
    return _run(*(_made(part).address for part in parts_for(resample)), *arguments)  # type: ignore[no-any-return]


def _made(part: Part) -> Any:
    """Return the C function of a part, made once: another one would be at another address."""
    with _compiling:
        return _make(part)


@cache
def _make(part: Part) -> Any:
    return numba.cfunc(part.signature, cache=KEPT, **part.kernel.targetoptions)(_kept(part.kernel.py_func))


def is_cold(schemes: Iterable[str]) -> bool:
    """Whether a function that runs with these schemes need is not kept yet, though it could be.

    What is kept for another kind of processor counts, too, although it has to be compiled anew.
    """
    functions = [loop.run, *(part.kernel.py_func for scheme in schemes for part in parts_for(scheme))]
    needed = {f"{Path(each.__code__.co_filename).stem}.{_kept(each).__qualname__}" for each in functions}
    return KEPT and not needed <= {path.name.split("-")[0] for path in Path(_run.stats.cache_path).glob("*.nbi")}


def compile_loop(*arguments: Any) -> None:
    """Compile the loop, but not its parts, for arguments of these types."""
    _run.compile((numba.int64,) * len(parts_for("systematic")) + tuple(map(numba.typeof, arguments)))


def compile_parts(schemes: Iterable[str]) -> None:
    """Compile what `compile_loop` does not, as runs with these schemes need it."""
    for scheme in schemes:
        for part in parts_for(scheme):
            _made(part)
