"""Scenes: one impact on one foam block, as typed, frozen, validated values in SI units.

Every part has defaults, those of the paper's tests; `Scene()` lacks only an impactor or an end
time. An invalid value raises `pydantic.ValidationError`; `scene.messages.explain` turns it into
readable text.
"""

from taichi_foam.choices import CHOICE_SETS
from taichi_foam.laws.bond import kinds as laws
from taichi_foam.laws.bond.curve import Curve
from taichi_foam.laws.bond.kinds import *  # noqa: F403
from taichi_foam.laws.shape import kinds as shapes
from taichi_foam.laws.shape.base import Impactor
from taichi_foam.laws.shape.kinds import *  # noqa: F403
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
    "Impactor",
    "Layer",
    "Model",
    "Numerics",
    "Output",
    "Pulse",
    "Scene",
    "Start",
    "Support",
]
__all__ += laws.__all__
__all__ += shapes.__all__


def __dir__() -> list[str]:
    return sorted(__all__)
