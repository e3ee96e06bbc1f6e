"""A filter's run as one call of the compiled loop of `lab.fast`.

Question answered: what does a particle filter do for backend="numba"?  It hands the plan of its laws to the loop, with
room for the answer, and puts the rows of the state back in their order.  Called by `lab.solvers.particle`.
"""

from collections.abc import Iterable
from contextlib import suppress
from functools import cache, partial
from typing import Any

import numpy as np

from lab import fast
from lab.problem import LinearGaussianModel, Problem
from lab.result import Filtered
from lab.solvers import apart
from lab.solvers.plan import Plan, plan
from lab.solvers.proposals import GaussianProposal, prior
from lab.validation import Array, InputError


def is_cold(schemes: Iterable[str]) -> bool:
    """Whether a first run with one of these schemes would have to compile the loop or a part of it."""
    kernels = fast.load()
    return kernels is not None and kernels.is_cold(schemes)


@cache
def warm(resample: str = "systematic") -> None:
    """Load the kernels of a scheme, compiling them where they were never used: what the first run would wait for."""
    run(_nothing(), np.random.default_rng(0), proposal=prior, n_particles=1, ess_threshold=0.0, resample=resample)


def compile_loop() -> None:
    """Do what `warm` does first: the loop without its parts, which another process may be compiling."""
    kernels: Any = fast.load()
    state = kernels.seed(np.random.default_rng(0))
    kernels.compile_loop(*_Cloud(kernels, plan(_nothing(), prior), 0.0, "systematic", state, 1).arguments)


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
    laws, state = plan(problem, proposal), kernels.seed(rng)
    settings = kernels, laws, ess_threshold, resample
    filtered = None
    if ess_threshold == 0 and n_particles > apart.PART:
        cloud = cache(partial(_Cloud, *settings, state.copy()))
        # of a part without weight: the whole cloud, which is run then, has some, or says when it has none
        with suppress(InputError):
            filtered = apart.run_apart(cloud, n_particles, laws.constants[: problem.n_instants - 1])
    if filtered is None:
        filtered = _Cloud(*settings, state, n_particles)()
    if not np.isfinite(filtered.means).all():
        raise InputError("A particle is NaN or infinite.")
    back = laws.back
    means, covs = filtered.means[:, back], filtered.covs[:, back[:, np.newaxis], back]
    return Filtered(means, covs, filtered.log_evidence, filtered.ess, filtered.survivors)


class _Cloud:
    """Particles and the compiled loop that they run in; a function that may be called again, with other draws.

    `arguments` are the loop's, and `answer` those of them that are room for the answer, in the plan's order of rows.
    """

    def __init__(
        self, kernels: Any, laws: Plan, ess_threshold: float, resample: str, state: Any, n_particles: int
    ) -> None:
        N, n = len(laws.extra), len(laws.m0)
        sizes = laws.sizes
        if ess_threshold == 0:  # all have descendants: nothing is gained by genealogies that begin later
            sizes = sizes.copy()
            sizes[:, 2] = len(laws.B)
        self._run = partial(kernels.run, resample)
        self._least = np.empty((2, N))
        self.answer: list[Any] = [np.empty((N, n)), np.empty((N, n, n)), np.empty(N), np.empty(N)]
        self.answer.append(np.empty(N, dtype=np.int64))
        drawn = max(laws.spread.shape[2], laws.spread_0.shape[1])
        self.arguments = [
            *(n_particles, state),
            *(laws.m0, laws.spread_0, laws.F, laws.B, laws.n_moving),
            *(sizes, laws.z, laws.H, laws.K, laws.spread, laws.constants, laws.extra, laws.draw_first),
            *(ess_threshold, kernels.SCHEMES[resample], self._least),
            *self.answer,
            *kernels.room(n_particles, n, len(laws.B), laws.z.shape[1], drawn),
        ]

    def __call__(self, least: Array | float = -np.inf) -> Filtered:
        """Return what the particles say, in arrays that the next call fills anew."""
        self._least[:] = least
        failed = self._run(*self.arguments)
        if failed:
            raise InputError(f"At k = {failed}: The weights cannot be normalised: every weight is zero, or one is NaN.")
        return Filtered(*self.answer)
