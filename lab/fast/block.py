"""What a step does to one block of 256 particles while it is in the cache.

Question answered: how do particles move, draw, get weighed and follow their ancestors, when a step is an affine map
that all share?  Functions take all blocks and the number b of one rather than a view of it for each look; zeros of a
map are left out once per block, and the loop over lanes inside has neither branch nor call.
Called by `lab.fast.loop`.
"""

from typing import Any

import numpy as np

from lab.fast.arithmetic import exp
from lab.fast.kernel import PRODUCTS, SUMS, kernel, wide
from lab.fast.normals import LANES
from lab.validation import Array

BLOCK, LANE = np.uint64(LANES.bit_length() - 1), np.uint64(LANES - 1)  # of a place: shift, mask


@kernel(PRODUCTS)
def add_rows(target: Array, map_: Array, source: Array, b: int, n_rows: int, n_terms: int) -> None:
    """Add map_ @ source to the first rows of block b of `target`, leaving out the zeros of the map."""
    wide()
    for i in range(n_rows):
        for q in range(n_terms):
            factor = map_[i, q]
            if factor != 0.0:
                for lane in range(LANES):
                    target[b, i, lane] += factor * source[q, lane]


@kernel(PRODUCTS)
def correct_and_draw(x: Array, K: Array, y: Array, spread: Array, noise: Array, b: int, n_active: int) -> None:
    """Add K @ y and spread @ noise to block b, for two components of z and two normals: each row is written once."""
    wide()
    for i in range(n_active):
        k0, k1, s0, s1 = K[i, 0], K[i, 1], spread[i, 0], spread[i, 1]
        if k0 != 0.0 or k1 != 0.0 or s0 != 0.0 or s1 != 0.0:
            for lane in range(LANES):
                x[b, i, lane] += k0 * y[0, lane] + k1 * y[1, lane] + s0 * noise[0, lane] + s1 * noise[1, lane]


@kernel(PRODUCTS)
def turns(F: Array, n_moving: int) -> bool:
    """Whether nothing moves but a point in the plane, by itself."""
    alone = n_moving == 2
    for i in range(n_moving):
        for j in range(n_moving, len(F)):
            alone &= F[i, j] == 0.0
    return alone


@kernel(PRODUCTS)
def move(x: Array, F: Array, B: Array, b: int, n_moving: int, n_active: int, turning: bool, scratch: Array) -> None:
    """Set the first rows of block b to F x + B; the others stay as they are."""
    wide()
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


