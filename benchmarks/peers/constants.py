"""A scene's numbers as the peers take them: constants in one flat order, edges, start state.

They are worked out from the scene, not taken from the engine, so that a comparison of both tests
these formulas too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from taichi_foam.scene import Foam, Impactor, Model, Scene

# The impactor swings on the support so many times as slowly as a node on the impactor.
SLOWNESS = 20.0


class Constants(NamedTuple):
    """Every constant of a step, in the order of model.hpp. SI units; `_a` along x, `_b` along y."""

    youngs_modulus: float
    shear_modulus: float
    yield_strain: float
    tensile_strain: float
    shear_strength: float
    pressure_coefficient: float
    densification_strain: float
    locking_strain: float
    densification_a: float
    densification_b: float
    crushed_strain: float
    crushed_stress: float
    tensile_tail_a: float
    tensile_tail_b: float
    shear_tail_a: float
    shear_tail_b: float
    rate: float
    cell_a: float
    cell_b: float
    per_length_a: float
    per_length_b: float
    area_a: float
    area_b: float
    thickness: float
    dashpot_a: float
    dashpot_b: float
    shear_viscosity: float
    node_mass: float
    gravity: float
    hold_x: float
    hold_y: float
    floor_friction: float
    contact_stiffness: float
    contact_dashpot: float
    support_stiffness: float
    impactor_x: float
    impactor_half_width: float
    impactor_mass: float
    impactor_friction: float
    step: float
    largest_step: float
    safety: float


class Features(NamedTuple):
    """What the peers are compiled for: each part of a step that not every scene needs."""

    rate: bool
    """The plateau's stress grows with the strain rate."""
    room: bool = False
    """Cells keep the room that their bonds have left them."""
    softening: bool = False
    """Bonds hold beyond their limits, with ever less of their faces."""


RATE_ONLY = Features(rate=True)


@dataclass(frozen=True)
class Case:
    """One scene as the peers take it."""

    columns: int
    rows: int
    features: Features
    constants: Constants
    edges: np.ndarray  # (n, 3): outward normal and offset of each
    start: np.ndarray  # (columns, rows, 4): x, y, v_x, v_y
    body: np.ndarray  # (2,): the impactor's height and upward velocity


@dataclass(frozen=True)
class State:
    """Where a peer stands; units SI, y upwards."""

    position: np.ndarray  # (columns, rows, 2)
    impactor_y: float
    time: float
    step: float
    broken: int
    works: dict[str, float]  # in the order of WORKS


WORKS = ("bonds", "shear", "dashpots", "contact", "friction", "room")


@dataclass(frozen=True)
class Skipped:
    """Why a peer cannot take part, in one line.

    Only what is not installed is skipped; anything else that goes wrong is an error.
    """

    reason: str


