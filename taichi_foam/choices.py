"""Named options of scenes and the command line: sets of model choices, picture modes and themes.

Words and values only: the command line shows them before it loads the rest of the package.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Literal

Mode = Literal["worst-strain", "strain", "stress", "speed", "shear", "broken", "energy"]
"""The quantity that the colours of a picture show."""

Theme = Literal["light", "dark"]
"""Colour theme of a picture."""

PAPERS_FOAM: Mapping[str, Any] = MappingProxyType(
    {
        "yield_strain": -0.0425,  # for a plateau of 0.118 MPa; 0.12 MPa was measured
        "rate": 7.0,
        "overshoot_strain": 0.0155,
        "fracture_energy": 55.0,
        "shear_fracture_energy": 155.0,
        "crush_band": 0.005,
    }
)
"""Measured or calibrated constants of the paper's foam, where they differ from Table 1."""

CHOICE_SETS: Mapping[str, Mapping[str, object]] = MappingProxyType(
    {
        "calibrated": MappingProxyType(
            {
                "block.mass_points": "faces",
                **{f"foam.{key}": value for key, value in PAPERS_FOAM.items()},
                "foam.softening": True,
                "base.kind": "gripped",
                "impactor.friction": 0.13,
                "model.damping": "stiffness",
                "model.shear": "cell",
                "model.shear_failure": "pressure-dependent",
                "model.shear_pressure_coefficient": 0.7,
                "model.broken_contact": "reload",
                "model.self_contact": True,
                "model.crushed_room": True,
                "model.shear_yield": True,
            }
        ),
        "paper-literal": MappingProxyType(
            {
                "block.mass_points": "cells",
                "foam.yield_strain": -0.05,
                "foam.fracture_energy": None,
                "foam.shear_fracture_energy": None,
                "foam.crush_band": None,
                "foam.rate": None,
                "foam.overshoot_strain": None,
                "foam.softening": False,
                "base.kind": "held",
                "impactor.friction": 0.0,
                "model.damping": "absolute",
                "model.shear": "face",
                "model.shear_failure": "always",
                "model.broken_contact": "jump",
                "model.self_contact": False,
                "model.crushed_room": False,
                "model.shear_yield": False,
            }
        ),
    }
)
"""Named sets of model choices, for what the paper leaves open: dotted keys and their values.

The values of `block`, and of `foam` except softening, describe the paper's specimens.
"""
