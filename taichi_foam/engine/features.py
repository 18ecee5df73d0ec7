"""What a scene's kernels are compiled for: everything that they choose by `ti.static`."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from taichi_foam.engine.strengths import limits
from taichi_foam.laws.bond import BondLaw
from taichi_foam.laws.shape import Impactor
from taichi_foam.scene import Scene


@dataclass(frozen=True)
class Features:
    """Scenes with equal features, and as many nodes, can share a batch and its kernels.

    law            of the bonds, with its options
    distance       of a point from the impactor's surface; without an impactor that of a polygon
    scattered      each bond has its own strength
    softens        bonds hold beyond their limits, with ever less of their faces
    variational    shear acts on all six nodes that its strain depends on
    four_weights   each broken bond is left out by itself (Model.broken_halves = "each"); otherwise
                   the two differences on one side of a bond count alike
    excess_damping   the dashpots along a bond differ from those across it
    drag           a dashpot on each node's own velocity
    self_contact   pieces touch each other
    crushed_room   cells keep the room that their bonds have left them
    turns          the impactor moves and turns in the plane
    """

    law: BondLaw
    distance: Callable[..., Any]
    scattered: bool
    softens: bool
    variational: bool
    four_weights: bool
    excess_damping: bool
    drag: bool
    self_contact: bool
    crushed_room: bool
    turns: bool


def features_of(scene: Scene) -> Features:
    """The features that a scene needs."""
    model = scene.model
    return Features(
        law=scene.foam.law_for(model),
        distance=(scene.impactor or Impactor).distance,
        scattered=scene.foam.strength_scatter > 0.0,
        softens=any(each.tail > 1.0 for pair in limits(scene) for each in pair),
        variational=model.shear == "variational",
        four_weights=model.broken_halves == "each",
        excess_damping=model.damping == "stiffness",
        drag=model.damping == "absolute",
        self_contact=model.self_contact,
        crushed_room=model.crushed_room,
        turns=scene.turns,
    )