def case_of(scene: Scene, known: Features = RATE_ONLY) -> Case:
    """The scene's numbers, without contact of pieces, for a peer that has the features `known`.

    Raises:
        ValueError: the scene asks for a choice that the peer does not have.
    """
    foam, impactor = _checked(scene, known)
    block, base, model, numerics = scene.block, scene.base, scene.model, scene.numerics
    features = Features(
        rate=foam.rate is not None, room=model.crushed_room, softening=foam.softening
    )
    area_a, area_b = block.dy * block.depth, block.dx * block.depth
    stretch_a, stretch_b = area_a / block.dx, area_b / block.dy  # area over length
    along = numerics.damping_time * foam.youngs_modulus
    crushed_strain = foam.crushed_tensile_fraction * foam.tensile_strain
    crushed_stress = foam.crushed_tensile_stress
    (tension_a, shear_a), (tension_b, shear_b) = foam.limits(block.dx), foam.limits(block.dy)
    contact = numerics.contact_stiffness * foam.youngs_modulus * block.depth
    touching = max(
        min(block.columns, math.floor(impactor.extent / block.dx) + 1),
        2 * min(block.rows, math.ceil(impactor.nose_depth / block.dy)),
    )
    swing = math.sqrt(contact / block.node_mass + touching * contact / impactor.mass)
    outline = impactor.outline()
    constants = Constants(
        youngs_modulus=foam.youngs_modulus,
        shear_modulus=foam.shear_modulus,
        yield_strain=foam.yield_strain,
        tensile_strain=foam.tensile_strain,
        shear_strength=foam.shear_modulus * foam.shear_strain,
        pressure_coefficient=(
            model.shear_pressure_coefficient if model.shear_failure != "always" else 0.0
        ),
        densification_strain=foam.densification_strain,
        locking_strain=foam.locking_strain,
        densification_a=foam.densification_a,
        densification_b=foam.densification_b,
        crushed_strain=crushed_strain,
        crushed_stress=(
            foam.youngs_modulus * crushed_strain if crushed_stress is None else crushed_stress
        ),
        tensile_tail_a=tension_a.tail,
        tensile_tail_b=tension_b.tail,
        shear_tail_a=shear_a.tail,
        shear_tail_b=shear_b.tail,
        rate=foam.rate or 0.0,
        cell_a=block.dx,
        cell_b=block.dy,
        per_length_a=1.0 / block.dx,
        per_length_b=1.0 / block.dy,
        area_a=area_a,
        area_b=area_b,
        thickness=block.depth,
        dashpot_a=along * stretch_a,
        dashpot_b=along * stretch_b,
        shear_viscosity=numerics.damping_time * foam.shear_modulus,
        node_mass=block.node_mass,
        gravity=numerics.gravity,
        hold_x=float(base.kind == "gripped"),
        hold_y=float(base.kind != "floor"),
        floor_friction=base.friction,
        contact_stiffness=contact,
        contact_dashpot=2.0 * numerics.contact_damping * contact / swing,
        support_stiffness=(
            contact * impactor.mass / block.node_mass / SLOWNESS**2 if base.stops_impactor else 0.0
        ),
        impactor_x=impactor.x,
        impactor_half_width=float(np.abs(outline[:, 0]).max()),
        impactor_mass=impactor.mass,
        impactor_friction=impactor.friction,
        step=0.0 if numerics.dt == "auto" else numerics.dt,
        largest_step=0.5 * scene.output.history_interval,
        safety=numerics.safety,
    )
    start = np.zeros((block.columns, block.rows, 4))
    start[..., :2] = block.positions
    body = np.array([scene.contact_height + impactor.gap, -impactor.velocity])
    return Case(block.columns, block.rows, features, constants, _edges(outline), start, body)


def _checked(scene: Scene, known: Features) -> tuple[Foam, Impactor]:
    """Foam and impactor of a scene, refused if a peer would compute otherwise than the engine."""
    foam, impactor, model = scene.foam, scene.impactor, scene.model
    if not isinstance(foam, Foam):
        raise ValueError(f"the peers do not know the bond law {foam.law!r}")
    model_known: dict[str, tuple[Any, ...]] = {  # of other keys the peers know the default
        "damping": ("stiffness",),
        "shear": ("cell",),
        "shear_failure": ("always", "pressure-dependent"),
        "shear_pressure_coefficient": (model.shear_pressure_coefficient,),
        "broken_contact": ("reload",),
        "self_contact": (False,),
        "shear_yield": (False,),
        "crushed_room": (False, known.room),
    }
    refused = {
        "a scene without impactor": impactor is None,
        "an impactor that is no polygon": (
            impactor is not None
            and (impactor.is_circle or impactor.distance is not Impactor.distance)
        ),
        "mass points that stand for no whole cells": not scene.block.is_rectangle,
        "a plateau that heeds the rate": foam.rate is not None and not known.rate,
        "a rate that grows as foam yields": (
            foam.rate is not None and foam.overshoot_strain is not None
        ),
        f"rate exponent {foam.rate_exponent:g}": (
            foam.rate is not None and foam.rate_exponent != 1.0
        ),
        "crushed foam without tensile stress": foam.crushed_tensile_stress == 0.0,
        "bonds that soften": foam.softening and not known.softening,
        "limits that are not those of the law": any(
            each.share != 1.0
            for length in (scene.block.dx, scene.block.dy)
            for each in foam.limits(length)
        ),
        "strain rates over a crush band": foam.crush_band is not None,
        "strengths that differ": foam.strength_scatter > 0.0 or bool(scene.start.cuts),
        "a start in motion": not scene.start.is_at_rest,
        **{
            f"model.{key} = {value}": value not in model_known.get(key, (default,))
            for (key, value), (_, default) in zip(model, Model(), strict=True)
        },
    }
    if impactor is None or any(refused.values()):
        names = ", ".join(name for name, is_so in refused.items() if is_so)
        raise ValueError(f"the peers do not know {names}")
    return foam, impactor


def _edges(outline: np.ndarray) -> np.ndarray:
    """Outward half-planes (n, 3) of a convex outline: normal, and offset from its lowest point."""
    following = np.roll(outline, -1, axis=0)
    along = following - outline
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1)
    normals /= np.hypot(along[:, 0], along[:, 1])[:, None]
    offsets = (normals * 0.5 * (outline + following)).sum(axis=1)
    return np.ascontiguousarray(np.column_stack([normals, offsets]))
