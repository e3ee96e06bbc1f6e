"""Logarithm, exponential and random directions without a branch or a call, so that several lanes go at once.

Question answered: how does one take 256 logarithms in the time of forty?  The functions of the C library are called
for one number at a time; polynomials after an exact reduction of the argument are not:

    log u = e log 2 + 2 atanh((m - 1) / (m + 1)),   u = m 2^e,  sqrt(1/2) < m <= sqrt 2
    exp x = 2^q exp r,                              q = round(x / log 2),  |r| <= log(2) / 2
    sin a, cos a,                                   |a| <= pi / 4

The coefficients are those of the series themselves, cut where a term is below 1e-17.  No reordering of sums is allowed
here (no fastmath): the reductions rest on the order.  Called by the kernels, in loops over lanes.
"""

import math
from typing import Any

import numpy as np
from llvmlite import ir
from numba import float64, njit, uint64
from numba.extending import intrinsic

LOG_2_HIGH = 6.93147180369123816490e-01  # the leading 33 bits of log 2: a whole number times it is exact
LOG_2_LOW = 1.90821492927058770002e-10
SMALLEST = -708.0  # exp of less is no normal number, and counts as 0
ROUNDER = 1.5 * 2.0**52  # added and subtracted, it rounds to the nearest whole number
MANTISSA = np.uint64(0x000FFFFFFFFFFFFF)
ONE = np.uint64(0x3FF0000000000000)  # the bits of 1.0
POWER_52 = np.uint64(0x4330000000000000)  # of 2^52: a whole number in its mantissa is added to it
BIAS = np.uint64(1023)
EXPONENT = np.uint64(52)
UNUSED = np.uint64(12)  # of 64 random bits, beyond the 52 of a mantissa


def _as_double(context: Any, bits: Any) -> Any:
    """Read 64 bits as a double."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], ir.DoubleType())

    return float64(uint64), generate


as_double: Any = intrinsic(_as_double)


def _as_bits(context: Any, number: Any) -> Any:
    """Read a double as its 64 bits."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], ir.IntType(64))

    return uint64(float64), generate


as_bits: Any = intrinsic(_as_bits)


@njit(error_model="numpy", fastmath={"contract"}, nogil=True)
def uniform(bits: Any) -> Any:
    """Return a number of (0, 1], uniform on a grid of 2^-52, from 64 random bits."""
    return 2.0 - as_double((bits >> UNUSED) | ONE)


@njit(error_model="numpy", fastmath={"contract"}, nogil=True)
def log(u: Any) -> Any:
    """Return log u of a positive normal number, to a few units in the last place."""
    bits = as_bits(u)
    exponent = as_double((bits >> EXPONENT) | POWER_52) - (2.0**52 + 1023.0)
    m = as_double((bits & MANTISSA) | ONE)
    large = m > math.sqrt(2.0)
    m = 0.5 * m if large else m
    exponent = exponent + 1.0 if large else exponent
    s = (m - 1.0) / (m + 1.0)
    t = s * s
    series = 1 / 21
    series = series * t + 1 / 19
    series = series * t + 1 / 17
    series = series * t + 1 / 15
    series = series * t + 1 / 13
    series = series * t + 1 / 11
    series = series * t + 1 / 9
    series = series * t + 1 / 7
    series = series * t + 1 / 5
    series = series * t + 1 / 3
    return exponent * LOG_2_HIGH + (2.0 * s + (2.0 * s * t * series + exponent * LOG_2_LOW))


@njit(error_model="numpy", fastmath={"contract"}, nogil=True)
def exp(x: Any) -> Any:
    """Return exp x for x <= 0, to a few units in the last place; 0 below -708, -inf included."""
    held = x if x > SMALLEST else SMALLEST
    shifted = held * (1.0 / math.log(2.0)) + ROUNDER
    q = shifted - ROUNDER
    r = (held - q * LOG_2_HIGH) - q * LOG_2_LOW
    series = 1 / 6227020800
    series = series * r + 1 / 479001600
    series = series * r + 1 / 39916800
    series = series * r + 1 / 3628800
    series = series * r + 1 / 362880
    series = series * r + 1 / 40320
    series = series * r + 1 / 5040
    series = series * r + 1 / 720
    series = series * r + 1 / 120
    series = series * r + 1 / 24
    series = series * r + 1 / 6
    series = series * r + 1 / 2
    value = (r * r * series + r + 1.0) * as_double((as_bits(shifted) + BIAS) << EXPONENT)
    return value if x > SMALLEST else 0.0


@njit(error_model="numpy", fastmath={"contract"}, nogil=True)
def sine(a: Any) -> Any:
    """Return sin a for |a| <= pi / 4."""
    t = a * a
    series = -1 / 1307674368000
    series = series * t + 1 / 6227020800
    series = series * t - 1 / 39916800
    series = series * t + 1 / 362880
    series = series * t - 1 / 5040
    series = series * t + 1 / 120
    series = series * t - 1 / 6
    return a + a * t * series


@njit(error_model="numpy", fastmath={"contract"}, nogil=True)
def cosine(a: Any) -> Any:
    """Return cos a for |a| <= pi / 4."""
    t = a * a
    series = 1 / 20922789888000
    series = series * t - 1 / 87178291200
    series = series * t + 1 / 479001600
    series = series * t - 1 / 3628800
    series = series * t + 1 / 40320
    series = series * t - 1 / 720
    series = series * t + 1 / 24
    series = series * t - 1 / 2
    return 1.0 + t * series
