"""Exponential, logarithm, power and sine in plain float64 arithmetic, of scalars and vectors alike.

SPIR-V, and so Vulkan, has these in 32 bits only. Every backend uses these functions, the CPU too,
so that all agree to rounding: they are sums, products, one division, comparisons, selections and
shifts. Nothing branches on a value and no bits are reinterpreted, so the compiler can vectorise
them for four numbers at once, where a library function would be called four times.

Errors are given in ulp, the distance from the true value to the next double, and were measured
against 40 digits. A compiler that fuses products with sums may change them by a part of an ulp.
"""

import math
from typing import Any

from taichi_foam.backend import ti

# The exponential is set to 0 below the first (where it is 3e-308; subnormal numbers are flushed to
# 0 by many devices, and in a process that has imported Taichi), and infinite above the second.
LEAST_EXPONENT = -708.0
GREATEST_EXPONENT = 709.782712893384

SMALLEST = 2.0**-1022  # normal number
LARGEST = 2.0**1023 * (2.0 - 2.0**-52)

# ln 2 as a sum: the first part has 32 bits, so that its product with a binary exponent is exact.
LN_2_HIGH = math.floor(math.log(2.0) * 2.0**32) / 2.0**32
LN_2_LOW = 1.9082149292705877e-10
PER_LN_2 = 1.0 / math.log(2.0)
SQRT_2 = math.sqrt(2.0)

# The binary exponent of LEAST_EXPONENT: counted from there, no exponent is negative.
LEAST_BINARY = -1021
# Powers of two, their inverses and their logarithms: enough to bring any number down to 1.
HALVINGS = tuple((2.0**k, 2.0**-k, float(k)) for k in (512, 256, 128, 64, 32, 16, 8, 4, 2, 1))

# pi / 2 as a sum: the first part has 33 bits, so that its product with fewer than 2^20 is exact.
HALF_PI_HIGH = math.floor(0.5 * math.pi * 2.0**32) / 2.0**32
HALF_PI_LOW = (0.5 * math.pi - HALF_PI_HIGH) + 6.123233995736766e-17
PER_HALF_PI = 2.0 / math.pi

# Taylor's coefficients in r^2: of sin(r) / r - 1, from 1/17! to -1/3!, and of cos(r) - 1, from
# 1/16! to -1/2!. For |r| <= pi / 4 the rest is below 2^-58.
SINE_SERIES = tuple((-1) ** k / math.factorial(2 * k + 1) for k in range(8, 0, -1))
COSINE_SERIES = tuple((-1) ** k / math.factorial(2 * k) for k in range(8, 0, -1))

# Taylor's coefficients: of exp(r) - 1, from 1/13! to 1; and of log((1 + s) / (1 - s)) / s - 2 in
# s^2, from 2/21 to 2/3. For |r| <= ln(2) / 2 and |s| <= 0.172 the rest is below 2^-57 of the whole.
EXP_SERIES = tuple(1.0 / math.factorial(k) for k in range(13, 0, -1))
LOG_SERIES = tuple(2.0 / k for k in range(21, 1, -2))


@ti.func
def smaller(x, y):
    """The smaller of two numbers; `y` if either is NaN.

    It takes one instruction; ti.min, which returns the number that is not NaN, takes three.
    """
    return ti.select(x < y, x, y)


@ti.func
def larger(x, y):
    """The larger of two numbers; `y` if either is NaN."""
    return ti.select(x > y, x, y)


@ti.func
def any_of(mask: ti.template()) -> ti.i32:
    """Whether a mask is set, for a vector: in any place."""
    if ti.static(width(mask) == 0):
        return ti.i32(mask)
    found = ti.i32(mask[0])
    for place in ti.static(range(1, width(mask))):
        found |= ti.i32(mask[place])
    return found


def width(value: Any) -> int:
    """Number of places of a value in kernels; 0: it is a scalar."""
    return value.n if value.is_tensor() else 0


