"""Resampling by offspring: how many particles descend from the first i, for all i, and who descends from whom.

Question answered: how is a cloud resampled without a search?  A scheme is the numbers

    before[i] = how many of the N points that the scheme throws into [0, 1) lie below w_0 + ... + w_{i-1}

and particle i becomes the ancestor of the places before[i] .. before[i + 1] - 1.  Systematic: point j is (j + u) / N,
so before = ceil(N c - u) needs no points at all; stratified: of the stratum that c cuts, the own uniform number
decides; multinomial: points in ascending order are normalised sums of exponential numbers; residual: copies, and what
remains multinomially.  So ancestors are in ascending order under every scheme; their order says nothing.  As in
`lab.resampling`, nothing is taken from beyond the last positive weight, and nothing of weight zero is taken.
Source: question 6 of the handout; Douc, Cappe and Moulines (2005).
"""

import math
from typing import Any

import numpy as np

from lab.fast.arithmetic import exp, log
from lab.fast.kernel import PRODUCTS, kernel, wide
from lab.fast.normals import LANES, uniforms
from lab.validation import Array

SYSTEMATIC, STRATIFIED, MULTINOMIAL, RESIDUAL = range(4)
SCHEMES = {"systematic": SYSTEMATIC, "stratified": STRATIFIED, "multinomial": MULTINOMIAL, "residual": RESIDUAL}
CHAINS = 8  # sums of a block that run side by side, since one addition waits for the one before
EPS = 2.0**-52


@kernel(PRODUCTS)
def cumulate(weights: Array, tops: Array, largest: float, ends: Array) -> int:
    """Turn weights into their sums from each block's start, and fill `ends` with the sums of whole blocks.

    Returns
    -------
    int
        The last particle of positive weight.
    """
    wide()
    length = LANES // CHAINS
    last, ends[0] = 0, 0.0
    for b in range(len(weights)):
        scale = exp(tops[b] - largest)
        for lane in range(LANES):
            weights[b, lane] *= scale
        for lane in range(LANES):
            if weights[b, LANES - 1 - lane] > 0:
                last = b * LANES + LANES - 1 - lane
                break
        for t in range(1, length):
            for chain in range(CHAINS):
                weights[b, chain * length + t] += weights[b, chain * length + t - 1]
        total = weights[b, length - 1]
        for chain in range(1, CHAINS):
            for t in range(length):
                weights[b, chain * length + t] += total
            total = weights[b, chain * length + length - 1]
        ends[b + 1] = ends[b] + total
    return last


@kernel(PRODUCTS)
def systematic(cumulative: Array, ends: Array, n: int, state: Any, scratch: Array, before: Any) -> None:
    """Count the points (j + u) / n."""
    wide()
    uniforms(state, scratch, 0)
    u = scratch[0, 0]
    scale = n / ends[len(cumulative)]
    for b in range(len(cumulative)):
        for lane in range(min(LANES, n - b * LANES)):
            below = np.ceil((ends[b] + cumulative[b, lane]) * scale - u)
            before[b * LANES + lane + 1] = np.int32(min(max(below, 0.0), float(n)))


@kernel()
def stratified(cumulative: Array, ends: Array, n: int, state: Any, scratch: Array, points: Array, before: Any) -> None:
    """Count the points (j + u_j) / n."""
    for b in range(len(cumulative)):
        uniforms(state, scratch, 0)
        for lane in range(min(LANES, n - b * LANES)):
            points[b * LANES + lane] = scratch[0, lane]
    scale = n / ends[len(cumulative)]
    for b in range(len(cumulative)):
        for lane in range(min(LANES, n - b * LANES)):
            c = (ends[b] + cumulative[b, lane]) * scale
            j = min(int(c), n - 1)
            before[b * LANES + lane + 1] = j + (points[j] < c - j)


@kernel()
def multinomial(
    cumulative: Array, ends: Array, n: int, count: int, state: Any, scratch: Array, points: Array, before: Any
) -> None:
    """Add to `before` what `count` independent points amount to."""
    total = 0.0
    for j in range(count + 1):
        if j % LANES == 0:
            uniforms(state, scratch, 0)
        total -= log(1.0 - scratch[0, j % LANES])
        points[j] = total
    scale = total / ends[len(cumulative)]
    j = 0
    for b in range(len(cumulative)):
        for lane in range(min(LANES, n - b * LANES)):
            c = (ends[b] + cumulative[b, lane]) * scale
            while j < count and points[j] < c:
                j += 1
            before[b * LANES + lane + 1] += j


