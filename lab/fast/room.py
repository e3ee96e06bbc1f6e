"""The memory that a compiled run works in.

Question answered: who asks the system for it, and how?  All that grows with the particles is asked for at once, through
numpy, which asks for large pages from 4 MB on: a run with twelve rows walks through thousands of small ones at every
step, and a processor remembers where two thousand are.  Nothing of it is given back before the run ends.
Called by `lab.solvers.compiled`.
"""

from typing import Any

import numpy as np

from lab.fast.genealogy import PAD
from lab.fast.normals import LANES

COUNTS = 5  # arrays of whole numbers, one for each particle


def room(n: int, d: int, a: int) -> tuple[Any, ...]:
    """Return the last arguments of the compiled run; what they hold does not matter and is overwritten.

    Parameters
    ----------
    n, d, a : int
        Particles, rows of the state, rows that are not static from time 0 on.

    Returns
    -------
    clouds : (2, blocks * a * LANES) array
    by_block : (2, blocks, LANES) array
        Weights, log-weights.
    static : (d, blocks * LANES + PAD) array
    points : (n + 1,) array
    counts : (COUNTS, n + 1) array of int32
    """
    blocks = -(-n // LANES)
    held = blocks * LANES
    sizes = np.cumsum([2 * held * a, 2 * held, d * (held + PAD), n + 1, (COUNTS * (n + 1) + 1) // 2])
    parts: Any = np.split(np.empty(sizes[-1]), sizes[:-1])
    clouds, by_block, static, points, counts = parts
    return (
        clouds.reshape(2, held * a),
        by_block.reshape(2, blocks, LANES),
        static.reshape(d, held + PAD),
        points,
        counts.view(np.int32)[: COUNTS * (n + 1)].reshape(COUNTS, n + 1),
    )
