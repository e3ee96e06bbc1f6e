"""Who computes a filter: numpy, which is always there, or the compiled loop of the extra toy-slam-lab[fast].

Question answered: which of the two does ``backend="auto"`` mean?  Compiled from N = 100 on, where numba is installed:
there a run takes a tenth of the time, and a few dozen runs make up for importing numba.  The choice depends on N alone,
so that no result depends on what else is computed.  The same seed gives the same numbers with the same backend, and
others, equal in distribution, with another.  Called by the particle filters and by the command line.
"""

from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

from lab import fast
from lab.validation import InputError

BACKENDS = ("numpy", "numba", "auto")
WORTHWHILE = 100  # particles


def is_compiled(backend: str, n_particles: int, resample: str | Callable[..., Any] = "systematic") -> bool:
    """Whether the compiled loop is to run.

    Parameters
    ----------
    backend : str
        "numpy"; "numba", which numpy replaces, with a warning, where numba is missing; or "auto".
    n_particles : int
        N.
    resample : str or Resampler
        The compiled loop has the named schemes only.

    Raises
    ------
    InputError
        An unknown backend, or numba asked for with a resampling function.
    """
    if not isinstance(backend, str) or backend not in BACKENDS:
        raise InputError(f"Unknown backend {backend!r}; known are {', '.join(BACKENDS)}.")
    if backend == "numpy":
        return False
    if callable(resample):
        if backend == "numba":
            raise InputError(
                'backend="numba" has the named resampling schemes only; with a function of your own take "numpy".'
            )
        return False
    if backend == "auto" and (n_particles < WORTHWHILE or find_spec("numba") is None):
        return False
    return fast.load() is not None
