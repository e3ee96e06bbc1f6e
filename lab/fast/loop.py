"""The particle loop, compiled: all instants of one run, block by block of 256 particles.

Question answered: what is the least that a filter has to do when every step is an affine map that all particles share?

    move x -> F x + B;   draw x += spread e, before or after;   weigh y = z - H x, log w += c - |y|^2 / 2;   x += K y

with H, z, K whitened by the caller (S = I), so that the loop knows neither Cholesky factors nor robots: SIS, SIR, the
guided and the Rao-Blackwellized filter are the same loop on other matrices.  Three things make it fast:

    one pass     a block is moved, weighed and summed while it is in the cache; weights are relative to the largest so
                 far, and the sums are scaled when a larger one appears
    genealogy    rows that no step touches are the same for all descendants of one particle of time 0, so they are kept
                 once per living ancestor; descendants stay neighbours, since ancestors come in ascending order
    one buffer   resampled particles are fetched by the step that moves them

The log-weights of the lanes beyond the last particle are -inf.  Called by `lab.fast.compiled`.
"""

import math
from typing import Any

import numpy as np
from numba import njit

from lab.fast.arithmetic import SMALLEST, exp
from lab.fast.moments import TILE, add_shared, products, sum_segment, weigh
from lab.fast.normals import LANES, normals
from lab.fast.offspring import resample
from lab.validation import Array

DENSE = LANES // 8  # groups in a block from which on their rows are laid out particle by particle
LOST = 1e-6  # a variance below this part of the squared distance of mean and c has lost too many digits
ROUNDING = 1e-9  # as in the readable loop: equal weights must trigger at a threshold of 1
BLOCK, LANE = np.uint64(LANES.bit_length() - 1), np.uint64(LANES - 1)  # of a place: shift, mask
COLLAPSED = 2.0  # an ESS below it: the mean goes where single particles go, so that none is expected
NEAR = 1e-13  # of the mean: c is as near as can be


@njit(error_model="numpy", fastmath={"contract"}, nogil=True)
def add_rows(target: Array, map_: Array, source: Array, b: int, n_rows: int, n_terms: int) -> None:
    """Add map_ @ source to the first rows of block b of `target`, leaving out the zeros of the map."""
    for i in range(n_rows):
        for q in range(n_terms):
            factor = map_[i, q]
            if factor != 0.0:
                for lane in range(LANES):
                    target[b, i, lane] += factor * source[q, lane]


@njit(error_model="numpy", fastmath={"contract"}, nogil=True)
def turns(F: Array, n_moving: int) -> bool:
    """Whether nothing moves but a point in the plane, by itself."""
    alone = n_moving == 2
    for i in range(n_moving):
        for j in range(n_moving, len(F)):
            alone &= F[i, j] == 0.0
    return alone


@njit(error_model="numpy", fastmath={"contract"}, nogil=True)
def move(x: Array, F: Array, B: Array, b: int, n_moving: int, n_active: int, turning: bool, scratch: Array) -> None:
    """Set the first rows of block b to F x + B; the others stay as they are."""
    if turning:
        f00, f01, f10, f11, b0, b1 = F[0, 0], F[0, 1], F[1, 0], F[1, 1], B[0], B[1]
        for lane in range(LANES):
            x0, x1 = x[b, 0, lane], x[b, 1, lane]
            x[b, 0, lane] = b0 + f00 * x0 + f01 * x1
            x[b, 1, lane] = b1 + f10 * x0 + f11 * x1
        return
    for i in range(n_moving):
        for lane in range(LANES):
            scratch[i, lane] = B[i]
        for j in range(n_active):
            factor = F[i, j]
            if factor != 0.0:
                for lane in range(LANES):
                    scratch[i, lane] += factor * x[b, j, lane]
    for i in range(n_moving):
        for lane in range(LANES):
            x[b, i, lane] = scratch[i, lane]


@njit(error_model="numpy", nogil=True)
def fetch(new: Array, old: Array, ancestors: Any, b: int, n: int, n_active: int) -> None:
    """Copy the ancestors of the particles of block b."""
    held = min(LANES, n - b * LANES)
    for i in range(n_active):
        for lane in range(held):
            ancestor = np.uint64(ancestors[b * LANES + lane])
            new[b, i, lane] = old[ancestor >> BLOCK, i, ancestor & LANE]
        for lane in range(held, LANES):
            new[b, i, lane] = 0.0


