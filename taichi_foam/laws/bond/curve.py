"""A measured curve of compressive stress over strain, and the values derived from it.

Strains and stresses are engineering ones, compression positive here as in the test. Between its
points the curve is linear. Beyond its last point it is extrapolated as a power of the distance to
locking, with the slope of its end, so that every strain has a stress; a run that gets there reports
it.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from taichi_foam.formulas.energy import absorbed_energy, densification_onset, efficiency
from taichi_foam.laws.bond.base import TABLE_COLUMNS, TABLE_ROWS
from taichi_foam.parts import Part, is_number, quantity

Array = NDArray[np.float64]

STRESS, UNLOADING, IN_CELLS, CELLS_ENERGY, SHEAR = range(TABLE_COLUMNS)
"""Columns of the table that kernels read."""

MOST_POINTS = 2000
"""Most points of a curve; the table has half as many rows."""

LEAST_STRESS, LARGEST_STRESS = 500.0, 1e9
"""Range of a curve's largest stress [Pa]; one below it was probably given in kPa or MPa."""

PLATEAU = (0.2, 0.4)
"""Strains between which the mean stress is the plateau stress (ISO 13314)."""

LOCKS = 0.75
"""The default locking strain lies at this fraction of the way from the last point to a strain of
1."""

SECANT = 0.005
"""Strain interval of the secants by which slopes are taken."""

FLATTEST = 0.02
"""Lower limit of a bond's relative length in the loss of shear stiffness, see `Curve.table`."""

SMOOTHED = 0.02
"""Strain interval over which kinks of the rise in shear modulus are smoothed."""

END = 0.02
"""Strain interval before the last point over which the curve's final slope is taken."""

LEAST_POWER = 0.5
"""Smallest power of the extrapolation: a curve that ends on its plateau must lock, too."""

STEEPEST = 20.0
"""Largest power of the extrapolation: a jump at the curve's end must not give infinite stress."""

GUARD = 0.05
"""Within this fraction of the interval from locking to the last point the curve is its tangent."""


class Curve(Part):
    """Stress over strain of a compression test (any sampling, from rest).

    Strains rise from point to point; stresses never fall. A first point at zero strain and stress
    is added if it is missing. If stresses fall, because of noise or after a first peak, they are
    replaced by the closest non-decreasing curve (isotonic regression, least squares); `smoothing`
    keeps the largest change.
    """

    strain: tuple[float, ...] = Field(
        strict=False,  # lists are accepted
        description="engineering strains in compression, fractions, each above the one before",
        json_schema_extra={
            "allowed": f"2 to {MOST_POINTS:,} rising numbers",
            "fix": "strains are fractions (80 % is 0.80)",
        },
    )
    stress: tuple[float, ...] = quantity(
        ...,
        "Pa",
        "engineering stresses in compression at these strains",
        allowed="as many numbers as strains",
        fix="stresses are in pascals (0.12 MPa is 0.12e6)",
        strict=False,
    )
    smoothing: float = quantity(
        0.0, "Pa", "largest change that was made to a stress so that no stress falls", at_least=0
    )

    @model_validator(mode="before")
    @classmethod
    def _upright(cls, data: Any) -> Any:
        """Make data positive in compression, starting from rest, and non-decreasing."""
        if not isinstance(data, dict):
            return data
        data = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in data.items()}
        lists = data.get("strain"), data.get("stress")
        if not all(map(_are_numbers, lists)) or len(lists[0]) != len(lists[1]):
            return data  # later checks report the error
        strain, stress = (np.array(each, dtype=np.float64) for each in lists)
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
            from scipy.optimize import isotonic_regression  # slow to import, and seldom needed

            # the point at rest has a weight so large that the regression does not move it
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
                "strains must rise from point to point; sort them, or remove the unloading"
            )
        if strain[0] < 0.0:
            return (
                f".strain[0] = {strain[0]:g}: the strains have both signs; all must be at least 0, "
                "in compression; remove the points before contact"
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

    def __str__(self) -> str:
        return f"{len(self.strain):,} points"

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
        """Energy per volume [J/m3] absorbed up to each point."""
        return absorbed_energy(*self.points)

    @property
    def efficiency(self) -> Array:
        """Absorbed energy over stress at each point: the stroke of an ideal absorber, in strain."""
        return efficiency(*self.points)

    @property
    def densification(self) -> float:
        """Strain at which densification begins: where the energy efficiency is largest."""
        return _landmarks_of(self)[0]

    @property
    def plateau_stress(self) -> float:
        """Mean stress [Pa] between the strains of PLATEAU, before densification."""
        return _landmarks_of(self)[1]

    def steepest(self, until: float) -> float:
        """The largest slope [Pa] up to a strain, by secants over SECANT to suppress noise."""
        points, _ = self.points
        starts = np.append(points, points - SECANT)
        starts = starts[(starts >= 0.0) & (starts < min(until, self.tested - SECANT))]
        return float((self.stress_at(starts + SECANT) - self.stress_at(starts)).max() / SECANT)

    def table(self, locking: float, young: float, steepest: float, shear: float) -> Array:
        """The kernels' table (TABLE_ROWS, TABLE_COLUMNS), at strains of 0, 0.001 and so on to 1.

        STRESS     stress [Pa]
        UNLOADING  slope of unloading from there [Pa]: `young`, or the steepest secant of the curve
                   so far if that is larger. So the dissipated energy never falls
        IN_CELLS   stress [Pa] that rises like STRESS, but with at most the slope `steepest` [Pa]
        CELLS_ENERGY   area under IN_CELLS [J/m3]
        SHEAR      increase of the shear modulus [Pa], which is `shear` for whole foam. Under the
                   stress s, bonds of relative length 1 - e reduce it by s / (1 - e) by rotating,
                   and rows would fold sideways when nothing is left: the increased modulus is at
                   least twice that reduction. Forces contain its slope, so kinks are smoothed
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
        return np.column_stack(
            [stress, unloading, in_cells, absorbed_energy(strain, in_cells), rise]
        )

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


def _mean_around(strain: Array, values: Array) -> Array:
    """The mean over a strain interval SMOOTHED around each point; shorter near the ends."""
    area = absorbed_energy(strain, values)
    reach = np.minimum(0.5 * SMOOTHED, np.minimum(strain, 1.0 - strain))[1:-1]
    low, high = strain[1:-1] - reach, strain[1:-1] + reach
    means = (np.interp(high, strain, area) - np.interp(low, strain, area)) / (2.0 * reach)
    return np.concatenate([values[:1], means, values[-1:]])


def _are_numbers(values: Any) -> bool:
    """Whether raw data is a list of finite numbers, at least two."""
    return isinstance(values, list | tuple) and len(values) >= 2 and all(map(is_number, values))


@lru_cache(maxsize=64)  # every figure of a run asks for them
def _landmarks_of(curve: Curve) -> tuple[float, float]:
    """Strain at which densification begins, and plateau stress [Pa]."""
    end = densification_onset(*curve.points)
    last = min(PLATEAU[1], end)
    first = min(PLATEAU[0], 0.5 * last)
    strain = np.union1d(curve.points[0], [first, last])
    strain = strain[(strain >= first) & (strain <= last)]
    return end, float(absorbed_energy(strain, curve.stress_at(strain))[-1] / (last - first))
