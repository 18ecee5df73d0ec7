"""The nine drop tests of Shim, Tu & Lim (2000), Int. J. Impact Engng 24, 703-731.

As scenes, with what was measured in them; and `test_of`, which says whether a scene is one of
them. Table 1 (the foam) and Table 6 (the lattice) are the defaults of `taichi_foam.scene`.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Any

from taichi_foam.errors import UserError
from taichi_foam.picture.naming import Caption
from taichi_foam.scene import (
    CHOICE_SETS,
    Base,
    Block,
    Cylinder,
    FlatBlock,
    Foam,
    Impactor,
    Model,
    Scene,
    Start,
    Support,
    Wedge,
)

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


_TABLE = {"rectangular": 2, "cylinder": 3, "wedge": 4}
_SHAPE: dict[str, type[FlatBlock] | type[Cylinder] | type[Wedge]] = {
    "rectangular": FlatBlock,
    "cylinder": Cylinder,
    "wedge": Wedge,
}


@dataclass(frozen=True)
class PaperTest:
    """One of the nine tests.

    kind                "rectangular", "cylinder" or "wedge"
    velocity            of the impact [m/s]
    measured            its figures
    picture             number of the figure that shows the block during the impact
    simulated_duration  impact duration that the paper's own simulation gave [s]
    """

    kind: str
    velocity: float
    measured: Measured
    picture: int | None = None
    simulated_duration: float | None = None

    @property
    def name(self) -> str:
        """Of its scene."""
        return f"paper/{self.kind}-{self.velocity:.2f}"

    @property
    def title(self) -> str:
        """For people: "wedge, 2.86 m/s"."""
        return f"{_SHAPE[self.kind].label}, {self.velocity:.2f} m/s"


_TESTS = (
    # Table 2
    PaperTest("rectangular", 2.46, Measured(0.037, 0.046, 72, 1.50e5, 90, 0.0029)),
    PaperTest("rectangular", 3.03, Measured(0.042, 0.065, 74, 1.56e5, 97, 0.0020), 22, 0.0402),
    PaperTest("rectangular", 3.60, Measured(0.048, 0.086, 75, 1.60e5, 102, 0.0018)),
    # Table 3
    PaperTest("cylinder", 2.32, Measured(0.040, 0.048, 60, 1.32e5)),
    PaperTest("cylinder", 2.94, Measured(0.047, 0.070, 64, 1.43e5)),
    PaperTest("cylinder", 3.32, Measured(0.053, 0.090, 65, 1.46e5), 24),
    # Table 4; the last sinks deeper than the block is high
    PaperTest("wedge", 2.10, Measured(0.040, 0.046, 61, 1.34e5)),
    PaperTest("wedge", 2.86, Measured(0.049, 0.075, 66, 1.36e5), 26, 0.0483),
    PaperTest("wedge", 3.60, Measured(0.059, 0.110, 68, 1.40e5)),
)
TESTS: Mapping[str, PaperTest] = MappingProxyType({test.name: test for test in _TESTS})
"""The nine tests by name, in the tables' order (Tables 2-5, captions of Figs 22 and 26)."""

NAMES: tuple[str, ...] = tuple(TESTS)
"""Their names."""


# --- what makes a scene a test ------------------------------------------------------------------

# What was set up or measured in the laboratory has to be as in the test; how the model reads it and
# how finely it is computed has not. Of the impactor everything counts but its friction, which the
# paper does not give: shape, sizes and mass (section 3.1), offset and gap, which were none. The
# velocity may differ by as much as that of an ensemble's runs does.
_CONDITIONS: Mapping[str, tuple[str, ...]] = {
    # The specimens. Columns, rows and the lattice's angle are a mesh.
    "block": ("width", "height", "depth", "density", "outline", "holes", "layers"),
    # Table 1. Its yield strain and the plateau that was measured contradict each other by a
    # seventh: each choice set has one of them. The other constants of the law (locking, Eq. 26's a
    # and b, fracture energies, rate, scatter) were not measured: the paper chooses them, or leaves
    # them open.
    "foam": (
        "youngs_modulus", "shear_modulus", "yield_strain", "densification_strain",
        "tensile_strain", "shear_strain",
    ),
    # The rig let the wedge sink deeper than the block is high. How the bottom row is held
    # (base.kind) is a reading.
    "base": ("stops_impactor", "acceleration", "pulse", "pulse_peak_g", "pulse_duration_ms"),
    # It lay on a plate.
    "support": tuple(Support.model_fields),
    # It is the same in both directions.
    "across": ("foam",),
    # Decelerations are counted without gravity. All else there is a matter of computing.
    "numerics": ("gravity",),
    # At rest, undeformed, without cuts.
    "start": tuple(Start.model_fields),
}  # fmt: skip
_OPEN_FOR_IMPACTORS = frozenset({"friction", "velocity"})

