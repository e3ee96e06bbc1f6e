"""Particles that can no longer weigh anything, left out.

Question answered: how does a cloud that is never resampled become smaller?  Those that go on move up to the front, so
that whole blocks become free.  Who need not go on: `lab.solvers.apart`.
Called by `lab.fast.loop`.
"""

from typing import Any

import numpy as np

from lab.fast.genealogy import keep
from lab.fast.kernel import SUMS, kernel, wide
from lab.fast.normals import LANES
from lab.validation import Array

SPARSE = 0.9  # of the blocks: particles move up when they fit into so many


@kernel(SUMS)
def _count_heavy(logs: Array, blocks: int, least: float) -> int:
    wide()
    count = 0.0
    for b in range(blocks):
        for lane in range(LANES):
            count += 1.0 if logs[b, lane] >= least else 0.0
    return int(count)


@kernel()
def leave_out(logs: Array, static: Array, n_active: int, n: int, least: float, places: Any) -> int:
    """Keep the log-weights from `least` on, and the static rows of those particles, if that saves blocks.

    Every particle is a group of its own.  Returns how many particles there are now, 0 if none is heavy enough; where
    they were is then in `places` (n,), for the rows that are still to be fetched.
    """
    blocks = (n + LANES - 1) // LANES
    heavy: int = _count_heavy(logs, blocks, least)
    needed = (heavy + LANES - 1) // LANES
    if needed > SPARSE * blocks:
        return n
    count = np.uint64(0)
    for b in range(blocks):
        for lane in range(LANES):
            if logs[b, lane] >= least:
                places[count] = b * LANES + lane
                logs[count // LANES, count % LANES] = logs[b, lane]
                count += np.uint64(1)
    for place in range(heavy, needed * LANES):
        logs[place // LANES, place % LANES] = -np.inf
    keep(static, n_active, places, heavy)
    return heavy


@kernel()
def weigh_nothing(centre: Array, extra: Array, mean: Array, cov: Array, totals: Array) -> None:
    """Answer with moments that will not count, and a weight that may be too small: it is next to nothing as it is."""
    totals[0] = totals[1] = 1.0
    for i in range(len(centre)):
        mean[i] = centre[i]
        for j in range(len(centre)):
            cov[i, j] = extra[i, j]


@kernel()
def end_early(
    k: int, extra: Array, means: Array, covs: Array, log_evidence: Array, ess: Array, survivors: Any, totals: Array
) -> None:
    """Answer for the instants from k > 0 on, with no weight at all."""
    for j in range(k, len(means)):
        weigh_nothing(means[k - 1], extra[j], means[j], covs[j], totals)
        log_evidence[j], ess[j], survivors[j] = -np.inf, 1.0, survivors[k - 1]
