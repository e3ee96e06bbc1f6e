"""Machine code kept on disk from one process to the next.

Question answered: what if a file there was left half written by a power cut, or the disk is full?  numba lets the call
fail that wanted the function, and so every run of a comparison.  Here the function is compiled as if it had never been
kept, and takes the damaged file's place.  Machine code has a checksum, since a hole in it would end the process.
Otherwise this is numba's own cache.
Called by `lab.fast.compiled`.
"""

import pickle
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any
from zlib import crc32

from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.serialize import dumps

ENOUGH = 2_000_000  # bytes: twice what all kernels take


class _Loading:
    """A target of numba's compiler that does not get ready to compile, which takes four times as long as loading."""

    def __init__(self, context: Any) -> None:
        self.context = context

    def __getattr__(self, name: str) -> Any:
        return getattr(self.context, name)

    def refresh(self) -> None:
        """Load nothing that a compiler needs."""


class _Checked(CompileResultCacheImpl):
    """What is written down of a compiled function, behind a checksum."""

    def reduce(self, data: Any) -> tuple[int, bytes]:
        packed = dumps(super().reduce(data))
        return crc32(packed), packed

    def rebuild(self, target_context: _Loading, payload: tuple[int, bytes]) -> Any:
        checksum, packed = payload
        if crc32(packed) != checksum:
            raise ValueError("The checksum is wrong.")
        return super().rebuild(target_context.context, pickle.loads(packed))


class Cache(FunctionCache):
    """numba's, whose failures are nobody's concern."""

    _impl_class = _Checked

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return what is kept for a signature, or None: also of what cannot be read, and then it is forgotten."""
        try:
            return super().load_overload(sig, _Loading(target_context))
        except Exception:  # of any kind, since anything may stand in a damaged file
            with suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled, if that can be done."""
        with suppress(Exception):  # of a full disk, or an index that can be neither read nor forgotten
            super().save_overload(sig, data)


def keep(compiled: Any, function: Any) -> bool:
    """Have a Dispatcher or CFunc of a function kept on disk; return whether there is a folder for it."""
    try:
        compiled._cache = Cache(function)
    except RuntimeError:  # no folder can be written to
        return False
    return True


def has_room(folder: str) -> bool:
    """Whether all kernels could be written to a folder: the disk may be full, or what a person is allowed of it."""
    try:
        with TemporaryFile(dir=Path(folder)) as file:
            file.write(bytes(ENOUGH))
    except OSError:
        return False
    return True
