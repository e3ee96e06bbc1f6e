"""Logarithm, exponential and random directions without a branch or a call, so that several lanes go at once.

Question answered: how does one take 256 logarithms in the time of forty?  The functions of the C library are called
for one number at a time; polynomials after an exact reduction of the argument are not:

    log u = e log 2 + 2 atanh((m - 1) / (m + 1)),   u = m 2^e,  sqrt(1/2) < m <= sqrt 2
    exp x = 2^q exp r,                              q = round(x / log 2),  |r| <= log(2) / 2
    sin a, cos a,                                   |a| <= pi / 4

The coefficients of exp are those of the series itself, cut where a term is below 1e-17; those of log, sin and cos fit
their interval to 2^-57 or better.  Polynomials are taken by halves (Estrin's form), since in Horner's each product
waits for the one before.  No other reordering of sums is allowed here: the reductions rest on the order.
Source of the coefficients: FreeBSD's msun (Sun Microsystems 1993), e_log.c, k_sin.c, k_cos.c.
Called by the kernels, in loops over lanes.
"""

import math
from typing import Any

import numpy as np
from llvmlite import ir
from numba import float64, uint64
from numba.extending import intrinsic

from lab.fast.kernel import PRODUCTS, kernel

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
# of log: 2 atanh(s) = 2 s + s t (L1 + L2 t + ...), t = s^2; of sin and cos
L1, L2, L3 = 6.666666666666735130e-01, 3.999999999940941908e-01, 2.857142874366239149e-01
L4, L5, L6 = 2.222219843214978396e-01, 1.818357216161805012e-01, 1.531383769920937332e-01
L7 = 1.479819860511658591e-01
S1, S2, S3 = -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04
S4, S5, S6 = 2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10
C1, C2, C3 = 4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05
C4, C5, C6 = -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11


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


@kernel(PRODUCTS)
def uniform(bits: Any) -> Any:
    """Return a number of (0, 1], uniform on a grid of 2^-52, from 64 random bits."""
    return 2.0 - as_double((bits >> UNUSED) | ONE)


@kernel(PRODUCTS)
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
    t2 = t * t
    t4 = t2 * t2
    series = (L1 + L2 * t) + (L3 + L4 * t) * t2 + ((L5 + L6 * t) + L7 * t2) * t4
    return exponent * LOG_2_HIGH + (2.0 * s + (s * t * series + exponent * LOG_2_LOW))


@kernel(PRODUCTS)
def exp(x: Any) -> Any:
    """Return exp x for x <= 0, to a few units in the last place; 0 below -708, -inf included."""
    held = x if x > SMALLEST else SMALLEST
    shifted = held * (1.0 / math.log(2.0)) + ROUNDER
    q = shifted - ROUNDER
    r = (held - q * LOG_2_HIGH) - q * LOG_2_LOW
    r2 = r * r
    r4 = r2 * r2
    low = (1 / 2 + 1 / 6 * r) + (1 / 24 + 1 / 120 * r) * r2
    high = (1 / 720 + 1 / 5040 * r) + (1 / 40320 + 1 / 362880 * r) * r2
    series = low + (high + ((1 / 3628800 + 1 / 39916800 * r) + (1 / 479001600 + 1 / 6227020800 * r) * r2) * r4) * r4
    value = (r * r * series + r + 1.0) * as_double((as_bits(shifted) + BIAS) << EXPONENT)
    return value if x > SMALLEST else 0.0


@kernel(PRODUCTS)
def sine(a: Any) -> Any:
    """Return sin a for |a| <= pi / 4."""
    t = a * a
    t2 = t * t
    series = (S1 + S2 * t) + ((S3 + S4 * t) + (S5 + S6 * t) * t2) * t2
    return a + a * t * series


@kernel(PRODUCTS)
def cosine(a: Any) -> Any:
    """Return cos a for |a| <= pi / 4."""
    t = a * a
    t2 = t * t
    series = (C1 + C2 * t) + ((C3 + C4 * t) + (C5 + C6 * t) * t2) * t2
    return 1.0 + t * (series * t - 0.5)