@kernel()
def fetch(new: Array, old: Array, ancestors: Any, b: int, n: int, n_active: int, places: Any) -> None:
    """Copy the ancestors of the particles of block b from `old`, all blocks in one row, which may be in part the same.

    `places` (LANES,) is room for where they are; two rows are copied at once and need none.
    """
    wide()
    held, stride = min(LANES, n - b * LANES), np.uint64(n_active * LANES)
    if n_active == 2:
        for lane in range(held):
            ancestor = np.uint64(ancestors[b * LANES + lane])
            place = ancestor + (ancestor & ~LANE)  # twice the ancestor's block
            new[b, 0, lane], new[b, 1, lane] = old[place], old[place + stride // 2]
        for lane in range(held, LANES):
            new[b, 0, lane] = new[b, 1, lane] = 0.0
        return
    for lane in range(held):
        ancestor = np.uint64(ancestors[b * LANES + lane])
        places[lane] = (ancestor >> BLOCK) * stride + (ancestor & LANE)
    for i in range(n_active):
        row = np.uint64(i * LANES)
        for lane in range(held):
            new[b, i, lane] = old[places[lane] + row]
        for lane in range(held, LANES):
            new[b, i, lane] = 0.0


@kernel(PRODUCTS)
def weigh_by_measurement(
    x: Array, rows: Array, z: Array, H: Array, b: int, p: int, n_active: int, y: Array, constant: float, logs: Array
) -> None:
    """Set y = z - H x and add constant - |y|^2 / 2 to the log-weights of block b, by pairs of components.

    A pair mostly reads the first two rows, which move, and two others.
    """
    wide()
    n = H.shape[1]
    if p == 0:
        for lane in range(LANES):
            logs[b, lane] += constant
    for r in range(0, p, 2):
        s = r + 1 if r + 1 < p else r
        added = constant if r == 0 else 0.0
        others, i, j = 0, n, n  # beyond the first two: how many, and the last two of them
        for column in range(2, n):
            if H[r, column] != 0.0 or H[s, column] != 0.0:
                others, i, j = others + 1, j, column
        if n_active >= 2 and others == 2 and i >= n_active:
            _weigh_pair(x, rows, i, j, z, H, r, s, b, y, added, logs)
        elif n_active >= 2 and others == 2 and j < n_active:
            _weigh_pair(x, x[b], i, j, z, H, r, s, b, y, added, logs)
        else:
            for q in range(r, s + 1):
                _weigh_component(x, rows, z[q], H, q, b, n_active, y, added if q == r else 0.0, logs)


@kernel(PRODUCTS)
def _weigh_pair(
    x: Array, source: Array, i: Any, j: Any, z: Array, H: Array, r: int, s: int, b: int, y: Array, added: float,
    logs: Array,
) -> None:  # fmt: skip
    """Weigh by components r and s, or by one if they are the same, which read rows 0, 1 of x and i, j of `source`."""
    wide()
    z0, h00, h01, h02, h03 = z[r], H[r, 0], H[r, 1], H[r, i], H[r, j]
    z1, h10, h11, h12, h13 = z[s], H[s, 0], H[s, 1], H[s, i], H[s, j]
    half = 0.5 if s > r else 0.0
    for lane in range(LANES):
        x0, x1, x2, x3 = x[b, 0, lane], x[b, 1, lane], source[i, lane], source[j, lane]
        y0 = z0 - h00 * x0 - h01 * x1 - h02 * x2 - h03 * x3
        y1 = z1 - h10 * x0 - h11 * x1 - h12 * x2 - h13 * x3
        y[r, lane], y[s, lane] = y0, y1
        logs[b, lane] += added - 0.5 * y0 * y0 - half * y1 * y1


@kernel(PRODUCTS)
def _weigh_component(
    x: Array, rows: Array, z: float, H: Array, r: int, b: int, n_active: int, y: Array, added: float, logs: Array
) -> None:
    """Weigh by component r, whatever it reads, row by row."""
    wide()
    for lane in range(LANES):
        y[r, lane] = z
    for j in range(H.shape[1]):
        factor = H[r, j]
        if factor != 0.0 and j < n_active:
            for lane in range(LANES):
                y[r, lane] -= factor * x[b, j, lane]
        elif factor != 0.0:
            for lane in range(LANES):
                y[r, lane] -= factor * rows[j, lane]
    for lane in range(LANES):
        logs[b, lane] += added - 0.5 * y[r, lane] * y[r, lane]


@kernel(PRODUCTS)
def weigh_point(
    x: Array, static: Array, group: Any, z: Array, H: Array, b: int, p: int, constant: float, logs: Array
) -> None:
    """Do at once what `weigh_by_measurement` does, for two active rows and one group, and keep no y."""
    wide()
    for r in range(0, p, 2):
        s = r + 1 if r + 1 < p else r
        z0, z1, added = z[r], z[s], constant if r == 0 else 0.0
        for j in range(2, len(static)):
            z0 -= H[r, j] * static[j, group]
            z1 -= H[s, j] * static[j, group]
        h00, h01, h10, h11, half = H[r, 0], H[r, 1], H[s, 0], H[s, 1], 0.5 if s > r else 0.0
        for lane in range(LANES):
            y0 = z0 - h00 * x[b, 0, lane] - h01 * x[b, 1, lane]
            y1 = z1 - h10 * x[b, 0, lane] - h11 * x[b, 1, lane]
            logs[b, lane] += added - 0.5 * y0 * y0 - half * y1 * y1


@kernel({"reassoc", "nsz", "nnan"})
def largest_of(logs: Array, b: int) -> Any:
    """Return the largest log-weight of block b; four at a time, since each comparison waits for the one before."""
    wide()
    top0, top1, top2, top3 = logs[b, 0], logs[b, 1], logs[b, 2], logs[b, 3]
    for lane in range(0, LANES, 4):
        v0, v1, v2, v3 = logs[b, lane], logs[b, lane + 1], logs[b, lane + 2], logs[b, lane + 3]
        top0 = v0 if v0 > top0 else top0
        top1 = v1 if v1 > top1 else top1
        top2 = v2 if v2 > top2 else top2
        top3 = v3 if v3 > top3 else top3
    top0 = top1 if top1 > top0 else top0
    top2 = top3 if top3 > top2 else top2
    return top2 if top2 > top0 else top0


@kernel(SUMS)
def weights_of(logs: Array, b: int, largest: float, weights: Array, totals: Array) -> Any:
    """Set the weights of block b relative to `largest`, add them and their squares to the totals, return their sum."""
    wide()
    for lane in range(LANES):
        weights[b, lane] = exp(logs[b, lane] - largest)
    total = squares = 0.0
    for lane in range(LANES):
        total += weights[b, lane]
        squares += weights[b, lane] * weights[b, lane]
    totals[0] += total
    totals[1] += squares
    return total


@kernel()
def fill_mean(x: Array, m0: Array, b: int) -> None:
    """Put every particle of block b at the mean of the prior."""
    for i in range(x.shape[1]):
        for lane in range(LANES):
            x[b, i, lane] = m0[i]


@kernel(PRODUCTS)
def draw_static(static: Array, m0: Array, spread: Array, noise: Array, b: int, n_active: int) -> None:
    """Draw from the prior the rows that the particles of block b do not have themselves."""
    wide()
    for i in range(n_active, len(static)):
        for lane in range(LANES):
            static[i, b * LANES + lane] = m0[i]
        for q in range(spread.shape[1]):
            factor = spread[i, q]
            if factor != 0.0:
                for lane in range(LANES):
                    static[i, b * LANES + lane] += factor * noise[q, lane]


@kernel()
def fill_even(logs: Array, n: int, even: float) -> None:
    """Give all n particles the same log-weight."""
    for b in range(len(logs)):
        for lane in range(min(LANES, n - b * LANES)):
            logs[b, lane] = even
