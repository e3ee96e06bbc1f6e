"""Compiled kernels, for whoever has the extra toy-slam-lab[fast]; imports numba only when a kernel is asked for.

Question answered: can this machine run the compiled loop?  `load` answers with the kernels, or with one warning and
None where numba is missing or does not import; what takes their place is for the caller to know.  Arrays in, arrays
out: nothing here knows of robots.

    kernel       how all are compiled         arithmetic  log, exp, directions
    normals      the random stream            block       a step of 256 particles
    genealogy    rows kept once per ancestor  offspring   resampling
    moments      sums over a block            sums        mean and covariance of them
    dropping     who need not go on           room        the memory of a run
    memory       where in it a cloud is       loop        a whole run
    parts        what the loop calls by address, compiled by itself
    keeping      machine code on disk, whatever befalls it
    compiled     the run and its parts as functions kept there
"""

import warnings
from functools import cache
from types import ModuleType


@cache
def load() -> ModuleType | None:
    """Return the module of the kernels, or None where it cannot be imported; warns once of what is missing.

    Warns
    -----
    RuntimeWarning
        numba is missing or does not import, so that there are no kernels; or no folder can be written to or has
        room for them, so that every process compiles them for itself.
    """
    try:
        from lab.fast import compiled
    except ModuleNotFoundError as error:
        _say(f"compiled filters need the extra toy-slam-lab[fast] ({error}); numpy takes their place")
        return None
    except Exception as error:  # numba refuses versions of numpy that it does not know with errors of several kinds
        _say(f"numba cannot be imported ({type(error).__name__}: {error}); numpy takes its place")
        return None
    if not compiled.KEPT:
        _say(
            "no folder for kernels can be written to, or it is full, so every process compiles its own;"
            " NUMBA_CACHE_DIR names another"
        )
    return compiled


def _say(text: str) -> None:
    warnings.warn(" ".join(text.split()), RuntimeWarning, stacklevel=3)
