"""The study of cells: its runs, and its page with a picture.

Runs have other cells, other readings of strength and rate, and mechanisms switched off in turn. The
page says what the figures do as cells become smaller.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

from ensembles import median_and_range, percent, short
from fidelity_study.members import Ensemble
from matplotlib.axes import Axes
from pages import MARKS, Page, cell_axis, key, panels, table
from store import Store

from taichi_foam.analysis.bands import Band
from taichi_foam.analysis.measures import DISPLACEMENT, DURATION, PLATEAU, Quantity
from taichi_foam.laws.bond.base import OPENING, SLIDING
from taichi_foam.scene import Block, Foam
from taichi_foam.shim2000.scores import HELD_OUT

CELLS = (0.010, 0.00625, 0.005, 0.004, 0.0025, 0.00125)  # m
REFERENCE = 0.005  # the paper's
COMPARED = (0.005, 0.004, 0.0025)  # cells of the other readings
FINE = (0.005, 0.0025)  # cells of the mechanisms
TESTS = tuple(HELD_OUT)  # the tests at the middle velocities

Overrides = tuple[str, ...]


@dataclass(frozen=True)
class Variant:
    """Settings changed from the calibrated ones; some depend on the cell.

    part     under which its runs are kept
    label    for the page
    cells    in which it is computed [m]
    runs     velocities of each ensemble, by the cell; 1 is the test's own velocity
    """

    part: str
    label: str
    cells: tuple[float, ...]
    runs: Mapping[float, int]
    settings: Overrides = ()
    strengths: str = "energies"

    def overrides(self, cell: float) -> Overrides:
        block = Block()
        # rows of mass points lie on the faces, one more than there are cells
        counts = (round(block.width / cell), round(block.height / cell) + 1)
        mesh = (f"block.columns={counts[0]}", f"block.rows={counts[1]}")
        return (*mesh, *limits(self.strengths, cell), *self.settings)

    def ensemble(self, test: str, cell: float) -> Ensemble:
        return Ensemble(test, self.overrides(cell), self.runs[cell])

    def ensembles(self, tests: tuple[str, ...]) -> Iterator[Ensemble]:
        """All of them, quick ones first."""
        for cell in self.cells:
            for test in tests:
                yield self.ensemble(test, cell)


def limits(strengths: str, cell: float) -> Overrides:
    """Settings that make bonds break at once, at strains that do not, or do, heed the cell."""
    if strengths == "energies":
        return ()
    brittle = ("foam.softening=false",)
    if strengths == "scaled":
        return brittle  # by one over the root of the cell: a crack costs the same
    foam = Foam()
    opening = OPENING * 0.5 * foam.youngs_modulus * foam.tensile_strain**2 * cell
    sliding = SLIDING * 0.5 * foam.shear_modulus * foam.shear_strain**2 * cell
    return (
        *brittle,
        f"foam.fracture_energy={opening!r}",
        f"foam.shear_fracture_energy={sliding!r}",
    )


MANY = {0.010: 9, 0.00625: 9, 0.005: 9, 0.004: 9, 0.0025: 5, 0.00125: 1}
SOME = {0.005: 5, 0.004: 5, 0.0025: 3}
CONTINUUM = ("foam.crush_band=none",)
UNBROKEN = ("foam.tensile_strain=2", "foam.shear_strain=2")


@cache
def variants() -> tuple[Variant, ...]:
    """As it is, other readings of strength and rate, and mechanisms switched off in turn."""
    readings = (
        ("limits the same in every cell", (), "fixed"),
        ("limits by one over the root of the cell", (), "scaled"),
        ("dashpots and rate of a continuum", CONTINUUM, "energies"),
        ("both: limits the same, continuum", CONTINUUM, "fixed"),
    )
    mechanisms = (
        ("no fracture", UNBROKEN),
        ("no rate", ("foam.rate=none",)),
        ("a tenth of the dashpots", (f"numerics.damping_time={1e-7 / 0.057!r}",)),
        ("strength in shear without pressure", ("model.shear_failure=always",)),
        ("pieces pass through each other", ("model.self_contact=false",)),
        ("shear by faces", ("model.shear=face",)),
    )
    return (
        Variant("cells", "as it is", CELLS, MANY),
        *(
            Variant("readings", label, COMPARED, SOME, settings, strengths)
            for label, settings, strengths in readings
        ),
        *(Variant("mechanisms", label, FINE, SOME, settings) for label, settings in mechanisms),
    )


AS_IT_IS = variants()[0]


JUDGED = (DURATION, DISPLACEMENT, PLATEAU)
TOLERANCE = 0.06
"""What cells of 4 and 2.5 mm may differ from those of 5 mm."""

INTRODUCTION = """# The paper's tests in other cells

