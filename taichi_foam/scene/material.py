"""The foam: the block that is hit and the law of its bonds."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from taichi_foam.scene.fields import Part, quantity

MAX_NODES = 4_000_000


class Block(Part):
    """A rectangular block, its lattice of mass points and its density (paper, Table 6, Fig. 14)."""

    width: float = quantity(0.2, "m", "width of the block", at_least=1e-4, at_most=5)
    height: float = quantity(0.1, "m", "height of the block", at_least=1e-4, at_most=5)
    thickness: float = quantity(
        0.057,
        "m",
        "thickness of the block, and of the impactor",
        at_least=1e-5,
        at_most=5,
        fix="lengths are in metres (57 mm is 0.057)",
    )
    columns: int = quantity(
        40,
        "count",
        "number of mass points across",
        at_least=2,
        at_most=MAX_NODES // 2,
        fix="the paper uses 40 by 20",
    )
    rows: int = quantity(
        20,
        "count",
        "number of mass points upwards",
        at_least=2,
        at_most=MAX_NODES // 2,
        fix="the paper uses 40 by 20",
    )
    density: float = quantity(25.6, "kg/m3", "density of the foam", at_least=1, at_most=5000)

    @model_validator(mode="after")
    def _check_size(self) -> Block:
        if self.columns * self.rows > MAX_NODES:
            raise ValueError(
                f"block.columns = {self.columns}, block.rows = {self.rows}: "
                f"{self.columns * self.rows:,} mass points; at most {MAX_NODES:,}; "
                "take fewer columns or rows"
            )
        return self

    @property
    def dx(self) -> float:
        """Width of a cell [m]."""
        return self.width / self.columns

    @property
    def dy(self) -> float:
        """Height of a cell [m]."""
        return self.height / self.rows

    @property
    def node_mass(self) -> float:
        """Mass of a mass point [kg]: that of its cell, rho dX dY Z."""
        return self.density * self.dx * self.dy * self.thickness


class Foam(Part):
    """Parameters of the bonds (paper, Table 1 and Eq. 26). Strains: tension positive."""

    youngs_modulus: float = quantity(2.78e6, "Pa", "Young's modulus K", at_least=1e3, at_most=1e11)
    shear_modulus: float = quantity(
        0.84e6,
        "Pa",
        "shear modulus G",
        at_least=1e3,
        at_most=1e11,
        fix="moduli and stresses are in pascals (0.84 MPa is 0.84e6)",
    )
    yield_strain: float = quantity(
        -0.05, "compression", "strain at which the plateau begins", at_least=-0.5, below=0
    )
    tensile_strain: float = quantity(
        0.05, "tension", "tensile strain at which a bond breaks", above=0, at_most=2
    )
    shear_strain: float = quantity(
        0.10,
        "tension",
        "shear strain at which a bond breaks, either way",
        above=0,
        at_most=2,
        fix="strains are fractions (10 % is 0.10)",
    )
    densification_strain: float = quantity(
        -0.80,
        "compression",
        "strain at which densification begins",
        above=-1,
        below=0,
        fix="strains are fractions (80 % is 0.80), negative in compression: -0.80",
    )
    locking_strain: float = quantity(
        -0.95,
        "compression",
        "strain at which the stress becomes infinite",
        above=-1,
        below=0,
        fix="strains are fractions (95 % is 0.95), negative in compression: -0.95",
    )
    densification_a: float = quantity(
        0.5, "-", "constant a of Eq. 26: how steeply the stress rises", above=0, at_most=10
    )
    densification_b: float = quantity(
        1.0, "-", "constant b of Eq. 26: the power of the distance to locking", above=0, at_most=5
    )
    crushed_tensile_fraction: float = quantity(
        0.5,
        "-",
        "a crushed bond breaks at this fraction of tensile_strain",
        above=0,
        at_most=1,
    )
    crushed_tensile_stress: Annotated[float, Field(ge=0, le=1e9)] | None = quantity(
        None,
        "Pa",
        "stress at which a crushed bond breaks; none: that of the virgin elastic line, "
        "youngs_modulus * crushed_tensile_fraction * tensile_strain",
        allowed="none, or at least 0 and at most 1e9 Pa",
    )
    crushed_strength: float = quantity(
        1.0,
        "-",
        "tensile strength of a bond between two cells that have been crushed across it, over "
        "that of whole foam; 1: only crush along a bond weakens it",
        at_least=0,
        at_most=1,
    )
    rate: Annotated[float, Field(ge=1, le=1e9)] | None = quantity(
        None,
        "1/s",
        "strain rate D at which the plateau's stress is twice its static one (Cowper & Symonds); "
        "none: the foam does not heed the rate",
        allowed="none, or at least 1 and at most 1e9 1/s",
    )
    rate_exponent: float = quantity(
        1.0,
        "-",
        "exponent q: the plateau's stress grows by the part (rate / D)^(1/q)",
        at_least=1,
        at_most=20,
    )
    strength_scatter: float = quantity(
        0.0,
        "-",
        "scatter of the bonds' strength in tension and shear, Weibull: standard deviation "
        "over mean; 0: all are equally strong",
        at_least=0,
        at_most=0.5,
    )
    strength_seed: int = quantity(
        0,
        "count",
        "which strengths the scatter draws",
        at_least=0,
        at_most=2**32 - 1,
        fix="any other whole number draws others",
    )

    @model_validator(mode="after")
    def _check_order(self) -> Foam:
        problems = []
        if self.densification_strain >= self.yield_strain:
            problems.append(
                f"foam.densification_strain = {self.densification_strain:g}: must be below "
                f"foam.yield_strain = {self.yield_strain:g}; the paper uses -0.80 and -0.05"
            )
        if self.locking_strain >= self.densification_strain:
            problems.append(
                f"foam.locking_strain = {self.locking_strain:g}: must be below "
                f"foam.densification_strain = {self.densification_strain:g} (more compressive, "
                "nearer to -1); the paper uses -0.95 and -0.80"
            )
        if problems:
            raise ValueError("\n".join(problems))
        return self

    @property
    def plateau_stress(self) -> float:
        """Magnitude of the plateau's stress [Pa], K |e_y| (Eq. 26)."""
        return self.youngs_modulus * -self.yield_strain
