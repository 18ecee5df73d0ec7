"""A measured curve of compressive stress over strain, and what is read off it.

Strains and stresses are engineering ones, compression positive here as in the test. Between its
points the curve is straight. Beyond its last one it goes on as a power of the distance to
locking, with the slope of its end, so that whatever a run reaches has a stress; a run says so.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator

from taichi_foam.laws.bond.base import TABLE_COLUMNS, TABLE_ROWS
from taichi_foam.parts import Part

Array = NDArray[np.float64]

STRESS, UNLOADING, IN_CELLS, CELLS_ENERGY, SHEAR = range(TABLE_COLUMNS)
"""Columns of the table that kernels read."""

MOST_POINTS = 2000
"""Of a curve; the table has half as many rows."""

LEAST_STRESS, LARGEST_STRESS = 500.0, 1e9
"""What a curve's largest stress [Pa] may be: less is stress in kPa or MPa."""

PLATEAU = (0.2, 0.4)
"""Strains between which the mean stress is that of the plateau (ISO 13314)."""

LOCKS = 0.75
"""Without a locking strain: the share of what is left beyond the last point that crush closes."""

SECANT = 0.005
"""Strain over which a slope of the curve is taken."""

FLATTEST = 0.02
"""What of a bond's length is always left, as far as its turning goes."""

SMOOTHED = 0.02
"""Strain over which kinks of the rise in shear are smoothed."""

END = 0.02
"""Strain before the last point over which the slope of a curve's end is taken."""

LEAST_POWER = 0.5
"""With which a curve goes on at least: one that ends on its plateau is to lock, too."""

STEEPEST = 20.0
"""Largest power with which a curve goes on: a jump at its end is not to become infinite."""

GUARD = 0.05
"""Within this part of the way from locking back to the last point the curve is its tangent."""


