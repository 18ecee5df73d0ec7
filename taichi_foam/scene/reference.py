"""What was measured in the impact that a scene describes, and whether it has still that impact.

A reference holds for an impact, not for a name: it knows what was set up where it was measured, by
a digest, and says nothing of a scene in which any of that is otherwise. How the model reads an
impact, and how finely it is computed, does not count.
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
"""Velocities may differ by what the runs of an ensemble vary by, 0.5 %, and what rounding adds."""

_OPEN: Mapping[str, frozenset[str]] = {
    # Columns, rows and the lattice's angle are a mesh.
    "block": frozenset({"cell", "columns", "rows", "lattice_angle_deg", "mass_points"}),
    # Of Eq. 26 what a compression test does not give: it is chosen, or left open.
    "foam": frozenset({
        "law", "source", "locking_strain", "densification_a", "densification_b",
        "crushed_tensile_fraction", "crushed_tensile_stress", "rate", "rate_exponent",
        "crush_band", "fracture_energy", "shear_fracture_energy", "softening",
        "strength_scatter", "strength_seed",
    }),
    "across": frozenset(),
    # Its velocity is compared by itself.
    "impactor": frozenset({"friction", "velocity", "drop_height"}),
    # How the bottom row is held is a reading.
    "base": frozenset({"kind", "friction"}),
    "support": frozenset(),
    # Decelerations are counted without gravity. All else is a matter of computing.
    "numerics": frozenset({
        "dt", "safety", "damping_time", "contact_stiffness", "contact_damping", "end", "time_limit",
    }),
    "start": frozenset(),
}  # fmt: skip
"""Keys of a scene's parts that may be otherwise where a reference holds; of its other parts all."""


class Reference(Part):
    """What was measured in the impact of a scene, by whom."""

    name: str | None = Field(default=None, description="of the scene that has the title")
    title: str | None = Field(default=None, description="of this scene, for people")
    source: str = Field(description="who measured it, where")
    figures: Mapping[str, float] = Field(description="what was measured, by keys of summary.json")
    readings: Mapping[str, Mapping[str, float]] = Field(
        default={},
        description="by set of choices, values by dotted key that the source can be read to give",
    )
    velocity: float | None = Field(default=None, description="of that impact")
    impact: str | None = Field(default=None, description="digest of what was set up in it")

    def __hash__(self) -> int:
        """Of what tells references apart."""
        return hash((self.name, self.impact))

    def of(self, scene: Any) -> Reference:
        """The same, measured in the impact of a scene."""
        mine = {"velocity": _velocity(scene), "impact": self._digest(scene)}
        return self.model_copy(update={**mine, "name": self.name or scene.name})

    def has_velocity_of(self, scene: Any) -> bool:
        """Whether a scene's impactor has the velocity that was measured with, within 0.5 %."""
        given = _velocity(scene)
        if given is None or self.velocity is None:
            return given is self.velocity
        return math.isclose(given, self.velocity, rel_tol=_VELOCITY_WITHIN)

    def fits(self, scene: Any) -> bool:
        """Whether a scene has the impact that was measured in, whatever it is called."""
        return self.has_velocity_of(scene) and self.impact == self._digest(scene)

    def _digest(self, scene: Any) -> str:
        """Of all that was set up in a scene and is not as by default, but the velocity."""
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
    """What counts of a scene and has not its default value, by dotted key."""
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
    """The same to nine digits is the same: 0.1 + 0.2 is no other length than 0.3."""
    return float(f"{value:.9g}") if isinstance(value, float) else value
