"""Energy balance, efficiency and optimum of a flat cushion, exact on a piecewise linear curve.

A product of the static stress sigma_st (weight over area) that falls from the height h and crushes
a cushion of the thickness T to the strain e has lost the energy sigma_st (h + e T) per area; the
cushion has taken T W(e), where W is the area under its stress-strain curve. Both are equal at the
stop. There the deceleration is G = sigma / sigma_st - 1 in g; force over weight is G + 1. sigma is
the largest stress until the stop, which is the stress at the stop unless the curve falls. Waves,
the cushion's own mass, and rebound are neglected.

Curves are given by points, from rest at a strain of 0, and are linear between them. Two points at
one strain are a jump.

G. Gruenbaum, J. Miltz: Static versus dynamic evaluation of cushioning properties of plastic foams.
    J. Appl. Polym. Sci. 28 (1983) 135-143
J. Miltz, G. Gruenbaum: Evaluation of cushioning properties of plastic foams from compressive
    measurements. Polym. Eng. Sci. 21 (1981) 1010-1014
M. Avalle, G. Belingardi, R. Montanini: Characterization of polymeric structural foams under
    compressive impact loading by means of energy-absorption diagram. Int. J. Impact Eng. 25 (2001)
    455-472
Q. M. Li, I. Magkiriadis, J. J. Harrigan: Compressive strain at the onset of densification of
    cellular solids. J. Cell. Plast. 42 (2006) 371-392
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taichi_foam.errors import UserError

Array = NDArray[np.float64]

ROUNDING = 1e-12
"""A shortfall of energy of this fraction is one of rounding."""

USUAL_LOAD, USUAL_PEAK = 6.0, 3.0
"""A curve's usual range begins at the optimum over the one, and ends at the least peak times the
other."""

STANDS = 0.95
"""Part of the plateau's stress that foam carries at rest."""


def absorbed_energy(strain: ArrayLike, stress: ArrayLike) -> Array:
    """(n,) energy per volume W [J/m3] taken from the first point of a curve up to each."""
    e, s = np.asarray(strain, dtype=np.float64), np.asarray(stress, dtype=np.float64)
    parts = 0.5 * (s[1:] + s[:-1]) * np.diff(e)
    return np.append(0.0, np.cumsum(parts))


def efficiency(strain: ArrayLike, stress: ArrayLike) -> Array:
    """(n,) energy efficiency W / sigma at each point (Miltz & Gruenbaum 1981), 0 without stress.

    It is the stroke, as a strain, of an ideal absorber that takes the energy at the stress.
    """
    return _ratio(absorbed_energy(strain, stress), np.asarray(stress, dtype=np.float64))


def ideality(strain: ArrayLike, stress: ArrayLike) -> Array:
    """(n,) W / (sigma e) at each point (Avalle et al. 2001): 1 for an ideal absorber, 0 at rest."""
    e, s = np.asarray(strain, dtype=np.float64), np.asarray(stress, dtype=np.float64)
    return _ratio(absorbed_energy(e, s), s * e)


def densification_onset(strain: ArrayLike, stress: ArrayLike) -> float:
    """Strain at which densification begins: where d(efficiency)/d(strain) = 0 (Li et al. 2006).

    The efficiency of a piecewise linear curve is largest at one of its points: within a segment it
    rises, falls, or passes a minimum. It is the last point of a curve that does not densify. Raises
    UserError: no curve.
    """
    e, s = points(strain, stress)
    return float(e[int(np.argmax(efficiency(e, s)))])


@dataclass(frozen=True)
class Stop:
    """Where a cushion has stopped a product.

    strain  strain of the cushion
    stress  largest stress until then [Pa]
    g       largest deceleration of the product [g]
    """

    strain: float
    stress: float
    g: float


def stop(
    strain: ArrayLike,
    stress: ArrayLike,
    static_stress: float,
    drop_height: float,
    thickness: float,
) -> Stop | None:
    """The stop of a product of a static stress [Pa] after a fall [m] on a cushion [m] of a curve.

    None: the foam cannot absorb the energy before its curve ends. Raises UserError: no curve, or a
    number that is not above 0.
    """
    check_above_0(static_stress=static_stress, drop_height=drop_height, thickness=thickness)
    e, s = points(strain, stress)
    return _stop(e, s, static_stress, drop_height, thickness)


