"""A filter's run as one call of the compiled loop of `lab.fast`.

Question answered: what does a particle filter do for backend="numba"?  It hands the plan of its laws to the loop, with
room for the answer, and puts the rows of the state back in their order.  Called by `lab.solvers.particle`.
"""

from collections.abc import Iterable
from functools import cache
from typing import Any

import numpy as np

from lab import fast
from lab.problem import LinearGaussianModel, Problem
from lab.result import Filtered
from lab.solvers.plan import plan
from lab.solvers.proposals import GaussianProposal, prior
from lab.validation import InputError

LEAST: dict[str, Any] = {"proposal": prior, "n_particles": 1, "ess_threshold": 0.0}


def is_cold(schemes: Iterable[str]) -> bool:
    """Whether a first run with one of these schemes would have to compile the loop or a part of it."""
    kernels = fast.load()
    return kernels is not None and kernels.is_cold(schemes)


@cache
def warm(resample: str = "systematic") -> None:
    """Load the kernels of a scheme, compiling them where they were never used: what the first run would wait for."""
    run(_nothing(), np.random.default_rng(0), resample=resample, **LEAST)


def compile_loop() -> None:
    """Do what `warm` does first: the loop without its parts, which another process may be compiling."""
    kernels: Any = fast.load()
    arguments, _ = _arguments(kernels, _nothing(), np.random.default_rng(0), resample="systematic", **LEAST)
    kernels.compile_loop(*arguments)


def _nothing() -> Problem:
    """Return two instants at which nothing is seen."""
    model = LinearGaussianModel(np.eye(4), np.zeros(4), np.eye(4), np.zeros(4), np.eye(4))
    return Problem(model, np.full((2, 2), np.nan), np.full((2, 2, 4), np.nan), np.full((2, 2, 2), np.nan))


def run(
    problem: Problem,
    rng: np.random.Generator,
    *,
    proposal: GaussianProposal,
    n_particles: int,
    ess_threshold: float,
    resample: str,
) -> Filtered:
    """Run a filter of `lab.solvers.particle` with the compiled loop; arguments as there, checked already.

    Raises
    ------
    InputError
        Every weight is zero at some k, which is named, or a particle is not finite.
    """
    kernels: Any = fast.load()
    settings = proposal, n_particles, ess_threshold, resample
    arguments, (means, covs, *others) = _arguments(kernels, problem, rng, *settings)
    failed = kernels.run(resample, *arguments)
    if failed:
        raise InputError(f"At k = {failed}: The weights cannot be normalised: every weight is zero, or one is NaN.")
    if not np.isfinite(means).all():
        raise InputError("A particle is NaN or infinite.")
    back = np.argsort(plan(problem, proposal).order)
    return Filtered(means[:, back], covs[:, back[:, np.newaxis], back], *others)


def _arguments(
    kernels: Any,
    problem: Problem,
    rng: np.random.Generator,
    proposal: GaussianProposal,
    n_particles: int,
    ess_threshold: float,
    resample: str,
) -> tuple[list[Any], list[Any]]:
    """Return the arguments of the compiled loop, and those of them which are room for the answer."""
    laws = plan(problem, proposal)
    N, n = problem.n_instants, len(laws.m0)
    sizes = laws.sizes
    if ess_threshold == 0:  # all have descendants: nothing is gained by genealogies that begin later
        sizes = sizes.copy()
        sizes[:, 2] = len(laws.B)
    answer = [np.empty((N, n)), np.empty((N, n, n)), np.empty(N), np.empty(N), np.empty(N, dtype=np.int64)]
    given = [
        *(n_particles, kernels.seed(rng)),
        *(laws.m0, laws.spread_0, laws.F, laws.B, laws.n_moving),
        *(sizes, laws.z, laws.H, laws.K, laws.spread, laws.constants, laws.extra, laws.draw_first),
        *(ess_threshold, kernels.SCHEMES[resample]),
    ]
    drawn = max(laws.spread.shape[2], laws.spread_0.shape[1])
    room = kernels.room(n_particles, n, len(laws.B), laws.z.shape[1], drawn)
    return [*given, *answer, *room], answer
