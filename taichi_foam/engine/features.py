"""Features that a scene's kernels are compiled for: everything that they select by `ti.static`."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_foam.engine.grading import grading, limits
from taichi_foam.laws.bond import BondLaw
from taichi_foam.laws.shape import Impactor, edges
from taichi_foam.scene import Block, Scene
from taichi_foam.scene.filling import Filling, filling


@dataclass(frozen=True)
class Features:
    """Scenes with equal features and lattices of the same size can share a batch and its kernels.

    law            the bond law, with its options
    distance       function for the distance of a point from the impactor's surface; without an
                   impactor, that of a polygon
    scattered      each bond has its own strength
    softens        bonds soften beyond their limits instead of breaking at once
    faces          bonds carry shear, by the strain at their faces (Model.shear = "face")
    cells          cells carry the shear, or keep the room that their bonds have left them, or the
                   law looks around each bond
    drag           a dashpot acts on each node's absolute velocity
    self_contact   pieces can touch each other
    crushed_room   cells keep the room that their bonds have left them
    shear_yields   shear and crush have one yield surface (Model.shear_yield)
    shaped         mass points and faces differ from those of a plain block
    alike          columns of such a block are identical and stored once, see `Filling.is_alike`
    edged          its foam reaches beyond mass points, or less far, see `Filling.edge`
    foams          number of foams of the bonds
    turns          the impactor moves and turns in the plane
    shaken         a pulse accelerates the base
    supported      the block stands on a support with an outline, in place of the floor
    """

    law: BondLaw
    distance: Callable[..., Any]
    scattered: bool
    softens: bool
    faces: bool
    cells: bool
    drag: bool
    self_contact: bool
    crushed_room: bool
    shear_yields: bool
    shaped: bool
    alike: bool
    edged: bool
    foams: int
    turns: bool
    shaken: bool
    supported: bool

    @property
    def flows(self) -> bool:
        """Whether what bonds remember also changes between two steps, see `bonds.flow_pack`."""
        return self.law.heeds_rate or self.shear_yields


def features_of(scene: Scene) -> Features:
    """The features that a scene needs."""
    model, foams = scene.model, grading(scene).foams
    law, faces = scene.foam.law_for(model), model.shear == "face"
    filled = filling(scene.block)
    shaped = not _is_plain(scene.block, filled)
    edged = filled.has_edges
    return Features(
        law=law,
        distance=(
            edges.distance_of(scene.impactor, edged) if scene.impactor else Impactor.distance
        ),
        scattered=scene.foam.strength_scatter > 0.0,
        softens=any(
            each.tail > 1.0 for foam in foams for pair in limits(foam, scene.block) for each in pair
        ),
        faces=faces,
        cells=model.crushed_room or not faces or law.looks_around,
        drag=model.damping == "absolute",
        self_contact=model.self_contact,
        crushed_room=model.crushed_room,
        shear_yields=model.shear_yield and law.yields_in_shear and not faces,
        shaped=shaped,
        alike=shaped and filled.is_alike,
        edged=edged,
        foams=len(foams),
        turns=scene.turns,
        shaken=scene.base.shaking is not None,
        supported=scene.support.kind != "floor",
    )


def _is_plain(block: Block, filled: Filling) -> bool:
    """Whether all mass points are equal and foam fills every cell."""
    return filled.is_full and bool(np.all(filled.mass == block.node_mass))