def cushion_curve(
    strain: ArrayLike,
    stress: ArrayLike,
    drop_height: float,
    thickness: float,
    static_stresses: ArrayLike,
) -> Array:
    """(n,) largest decelerations [g] of products of n static stresses [Pa]; NaN where it bottoms.

    Raises UserError as `stop`.
    """
    e, s = points(strain, stress)
    check_above_0(drop_height=drop_height, thickness=thickness)
    statics = np.asarray(static_stresses, dtype=np.float64).ravel().tolist()
    for each in statics:
        check_above_0(static_stress=each)
    found = [_stop(e, s, each, drop_height, thickness) for each in statics]
    return np.array([math.nan if each is None else each.g for each in found])


def optimum(
    strain: ArrayLike, stress: ArrayLike, drop_height: float, thickness: float
) -> tuple[float, Stop]:
    """The static stress [Pa] of least deceleration, and the stop there.

    The deceleration falls with the static stress up to the end of a curve that does not densify:
    the optimum is there then. Raises UserError as `stop`.

    Over the strain e of the stop, the static stress is T W / (h + e T), and G + 1 is
    sigma (h + e T) / (T W). Within a segment of the curve, both are extreme at roots of quadratics.
    """
    check_above_0(drop_height=drop_height, thickness=thickness)
    e, s, most = _with_largest(*points(strain, stress))
    width = np.diff(e)
    slope, rise = _ratio(np.diff(s), width), _ratio(np.diff(most), width)
    start, before, s, top = e[:-1], absorbed_energy(e, s)[:-1], s[:-1], most[:-1]
    way = drop_height / thickness + start
    x = np.array(
        [
            np.zeros_like(width),
            width,
            # of G, where the curve is at its largest stress: d(ln sigma (h/T + e) / W)/de = 0
            *_roots(
                0.5 * rise * (s - rise * way),
                rise * (2.0 * before - s * way),
                (rise * way + s) * before - s**2 * way,
            ),
            # of the static stress: sigma (h/T + e) = W
            *_roots(0.5 * slope, slope * way, s * way - before),
        ]
    )
    x = np.clip(np.nan_to_num(x), 0.0, width)
    static = (before + s * x + 0.5 * slope * x**2) / (way + x)
    largest = top + rise * x
    force = np.divide(largest, static, out=np.full_like(static, math.inf), where=static > 0.0)
    best = np.unravel_index(int(np.argmin(force)), force.shape)
    found = Stop(float((start + x)[best]), float(largest[best]), float(force[best]) - 1.0)
    return float(static[best]), found


def usual_range(
    strain: ArrayLike, stress: ArrayLike, drop_height: float, thickness: float, plateau: float
) -> tuple[float, float]:
    """The static stresses [Pa] between which a cushion curve is of interest.

    From a sixth of the optimum to where the deceleration is three times the least one, or a fifth
    beyond the optimum where the curve ends there; and at most to 95 % of the foam's `plateau`
    stress [Pa]: under more it is crushed by the weight alone. Raises UserError as `stop`.
    """
    best, least = optimum(strain, stress, drop_height, thickness)
    most = STANDS * plateau
    if best < most:
        static = np.geomspace(best, most, 400)
        g = cushion_curve(strain, stress, drop_height, thickness, static)
        beyond = static[1:][g[1:] <= USUAL_PEAK * least.g]
        most = min(float(beyond.max(initial=0.0)) or 1.2 * best, most)
    return min(best / USUAL_LOAD, 0.5 * most), most


def stopping_strain(strain: Array, stress: Array, energy: float, load: float) -> float | None:
    """The strain at which a curve from rest has taken an energy [J/m3] and a load's work.

    `load` [Pa] is the stress that goes on pressing while the foam is crushed: the first strain
    above 0 at which W = energy + load strain. None: the curve ends before.
    """
    taken = absorbed_energy(strain, stress)
    due = energy + load * strain
    excess = taken - due
    width, net = np.diff(strain), stress[:-1] - load
    slope = _ratio(np.diff(stress), width)
    # within a segment that falls, the excess may be largest at the strain where stress is the load
    crest = _ratio(-net, slope)
    within = (slope < 0.0) & (crest > 0.0) & (crest < width)
    top = excess[:-1] + np.where(within, 0.5 * net * crest, -math.inf)
    reached = np.maximum(excess[1:], top) >= -ROUNDING * due[1:]
    at = int(np.argmax(reached))
    if not reached[at]:
        return None
    # net x + slope x^2 / 2 is what is missing; of two roots, the one at which the excess rises
    missing, first, second = max(-float(excess[at]), 0.0), float(net[at]), float(slope[at])
    root = math.sqrt(max(first**2 + 2.0 * second * missing, 0.0))
    if first < 0.0 < second:
        way = (root - first) / second
    else:
        way = 2.0 * missing / (first + root) if missing > 0.0 else 0.0
    return float(strain[at] + min(way, float(width[at])))