class Curve(Part):
    """Stress over strain of a compression test (any sampling, from rest).

    Every strain above the last one; stresses never fall. A first point at rest is added where there
    is none, at no stress. Stresses that fall, as by noise or after a first peak, are replaced
    by the rising curve next to them (isotonic regression, least squares); `smoothing` keeps
    the largest change.
    """

    strain: tuple[float, ...] = Field(
        description="engineering strains in compression, fractions, each above the one before",
        json_schema_extra={
            "allowed": f"2 to {MOST_POINTS:,} rising numbers",
            "fix": "strains are fractions (80 % is 0.80)",
        },
    )
    stress: tuple[float, ...] = Field(
        description="engineering stresses in compression there [Pa]",
        json_schema_extra={
            "allowed": "as many numbers as strains",
            "fix": "stresses are in pascals (0.12 MPa is 0.12e6)",
            "unit": "Pa",
        },
    )
    smoothing: float = Field(
        default=0.0,
        ge=0,
        description="by how much a stress was changed at most, so that none falls [Pa]",
        json_schema_extra={"allowed": "at least 0 Pa", "unit": "Pa"},
    )

    @field_validator("strain", "stress", mode="before")
    @classmethod
    def _listed(cls, value: Any) -> Any:
        if isinstance(value, np.ndarray):
            value = value.tolist()
        if isinstance(value, list):
            value = tuple(value)
        if isinstance(value, tuple):
            return tuple(float(each) if type(each) is int else each for each in value)
        return value

    @model_validator(mode="before")
    @classmethod
    def _upright(cls, data: Any) -> Any:
        """Positive in compression, from rest on, and rising."""
        numbers = _numbers(data)
        if numbers is None:
            return data  # what is wrong with it is said below
        strain, stress = numbers
        if strain.max() <= 0.0 and strain.min() < 0.0:
            strain = -strain
        if -stress.min() > stress.max():  # noise may have the other sign
            stress = -stress
        smoothing = data.get("smoothing", 0.0)
        if not (np.diff(strain) > 0.0).all() or strain[0] < 0.0:
            return {**data, "strain": tuple(strain.tolist()), "stress": tuple(stress.tolist())}
        if strain[0] > 0.0:
            strain, stress = np.append(0.0, strain), np.append(0.0, stress)
        if (np.diff(stress) < 0.0).any() or stress[0] != 0.0:
            from scipy.optimize import isotonic_regression  # takes long to load; few need it

            # rest is rest: it weighs so much that the regression leaves it where it is
            weights = np.ones(stress.size)
            weights[0] = 1e12
            wanted = np.append(0.0, np.maximum(stress[1:], 0.0))
            rising = np.maximum(isotonic_regression(wanted, weights=weights).x, 0.0)
            rising[0] = 0.0
            change = float(np.abs(rising - stress).max())
            if isinstance(smoothing, int | float):
                smoothing = max(float(smoothing), change)
            stress = rising
        return {
            **data,
            "strain": tuple(strain.tolist()),
            "stress": tuple(stress.tolist()),
            "smoothing": smoothing,
        }

    @model_validator(mode="after")
    def _check(self) -> Curve:
        problem = self._problem()
        if problem:
            raise ValueError(f"foam.curve{problem}")
        return self

    def _problem(self) -> str | None:
        strain, stress = self.strain, self.stress
        if len(strain) != len(stress):
            return (
                f": {len(strain)} strains and {len(stress)} stresses; each point needs both; "
                "add what is missing"
            )
        if not 2 <= len(strain) <= MOST_POINTS:
            return (
                f".strain: {len(strain):,} points; must be 2 to {MOST_POINTS:,}; `taichi-foam foam "
                "import` thins a test"
            )
        steps = np.diff(strain)
        if not (steps > 0.0).all():
            at = int(np.argmax(steps <= 0.0)) + 1
            word = "repeats" if strain[at] == strain[at - 1] else "is below"
            return (
                f".strain[{at}] = {strain[at]:g}: {word} the one before, {strain[at - 1]:g}; "
                "strains must rise from point to point; sort them, or cut the unloading off"
            )
        if strain[0] < 0.0:
            return (
                f".strain[0] = {strain[0]:g}: strains of both signs; must be from 0 up, all in "
                "compression; cut off what is before contact"
            )
        if strain[-1] >= 1.0:
            return (
                f".strain[{len(strain) - 1}] = {strain[-1]:g}: must be below 1; strains are "
                "fractions (80 % is 0.80)"
            )
        if strain[-1] < 0.05:
            return (
                f".strain[{len(strain) - 1}] = {strain[-1]:g}: the test ends before the foam is "
                "crushed; must reach at least 0.05"
            )
        if not LEAST_STRESS <= stress[-1] <= LARGEST_STRESS:
            return (
                f".stress: at most {stress[-1]:g} Pa; must reach {LEAST_STRESS:g} to "
                f"{LARGEST_STRESS:g} Pa; stresses are in pascals (0.12 MPa is 0.12e6)"
            )
        return None

    @property
    def points(self) -> tuple[Array, Array]:
        """Strains and stresses [Pa], compression positive."""
        return np.array(self.strain), np.array(self.stress)

    def stress_at(self, strain: Array) -> Array:
        """Stress [Pa] at strains within the test, compression positive."""
        return np.interp(strain, *self.points)

    @property
    def tested(self) -> float:
        """The largest strain of the test."""
        return self.strain[-1]

    @property
    def energy(self) -> Array:
        """Energy per volume [J/m3] that the foam has taken up to each point."""
        strain, stress = self.points
        return _areas(strain, stress)

    @property
    def efficiency(self) -> Array:
        """Energy taken over stress at each point: the length of an ideal stop, in strain."""
        _, stress = self.points
        return np.divide(self.energy, stress, out=np.zeros_like(stress), where=stress > 0.0)

    @property
    def densification(self) -> float:
        """Strain at which densification begins: where the energy efficiency is largest."""
        return self.strain[int(np.argmax(self.efficiency))]

    @property
    def plateau_stress(self) -> float:
        """Mean stress [Pa] between the strains of PLATEAU, or of what of them was tested."""
        last = min(PLATEAU[1], self.densification)
        first = min(PLATEAU[0], 0.5 * last)
        strain = np.union1d(self.points[0], [first, last])
        strain = strain[(strain >= first) & (strain <= last)]
        return float(_areas(strain, self.stress_at(strain))[-1] / (last - first))

    def steepest(self, until: float) -> float:
        """The steepest slope [Pa] up to a strain, of secants over SECANT: noise is no stiffness."""
        points, _ = self.points
        starts = np.append(points, points - SECANT)
        starts = starts[(starts >= 0.0) & (starts < min(until, self.tested - SECANT))]
        return float((self.stress_at(starts + SECANT) - self.stress_at(starts)).max() / SECANT)

    def table(self, locking: float, young: float, steepest: float, shear: float) -> Array:
        """(TABLE_ROWS, TABLE_COLUMNS) what kernels look up, at strains of 0, 0.001 and so on to 1.

        STRESS     [Pa]
        UNLOADING  slope [Pa] with which foam unloads from there: `young`, or the steepest secant of
                   the curve so far where that is more. So what has been dissipated never falls
        IN_CELLS   stress [Pa] that rises as the other does, but with `steepest` [Pa] at most
        CELLS_ENERGY   [J/m3] the area under it
        SHEAR      what is added to the shear modulus [Pa], `shear` of whole foam. Under the stress
                   s bonds of the length 1 - e lose s / (1 - e) of it by turning, and rows would
                   fold sideways once that is all: the sum is twice as much. Forces have its slope
                   in them, so the kinks of the curve are smoothed.
        """
        strain = np.linspace(0.0, 1.0, TABLE_ROWS)
        stress = np.where(
            strain <= self.tested, self.stress_at(strain), self._beyond(strain, locking)
        )
        rows = round(SECANT * (TABLE_ROWS - 1))
        secants = (stress[rows:] - stress[:-rows]) / SECANT
        secants = np.append(secants, np.full(rows, secants[-1]))
        unloading = np.maximum.accumulate(np.maximum(secants, young))
        rises = np.minimum(np.diff(stress, prepend=0.0), steepest / (TABLE_ROWS - 1))
        turning = stress / np.maximum(1.0 - strain, FLATTEST)
        rise = np.maximum.accumulate(np.maximum(2.0 * turning - shear, 0.0))
        rise = _mean_around(strain, _mean_around(strain, rise))
        in_cells = np.cumsum(rises)
        return np.column_stack([stress, unloading, in_cells, _areas(strain, in_cells), rise])

    def _beyond(self, strain: Array, locking: float) -> Array:
        """Stress [Pa] beyond the last point: a power of the distance to locking, then a tangent."""
        last, top = self.tested, self.stress[-1]
        before = last - min(END, last)
        slope = (top - float(self.stress_at(np.array(before)))) / (last - before)
        power = min(max(slope * (locking - last) / top, LEAST_POWER), STEEPEST)
        guard = locking - GUARD * (locking - last)
        inside = np.clip(strain, last, guard)
        stress = top * ((locking - last) / (locking - inside)) ** power
        return stress * (1.0 + power * (strain - inside) / (locking - inside))


