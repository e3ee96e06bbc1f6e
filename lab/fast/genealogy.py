"""Rows that no step touches, kept once per living ancestor of time 0.

Question answered: what do a million particles with the landmarks of three ancestors have to store?  Three maps.
Ancestors come in ascending order, so the descendants of one particle of time 0 stay neighbours, a group: group g begins
at place starts[g] and ends where the next begins, and its rows are static[g // LANES, :, g % LANES].  The groups are
the survivors.
Called by `lab.fast.loop`.
"""

from typing import Any

import numpy as np
from numba import njit

from lab.fast.normals import LANES
from lab.validation import Array


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
        # without a sign: where it could be negative, numba asks at every lane
        low = np.uint64(max(starts[g] - b * LANES, 0))
        high = np.uint64(min(starts[g + 1] - b * LANES, LANES) if g + 1 < n_groups else LANES)
        value = static[g // LANES, j, g % LANES]
        for lane in range(low, high):
            rows[j, lane] = value


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