# What the runs of an ensemble vary by, 0.5 %, and what rounding adds to it.
_VELOCITY_WITHIN = 0.00501

# What the titles of tests say.
_SAID = frozenset({"impactor.shape", "impactor.velocity"})


def test_of(scene: Scene) -> PaperTest | None:
    """The test that a scene computes, whatever it is called; None if it is none of the nine.

    A scene is a test if its impactor, block, foam (Table 1), rig and start are those of the test,
    its velocity within 0.5 %. Mesh, steps, outputs and readings of what the paper leaves open
    (`CHOICE_SETS`, seeds and scatter of strengths, ...) do not count. A cylinder may have either
    radius that the paper can be read to give.
    """
    if scene.impactor is None:
        return None
    velocity, own = scene.impactor.velocity, _conditions(scene)
    for test, conditions in _known():
        if math.isclose(velocity, test.velocity, rel_tol=_VELOCITY_WITHIN) and own == conditions:
            return test
    return None


def _conditions(scene: Scene) -> dict[str, Any]:
    """The values of a scene that make it a test, all but the velocity, by dotted key."""
    assert scene.impactor is not None
    found = scene.impactor.model_dump(exclude=set(_OPEN_FOR_IMPACTORS))
    for part, keys in _CONDITIONS.items():
        # another law has other constants
        found |= {f"{part}.{key}": getattr(getattr(scene, part), key, None) for key in keys}
    # The same to nine digits is the same: 0.1 + 0.2 is no other length than 0.3.
    return {k: float(f"{v:.9g}") if isinstance(v, float) else v for k, v in found.items()}


@lru_cache(maxsize=1)
def _known() -> tuple[tuple[PaperTest, dict[str, Any]], ...]:
    """The conditions of the nine tests, in every choice set: one may read a size differently."""
    return tuple(
        (test, _conditions(paper_scene(test.name, choices)))
        for test in TESTS.values()
        for choices in CHOICE_SETS
    )


def caption(scene: Scene) -> Caption:
    """What a scene is called in pictures: "wedge, 2.86 m/s" if it has a test's name and is one.

    One with a test's name that is none is "paper/wedge-2.86, changed"; all others have their name.
    """
    named = TESTS.get(scene.name)
    if named is None:
        return Caption(scene.name)
    test = test_of(scene)
    if test is not None:
        return Caption(test.title, _SAID)
    impactor = scene.impactor
    says_it = (
        impactor is not None
        and isinstance(impactor, _SHAPE[named.kind])
        and math.isclose(impactor.velocity, named.velocity, rel_tol=_VELOCITY_WITHIN)
    )
    return Caption(f"{scene.name}, changed", _SAID if says_it else frozenset())


def title(scene: Scene) -> str:
    """The title of a scene's `caption`."""
    return caption(scene).title


# --- scenes -------------------------------------------------------------------------------------


def describe(name: str) -> str:
    """Return one line about a test: shape, velocity, where the paper treats it."""
    test = _named(name)
    words = f"{'90 degree ' if test.kind == 'wedge' else ''}{_SHAPE[test.kind].label}"
    where = f"Table {_TABLE[test.kind]}" + (f", Fig. {test.picture}" if test.picture else "")
    return f"6 kg {words} at {test.velocity:.2f} m/s ({where})"


def paper_scene(name: str, choices: str = "calibrated") -> Scene:
    """Return one of the nine tests.

    Args:
        name: one of `NAMES`, e.g. "paper/wedge-2.86".
        choices: a key of `CHOICE_SETS`. "paper-literal" also takes the cylinder's radius as
            section 3.1 words it.

    Raises:
        UserError: unknown name or choice set.
    """
    test = _named(name)
    if choices not in CHOICE_SETS:
        raise UserError(f"choices = {choices!r}: must be one of {', '.join(CHOICE_SETS)}")
    parts: dict[str, dict[str, object]] = defaultdict(dict)
    for key, value in CHOICE_SETS[choices].items():
        head, field = key.split(".")
        parts[head][field] = value
    if test.kind == "cylinder" and choices == "paper-literal":
        parts["impactor"]["radius"] = LITERAL_CYLINDER_RADIUS
    impactor: Impactor = _SHAPE[test.kind].model_validate(
        {"velocity": test.velocity, **parts["impactor"]}
    )
    return Scene(
        name=name,
        block=Block.model_validate(parts["block"]),
        impactor=impactor,
        foam=Foam.model_validate(parts["foam"]),
        # the wedge was measured to sink 11 cm into a block of 10 cm: the rig let it
        base=Base.model_validate({"stops_impactor": False, **parts["base"]}),
        model=Model.model_validate(parts["model"]),
    )


def _named(name: str) -> PaperTest:
    if name not in TESTS:
        raise UserError(f"{name}: not one of the paper's tests; choose from {', '.join(NAMES)}")
    return TESTS[name]
