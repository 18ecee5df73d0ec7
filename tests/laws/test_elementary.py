"""Exponential, logarithm, power and sine against NumPy, most by the count of doubles between."""

import math

import numpy as np
import pytest
import taichi as ti
from hypothesis import given, settings
from hypothesis import strategies as st

from taichi_foam.laws import elementary

pytestmark = pytest.mark.usefixtures("taichi_runtime")

vec4 = ti.types.vector(4, ti.f64)
Scalars = ti.types.ndarray(dtype=ti.f64, ndim=1)
Vectors = ti.types.ndarray(dtype=vec4, ndim=1)

# Errors of 1.2 ulp here and less than 1 ulp in NumPy keep the two within two doubles.
NEIGHBOURS = 2

POINTS = 4096

ANY = settings(deadline=None)  # the first example compiles


def kernel_of(function, kind):
    """A kernel that maps a function of one number over an array of numbers, or of vectors."""

    @ti.kernel
    def over(x: kind, out: kind):
        for k in range(x.shape[0]):
            out[k] = function(x[k])

    return over


def kernel_of_powers(kind):
    @ti.kernel
    def over(x: kind, y: kind, out: kind):
        for k in range(x.shape[0]):
            out[k] = elementary.power(x[k], y[k])

    return over


_exp, _exp_of_four = kernel_of(elementary.exp, Scalars), kernel_of(elementary.exp, Vectors)
_log, _log_of_four = kernel_of(elementary.log, Scalars), kernel_of(elementary.log, Vectors)
_power, _power_of_four = kernel_of_powers(Scalars), kernel_of_powers(Vectors)


@ti.kernel
def _sine_cosine(x: Scalars, sine: Scalars, cosine: Scalars):
    for k in range(x.shape[0]):
        sine[k], cosine[k] = elementary.sine_cosine(x[k])


@ti.kernel
def _powers_of_one(x: ti.f64, y: Vectors, out: Vectors):
    for k in range(y.shape[0]):
        out[k] = elementary.power(x, y[k])


@ti.kernel
def _one_power(x: Vectors, y: ti.f64, out: Vectors):
    for k in range(x.shape[0]):
        out[k] = elementary.power(x[k], y)


@ti.kernel
def _any_positive(x: Scalars, found: Scalars):
    for k in range(x.shape[0]):
        found[k] = elementary.any_of(x[k] > 0.0)


@ti.kernel
def _any_of_four_positive(x: Vectors, found: Scalars):
    for k in range(x.shape[0]):
        found[k] = elementary.any_of(x[k] > 0.0)


def mapped(kernel, *arguments) -> np.ndarray:
    """`kernel` over arrays, and over numbers as over arrays of one."""
    arrays = [np.atleast_1d(np.asarray(x, dtype=np.float64)) for x in arguments]
    out = np.empty_like(arrays[0])
    kernel(*arrays, out)
    return out


