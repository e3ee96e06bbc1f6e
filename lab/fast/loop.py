"""The particle loop, compiled: all instants of one run, block by block of 256 particles.

Question answered: what is the least that a filter has to do when every step is an affine map that all particles share?

    move x -> F x + B;   draw x += spread e, before or after;   weigh y = z - H x, log w += c - |y|^2 / 2;   x += K y

with H, z, K whitened by the caller (S = I), so that the loop knows neither Cholesky factors nor robots: SIS, SIR, the
guided and the Rao-Blackwellized filter are the same loop on other matrices.  Three things make it fast:

    one pass     a block is moved, weighed and summed while it is in the cache; weights are relative to the largest so
                 far, and the sums are scaled when a larger one appears
    genealogy    rows that no step touches any more are the same for all descendants of one particle, so they are kept
                 once per living ancestor; descendants stay neighbours, since ancestors come in ascending order
    one buffer   resampled particles are fetched by the step that moves them, and so are those that move up where
                 others need not go on; they are written over the ones before, which have been read by then

The log-weights of the lanes beyond the last particle are -inf.  Called by `lab.fast.compiled`.
"""

import math
from typing import Any

import numpy as np

from lab.fast.arithmetic import SMALLEST
from lab.fast.block import (
    add_rows,
    correct_and_draw,
    draw_static,
    fetch,
    fill_even,
    fill_mean,
    largest_of,
    move,
    turns,
    weigh_point,
    weights_of,
)
from lab.fast.dropping import end_early, leave_out, weigh_nothing
from lab.fast.genealogy import count_groups, keep, lay_out, next_group, regroup
from lab.fast.kernel import kernel, wide
from lab.fast.memory import CACHED, ahead, below, beside
from lab.fast.normals import LANES
from lab.fast.parts import ADD_MOMENTS, NORMALS, RESAMPLE_SYSTEMATIC, RETIRE, WEIGH
from lab.fast.sums import DENSE, clear, finish, rescale
from lab.validation import Array

COLLAPSED = 2.0  # an ESS below it: the mean goes where single particles go, so that none is expected
FAINT = 52.0  # a million weights so far below that of the second heaviest block change no digit: exp(-52) = 3e-23
ROUNDING = 1e-9  # as in the readable loop: equal weights must trigger at a threshold of 1

resample, retire = RESAMPLE_SYSTEMATIC.caller(), RETIRE.caller()  # the address says which scheme it is
add_moments, weigh, normals = ADD_MOMENTS.caller(), WEIGH.caller(), NORMALS.caller()


@kernel()
def expect(
    mean: Array, F: Array, B: Array, n_moving: int, z: Array, H: Array, K: Array, p: int, centre: Array, y: Array
) -> None:
    """Set `centre` to where the step takes the mean: near the next mean, as centres have to be."""
    for i in range(len(mean)):
        centre[i] = mean[i]
    for i in range(n_moving):
        centre[i] = B[i]
        for j in range(len(B)):
            centre[i] += F[i, j] * mean[j]
    for r in range(p):
        y[r, 0] = z[r]
        for j in range(len(centre)):
            y[r, 0] -= H[r, j] * centre[j]
    for i in range(len(B)):
        for r in range(p):
            centre[i] += K[i, r] * y[r, 0]


