"""The two slots that the laboratory offers: a solver and a proposal.

Question answered: what must a function look like to take part?  The reference and a student's work go through the
same slots.  A solver answers p(x_k given z_1..z_k) for every k; a proposal moves a cloud by one step and says by how
much its log-weights change,

    increment = log [ p(z_k given x_k) p(x_k given x_{k-1}) / q(x_k given x_{k-1}, z_k) ].
"""

from typing import Any, Protocol

import numpy as np

from lab.problem import Problem
from lab.result import Filtered
from lab.validation import Array, InputError, real_array


class Solver(Protocol):
    """A particle filter: ``solver(problem, rng, *, n_particles=..., **options) -> Filtered``."""

    def __call__(self, problem: Problem, rng: np.random.Generator, *, n_particles: int) -> Filtered:
        """Filter the problem's measurements, all randomness coming from `rng`."""
        ...


class Proposal(Protocol):
    """An importance function, as the particle loop takes it."""

    def __call__(self, cloud: Any, k: int, problem: Problem, rng: np.random.Generator) -> tuple[Any, Array]:
        """Return the cloud moved from instant k - 1 to k and its log-weight increments (P,)."""
        ...


def check_filtered(answer: Any, problem: Problem) -> Filtered:
    """Return a solver's answer, as arrays, when it has the right type and shapes and holds numbers only.

    Raises
    ------
    InputError
        One sentence that says which field is wrong and what was expected.
    """
    if not isinstance(answer, Filtered):
        raise InputError(
            f"it returned {type(answer).__name__}, not lab.result.Filtered(means, covs, log_evidence, ess, survivors)."
        )
    N, n = problem.n_instants, len(problem.model.m0)
    hint = f"time comes first: N = {N} instants, n = {n} components"
    shapes = {"means": (N, n), "covs": (N, n, n), "log_evidence": (N,), "ess": (N,), "survivors": (N,)}
    fields: dict[str, Any] = {}
    for name, shape in shapes.items():
        value = getattr(answer, name)
        if value is None and name in ("ess", "survivors"):
            continue
        try:
            fields[name] = real_array(name, value, shape)
        except InputError as error:
            raise InputError(f"{str(error).rstrip('.')} ({hint}).") from None
    negative = np.diagonal(fields["covs"], axis1=1, axis2=2) < 0
    if negative.any():
        raise InputError(f"covs has a negative variance at k = {np.argmax(negative.any(axis=1))}.")
    return Filtered(**fields)
