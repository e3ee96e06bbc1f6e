"""From blocks of weighted particles to mean and covariance.

Question answered: how are moments taken in one pass, before their mean is known?  As sums around a centre c where the
mean is expected,

    mean = c + s / W,   cov = S / W - (s / W)(s / W)',   s = sum w (x - c),   S = sum w (x - c)(x - c)',

which `finish` refuses where c was so far off that a variance has lost its digits: then they are taken again around the
mean.  Weights are relative to the largest so far, and `rescale` makes the sums relative to a larger one.
Called by `lab.fast.loop`.
"""

from typing import Any

import numpy as np

from lab.fast.kernel import kernel, wide
from lab.fast.moments import add_shared, point_in_plane, products, sum_segment, weigh
from lab.fast.normals import LANES
from lab.validation import Array

DENSE = LANES // 8  # groups in a block from which on their rows are laid out particle by particle
LOST = 1e-6  # a variance below this part of the squared distance of mean and c has lost too many digits
NEAR = 1e-13  # of the mean: c is as near as can be


@kernel()
def add_moments(
    memory: Array,
    following: Any,
    end: Any,
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
    weighted: Array,
    shared: Array,
    part: Array,
    first: Array,
    second: Array,
) -> None:
    """Add what block b contributes to sum w (x - c) and sum w (x - c)(x - c)'.

    Meanwhile places following..end - 1 of `memory` are asked for.
    """
    wide()
    n = len(centre)
    top: Any = np.int64(0)  # to numba, 0 is a type of its own, and what takes it would be compiled again
    dense = groups > DENSE
    n_rows = n if dense else n_active
    if n_rows == 2 and groups == 1:
        point_in_plane(x, b, centre, weights, part, second)
    else:
        weigh(x[b], centre, weights, b, weighted, top, n_active, part)
        products(weighted, x[b], centre, top, n_active, top, n_active, second, memory, following, end)
        if dense:
            weigh(rows, centre, weights, b, weighted, n_active, n, part)
            products(weighted, rows, centre, top, n_active, n_active, n, second, memory, end, end)
            products(weighted, rows, centre, n_active, n, n_active, n, second, memory, end, end)
    for i in range(n_rows):
        first[i] += part[i]
    if not dense and n_active < n:
        for g in range(group, group + groups):
            low = np.uint64(max(starts[g] - b * LANES, 0))
            high = np.uint64(min(starts[g + 1] - b * LANES, LANES) if g + 1 < n_groups else LANES)
            for j in range(n - n_active):
                shared[j] = static[n_active + j, g] - centre[n_active + j]
            if groups > 1:
                total = sum_segment(weights, b, weighted, n_active, low, high, part)
            add_shared(total, part, n_active, n, shared, first, second)


@kernel()
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


@kernel()
def clear(totals: Array, first: Array, second: Array) -> None:
    """Begin sums."""
    totals[0] = totals[1] = 0.0
    for i in range(len(first)):
        first[i] = 0.0
        for j in range(len(first)):
            second[i, j] = 0.0


@kernel()
def rescale(factor: float, totals: Array, first: Array, second: Array) -> None:
    """Make sums relative to a larger weight than before."""
    totals[0] *= factor
    totals[1] *= factor * factor
    for i in range(len(first)):
        first[i] *= factor
        for j in range(len(first)):
            second[i, j] *= factor