Written by `python validation/cells.py`. The three tests at the middle velocities with the
calibrated choices and nothing else changed but the cell: medians of ensembles whose velocities lie
within 0.5 % of the test's own, and what they are off those with cells of 5 mm.

What a crack costs is a property of the foam: `foam.fracture_energy` and
`foam.shear_fracture_energy`. Dashpots and rate take strain rates over `foam.crush_band`.
[docs/model.md](../../docs/model.md#cells) has the reasons.

In cells of 4 and 10 mm a flat face of 50 mm covers 12 and 4 mass points, 48 and 40 mm: 4 and 20 %
of its plateau are missing by geometry alone. In the other cells it covers whole ones.
"""

PARTS = {
    "readings": """## Other readings

Bonds that break at once at strains that are the same in every cell, or that grow with one over the
root of the cell (a brittle lattice then takes as much for a crack in every cell); and rates over
one cell, as continuum constants of dashpots and rate. Per cent against the same in 5 mm:
duration, displacement, plateau.
""",
    "mechanisms": """## Mechanisms, switched off in turn

What still moves with the cell without this mechanism. Per cent against the same in 5 mm:
duration, displacement, plateau; in brackets what 5 mm gives.
""",
}


def figures(variant: Variant, test: str, cell: float, store: Store) -> dict[str, Band] | None:
    """Median, least and largest of each figure; None unless all runs have ended."""
    runs = variant.ensemble(test, cell).runs(store.part(variant.part))
    if not runs:
        return None
    return {q.key: median_and_range([run["figures"][q.key] for run in runs]) for q in JUDGED}


def change(variant: Variant, test: str, cell: float, quantity: Quantity, store: Store) -> Band:
    """Median, least and largest over the median in cells of 5 mm, less 1; NaN where one is missing.

    A run without an answer counts as infinite.
    """
    found, known = figures(variant, test, cell, store), figures(variant, test, REFERENCE, store)
    if found is None or known is None:
        return Band(math.nan, math.nan, math.nan)
    band, middle = found[quantity.key], known[quantity.key].median
    return Band(*(_ratio(value, middle) for value in (band.low, band.median, band.high)))


def _ratio(value: float, known: float) -> float:
    return value / known - 1.0 if math.isfinite(known) else math.nan


def write(store: Store, page: Page) -> str:
    """Write the page and its picture; its text comes back."""
    text = INTRODUCTION + "\n" + _cells(store)
    if any(figures(AS_IT_IS, test, REFERENCE, store) for test in TESTS):
        text += "\n" + page.picture("cells", "Figures against the cell", partial(draw, store))
    for part, method in PARTS.items():
        rows = [_row(variant, store) for variant in variants() if variant.part == part]
        rows = [row for group in rows for row in group]
        if rows:
            header = ["", "cell, mm", *(short(test) for test in TESTS)]
            text += f"\n{method}\n{table(header, rows)}"
    page.write(text)
    return text


def _cells(store: Store) -> str:
    """All figures of the foam as it is, and the worst change in each cell."""
    header = ["test", "cell, mm", "runs"]
    header += [f"{quantity.name}, {quantity.unit}" for quantity in JUDGED]
    rows = []
    for test in TESTS:
        for cell in CELLS:
            found = figures(AS_IT_IS, test, cell, store)
            if found is not None:
                runs = str(AS_IT_IS.runs[cell])
                rows.append([short(test), f"{1e3 * cell:g}", runs, *_told(test, cell, store)])
    worst = []
    for cell in CELLS:
        changes = [
            abs(change(AS_IT_IS, test, cell, quantity, store).median)
            for test in TESTS
            for quantity in JUDGED
        ]
        if cell != REFERENCE and not any(map(math.isnan, changes)):
            within = sum(each <= TOLERANCE for each in changes)
            worst.append(
                f"- {1e3 * cell:g} mm: {within} of {len(changes)} medians within "
                f"{100 * TOLERANCE:g} % of those with 5 mm, the worst off by "
                f"{100 * max(changes):.1f} %."
            )
    return table(header, rows) + "\n" + "\n".join(worst) + "\n"


def _told(test: str, cell: float, store: Store) -> list[str]:
    found = figures(AS_IT_IS, test, cell, store)
    assert found is not None
    told = []
    for quantity in JUDGED:
        band = found[quantity.key]
        low, median, high = map(quantity.text, (band.low, band.median, band.high))
        off = percent(change(AS_IT_IS, test, cell, quantity, store).median)
        told.append(f"{median} ({low} to {high}), {off} %")
    return told


def _row(variant: Variant, store: Store) -> list[list[str]]:
    rows = []
    for cell in variant.cells:
        cells = [_changes(variant, test, cell, store) for test in TESTS]
        if cell != REFERENCE and any(cells):
            rows.append([variant.label, f"{1e3 * cell:g}", *cells])
    return rows


def _changes(variant: Variant, test: str, cell: float, store: Store) -> str:
    known = figures(variant, test, REFERENCE, store)
    if known is None or figures(variant, test, cell, store) is None:
        return ""
    changes = " ".join(
        percent(_finite(change(variant, test, cell, quantity, store).median)) for quantity in JUDGED
    )
    if variant.part != "mechanisms":
        return changes
    middle = (
        f"{q.factor * known[q.key].median:.{digits}f}"
        for q, digits in zip(JUDGED, (1, 2, 0), strict=True)
    )
    return f"{changes} ({' '.join(middle)})"


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def draw(store: Store, path: Path) -> None:
    """A panel for each test: its figures over those with cells of 5 mm, with their ranges."""
    with panels(path, [short(test) for test in TESTS]) as axes:
        for axis, test in zip(axes, TESTS, strict=True):
            _panel(axis, test, store)
        axes[0].set_ylabel("change from cells of 5 mm (%)")
        key(axes[0])


def _panel(axis: Axes, test: str, store: Store) -> None:
    axis.axhspan(-100 * TOLERANCE, 100 * TOLERANCE, color="0.92", zorder=0)
    for quantity, mark in zip(JUDGED, MARKS, strict=False):
        found = {
            cell: change(AS_IT_IS, test, cell, quantity, store)
            for cell in CELLS
            if figures(AS_IT_IS, test, cell, store) is not None
        }
        kept = {cell: band for cell, band in found.items() if math.isfinite(band.median)}
        median = [100 * band.median for band in kept.values()]
        spread: Sequence[Sequence[float]] = [
            [100 * (band.median - band.low) for band in kept.values()],
            [100 * (min(band.high, 1.0) - band.median) for band in kept.values()],
        ]
        sizes = [1e3 * cell for cell in kept]
        axis.errorbar(sizes, median, yerr=spread, fmt=f"{mark}-", capsize=3, label=quantity.name)
    cell_axis(axis, CELLS)
    axis.set_ylim(-30, 30)
