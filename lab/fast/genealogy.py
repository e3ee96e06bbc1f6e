"""Rows that no step touches any more, kept once per ancestor of the time when they were taken from the particles.

Question answered: what do a million particles with the landmarks of three ancestors have to store?  Three maps.
Ancestors come in ascending order, so the descendants of one particle stay neighbours, a group: group g begins at place
starts[g], ends where the next begins, and has the rows static[n_active:, g].  When more rows become static, every
particle is a group again (`retire`).  Groups that have gone on since time 0 count the survivors.
Called by `lab.fast.loop`.
"""

from typing import Any

import numpy as np

from lab.fast.kernel import kernel, wide
from lab.fast.normals import LANES
from lab.validation import Array

PAD = 8  # doubles, so that the rows of all groups are at no distance that shares places in the cache


@kernel()
def count_groups(starts: Any, n_groups: int, group: int, b: int) -> int:
    """Return how many groups, from `group` on, reach into block b."""
    if n_groups == len(starts) - 1:  # every particle is a group
        return min(LANES, n_groups - group)
    end = (b + 1) * LANES
    last = group
    while last + 1 < n_groups and starts[last + 1] < end:
        last += 1
    return last - group + 1


@kernel()
def next_group(starts: Any, n_groups: int, group: int, groups: int, b: int) -> int:
    """Return the first group of block b + 1, when `groups` from `group` on reach into block b."""
    last = group + groups - 1
    return last + 1 if last + 1 < n_groups and starts[last + 1] == (b + 1) * LANES else last


@kernel()
def lay_out(rows: Array, static: Array, starts: Any, n_groups: int, group: int, groups: int, b: int, j: int) -> None:
    """Write row j of block b particle by particle, from the groups that reach into it."""
    wide()
    if n_groups == len(starts) - 1:
        for lane in range(LANES):
            rows[j, lane] = static[j, b * LANES + lane]
        return
    for g in range(group, group + groups):
        # without a sign: where it could be negative, numba asks at every lane
        low = np.uint64(max(starts[g] - b * LANES, 0))
        high = np.uint64(min(starts[g + 1] - b * LANES, LANES) if g + 1 < n_groups else LANES)
        value = static[j, g]
        for lane in range(low, high):
            rows[j, lane] = value


@kernel()
def regroup(starts: Any, n_groups: int, before: Any, n: int, kept: Any) -> int:
    """Drop the groups without descendants, and say where the others begin now; return how many they are.

    `kept` (n,) gets what their numbers were.
    """
    count = 0
    for g in range(n_groups):
        low = before[starts[g]]
        high = before[starts[g + 1]] if g + 1 < n_groups else n
        if high > low:
            starts[count] = low
            kept[count] = g
            count += 1
    return count


@kernel()
def keep(static: Array, n_active: int, kept: Any, n_groups: int) -> None:
    """Let the first groups have the rows of those that were kept."""
    for j in range(n_active, len(static)):
        for g in range(n_groups):
            static[j, g] = static[j, kept[g]]


@kernel()
def retire(x: Array, own: Array, static: Array, starts: Any, n_groups: int, n: int) -> None:
    """Take over rows from the particles, which keep in `own` as many as it has; every particle is a group then."""
    n_active, n_before = own.shape[1], x.shape[1]
    for b in range(len(x)):
        for j in range(n_active):
            for lane in range(LANES):
                own[b, j, lane] = x[b, j, lane]
        for j in range(n_active, n_before):
            for lane in range(LANES):
                static[j, b * LANES + lane] = x[b, j, lane]
    for j in range(n_before, len(static)):
        # backwards: group g is written to places from g on
        for g in range(n_groups - 1, -1, -1):
            value = static[j, g]
            for place in range(starts[g], starts[g + 1] if g + 1 < n_groups else n):
                static[j, place] = value
    for place in range(n):
        starts[place] = place
