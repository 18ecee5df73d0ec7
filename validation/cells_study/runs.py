"""Which runs the study of cells has: the tests, the cells, and what is switched off in turn."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache

from fidelity_study.members import Ensemble

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
