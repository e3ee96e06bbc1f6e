"""The particle loop in numpy, block by block and with each static landmark once per ancestor.

Question answered: how fast can a filter of the laboratory be without a compiler?  The readable loop of
`lab.solvers.particle` draws the same random numbers in the same order and gives the same answers, but for rounding.
Here

    blocks      a step moves, draws and weighs some thousand particles at a time, which stay in the processor's cache
    in place    nobody keeps the cloud of the step before
    path        particles are counted from where one without noise would be, so that near 0 nothing need be taken off
                (rows that no measurement corrects from 0: weights and an unstable F may take them anywhere)
    genealogy   rows that are static from time 0 on (see `lab.solvers.plan`) are kept once per living ancestor of then;
                its descendants stay neighbours, so their weights are added by segments
    together    several runs with few particles are one long cloud to all steps but resampling and moments, each with
                its own generator: what numpy costs per call is shared

For schemes whose ancestors come in ascending order.  Called by `lab.solvers.particle`.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from lab import weights
from lab.problem import Problem
from lab.resampling import ends_of_strata
from lab.result import Filtered
from lab.solvers.clones import Clones, blocks
from lab.solvers.plan import plan
from lab.solvers.proposals import GaussianProposal
from lab.solvers.steps import Step, loose, neighbours, steps_of
from lab.solvers.terms import combine, pay
from lab.validation import Array, InputError

ASCENDING = ("systematic", "stratified")  # schemes whose ancestors come in ascending order
ROUNDING = 1e-9  # as in the readable loop: equal weights must trigger at a threshold of 1
LEAST = -600.0  # log-weights below this count as 0: with numbers near the smallest one, all is slow
FAINT = 1e-40  # a mean weight below this, and log-weights are counted from the largest anew
LONG = 1000  # particles: where groups have as many on average, they are gone through one by one


def run(
    problem: Problem,
    rngs: Sequence[np.random.Generator],
    *,
    proposal: GaussianProposal,
    n_particles: int,
    ess_threshold: float,
    resample: str,
) -> list[Filtered]:
    """Run a filter of `lab.solvers.particle` once for each generator; arguments as there, checked already.

    Returns
    -------
    list of Filtered
        The numbers of each do not depend on the others.

    Raises
    ------
    InputError
        In one of the runs every weight is zero at some k, which is named, or a particle is not finite.
    """
    laws, runs, P = plan(problem, proposal), len(rngs), n_particles
    steps, N, n = steps_of(laws), problem.n_instants, len(laws.m0)
    means, covs = np.empty((N, runs, n)), np.empty((N, runs, n, n))
    path, differing = laws.m0, neighbours(np.flatnonzero(laws.spread_0[: len(laws.B)].any(axis=1)))
    near = not loose(laws).any()
    log_evidence, ess = np.zeros((N, runs)), np.empty((N, runs))
    survivors: Any = np.empty((N, runs), dtype=np.int64)
    cloud = Clones(laws, P, rngs)
    w, totals = np.ones((runs, P)), np.full(runs, float(P))
    logs, shared = np.zeros((runs, P)), np.full(runs, -np.log(P))  # log-weights, and what all of a run have of them
    # a large array is dear the first time that it is written to, so these are written to again and again
    room = np.empty((runs, P)), np.empty((runs, P), np.intp)
    for k in range(N):
        if k:
            tired: Any = np.flatnonzero(ess[k - 1] <= ess_threshold * P * (1 + ROUNDING))
            if len(tired):
                shifts = np.array([rngs[i].random(P if resample == "stratified" else 1) for i in tired])
                _resample(cloud, w, tired, shifts, room)
                shared[tired] = -np.log(P)
            step, fresh = steps[k - 1], len(tired) == runs and len(steps[k - 1].expected) > 0
            if not fresh:
                logs[tired], w[tired] = 0, 1
            cloud.draw(step.n_draws)
            _make(step, cloud, logs.ravel(), w.ravel(), fresh=fresh)
            totals = w.sum(axis=1)
            for i in np.flatnonzero(~(totals > FAINT * P)):
                shared[i] += _count_from_largest(logs[i], w[i], k)
                totals[i] = w[i].sum()
            increment = np.log(totals) + shared + step.constant
            shared += step.constant - increment
            log_evidence[k] = log_evidence[k - 1] + increment
            path, differing = step.path, step.differing
        means[k], covs[k] = cloud.moments(w, totals, differing, near=near)
        means[k] += path
        if not np.isfinite(means[k]).all():
            raise InputError("A particle is NaN or infinite.")
        ess[k] = [total**2 / (row @ row) for total, row in zip(totals, w, strict=True)]
        survivors[k] = cloud.survivors(runs)
    back = laws.back
    covs += laws.extra[:, np.newaxis]
    means, covs = means[..., back], covs[..., back][..., back, :]
    return [Filtered(means[:, i], covs[:, i], log_evidence[:, i], ess[:, i], survivors[:, i]) for i in range(runs)]


def _resample(cloud: Clones, w: Array, tired: Any, shifts: Array, room: tuple[Array, Any]) -> None:
    """Replace the particles of the runs that are `tired` by their ancestors."""
    runs, P = w.shape
    if len(tired) == runs:
        ends = ends_of_strata(w, shifts, room)
    else:
        ends = np.tile(np.arange(1, P + 1), (runs, 1))
        ends[tired] = ends_of_strata(w[tired], shifts)
    if runs > 1:
        ends += P * np.arange(runs)[:, np.newaxis]
    cloud.resample(ends.ravel())


def _count_from_largest(logs: Array, w: Array, k: int) -> float:
    """Take the largest log-weight from all of a run, weigh them anew, and return it."""
    largest = float(logs.max())
    if not np.isfinite(largest):
        try:
            weights.normalise(logs)
        except InputError as error:
            raise InputError(f"At k = {k}: {error}") from None
    logs -= largest
    _weigh(logs, w)
    return largest


def _weigh(logs: Array, w: Array) -> None:
    """Set w to the weights."""
    if logs.min() < LEAST:
        logs = np.where(logs < LEAST, -np.inf, logs)
    np.exp(logs, out=w)


def _make(step: Step, cloud: Clones, logs: Array, w: Array, *, fresh: bool) -> None:
    """Move, draw and weigh the particles in place; log-weights and weights (runs P,), the former 0 where `fresh`."""
    u, p, expected = len(step.gain), len(step.expected), step.expected
    each = pay(step.terms, step.map.shape[1], cloud.n_particles)
    corrected = False  # whether rows change by what the static ones make of y
    if step.of_static.any():
        beyond = cloud.product(step.of_static, cloud.static)
        if len(logs) < beyond.shape[1] * LONG:
            beyond = cloud.spread_out(beyond)
        expected, corrected = expected + beyond, bool(step.gain.any())
    for rows in blocks(len(logs), max(len(cloud.both), u + p)):
        read = [cloud.both[part, rows] for part in step.reads]
        made = np.empty((u + p, rows.stop - rows.start))
        if each:
            combine(step.terms, [row for part in read for row in part], made)
        else:
            cloud.product(step.map, np.concatenate(read) if len(read) > 1 else read[0], out=made)
        if corrected:
            apart = np.zeros((p, made.shape[1]))
            cloud.add(apart, beyond, rows)
            made[:u] += cloud.product(step.gain, apart)
        begin = 0
        for part in step.writes:
            end = begin + part.stop - part.start
            np.add(made[begin:end], step.shift[begin:end], out=cloud.x[part, rows])
            begin = end
        if not p:
            continue
        y = made[u:]
        cloud.add(y, expected, rows)
        np.square(y, out=y)
        for i, square in enumerate(y):
            if fresh and not i:
                np.negative(square, out=logs[rows])
            else:
                logs[rows] -= square
        _weigh(logs[rows], w[rows])