def run(
    resample_at: int,
    add_moments_at: int,
    weigh_at: int,
    normals_at: int,
    retire_at: int,
    n: int,
    state: Any,
    m0: Array,
    spread_0: Array,
    F: Array,
    B: Array,
    n_moving: int,
    sizes: Any,
    z: Array,
    H: Array,
    K: Array,
    spread: Array,
    constants: Array,
    extra: Array,
    draw_first: bool,
    threshold: float,
    scheme: int,
    least: Array,
    means: Array,
    covs: Array,
    log_evidence: Array,
    ess: Array,
    survivors: Any,
    clouds: Array,
    by_block: Array,
    static: Array,
    points: Array,
    ends: Array,
    counts: Any,
    tops: Array,
    rows: Array,
    weighted: Array,
    noise: Array,
    y: Array,
    scratch: Array,
    places: Any,
    second: Array,
    vectors: Array,
    wanted: Any,
) -> int:
    """Run the filter over all instants and fill the answer: `means` to `survivors`.

    Rows of the state are ordered: those that F moves, then the others, those first that are touched for longest.

    Parameters
    ----------
    resample_at, ... retire_at : int
        Where `lab.fast.parts` are.
    n : int
        N particles.
    state : (4, LANES) array of uint64
        Of the random stream; is advanced.
    m0, spread_0 : (d,), (d, e) array
        The particles of time 0 are m0 + spread_0 (e normals).
    F, B : (a, a), (a,) array
        The map of the active rows.
    n_moving : int
        How many rows it moves.
    sizes : (T, 3) array of int
        Of each step: measured components p, normals drawn e, rows not taken as static yet, at most a.
    z, H, K : (T, p), (T, p, d), (T, a, p) array
        Whitened; rows and columns beyond `sizes` are not read.
    spread : (T, a, e) array
    constants : (T,) array
        The logarithm of the density's constant.
    extra : (T + 1, d, d) array
        The covariance that every particle has of its own.
    draw_first : bool
        Whether the draw comes before the measurement.
    threshold : float
        Resample when ESS <= threshold * N.
    scheme : int
        Of `lab.fast.offspring.SCHEMES`.
    least : (2, T + 1) array
        -inf where anything is resampled.  Of each instant, as log p(z_1..z_k) + log w: the weight that the heaviest
        particle needs for moments to be taken, and the one that each needs to go on from there.
    means, covs, log_evidence, ess, survivors : (T + 1, d), (T + 1, d, d), (T + 1,), (T + 1,), (T + 1,) array
    clouds, ... wanted : array
        Of `lab.fast.room.room`.

    Returns
    -------
    int
        0, or the first instant at which the weights sum to nothing or a log-weight is no number.
    """
    wide()
    T, d, a = len(means) - 1, len(m0), len(B)
    blocks = (n + LANES - 1) // LANES
    memory, at = clouds.reshape(-1), clouds.shape[1]
    x = memory[at:].reshape((blocks, a, LANES))
    weights, logs = by_block[0], by_block[1]
    starts, founders, before, ancestors, kept = counts[0], counts[1], counts[2], counts[3], counts[4]
    active, n_groups, n_founders = a, n, n
    for i in range(n + 1):
        starts[i] = founders[i] = i
    for b in range(blocks):
        for lane in range(LANES):
            weights[b, lane] = 0.0
    centre, shared, part, first, totals = vectors[0], vectors[1], vectors[2], vectors[3], vectors[4]
    for i in range(d):
        centre[i] = m0[i]
    turning = turns(F, n_moving)
    even = -math.log(n)
    logs[blocks - 1] = -np.inf
    fill_even(logs, n, even)
    largest, log_total = -np.inf, 0.0

    for k in range(T + 1):
        step = max(k - 1, 0)
        p, e = (sizes[step, 0], sizes[step, 1]) if k else (0, spread_0.shape[1])
        z_k, H_k, K_k, mean_k, cov_k = z[step], H[step], K[step], means[k], covs[k]
        spread_k = spread[step] if k else spread_0
        resampled = k > 0 and ess[k - 1] <= threshold * n * (1 + ROUNDING)
        collapsed = k > 0 and ess[k - 1] < COLLAPSED
        left = n
        if k and least[1, k - 1] > -np.inf:
            # what the logarithms leave out is the evidence without the last step's, which they still have
            needed = least[1, k - 1] - (log_evidence[k - 1] - log_total)
            left = leave_out(logs, static, active, n, needed, ancestors)
            if left == 0:
                end_early(k, extra, means, covs, log_evidence, ess, survivors, totals)
                return 0
        dropped = left < n
        if dropped:
            n, blocks, n_groups, starts = left, (left + LANES - 1) // LANES, left, starts[: left + 1]
        if k and sizes[step, 2] < active:  # never with `dropped`: what never resamples takes no more rows as static
            source, at = beside(at, x.size, blocks * sizes[step, 2] * LANES, memory)
            x = memory[source : source + x.size].reshape((blocks, active, LANES))
            active = sizes[step, 2]
            own = memory[at : at + blocks * active * LANES].reshape((blocks, active, LANES))
            retire(retire_at, x, own, static, starts, n_groups, n)
            x, n_groups = own, n
        if resampled:
            resample(resample_at, scheme, weights, tops, largest, n, state, scratch, ends, points, before, ancestors)
            n_founders = regroup(founders, n_founders, before, n, kept)
            if active < d:
                n_groups = regroup(starts, n_groups, before, n, kept)
                keep(static, active, kept, n_groups)
            fill_even(logs, n, even)
            log_total = 0.0
        source, fetched = at, dropped or resampled
        if fetched:
            source, at = below(at, x.size, ancestors, blocks, active, memory)
            x = memory[at : at + blocks * active * LANES].reshape((blocks, active, LANES))
        old = memory[source:]
        far = k > 0 and blocks * active * LANES > CACHED
        if k:
            expect(means[k - 1], F, B, n_moving, z_k, H_k, K_k, p, centre, y)
        for j in range(active, d):
            wanted[j] = 0
            for r in range(p):
                wanted[j] |= H_k[r, j] != 0.0
        drawn_first = draw_first or k == 0
        bare = k > 0 and p > 0 and active == 2  # no row needs y
        for i in range(active):
            for r in range(p):
                bare &= K_k[i, r] == 0.0
        largest, second_largest, faintest, heaviest = -np.inf, -np.inf, SMALLEST, 0
        for attempt in range(3):
            clear(totals, first, second)
            group: Any = np.int64(0)  # to numba, 0 is a type of its own, and what takes it would be compiled twice
            for b in range(blocks):
                groups = count_groups(starts, n_groups, group, b) if active < d else 1
                point = bare and groups == 1
                # a block whose weights are next to nothing adds nothing
                summed = not collapsed if attempt == 0 else tops[b] - largest > faintest
                if attempt == 0:
                    normals(normals_at, state, noise, e)
                    if k == 0:
                        fill_mean(x, m0, b)
                        draw_static(static, m0, spread_0, noise, b, active)
                    elif fetched:
                        fetch(x, old, ancestors, b, n, active, places)
                for j in range(active, d):
                    if (groups > DENSE and summed) or (wanted[j] > 0 and attempt == 0 and not point):
                        lay_out(rows, static, starts, n_groups, group, groups, b, j)
                if attempt == 0:
                    if k:
                        move(x, F, B, b, n_moving, active, turning, scratch)
                    if drawn_first:
                        add_rows(x, spread_k, noise, b, active, e)
                    if point:
                        weigh_point(x, static, group, z_k, H_k, b, p, constants[step] - log_total, logs)
                    elif k:
                        weigh(weigh_at, x, rows, z_k, H_k, b, p, active, y, constants[step] - log_total, logs)
                    if not (drawn_first or point) and p == e == 2:
                        correct_and_draw(x, K_k, y, spread_k, noise, b, active)
                    else:
                        if not point:
                            add_rows(x, K_k, y, b, active, p)
                        if not drawn_first:
                            add_rows(x, spread_k, noise, b, active, e)
                    tops[b] = top = largest_of(logs, b)
                    if top > largest:
                        if not collapsed:
                            rescale(math.exp(largest - top), totals, first, second)
                        second_largest = largest
                        largest, heaviest = top, b
                    elif top > second_largest:
                        second_largest = top
                if attempt > 0:
                    tops[b] = -np.inf
                if summed and largest > -np.inf:
                    tops[b] = largest
                    total = weights_of(logs, b, largest, weights, totals)
                    following, end = ahead(b, fetched, ancestors, n, blocks, active) if far and attempt == 0 else (0, 0)
                    add_moments(
                        add_moments_at, old, following, end, x, rows, weights, total, static, starts, n_groups, group,
                        groups, b, centre, active, weighted, shared, part, first, second,
                    )  # fmt: skip
                group = next_group(starts, n_groups, group, groups, b) if active < d else 0
            if k and largest + log_evidence[k - 1] < least[0, k]:
                weigh_nothing(centre, extra[k], mean_k, cov_k, totals)
                break
            if attempt == 0 and collapsed:
                faintest = max(faintest, second_largest - largest - FAINT)
                # what weighs anything is near this one, and further from where the mean was expected
                for lane in range(LANES):
                    if logs[heaviest, lane] == largest:
                        for i in range(active):
                            centre[i] = x[heaviest, i, lane]
                continue
            if not 0.0 < totals[0] < np.inf:
                return k
            if not finish(centre, totals[0], first, second, extra[k], mean_k, cov_k):
                break
            for i in range(d):
                centre[i] = mean_k[i]
        log_total = largest + math.log(totals[0])
        log_evidence[k] = log_evidence[k - 1] + log_total if k else 0.0
        ess[k] = totals[0] * totals[0] / totals[1]
        survivors[k] = n_founders
    return 0
