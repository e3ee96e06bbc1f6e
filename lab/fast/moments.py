"""Sums behind mean and covariance, over one block of particles at a time while it is in the cache.

Question answered: how are sum w (x - c) and sum w (x - c)(x - c)' taken while the particles are at hand anyway?  Rows
of a block are taken three by three, so that nine sums stay in registers.  Rows that are the same within a group of
neighbours (landmarks of one ancestor) need the sums of the group only, W_g and sum w (x - c):

    sum w (x - c)(m - c)' = sum over g of [sum over i in g of w_i (x_i - c)] (m_g - c)'

c is any point near the mean; what is lost by one that is not near enough is for the caller to judge.
Called by `lab.fast.loop`.
"""

from typing import Any

import numpy as np

from lab.fast.kernel import PRODUCTS, SUMS, kernel, wide
from lab.fast.memory import LINE, ask_for
from lab.fast.normals import LANES
from lab.validation import Array

TILE = 3


@kernel(SUMS)
def weigh(
    source: Array, centre: Array, weights: Array, b: int, weighted: Array, start: int, stop: int, part: Array
) -> None:
    """Set rows start..stop - 1 of `weighted` to w (x - c) with the weights of block b, and `part` to their sums."""
    wide()
    for i in range(start, stop):
        total, c = 0.0, centre[i]
        for lane in range(LANES):
            value = weights[b, lane] * (source[i, lane] - c)
            weighted[i, lane] = value
            total += value
        part[i] = total


@kernel(SUMS)
def _tile(weighted: Array, i: int, stop: int, source: Array, centre: Array, j: int, end: int, second: Array) -> None:
    """Add the products of three rows, i of `weighted` and after it, and three, j of `source` and after it, minus c.

    Rows from `stop` and from `end` on are left out.
    """
    wide()
    i1, i2, j1, j2 = min(i + 1, stop - 1), min(i + 2, stop - 1), min(j + 1, end - 1), min(j + 2, end - 1)
    c0, c1, c2 = centre[j], centre[j1], centre[j2]
    s00 = s01 = s02 = s10 = s11 = s12 = s20 = s21 = s22 = 0.0
    for lane in range(LANES):
        a0, a1, a2 = weighted[i, lane], weighted[i1, lane], weighted[i2, lane]
        b0, b1, b2 = source[j, lane] - c0, source[j1, lane] - c1, source[j2, lane] - c2
        s00 += a0 * b0
        s01 += a0 * b1
        s02 += a0 * b2
        s10 += a1 * b0
        s11 += a1 * b1
        s12 += a1 * b2
        s20 += a2 * b0
        s21 += a2 * b1
        s22 += a2 * b2
    _add(second, i, j, end - j, s00, s01, s02)
    if i + 1 < stop:
        _add(second, i + 1, j, end - j, s10, s11, s12)
    if i + 2 < stop:
        _add(second, i + 2, j, end - j, s20, s21, s22)


@kernel()
def _add(second: Array, i: int, j: int, room: int, s0: float, s1: float, s2: float) -> None:
    """Add three sums to row i, from column j on, or as many of them as there is room for."""
    second[i, j] += s0
    if room > 1:
        second[i, j + 1] += s1
    if room > 2:
        second[i, j + 2] += s2


@kernel(SUMS)
def point_in_plane(x: Array, b: int, centre: Array, weights: Array, part: Array, second: Array) -> None:
    """Do at once what `weigh` and `products` do, for the two rows of block b, and keep no product."""
    wide()
    c0, c1 = centre[0], centre[1]
    s0 = s1 = s00 = s01 = s11 = 0.0
    for lane in range(LANES):
        d0, d1 = x[b, 0, lane] - c0, x[b, 1, lane] - c1
        w0, w1 = weights[b, lane] * d0, weights[b, lane] * d1
        s0 += w0
        s1 += w1
        s00 += w0 * d0
        s01 += w0 * d1
        s11 += w1 * d1
    part[0], part[1] = s0, s1
    second[0, 0] += s00
    second[0, 1] += s01
    second[1, 1] += s11


@kernel()
def products(
    weighted: Array, source: Array, centre: Array, start: int, stop: int, begin: int, end: int, second: Array,
    memory: Array, following: Any, until: Any,
) -> None:  # fmt: skip
    """Add the products of rows start..stop - 1 of `weighted` and begin..end - 1 of `source`, on and above the diagonal.

    Where the two overlap they are the same rows; a tile on the diagonal is added whole.  Meanwhile places
    following..until - 1 of `memory` are asked for.
    """
    side = (stop - start + TILE - 1) // TILE
    tiles = max(side * (side + 1) // 2, 1)
    share = (until - following + tiles * LINE - 1) // (tiles * LINE) * LINE
    for i in range(start, stop, TILE):
        for j in range(max(i, begin), end, TILE):
            ask_for(memory, following, min(following + share, until))
            following += share
            _tile(weighted, i, stop, source, centre, j, end, second)


@kernel(SUMS)
def sum_segment(weights: Array, b: int, weighted: Array, n_active: int, low: Any, high: Any, part: Array) -> float:
    """Return the sum of the weights of a group, lanes low..high - 1 of block b; set `part` to the sums of its rows."""
    total = 0.0
    for lane in range(low, high):
        total += weights[b, lane]
    for i in range(n_active):
        value = 0.0
        for lane in range(low, high):
            value += weighted[i, lane]
        part[i] = value
    return total


@kernel(PRODUCTS)
def add_shared(total: float, part: Array, n_active: int, n: int, shared: Array, first: Array, second: Array) -> None:
    """Add what a group contributes with the rows, from `n_active` on, that its particles share: values minus c."""
    # without a sign: where an index could be negative, numba asks each time
    start, n_shared = np.uint64(n_active), np.uint64(n - n_active)
    for i in range(start):
        for j in range(n_shared):
            second[i, start + j] += part[i] * shared[j]
    for i in range(n_shared):
        value = total * shared[i]
        first[start + i] += value
        for j in range(i, n_shared):
            second[start + i, start + j] += value * shared[j]
