"""The nine drop tests of Shim, Tu & Lim (2000), Int. J. Impact Engng 24, 703-731.

As scenes, with what was measured in them. Table 1 (the foam) and Table 6 (the lattice) are the
defaults of `taichi_foam.scene`; they stand here again in the paper's words for tests and tables.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from taichi_foam.errors import UserError
from taichi_foam.scene import (
    CHOICE_SETS,
    Base,
    Cylinder,
    FlatBlock,
    Foam,
    Impactor,
    Model,
    Scene,
    Wedge,
)

TABLE_1: Mapping[str, float] = MappingProxyType(
    {
        "density_kg_m3": 25.6,
        "youngs_modulus_Pa": 2.78e6,
        "shear_modulus_Pa": 0.84e6,
        "static_plateau_stress_Pa": 0.12e6,
        "yield_strain": -0.05,
        "densification_strain": -0.80,
        "tensile_strain": 0.05,
        "shear_strain": 0.10,
    }
)
"""Table 1, with Eq. 26's signs. The model's own plateau is K |e_y| = 0.139 MPa, not the measured
0.12 MPa."""

TABLE_6: Mapping[str, float] = MappingProxyType(
    {
        "damping_alpha": 0.0,
        "damping_beta_m_s": 1e-6,
        "cell_width_m": 0.005,
        "cell_height_m": 0.005,
        "columns": 40,
        "rows": 20,
        "dt_s": 1e-7,
        "time_limit_s": 0.050,
    }
)
"""Table 6 and the time limit that the text above it gives."""

LITERAL_CYLINDER_RADIUS = 0.05
"""Radius [m] in section 3.1's words; Eqs 3 and 5 with Tables 3 and 5 need half of it."""


@dataclass(frozen=True)
class Measured:
    """What was measured in one test. Signs as in the tables: decelerations positive."""

    impact_duration_s: float
    """First contact to zero velocity (Tables 2-4)."""
    max_displacement_m: float
    """Tables 2-4."""
    plateau_deceleration_m_s2: float
    """Mean over the plateau (Tables 2-4)."""
    energy_per_volume_J_m3: float  # noqa: N815 - J is the joule
    """Energy absorbed over volume crushed (Table 5)."""
    initial_peak_m_s2: float | None = None
    """First peak of the deceleration (Table 2; the other shapes have none)."""
    initial_peak_time_s: float | None = None
    """When that peak comes (Table 2)."""


MEASURED: Mapping[str, Measured] = MappingProxyType(
    {
        # Table 2
        "paper/rectangular-2.46": Measured(0.037, 0.046, 72, 1.50e5, 90, 0.0029),
        "paper/rectangular-3.03": Measured(0.042, 0.065, 74, 1.56e5, 97, 0.0020),
        "paper/rectangular-3.60": Measured(0.048, 0.086, 75, 1.60e5, 102, 0.0018),
        # Table 3
        "paper/cylinder-2.32": Measured(0.040, 0.048, 60, 1.32e5),
        "paper/cylinder-2.94": Measured(0.047, 0.070, 64, 1.43e5),
        "paper/cylinder-3.32": Measured(0.053, 0.090, 65, 1.46e5),
        # Table 4; the last sinks deeper than the block is high
        "paper/wedge-2.10": Measured(0.040, 0.046, 61, 1.34e5),
        "paper/wedge-2.86": Measured(0.049, 0.075, 66, 1.36e5),
        "paper/wedge-3.60": Measured(0.059, 0.110, 68, 1.40e5),
    }
)
"""Measured figures of the nine tests, by scene name (Tables 2-5)."""

NAMES: tuple[str, ...] = tuple(MEASURED)
"""The nine tests, in the tables' order."""

SIMULATED_DURATION: Mapping[str, float] = MappingProxyType(
    {"paper/rectangular-3.03": 0.0402, "paper/wedge-2.86": 0.0483}
)
"""Impact durations [s] that the paper's own simulation gave (captions of Figs 22 and 26)."""

_FIGURE = {
    "paper/rectangular-3.03": ", Fig. 22",
    "paper/cylinder-3.32": ", Fig. 24",
    "paper/wedge-2.86": ", Fig. 26",
}
_TABLE = {"rectangular": 2, "cylinder": 3, "wedge": 4}
_SHAPE: dict[str, type[FlatBlock] | type[Cylinder] | type[Wedge]] = {
    "rectangular": FlatBlock,
    "cylinder": Cylinder,
    "wedge": Wedge,
}

# For titles, by the shape of a scene's impactor.
_WORDS = {"flat": "flat block", "cylinder": "cylinder", "wedge": "wedge", "polygon": "polygon"}
# What the runs of an ensemble vary by, 0.5 %, and what rounding adds to it.
_ITS_OWN = 0.00501


def describe(name: str) -> str:
    """Return one line about a test: shape, velocity, where the paper treats it."""
    shape, velocity = _split(name)
    words = {"rectangular": "flat block", "cylinder": "cylinder", "wedge": "90 degree wedge"}
    return (
        f"6 kg {words[shape]} at {velocity:.2f} m/s (Table {_TABLE[shape]}{_FIGURE.get(name, '')})"
    )


def title(scene: Scene) -> str:
    """What a scene is called for people: "wedge, 2.86 m/s" if it is a test or made of one.

    Shape and velocity are those of the scene. Within 0.5 % the velocity is the test's own, as for
    the runs of an ensemble. Any other scene is called by its name.
    """
    if scene.name not in MEASURED or scene.impactor is None:
        return scene.name
    velocity, own = scene.impactor.velocity, _split(scene.name)[1]
    if math.isclose(velocity, own, rel_tol=_ITS_OWN):
        velocity = own
    return f"{_WORDS[scene.impactor.shape]}, {velocity:.2f} m/s"


def paper_scene(name: str, choices: str = "calibrated") -> Scene:
    """Return one of the nine tests.

    Args:
        name: one of `NAMES`, e.g. "paper/wedge-2.86".
        choices: a key of `CHOICE_SETS`. "paper-literal" also takes the cylinder's radius as
            section 3.1 words it.

    Raises:
        UserError: unknown name or choice set.
    """
    shape, velocity = _split(name)
    if choices not in CHOICE_SETS:
        raise UserError(f"choices = {choices!r}: must be one of {', '.join(CHOICE_SETS)}")
    parts: dict[str, dict[str, object]] = {"foam": {}, "base": {}, "impactor": {}, "model": {}}
    for key, value in CHOICE_SETS[choices].items():
        head, field = key.split(".")
        parts[head][field] = value
    if shape == "cylinder" and choices == "paper-literal":
        parts["impactor"]["radius"] = LITERAL_CYLINDER_RADIUS
    impactor: Impactor = _SHAPE[shape].model_validate({"velocity": velocity, **parts["impactor"]})
    return Scene(
        name=name,
        impactor=impactor,
        foam=Foam.model_validate(parts["foam"]),
        # the wedge was measured to sink 11 cm into a block of 10 cm: the rig let it
        base=Base.model_validate({"stops_impactor": False, **parts["base"]}),
        model=Model.model_validate(parts["model"]),
    )


def _split(name: str) -> tuple[str, float]:
    """Return shape and velocity [m/s] of a test's name."""
    if name not in MEASURED:
        raise UserError(f"{name}: not one of the paper's tests; choose from {', '.join(NAMES)}")
    shape, velocity = name.removeprefix("paper/").split("-")
    return shape, float(velocity)
