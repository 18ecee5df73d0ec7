"""Scenes: one impact on one foam block, as typed, frozen, validated values in SI units.

Every part has defaults, those of the paper's tests; `Scene()` lacks only an impactor or an end
time. An invalid value raises `pydantic.ValidationError`; `scene.messages.explain` turns it into
readable text.
"""

from taichi_foam.choices import CHOICE_SETS
from taichi_foam.laws.bond.crushable import Foam
from taichi_foam.laws.bond.curve import Curve
from taichi_foam.laws.bond.recovering import RecoveringFoam
from taichi_foam.laws.bond.tabulated import TabulatedFoam
from taichi_foam.laws.shape.base import Impactor
from taichi_foam.laws.shape.bodies import Cylinder, Ellipse, FlatBlock, IShape, Wedge
from taichi_foam.laws.shape.polygon import Outline, Polygon
from taichi_foam.scene.block import Across, Block, Layer
from taichi_foam.scene.options import Base, Model, Numerics, Output, Pulse, Start
from taichi_foam.scene.scene import Scene
from taichi_foam.scene.support import Support

__all__ = [
    "CHOICE_SETS",
    "Across",
    "Base",
    "Block",
    "Curve",
    "Cylinder",
    "Ellipse",
    "FlatBlock",
    "Foam",
    "IShape",
    "Impactor",
    "Layer",
    "Model",
    "Numerics",
    "Outline",
    "Output",
    "Polygon",
    "Pulse",
    "RecoveringFoam",
    "Scene",
    "Start",
    "Support",
    "TabulatedFoam",
    "Wedge",
]


def __dir__() -> list[str]:
    return sorted(__all__)