def steps_between(found: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """How many doubles further one is than the other: as integers their bits are in order."""
    assert np.array_equal(np.signbit(found), np.signbit(expected))
    return np.abs(found.view(np.int64) - expected.view(np.int64))


def spread(least: float, greatest: float, seed: int = 1) -> np.ndarray:
    """Random numbers, evenly spread, with both ends."""
    x = np.random.default_rng(seed).uniform(least, greatest, POINTS)
    x[0], x[-1] = least, greatest
    return x


@pytest.mark.parametrize("reach", [1e-9, 0.34, 0.36, 1.0, 40.0, 708.0])
def test_the_exponential_is_numpys(reach: float) -> None:
    x = spread(-reach, reach)
    assert steps_between(mapped(_exp, x), np.exp(x)).max() <= NEIGHBOURS


def test_the_exponential_is_right_beside_every_seam() -> None:
    """At (n + 1/2) ln 2 the binary exponent goes up by one: from -1021 to 1024 in all."""
    seams = (np.arange(-1021, 1024) + 0.5) * math.log(2.0)
    for x in (seams * (1.0 - 1e-15), seams, seams * (1.0 + 1e-15)):
        assert steps_between(mapped(_exp, x), np.exp(x)).max() <= NEIGHBOURS


def test_the_exponential_at_its_ends() -> None:
    """From the last that is normal straight to 0, and from the last that is finite to infinity."""
    below, above = np.nextafter(-708.0, -np.inf), np.nextafter(elementary.GREATEST_EXPONENT, np.inf)
    x = [0.0, -0.0, below, -1e4, -1e300, -np.inf, above, 1e4, 1e300, np.inf, np.nan]
    expected = [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, np.inf, np.inf, np.inf, np.inf, np.nan]
    np.testing.assert_array_equal(mapped(_exp, x), expected)
    ends = np.array([-708.0, elementary.GREATEST_EXPONENT])
    assert steps_between(mapped(_exp, ends), np.exp(ends)).max() <= NEIGHBOURS


@pytest.mark.parametrize("reach", [1e-9, 0.15, 0.151, 3.0, 300.0, 307.6])
def test_the_logarithm_is_numpys(reach: float) -> None:
    """Of 10^-reach to 10^reach: near 1, where it vanishes, as everywhere."""
    x = 10.0 ** spread(-reach, reach)
    assert steps_between(mapped(_log, x), np.log(x)).max() <= NEIGHBOURS


def test_the_logarithm_is_right_beside_every_seam() -> None:
    """Every power of two, where the mantissa starts again, and every sqrt(2) of it."""
    for mantissa in (1.0 - 2.0**-53, 1.0, 1.0 + 2.0**-52, math.sqrt(2.0) * (1.0 + 2.0**-52)):
        x = np.ldexp(mantissa, np.arange(-1021, 1023))
        assert steps_between(mapped(_log, x), np.log(x)).max() <= NEIGHBOURS


def test_the_logarithm_at_its_ends() -> None:
    x = [1.0, 0.0, -0.0, 2.0**-1023, np.inf, -1.0, -np.inf, np.nan]
    expected = [0.0, -np.inf, -np.inf, -np.inf, np.inf, np.nan, np.nan, np.nan]
    np.testing.assert_array_equal(mapped(_log, x), expected)
    ends = np.array([elementary.SMALLEST, elementary.LARGEST])
    assert steps_between(mapped(_log, ends), np.log(ends)).max() <= NEIGHBOURS


def test_powers_are_numpys() -> None:
    """What the foam's law asks for, a width in (0, 1) to an exponent about 1, and far beyond."""
    for reach, exponents in ((3.0, 3.0), (300.0, 1.0), (0.01, 300.0)):
        x, y = 10.0 ** spread(-reach, reach), spread(-exponents, exponents, seed=2)
        off = steps_between(mapped(_power, x, y), x**y)
        assert np.all(off <= 3 + 2 * np.abs(y * np.log(x)))


def test_powers_at_their_ends() -> None:
    x = [1.0, 1.0, 5.0, 0.0, 0.0, 0.5, 2.0, np.nan, 2.0]
    y = [0.0, 1e300, 0.0, 2.0, -2.0, 1e6, 1e6, 1.0, np.nan]
    expected = [1.0, 1.0, 1.0, 0.0, np.inf, 0.0, np.inf, np.nan, np.nan]
    np.testing.assert_array_equal(mapped(_power, x, y), expected)


def test_vectors_are_taken_element_by_element() -> None:
    """The same digits as one by one, ends included; a power's one side may be a single number."""
    x = spread(-720.0, 720.0)
    x[:4] = -np.inf, np.inf, np.nan, 0.0
    rows = x.reshape(-1, 4)
    np.testing.assert_array_equal(mapped(_exp_of_four, rows).ravel(), mapped(_exp, x))
    base = mapped(_exp, x)
    np.testing.assert_array_equal(
        mapped(_log_of_four, base.reshape(-1, 4)).ravel(), mapped(_log, base)
    )
    y = spread(-1.5, 1.5, seed=2)
    found = mapped(_power_of_four, base.reshape(-1, 4), y.reshape(-1, 4))
    np.testing.assert_array_equal(found.ravel(), mapped(_power, base, y))
    out = np.empty_like(found)
    _powers_of_one(0.7, y.reshape(-1, 4), out)
    np.testing.assert_array_equal(out.ravel(), mapped(_power, np.full_like(y, 0.7), y))
    _one_power(base.reshape(-1, 4), 1.7, out)
    np.testing.assert_array_equal(out.ravel(), mapped(_power, base, np.full_like(base, 1.7)))


@ANY
@given(st.floats(-708.0, 709.0))
def test_the_logarithm_undoes_the_exponential(x: float) -> None:
    """e^x is off by 2^-52 of itself, which moves its logarithm by that; and log's own ulp."""
    assert mapped(_log, mapped(_exp, x))[0] == pytest.approx(x, rel=2.0**-52, abs=2.0**-52)


@ANY
@given(st.floats(-350.0, 350.0), st.floats(-350.0, 350.0))
def test_the_exponential_never_falls_and_turns_sums_into_products(x: float, y: float) -> None:
    """Within two ulp there is no order; the rounding of the sum is one in the ratio too."""
    of_x, of_y, of_sum = mapped(_exp, [x, y, x + y])
    if x <= y:
        assert of_x <= of_y * (1.0 + 2.0**-51)
    assert of_sum == pytest.approx(of_x * of_y, rel=2.0**-53 * (8.0 + abs(x + y)))


@ANY
@given(st.floats(1e-3, 1e3), st.integers(0, 12))
def test_a_whole_power_is_a_product(x: float, n: int) -> None:
    expected = math.prod([x] * n)
    allowed = 2.0**-52 * (2.0 + 2.0 * abs(n * math.log(x)) + n)
    assert mapped(_power, x, n)[0] == pytest.approx(expected, rel=allowed)


def test_sine_and_cosine_are_good_to_rounding_and_symmetric_to_the_last_bit() -> None:
    """1.5e-16 of 1, half of that NumPy's, over many turns; exact where an angle begins."""
    rng = np.random.default_rng(7)
    x = np.concatenate([
        np.linspace(-2 * math.pi, 2 * math.pi, POINTS), rng.uniform(-1e5, 1e5, POINTS),
        rng.uniform(-1e-6, 1e-6, POINTS), np.arange(-8, 9) * 0.25 * math.pi, [0.0],
    ])  # fmt: skip
    sine, cosine, odd, even = (np.empty_like(x) for _ in range(4))
    _sine_cosine(x, sine, cosine)
    _sine_cosine(-x, odd, even)
    np.testing.assert_allclose(sine, np.sin(x), rtol=0, atol=2.3e-16)
    np.testing.assert_allclose(cosine, np.cos(x), rtol=0, atol=2.3e-16)
    np.testing.assert_array_equal(odd, -sine)
    np.testing.assert_array_equal(even, cosine)
    assert (sine[-1], cosine[-1]) == (0.0, 1.0)
    small = np.abs(x) < 1e-6
    np.testing.assert_allclose(sine[small], np.sin(x[small]), rtol=2.3e-16)


def test_any_of_a_mask_is_told_for_numbers_and_for_vectors() -> None:
    signs = np.array([[1.0 if n >> place & 1 else -1.0 for place in range(4)] for n in range(16)])
    alone, of_four = np.empty(signs.size), np.empty(len(signs))
    _any_positive(signs.ravel(), alone)
    _any_of_four_positive(signs, of_four)
    np.testing.assert_array_equal(alone, signs.ravel() > 0.0)
    np.testing.assert_array_equal(of_four, (signs > 0.0).any(axis=1))
