"""Several runs of one filter in one call.

Question answered: which filters can share what numpy costs per call?  Those of this laboratory, run by numpy, with a
resampling scheme whose ancestors ascend, and with so few particles that calls cost more than numbers.  A run's numbers
do not depend on what runs beside it.  And which can share a process?  Those that run in kernels.  Called by
`lab.units`.
"""

import inspect
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from lab.problem import Problem
from lab.result import Filtered
from lab.solvers import blocked, compiled
from lab.solvers.backends import is_compiled
from lab.solvers.clones import FEW
from lab.solvers.particle import GUIDED, RAO_BLACKWELLIZED, guided, rbpf, sir, sis
from lab.solvers.proposals import prior
from lab.solvers.protocol import Solver
from lab.validation import InputError

Together = Callable[[Problem, Sequence[np.random.Generator]], list[Filtered]]
OURS = (sis, sir, guided, rbpf)
FEWEST = 2  # particles: with one, sums take another order


def together(solver: Solver, n_particles: int) -> Together | None:
    """Return the function that runs this filter once for each of several generators; None where that does not pay.

    Parameters
    ----------
    solver : Solver
        Options bound by `functools.partial`.
    n_particles : int

    Returns
    -------
    function of problem and generators, or None
        Gives to the last digit what `solver` gives for each generator.
    """
    function, given = _taken_apart(solver)
    if function not in OURS or not FEWEST <= n_particles <= FEW:
        return None
    options: dict[str, Any] = {"ess_threshold": 0.0, "resample": "systematic", "proposal": "prior"}
    options |= {
        name: p.default for name, p in inspect.signature(function).parameters.items() if p.default is not p.empty
    }
    options |= given
    proposals = {guided: GUIDED, rbpf: RAO_BLACKWELLIZED}.get(function, {"prior": prior})
    try:
        elsewhere = is_compiled(options["backend"], n_particles, options["resample"])
    except InputError:
        return None
    share = options["ess_threshold"]
    known = options["proposal"] in proposals and options["resample"] in blocked.ASCENDING
    if elsewhere or not known or not isinstance(share, int | float) or not 0 <= share <= 1:
        return None
    settings = {"ess_threshold": float(share), "resample": options["resample"], "n_particles": n_particles}
    return partial(blocked.run, proposal=proposals[options["proposal"]], **settings)


def prepare(solver: Solver, n_particles: int) -> None:
    """Load the kernels that a run of this solver needs, so that the time of the first run is its own."""
    if in_kernels(solver, n_particles):
        compiled.warm(scheme_of(solver))


def in_kernels(solver: Solver, n_particles: int) -> bool:
    """Whether a run is that of a compiled loop, which leaves Python to other threads.

    Raises
    ------
    InputError
        A backend that is unknown, or that cannot run this.
    """
    function, given = _taken_apart(solver)
    return function in OURS and is_compiled(given.get("backend", "numpy"), n_particles, scheme_of(solver))


def scheme_of(solver: Solver) -> Any:
    """Return the resampling scheme that one of our filters is given: a name, or a student's function."""
    return _taken_apart(solver)[1].get("resample", "systematic")


def _taken_apart(solver: Solver) -> tuple[Any, dict[str, Any]]:
    """Return the function and the options that are bound to it."""
    if isinstance(solver, partial) and not solver.args:
        return solver.func, solver.keywords
    return solver, {}
