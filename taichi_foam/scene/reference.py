"""Measured values of the impact that a scene describes, and whether a scene still describes it.

A reference belongs to an impact, not to a name: it stores a digest of the test setup, and does not
apply to a scene with another setup. Model choices and numerical resolution are not part of the
setup.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from typing import Any

from pydantic import Field
from pydantic_core import to_jsonable_python

from taichi_foam.parts import Part
from taichi_foam.scene.paths import NOTHING, at

_VELOCITY_WITHIN = 0.00501
"""Allowed relative difference of velocities: the 0.5 % by which ensembles vary, plus rounding."""

_OPEN: Mapping[str, frozenset[str]] = {
    # The mesh.
    "block": frozenset({"cell", "columns", "rows", "lattice_angle_deg", "mass_points"}),
    # Constants that a compression test does not give: they are chosen, or left open.
    "foam": frozenset({
        "law", "source", "locking_strain", "densification_a", "densification_b",
        "crushed_tensile_fraction", "crushed_tensile_stress", "rate", "rate_exponent",
        "overshoot_strain", "crush_band", "fracture_energy", "shear_fracture_energy", "softening",
        "strength_scatter", "strength_seed",
    }),
    "across": frozenset(),
    # The velocity is compared separately.
    "impactor": frozenset({"friction", "velocity", "drop_height"}),
    # How the bottom row is held is a model choice.
    "base": frozenset({"kind", "friction"}),
    "support": frozenset(),
    # All but gravity, which decelerations exclude, is numerical.
    "numerics": frozenset({
        "dt", "safety", "damping_time", "contact_stiffness", "contact_damping", "end", "time_limit",
    }),
    "start": frozenset(),
}  # fmt: skip
"""Keys, by part, that may differ where a reference applies; parts not listed may differ freely."""


class Reference(Part):
    """What was measured in the impact of a scene, and by whom."""

    name: str | None = Field(
        default=None, description="name of the scene to which the title belongs"
    )
    title: str | None = Field(default=None, description="title of this scene in pictures")
    source: str = Field(description="who measured it, and where")
    figures: Mapping[str, float] = Field(description="measured figures, by keys of summary.json")
    readings: Mapping[str, Mapping[str, float]] = Field(
        default={},
        description="other possible readings of the source: values by dotted key, for each "
        "choice set",
    )
    velocity: float | None = Field(default=None, description="velocity of the measured impact")
    impact: str | None = Field(
        default=None, description="digest of the setup of the measured impact"
    )

    def __hash__(self) -> int:
        """Hash of the name and the impact."""
        return hash((self.name, self.impact))

    def of(self, scene: Any) -> Reference:
        """The same reference, tied to the impact of a scene."""
        mine = {"velocity": _velocity(scene), "impact": self._digest(scene)}
        return self.model_copy(update={**mine, "name": self.name or scene.name})

    def has_velocity_of(self, scene: Any) -> bool:
        """Whether a scene's impactor has the velocity of the measured impact, within 0.5 %."""
        given = _velocity(scene)
        if given is None or self.velocity is None:
            return given is self.velocity
        return math.isclose(given, self.velocity, rel_tol=_VELOCITY_WITHIN)

    def fits(self, scene: Any) -> bool:
        """Whether a scene has the measured impact, whatever its name."""
        return self.has_velocity_of(scene) and self.impact == self._digest(scene)

    def _digest(self, scene: Any) -> str:
        """Digest of a scene's setup: all values other than defaults, except the velocity."""
        found = _set_up(scene)
        for key in {key for values in self.readings.values() for key in values}:
            value = at(scene, key)
            given = None if value is NOTHING else _rounded(value)
            found.pop(key, None)
            if given not in [values.get(key) for values in self.readings.values()]:
                found[key] = given
        text = json.dumps(found, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def _set_up(scene: Any) -> dict[str, Any]:
    """The setup of a scene: relevant values other than defaults, by dotted key."""
    found: dict[str, Any] = {"impactor.shape": getattr(scene.impactor, "shape", None)}
    for name, left_open in _OPEN.items():
        part = getattr(scene, name)
        if part is None:
            continue
        for key, field in type(part).model_fields.items():
            value = _rounded(getattr(part, key))
            if key not in left_open and value != _rounded(field.default):
                found[f"{name}.{key}"] = to_jsonable_python(value)
    return found


def _velocity(scene: Any) -> float | None:
    return None if scene.impactor is None else scene.impactor.velocity


def _rounded(value: Any) -> Any:
    """A number rounded to nine digits, so that 0.1 + 0.2 equals 0.3."""
    return float(f"{value:.9g}") if isinstance(value, float) else value