@kernel()
def keep_copies(cumulative: Array, ends: Array, n: int, before: Any) -> int:
    """Give each floor(n w) places, leave in `cumulative` and `ends` what remains of its weight, return the places."""
    scale = n / ends[len(cumulative)]
    copies, earlier, start, rest = 0, 0.0, 0.0, 0.0
    for b in range(len(cumulative)):
        end = ends[b + 1]
        ends[b] = rest
        for lane in range(min(LANES, n - b * LANES)):
            now = (start + cumulative[b, lane]) * scale
            expected = now - earlier
            earlier = now
            # n times 1 / n may come out just below 1, and even weights must keep every particle
            whole = min(math.floor(expected + 4 * n * EPS), n - copies)
            copies += whole
            before[b * LANES + lane + 1] = copies
            rest += max(expected - whole, 0.0)
            cumulative[b, lane] = rest - ends[b]
        start = end
    ends[len(cumulative)] = rest
    return copies


@kernel()
def find_ancestors(before: Any, last: int, n: int, ancestors: Any) -> None:
    """Turn counts into the ancestor of each place: each particle is written where its places begin, the last one stays.

    A particle without places is overwritten by the next; the running maximum fills the places that follow.  What
    follows the last positive weight has none: rounding may leave the sum short of the last point.
    """
    length = LANES // CHAINS
    for i in range(last + 1, n + 1):
        before[i] = n
    for j in range(n + 1):
        ancestors[j] = 0
    for i in range(n):
        ancestors[np.uint64(before[i])] = i
    latest = ancestors[0]
    whole = n - n % LANES
    for start in range(0, whole, LANES):
        for t in range(1, length):
            for chain in range(CHAINS):
                j = start + chain * length + t
                ancestors[j] = max(ancestors[j], ancestors[j - 1])
        for chain in range(CHAINS):
            for t in range(length):
                j = start + chain * length + t
                ancestors[j] = max(ancestors[j], latest)
            latest = ancestors[start + chain * length + length - 1]
    for j in range(whole, n):
        latest = max(latest, ancestors[j])
        ancestors[j] = latest


@kernel(from_python=True)
def resample_systematic(
    scheme: int,
    weights: Array,
    tops: Array,
    largest: float,
    n: int,
    state: Any,
    scratch: Array,
    ends: Array,
    points: Array,
    before: Any,
    ancestors: Any,
) -> None:
    """Draw `before` (n + 1) and `ancestors` (n) by the usual scheme; the other arrays are room to work in.

    Parameters
    ----------
    scheme : int
        Not read: this is the signature of all schemes.
    weights : (blocks, LANES) array
        Finite, 0 in the lanes beyond the n particles; those of block b are to be multiplied by exp(tops[b] - largest).
        They are overwritten by sums.
    tops : (blocks,) array
        -inf for a block without weight.
    largest : float
        The largest of them.
    n : int
        N particles.
    state : (4, LANES) array
        Of the random stream.
    scratch, ends, points : (1, LANES), (blocks + 1,), (n + 1,) array
        The points are for other schemes.
    before, ancestors : (n + 1,), (n + 1,) array of int
    """
    before[0] = 0
    last = cumulate(weights, tops, largest, ends)
    systematic(weights, ends, n, state, scratch, before)
    find_ancestors(before, last, n, ancestors)


@kernel(from_python=True)
def resample_other(
    scheme: int,
    weights: Array,
    tops: Array,
    largest: float,
    n: int,
    state: Any,
    scratch: Array,
    ends: Array,
    points: Array,
    before: Any,
    ancestors: Any,
) -> None:
    """Do what `resample_systematic` does by another of SCHEMES: few ask for one, and they take as long to compile."""
    for i in range(n + 1):
        before[i] = 0
    last = cumulate(weights, tops, largest, ends)
    if scheme == STRATIFIED:
        stratified(weights, ends, n, state, scratch, points, before)
    else:
        copies = keep_copies(weights, ends, n, before) if scheme == RESIDUAL else 0
        if copies < n:
            multinomial(weights, ends, n, n - copies, state, scratch, points, before)
    find_ancestors(before, last, n, ancestors)