def _areas(strain: Array, stress: Array) -> Array:
    """The area [J/m3] under straight lines between points, up to each of them."""
    parts = 0.5 * (stress[1:] + stress[:-1]) * np.diff(strain)
    return np.append(0.0, np.cumsum(parts))


def _mean_around(strain: Array, values: Array) -> Array:
    """The mean over SMOOTHED of strain around each point, or as far as the nearer end allows."""
    area = _areas(strain, values)
    reach = np.minimum(0.5 * SMOOTHED, np.minimum(strain, 1.0 - strain))[1:-1]
    low, high = strain[1:-1] - reach, strain[1:-1] + reach
    means = (np.interp(high, strain, area) - np.interp(low, strain, area)) / (2.0 * reach)
    return np.concatenate([values[:1], means, values[-1:]])


def _numbers(data: Any) -> tuple[Array, Array] | None:
    """The numbers of raw data; None where something else is wrong with it."""
    if not isinstance(data, dict):
        return None
    found = []
    for key in ("strain", "stress"):
        values = data.get(key)
        if isinstance(values, np.ndarray):
            values = values.tolist()
        if not isinstance(values, list | tuple) or len(values) < 2:
            return None
        if not all(isinstance(each, int | float) and not isinstance(each, bool) for each in values):
            return None
        array = np.array(values, dtype=np.float64)
        if not np.isfinite(array).all():
            return None
        found.append(array)
    return None if found[0].size != found[1].size else (found[0], found[1])