def largest_until(strain: Array, stress: Array, end: float) -> float:
    """The largest stress [Pa] of a curve up to a strain; of a jump there, its lower end."""
    before = stress[: max(int(np.searchsorted(strain, end)), 1)]
    return max(float(before.max()), _at(strain, stress, end))


def _stop(
    e: Array, s: Array, static_stress: float, drop_height: float, thickness: float
) -> Stop | None:
    strain = stopping_strain(e, s, static_stress * drop_height / thickness, static_stress)
    if strain is None:
        return None
    largest = largest_until(e, s, strain)
    return Stop(strain, largest, largest / static_stress - 1.0)


def _at(strain: Array, stress: Array, where: float) -> float:
    """Stress at a strain; of a jump there, its lower end."""
    at = int(np.searchsorted(strain, where))
    if at == 0 or strain[at] == where:
        return float(stress[at])
    share = (where - strain[at - 1]) / (strain[at] - strain[at - 1])
    return float(stress[at - 1] + share * (stress[at] - stress[at - 1]))


def _with_largest(strain: Array, stress: Array) -> tuple[Array, Array, Array]:
    """A curve and its largest stress so far, with points added where it comes to exceed that."""
    most = np.maximum.accumulate(stress)
    again = (most[:-1] > stress[:-1]) & (stress[1:] > most[:-1])
    at = np.flatnonzero(again)
    share = (most[at] - stress[at]) / (stress[at + 1] - stress[at])
    e = np.insert(strain, at + 1, strain[at] + share * (strain[at + 1] - strain[at]))
    s = np.insert(stress, at + 1, most[at])
    return e, s, np.maximum.accumulate(s)


def _roots(a: Array, b: Array, c: Array) -> tuple[Array, Array]:
    """The roots of a x^2 + b x + c; NaN or infinite where there is none."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        half = -0.5 * (b + np.copysign(np.sqrt(b**2 - 4.0 * a * c), b))
        return half / a, c / half


def _ratio(above: Array, below: Array) -> Array:
    """The quotient, and 0 where the divisor is not above or below 0."""
    return np.divide(above, below, out=np.zeros_like(above), where=below != 0.0)


def points(strain: ArrayLike, stress: ArrayLike) -> tuple[Array, Array]:
    """The points of a curve from rest. Raises UserError: they are none."""
    e, s = np.asarray(strain, dtype=np.float64), np.asarray(stress, dtype=np.float64)
    if e.ndim != 1 or e.shape != s.shape or e.size < 2:
        raise UserError(
            f"curve of {e.size} strains and {s.size} stresses: must be at least two of each, as "
            "many strains as stresses"
        )
    if not (np.isfinite(e).all() and np.isfinite(s).all()):
        raise UserError("curve: a strain or a stress is not finite; remove that point")
    if e[0] != 0.0:
        raise UserError(
            f"curve: begins at a strain of {e[0]:g}: must begin at rest; add a point at 0 strain, "
            "and give strains as positive in compression"
        )
    if (np.diff(e) < 0.0).any():
        at = int(np.argmax(np.diff(e) < 0.0)) + 1
        raise UserError(
            f"curve: strain {e[at]:g} of point {at + 1} is below the one before, {e[at - 1]:g}: "
            "strains must not fall; cut the unloading off"
        )
    if not 0.0 < e[-1] <= 1.0:
        raise UserError(
            f"curve: ends at a strain of {e[-1]:g}: must end above 0, at most at 1; strains are "
            "fractions (80 % is 0.80)"
        )
    if s.min() < 0.0 or s.max() == 0.0:
        raise UserError(
            f"curve: stresses from {s.min():g} to {s.max():g} Pa: must not be below 0, nor all 0; "
            "stresses are positive in compression"
        )
    return e, s


EXAMPLES = {
    "static_stress": "Pa; 4 kPa is 4e3",
    "drop_height": "m; 76 cm is 0.76",
    "thickness": "m; 50 mm is 0.05",
    "width": "m; 200 mm is 0.2",
    "depth": "m; 200 mm is 0.2",
    "critical_velocity": "m/s",
    "critical_g": "g",
}
"""Units of numbers that must be above 0, with examples for messages."""


def check_above_0(**values: Any) -> None:
    """Raise UserError for the first of some `EXAMPLES` that is not a finite number above 0."""
    for name, value in values.items():
        is_number = isinstance(value, Real) and not isinstance(value, bool)
        if not (is_number and 0.0 < float(value) < math.inf):
            given = f"{value:g}" if is_number else repr(value)
            raise UserError(f"{name} = {given}: must be a number above 0 {EXAMPLES[name]}")