@ti.func
def exp(x):
    """e^x within 1.2 ulp for x from -708 to 709.78; 0 below that, infinity above, NaN of NaN."""
    bounded = ti.select(x > LEAST_EXPONENT, ti.min(x, GREATEST_EXPONENT), LEAST_EXPONENT)
    # x = n ln 2 + r with |r| <= ln(2) / 2, so that e^x = 2^n e^r; r propagates a NaN
    n = ti.floor(bounded * PER_LN_2 + 0.5)
    r = (x - n * LN_2_HIGH) - n * LN_2_LOW
    series = r * EXP_SERIES[0]
    for coefficient in ti.static(EXP_SERIES[1:]):
        series = (series + coefficient) * r
    # 2^n = 2^(2 half + odd + LEAST_BINARY); half has 10 bits, shifted in groups of 2, 4 and 4
    binary = ti.cast(n, ti.i32) - LEAST_BINARY
    half = binary >> 1
    root = ti.cast(1 << (half >> 8), ti.f64)
    for shift in ti.static((4, 0)):
        for _ in ti.static(range(4)):
            root *= root
        root *= ti.cast(1 << ((half >> shift) & 15), ti.f64)
    odd = ti.cast(1 + (binary & 1), ti.f64)
    y = (1.0 + series) * 2.0**LEAST_BINARY * odd * root * root
    y = ti.select(x < LEAST_EXPONENT, 0.0, y)
    return ti.select(x > GREATEST_EXPONENT, ti.math.inf, y)


@ti.func
def log(x):
    """Natural logarithm within 1 ulp for every normal x > 0.

    Minus infinity of 0 and of subnormal x, infinity of infinity, NaN of negative x and of NaN.
    """
    # x = 2^n m with 1 <= m < 2, and then with sqrt(1/2) < m <= sqrt(2)
    small = x < 1.0
    n = ti.select(small, -1022.0, 0.0)
    m = ti.select(small, x * 2.0**1022, x)
    for power_of_2, inverse, exponent in ti.static(HALVINGS):
        large = m >= power_of_2
        n += ti.select(large, exponent, 0.0)
        m *= ti.select(large, inverse, 1.0)
    upper = m > SQRT_2
    n += ti.select(upper, 1.0, 0.0)
    m *= ti.select(upper, 0.5, 1.0)
    # log m = 2 s + s series = f - s (f - series) with m = 1 + f: f is exact, and s is small
    f = m - 1.0
    s = f / (m + 1.0)
    square = s * s
    series = square * LOG_SERIES[0]
    for coefficient in ti.static(LOG_SERIES[1:]):
        series = (series + coefficient) * square
    y = n * LN_2_HIGH + (f - (s * (f - series) - n * LN_2_LOW))
    y = ti.select(x < SMALLEST, -ti.math.inf, y)
    y = ti.select(x < 0.0, ti.math.nan, y)
    return ti.select(x > LARGEST, x, y)


@ti.func
def sine_cosine(x):
    """Sine and cosine of an angle [rad] within 1e-16 for |x| up to 1e5, NaN of NaN.

    The sine is odd and the cosine even to the last bit.
    """
    size = ti.abs(x)
    # |x| = n pi / 2 + r with |r| <= pi / 4
    n = ti.floor(size * PER_HALF_PI + 0.5)
    r = (size - n * HALF_PI_HIGH) - n * HALF_PI_LOW
    square = r * r
    odd, even = SINE_SERIES[0], COSINE_SERIES[0]
    for k in ti.static(range(1, len(SINE_SERIES))):
        odd = odd * square + SINE_SERIES[k]
        even = even * square + COSINE_SERIES[k]
    sine, cosine = r + r * (odd * square), 1.0 + even * square
    quarter = ti.cast(n, ti.i32) & 3
    swapped = (quarter & 1) == 1
    found_sine, found_cosine = ti.select(swapped, cosine, sine), ti.select(swapped, sine, cosine)
    found_sine = ti.select((quarter >= 2) != (x < 0.0), -found_sine, found_sine)
    found_cosine = ti.select(quarter == 1 or quarter == 2, -found_cosine, found_cosine)
    return found_sine, found_cosine


@ti.func
def power(x, y):
    """x^y = exp(y log x) within 2 + 2 |y log x| ulp, for every normal x > 0.

    The exponent's own error, by its rounding and the logarithm's, is the relative error of the
    power. One of x and y may be a scalar where the other is a vector.
    """
    return exp(y * log(x))