@njit(error_model="numpy", nogil=True)
def count_groups(starts: Any, n_groups: int, group: int, b: int) -> int:
    """Return how many groups, from `group` on, reach into block b."""
    end = (b + 1) * LANES
    last = group
    while last + 1 < n_groups and starts[last + 1] < end:
        last += 1
    return last - group + 1


@njit(error_model="numpy", nogil=True)
def next_group(starts: Any, n_groups: int, group: int, groups: int, b: int) -> int:
    """Return the first group of block b + 1, when `groups` from `group` on reach into block b."""
    last = group + groups - 1
    return last + 1 if last + 1 < n_groups and starts[last + 1] == (b + 1) * LANES else last


@njit(error_model="numpy", nogil=True)
def lay_out(rows: Array, static: Array, starts: Any, n_groups: int, group: int, groups: int, b: int, j: int) -> None:
    """Write row j of block b particle by particle, from the groups that reach into it."""
    if n_groups == len(starts) - 1:  # every particle is a group
        for lane in range(LANES):
            rows[j, lane] = static[b, j, lane]
        return
    for g in range(group, group + groups):
        low = max(starts[g] - b * LANES, 0)
        high = min(starts[g + 1] - b * LANES, LANES) if g + 1 < n_groups else LANES
        value = static[g // LANES, j, g % LANES]
        for lane in range(low, high):
            rows[j, lane] = value


@njit(error_model="numpy", fastmath={"contract"}, nogil=True)
def weigh_by_measurement(
    x: Array, rows: Array, z: Array, H: Array, b: int, p: int, n_active: int, y: Array, constant: float, logs: Array
) -> None:
    """Set y = z - H x and add constant - |y|^2 / 2 to the log-weights of block b."""
    for r in range(p):
        for lane in range(LANES):
            y[r, lane] = z[r]
        for j in range(H.shape[1]):
            factor = H[r, j]
            if factor != 0.0 and j < n_active:
                for lane in range(LANES):
                    y[r, lane] -= factor * x[b, j, lane]
            elif factor != 0.0:
                for lane in range(LANES):
                    y[r, lane] -= factor * rows[j - n_active, lane]
    for lane in range(LANES):
        logs[b, lane] += constant
    for r in range(p):
        for lane in range(LANES):
            logs[b, lane] -= 0.5 * y[r, lane] * y[r, lane]


@njit(error_model="numpy", fastmath={"reassoc", "nsz", "nnan"}, nogil=True)
def largest_of(logs: Array, b: int) -> Any:
    """Return the largest log-weight of block b."""
    largest = logs[b, 0]
    for lane in range(LANES):
        value = logs[b, lane]
        largest = value if value > largest else largest
    return largest


@njit(error_model="numpy", fastmath={"contract", "reassoc", "nsz"}, nogil=True)
def weights_of(logs: Array, b: int, largest: float, weights: Array, totals: Array) -> Any:
    """Set the weights of block b relative to `largest`, add them and their squares to the totals, return their sum."""
    for lane in range(LANES):
        weights[lane] = exp(logs[b, lane] - largest)
    total = squares = 0.0
    for lane in range(LANES):
        total += weights[lane]
        squares += weights[lane] * weights[lane]
    totals[0] += total
    totals[1] += squares
    return total


@njit(error_model="numpy", nogil=True)
def add_moments(
    x: Array,
    rows: Array,
    weights: Array,
    total: float,
    static: Array,
    starts: Any,
    n_groups: int,
    group: int,
    groups: int,
    b: int,
    centre: Array,
    n_active: int,
    centred: Array,
    weighted: Array,
    shared: Array,
    part: Array,
    first: Array,
    second: Array,
) -> None:
    """Add what block b contributes to sum w (x - c) and sum w (x - c)(x - c)'."""
    n = len(centre)
    dense = groups > DENSE
    for i in range(n_active):
        for lane in range(LANES):
            centred[i, lane] = x[b, i, lane] - centre[i]
    n_rows = n if dense else n_active
    for i in range(n_active, n_rows):
        for lane in range(LANES):
            centred[i, lane] = rows[i - n_active, lane] - centre[i]
    for i in range(n_rows, n_rows + (-n_rows) % TILE):
        for lane in range(LANES):
            centred[i, lane] = weighted[i, lane] = 0.0
    weigh(centred, weights, weighted, n_rows, part)
    for i in range(n_rows):
        first[i] += part[i]
    products(centred, weighted, n_rows, second)
    if not dense and n_active < n:
        for g in range(group, group + groups):
            low = max(starts[g] - b * LANES, 0)
            high = min(starts[g + 1] - b * LANES, LANES) if g + 1 < n_groups else LANES
            for j in range(n - n_active):
                shared[j] = static[g // LANES, j, g % LANES] - centre[n_active + j]
            if groups > 1:
                total = sum_segment(weights, weighted, n_active, low, high, part)
            add_shared(total, part, n_active, shared, first, second)


@njit(error_model="numpy", nogil=True)
def finish(centre: Array, total: float, first: Array, second: Array, extra: Array, mean: Array, cov: Array) -> bool:
    """Turn sums into mean and covariance; return whether c was too far from the mean for that."""
    lost = False
    n = len(centre)
    for i in range(n):
        off = first[i] / total
        mean[i] = centre[i] + off
        if second[i, i] / total - off * off < LOST * off * off and abs(off) > NEAR * (abs(centre[i]) + abs(off)):
            lost = True
    for i in range(n):
        for j in range(i, n):
            value = second[i, j] / total - (first[i] / total) * (first[j] / total)
            if i == j:
                value = max(value, 0.0)
            cov[i, j] = cov[j, i] = value + extra[i, j]
    return lost


@njit(error_model="numpy", nogil=True)
def regroup(starts: Any, n_groups: int, before: Any, static: Array, n: int) -> int:
    """Drop the groups without descendants, and say where the others begin now; return how many they are."""
    kept = 0
    n_static = static.shape[1]
    for g in range(n_groups):
        low = before[starts[g]]
        high = before[starts[g + 1]] if g + 1 < n_groups else n
        if high > low:
            starts[kept] = low
            if kept != g:
                for j in range(n_static):
                    static[kept // LANES, j, kept % LANES] = static[g // LANES, j, g % LANES]
            kept += 1
    return kept


@njit(error_model="numpy", nogil=True)
def fill_even(logs: Array, n: int, even: float) -> None:
    """Give all n particles the same log-weight."""
    for b in range(len(logs)):
        for lane in range(min(LANES, n - b * LANES)):
            logs[b, lane] = even


@njit(error_model="numpy", nogil=True)
def fill_mean(x: Array, m0: Array, b: int, start: int, n_rows: int) -> None:
    """Put every particle of block b at the mean of the prior."""
    for i in range(n_rows):
        for lane in range(LANES):
            x[b, i, lane] = m0[start + i]


@njit(error_model="numpy", nogil=True)
def clear(totals: Array, first: Array, second: Array) -> None:
    """Begin sums."""
    totals[0] = totals[1] = 0.0
    for i in range(len(first)):
        first[i] = 0.0
        for j in range(len(first)):
            second[i, j] = 0.0


@njit(error_model="numpy", nogil=True)
def rescale(factor: float, totals: Array, first: Array, second: Array) -> None:
    """Make sums relative to a larger weight than before."""
    totals[0] *= factor
    totals[1] *= factor * factor
    for i in range(len(first)):
        first[i] *= factor
        for j in range(len(first)):
            second[i, j] *= factor


@njit(error_model="numpy", nogil=True)
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


def build(sources: int) -> Any:
    """Return the compiled run; `sources` becomes part of it, so that what is kept on disk knows of what it was made."""

    @njit(error_model="numpy", nogil=True)
    def run(
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
        means: Array,
        covs: Array,
        log_evidence: Array,
        ess: Array,
        survivors: Any,
    ) -> int:
        """Run the filter over all instants and fill the last five arguments.

        Rows of the state are ordered: those that F moves, other active ones, static ones that no step touches.

        Parameters
        ----------
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
        sizes : (T, 2) array of int
            Of each step: measured components p, normals drawn e.
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
        means, covs, log_evidence, ess, survivors : (T + 1, d), (T + 1, d, d), (T + 1,), (T + 1,), (T + 1,) array

        Returns
        -------
        int
            0, or the first instant at which the weights sum to nothing or a log-weight is no number.
        """
        if sources < 0:  # never
            return -1
        T, d, a = len(z), len(m0), len(B)
        n_static = d - a
        blocks = (n + LANES - 1) // LANES
        x, other = np.zeros((blocks, a, LANES)), np.empty((blocks, a, LANES))
        static, rows = np.zeros((blocks, n_static, LANES)), np.zeros((n_static, LANES))
        starts, n_groups = np.arange(n + 1).astype(np.int32), n
        before, ancestors = np.empty(n + 1, np.int32), np.empty(n + 1, np.int32)
        cumulative, ends, points = np.empty((blocks, LANES)), np.empty(blocks + 1), np.empty(n + 1)
        n_draws = max(spread.shape[2], spread_0.shape[1])
        noise, y = np.empty((n_draws + 2, LANES)), np.empty((z.shape[1] + 1, LANES))
        scratch, weights = np.empty((n_moving + 1, LANES)), np.empty(LANES)
        centred, weighted = np.zeros((d + TILE, LANES)), np.zeros((d + TILE, LANES))
        centre, shared, wanted = m0.copy(), np.empty(n_static), np.zeros(n_static, np.bool_)
        totals, part = np.zeros(2), np.zeros(d + TILE)
        first, second = np.zeros(d + TILE), np.zeros((d + TILE, d + TILE))
        start_active, start_static = spread_0[:a], spread_0[a:]
        turning = turns(F, n_moving)
        even = -math.log(n)
        logs = np.full((blocks, LANES), -np.inf)
        fill_even(logs, n, even)
        largest, log_total = -np.inf, 0.0

        for k in range(T + 1):
            step = max(k - 1, 0)
            p, e = (sizes[step, 0], sizes[step, 1]) if k else (0, spread_0.shape[1])
            z_k, H_k, K_k, mean_k, cov_k = z[step], H[step], K[step], means[k], covs[k]
            spread_k = spread[step] if k else start_active
            resampled = k > 0 and ess[k - 1] <= threshold * n * (1 + ROUNDING)
            collapsed = k > 0 and ess[k - 1] < COLLAPSED
            if resampled:
                resample(scheme, logs, largest, n, state, scratch, cumulative, ends, points, before, ancestors)
                n_groups = regroup(starts, n_groups, before, static, n)
                fill_even(logs, n, even)
                log_total = 0.0
                x, other = other, x
            if k:
                expect(means[k - 1], F, B, n_moving, z_k, H_k, K_k, p, centre, y)
            for j in range(n_static):
                wanted[j] = False
                for r in range(p):
                    wanted[j] |= H_k[r, a + j] != 0.0
            largest, heaviest = -np.inf, 0
            for attempt in range(3):
                clear(totals, first, second)
                group = 0
                for b in range(blocks):
                    groups = count_groups(starts, n_groups, group, b) if n_static else 1
                    # a block without a weight above 0 adds nothing
                    summed = not collapsed if attempt == 0 else largest_of(logs, b) - largest > SMALLEST
                    if attempt == 0:
                        normals(state, noise, e)
                        if k == 0:
                            fill_mean(x, m0, b, 0, a)
                            fill_mean(static, m0, b, a, n_static)
                            add_rows(static, start_static, noise, b, n_static, e)
                        elif resampled:
                            fetch(x, other, ancestors, b, n, a)
                    for j in range(n_static):
                        if (groups > DENSE and summed) or (wanted[j] and attempt == 0):
                            lay_out(rows, static, starts, n_groups, group, groups, b, j)
                    if attempt == 0:
                        if k:
                            move(x, F, B, b, n_moving, a, turning, scratch)
                        for turn in range(2):
                            if (turn == 0) == draw_first:
                                add_rows(x, spread_k, noise, b, a, e)
                            elif k:
                                weigh_by_measurement(x, rows, z_k, H_k, b, p, a, y, constants[step] - log_total, logs)
                                add_rows(x, K_k, y, b, a, p)
                        top = largest_of(logs, b)
                        if top > largest:
                            if not collapsed:
                                rescale(math.exp(largest - top), totals, first, second)
                            largest, heaviest = top, b
                    if summed and largest > -np.inf:
                        total = weights_of(logs, b, largest, weights, totals)
                        add_moments(
                            *(x, rows, weights, total, static, starts, n_groups, group, groups, b, centre, a),
                            *(centred, weighted, shared, part, first, second),
                        )
                    group = next_group(starts, n_groups, group, groups, b) if n_static else 0
                if attempt == 0 and collapsed:
                    # what weighs anything is near this one, and further from where the mean was expected
                    for lane in range(LANES):
                        if logs[heaviest, lane] == largest:
                            for i in range(a):
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
            survivors[k] = n_groups
        return 0

    return run
