"""The compiled loop as a function: built at the first import, kept on disk where a folder can be written to.

Question answered: when must kernels be compiled anew?  numba keeps machine code beside the source (in `__pycache__`, or
in the user's cache folder, or where NUMBA_CACHE_DIR says) and looks at the time of one file alone.  So the hash of all
sources of the package goes into the function as a constant: with any of them changed it is another function.
Where no folder can be written to, every process compiles for itself, in a quarter of a minute or more.
Imported by `lab.fast.load` only, since it imports numba.
"""

import hashlib
from pathlib import Path

from lab.fast import loop
from lab.fast.normals import normals, seed, uniforms
from lab.fast.offspring import SCHEMES
from lab.fast.room import room

__all__ = ["KEPT", "SCHEMES", "normals", "room", "run", "seed", "uniforms"]


def _fingerprint() -> int:
    files = sorted(Path(__file__).parent.glob("*.py"))
    return int.from_bytes(hashlib.sha256(b"".join(file.read_bytes() for file in files)).digest()[:6], "big")


run = loop.build(_fingerprint())
try:
    run.enable_caching()
    KEPT = True
except RuntimeError:  # no folder can be written to
    KEPT = False
