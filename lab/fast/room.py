"""The memory that a compiled run works in.

Question answered: who asks the system for it, and how?  All is asked for at once, through numpy, which asks for large
pages from 4 MB on: a run with twelve rows walks through thousands of small ones at every step, and a processor
remembers where two thousand are.  Each array begins where a line of the cache does, since a vector that lies in two
lines takes two reads.  Nothing of it is given back before the run ends.
Called by `lab.solvers.compiled`.
"""

import math
from functools import lru_cache
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
    whole, layout = _layout(n, d, a, p, e)
    memory = np.empty(whole + LINE, np.uint8)
    first = -memory.ctypes.data % LINE
    return [np.ndarray(sizes, type_, memory, first + begin) for begin, sizes, type_ in layout]


@lru_cache(64)
def _layout(n: int, d: int, a: int, p: int, e: int) -> tuple[int, list[tuple[int, tuple[int, ...], Any]]]:
    """Return how many bytes the arrays take, and where each begins, its shape and its type."""
    blocks, double = -(-n // LANES), np.dtype(float)
    arrays: list[tuple[tuple[int, ...], Any]] = [
        *(((2, blocks * LANES * a), double), ((2, blocks, LANES), double), ((d, blocks * LANES + PAD), double)),
        *(((n + 1,), double), ((blocks + 1,), double), ((COUNTS, n + 1), np.dtype(np.int32)), ((blocks,), double)),
        *(((d, LANES), double), ((d, LANES), double)),
        *(((e + 2, LANES), double), ((p + 1, LANES), double), ((a + 1, LANES), double)),
        *(((LANES,), np.dtype(np.uint64)), ((d, d), double), ((5, d), double), ((d,), np.dtype(np.int32))),
    ]
    whole, layout = 0, []
    for sizes, type_ in arrays:
        layout.append((whole, sizes, type_))
        whole += -(-math.prod(sizes) * type_.itemsize // LINE) * LINE
    return whole, layout
