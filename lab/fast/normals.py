"""The stream of random numbers of the kernels: xoshiro256+ in 256 lanes, and normals by Box and Muller.

Question answered: where does the randomness of a compiled filter come from?  From the Generator that is passed in, and
from nothing else: it gives each of 256 lanes a state of 256 random bits (`seed`), and from there on every lane is a
xoshiro256+ of its own, so that the lanes advance together.  Two lanes overlap within 2^64 numbers with a probability
below 2^-170.  A block of particles takes one number of each lane for each pair of normals and once more for their
directions:

    rho = sqrt(-2 log u),   (rho cos a, rho sin a),   a = (v - 1/2) pi / 2, turned by a random quarter

A block that needs an odd number of rows leaves the last one unused.
Source: Blackman and Vigna (2021), Scrambled linear pseudorandom number generators; Box and Muller (1958).
"""

import math
from typing import Any

import numpy as np

from lab.fast.arithmetic import as_bits, as_double, cosine, log, sine, uniform
from lab.fast.kernel import PRODUCTS, kernel, wide
from lab.validation import Array

LANES = 256  # particles of a block, and generators side by side
LOW = np.uint64(1 << 8)  # two bits that make no part of `uniform`
LOWER = np.uint64(1 << 9)
SHIFT = np.uint64(17)
TURN = np.uint64(45)
BACK = np.uint64(19)
TO_SIGN = np.uint64(55)


def seed(rng: np.random.Generator) -> Any:
    """Return the state (4, 256) of the stream that follows from a generator."""
    return rng.integers(0, 2**64, size=(4, LANES), dtype=np.uint64)


@kernel(PRODUCTS, from_python=True)
def uniforms(state: Any, out: Array, row: int) -> None:
    """Fill a row of `out` with numbers uniform in [0, 1), one of every lane."""
    wide()
    for lane in range(LANES):
        s0, s1, s2, s3 = state[0, lane], state[1, lane], state[2, lane], state[3, lane]
        out[row, lane] = 1.0 - uniform(s0 + s3)
        s2 ^= s0
        s3 ^= s1
        state[1, lane] = s1 ^ s2
        state[0, lane] = s0 ^ s3
        state[2, lane] = s2 ^ (s1 << SHIFT)
        state[3, lane] = (s3 << TURN) | (s3 >> BACK)


@kernel(PRODUCTS)
def _draw_uniforms(state: Any, out: Array, row: int) -> None:
    """Put a uniform number of every lane into a row, and the 64 bits of its next one, read as a double, below."""
    wide()
    for lane in range(LANES):
        s0, s1, s2, s3 = state[0, lane], state[1, lane], state[2, lane], state[3, lane]
        out[row, lane] = uniform(s0 + s3)
        s2 ^= s0
        s3 ^= s1
        t = s1 << SHIFT
        s1 ^= s2
        s0 ^= s3
        s2 ^= t
        s3 = (s3 << TURN) | (s3 >> BACK)
        out[row + 1, lane] = as_double(s0 + s3)
        s2 ^= s0
        s3 ^= s1
        state[1, lane] = s1 ^ s2
        state[0, lane] = s0 ^ s3
        state[2, lane] = s2 ^ (s1 << SHIFT)
        state[3, lane] = (s3 << TURN) | (s3 >> BACK)


@kernel(PRODUCTS)
def _to_squares(out: Array, row: int) -> None:
    """Turn uniform numbers into squares of radii."""
    wide()
    for lane in range(LANES):
        out[row, lane] = -2.0 * log(out[row, lane])


@kernel(PRODUCTS)
def _turn(out: Array, row: int) -> None:
    """Turn squares of radii, and the bits below them, into two normals."""
    wide()
    for lane in range(LANES):
        radius, bits = math.sqrt(out[row, lane]), as_bits(out[row + 1, lane])
        a = (uniform(bits) - 0.5) * (0.5 * math.pi)
        # a quarter around the first axis; one bit turns it around, another exchanges the axes
        c = radius * as_double(as_bits(cosine(a)) ^ ((bits & LOW) << TO_SIGN))
        s = radius * sine(a)
        swap = (bits & LOWER) != 0
        out[row, lane] = s if swap else c
        out[row + 1, lane] = c if swap else s


@kernel(PRODUCTS, from_python=True)
def normals(state: Any, out: Array, n_rows: int) -> None:
    """Fill the first rows of `out` with standard normals; it has an even number of rows, of which one may be wasted.

    In three loops: a chain of steps that wait for each other is overlapped with those of the next lanes only while they
    fit into what the processor looks ahead, and its constants into its registers.
    """
    for row in range(0, n_rows, 2):
        _draw_uniforms(state, out, row)
        _to_squares(out, row)
        _turn(out, row)
