"""What scenes and the command line choose by a word: sets of model choices, looks of pictures.

Words and values only: the command line shows them before anything else of the package loads.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal

Mode = Literal["worst-strain", "strain", "stress", "speed", "shear", "broken", "energy"]
"""What the colours of a picture show."""

Theme = Literal["light", "dark"]
"""Tones of a picture."""

PAPERS_FOAM: Mapping[str, float] = MappingProxyType(
    {
        "yield_strain": -0.042,  # of a plateau of 0.117 MPa; 0.12 MPa was measured
        "fracture_energy": 70.0,
        "shear_fracture_energy": 100.0,
        "crush_band": 0.005,
    }
)
"""What was measured or calibrated of the paper's foam, where it is not what Table 1 gives."""

CHOICE_SETS: Mapping[str, Mapping[str, object]] = MappingProxyType(
    {
        "calibrated": MappingProxyType(
            {
                "block.mass_points": "faces",
                **{f"foam.{key}": value for key, value in PAPERS_FOAM.items()},
                "foam.softening": True,
                "base.kind": "gripped",
                "impactor.friction": 0.14,
                "model.damping": "stiffness",
                "model.shear": "cell",
                "model.shear_failure": "pressure-dependent",
                "model.shear_pressure_coefficient": 0.7,
                "model.broken_contact": "reload",
                "model.self_contact": True,
                "model.crushed_room": True,
            }
        ),
        "paper-literal": MappingProxyType(
            {
                "block.mass_points": "cells",
                "foam.yield_strain": -0.05,
                "foam.fracture_energy": None,
                "foam.shear_fracture_energy": None,
                "foam.crush_band": None,
                "foam.softening": False,
                "base.kind": "held",
                "impactor.friction": 0.0,
                "model.damping": "absolute",
                "model.shear": "face",
                "model.shear_failure": "always",
                "model.broken_contact": "jump",
                "model.self_contact": False,
                "model.crushed_room": False,
            }
        ),
    }
)
"""Named sets of model choices, for what the paper leaves open: dotted keys and their values.

Those of `block`, and of `foam` but for softening, are the paper's own specimens.
"""
