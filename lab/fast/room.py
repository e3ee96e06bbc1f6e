"""The memory that a compiled run works in.

Question answered: who asks the system for it, and how?  All is asked for at once, through numpy, which asks for large
pages from 4 MB on: a run with twelve rows walks through thousands of small ones at every step, and a processor
remembers where two thousand are.  Each array begins where a line of the cache does, since a vector that lies in two
lines takes two reads.  Nothing of it is given back before the run ends.
Called by `lab.solvers.compiled`.
"""

import math
from typing import Any

import numpy as np

from lab.fast.genealogy import PAD
from lab.fast.normals import LANES

COUNTS = 5  # arrays of whole numbers, one for each particle
LINE = 64  # bytes of a line of the cache


def room(n: int, d: int, a: int, p: int, e: int) -> list[Any]:
    """Return the last arguments of the compiled run; what they hold does not matter.

    Parameters
    ----------
    n, d, a : int
        Particles, rows of the state, rows that are not static from time 0 on.
    p, e : int
        Measured components and normals of a step, at most.

    Returns
    -------
    clouds : (2, blocks * a * LANES) array
    by_block : (2, blocks, LANES) array
        Weights, log-weights.
    static : (d, blocks * LANES + PAD) array
    points, ends : (n + 1,), (blocks + 1,) array
    counts : (COUNTS, n + 1) array of int32
    tops : (blocks,) array
    rows, weighted : (d, LANES) array
        As the next ones, of the block at hand: the static rows particle by particle, and rows with their weights.
    noise, y, scratch : (e + 2, LANES), (p + 1, LANES), (a + 1, LANES) array
    places : (LANES,) array of uint64
    second : (d, d) array
    vectors : (5, d) array
    wanted : (d,) array of int32
    """
    blocks = -(-n // LANES)
    return _cut(
        *((2, blocks * LANES * a), (2, blocks, LANES), (d, blocks * LANES + PAD), (n + 1,), (blocks + 1,)),
        *((COUNTS, n + 1, np.int32), (blocks,), (d, LANES), (d, LANES)),
        *((e + 2, LANES), (p + 1, LANES), (a + 1, LANES), (LANES, np.uint64), (d, d), (5, d), (d, np.int32)),
    )


def _cut(*shapes: tuple[Any, ...]) -> list[Any]:
    """Return arrays of these shapes, of doubles where none is followed by another type, out of one piece of memory."""
    whole, layout = 0, []
    for shape in shapes:
        type_: Any = np.dtype(float if isinstance(shape[-1], int) else shape[-1])
        sizes = shape if isinstance(shape[-1], int) else shape[:-1]
        layout.append((whole, sizes, type_))
        whole += -(-math.prod(sizes) * type_.itemsize // LINE) * LINE
    memory = np.empty(whole + LINE, np.uint8)
    first = -memory.ctypes.data % LINE
    return [np.ndarray(sizes, type_, memory, first + begin) for begin, sizes, type_ in layout]
