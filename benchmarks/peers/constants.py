"""A scene's numbers as the peers take them: constants in one flat order, edges, start state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from taichi_foam.engine.parameters import impactor_edges, parameters_of

from taichi_foam.scene import Cylinder, Scene


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
    cell_a: float
    cell_b: float
    per_length_a: float
    per_length_b: float
    area_a: float
    area_b: float
    dashpot_a: float
    dashpot_b: float
    node_mass: float
    gravity: float
    hold_x: float
    hold_y: float
    floor_friction: float
    contact_stiffness: float
    support_stiffness: float
    impactor_x: float
    impactor_half_width: float
    impactor_mass: float
    impactor_friction: float
    step: float
    largest_step: float
    safety: float


@dataclass(frozen=True)
class Case:
    """One scene as the peers take it."""

    columns: int
    rows: int
    constants: Constants
    edges: np.ndarray  # (n, 3): outward normal and offset of each
    start: np.ndarray  # (columns, rows, 4): x, y, v_x, v_y
    body: np.ndarray  # (2,): the impactor's height and upward velocity


@dataclass(frozen=True)
class State:
    """Where a peer stands; units SI, y and velocities upwards."""

    position: np.ndarray  # (columns, rows, 2)
    velocity: np.ndarray  # (columns, rows, 2)
    impactor_y: float
    impactor_v: float
    time: float
    step: float
    broken: int
    works: dict[str, float]  # in the order of WORKS


WORKS = ("faces", "shear", "dashpots", "impactor", "friction", "base")


@dataclass(frozen=True)
class Skipped:
    """Why a peer cannot take part, in one line. It is false, so that `if peer:` reads well."""

    reason: str

    def __bool__(self) -> bool:
        return False


def lattice_of(scene: Scene, columns: int, rows: int) -> Scene:
    """The scene with other counts but the same cells, so that the step size stays the same.

    The impactor grows with the block's width, so that as large a part of it is hit.
    """
    block = scene.block
    size = {"width": columns * block.dx, "height": rows * block.dy}
    update: dict[str, object] = {
        "block": block.model_copy(update={"columns": columns, "rows": rows, **size})
    }
    impactor = scene.impactor
    if impactor is not None and hasattr(impactor, "width") and hasattr(impactor, "height"):
        share = size["width"] / block.width
        wider = {"mass": impactor.mass * share}
        if "width" in type(impactor).model_fields:
            wider["width"] = impactor.width * share
        update["impactor"] = impactor.model_copy(update=wider)
    return scene.model_copy(update=update)


def case_of(scene: Scene) -> Case:
    """The scene's numbers, without contact of pieces.

    Raises:
        ValueError: the scene asks for a reading of the model that the peers do not have.
    """
    p = parameters_of(scene)
    foam, model = p["foam"], scene.model
    refused = {
        "a cylinder": isinstance(scene.impactor, Cylinder),
        f"damping {model.damping!r}": model.damping != "bond",
        f"shear failure {model.shear_failure!r}": (
            model.shear_failure in ("tension-only", "angle")
        ),
        f"broken contact {model.broken_contact!r}": model.broken_contact != "reload",
        f"broken halves {model.broken_halves!r}": model.broken_halves != "either",
        f"shear {model.shear!r}": model.shear != "face",
        "foam that heeds the rate": scene.foam.rate is not None,
        "crushed foam that is weak all round": scene.foam.crushed_strength < 1.0,
        "strengths that differ": scene.foam.strength_scatter > 0.0 or bool(scene.start.cuts),
        "a start in motion": not scene.start.is_at_rest,
    }
    if any(refused.values()):
        names = ", ".join(name for name, is_so in refused.items() if is_so)
        raise ValueError(f"the peers do not know {names}")
    grows = model.shear_failure == "pressure-dependent"
    constants = Constants(
        youngs_modulus=foam["youngs_modulus"],
        shear_modulus=foam["shear_modulus"],
        yield_strain=foam["yield_strain"],
        tensile_strain=foam["tensile_strain"],
        shear_strength=foam["shear_modulus"] * foam["shear_failure_strain"],
        pressure_coefficient=foam["shear_pressure_coefficient"] if grows else 0.0,
        densification_strain=foam["densification_strain"],
        locking_strain=foam["locking_strain"],
        densification_a=foam["densification_a"],
        densification_b=foam["densification_b"],
        crushed_strain=foam["crushed_tensile_strain"],
        crushed_stress=foam["crushed_tensile_stress"],
        cell_a=p["cell"][0],
        cell_b=p["cell"][1],
        per_length_a=1.0 / p["cell"][0],
        per_length_b=1.0 / p["cell"][1],
        area_a=p["area"][0],
        area_b=p["area"][1],
        dashpot_a=p["cross_dashpot"][0],
        dashpot_b=p["cross_dashpot"][1],
        node_mass=p["node_mass"],
        gravity=p["gravity"],
        hold_x=float(p["hold_x"]),
        hold_y=float(p["hold_y"]),
        floor_friction=p["floor_friction"],
        contact_stiffness=p["contact_stiffness"],
        support_stiffness=p["support_stiffness"],
        impactor_x=p["impactor_x"],
        impactor_half_width=p["impactor_half_width"],
        impactor_mass=p["impactor_mass"],
        impactor_friction=p["impactor_friction"],
        step=p["step"],
        largest_step=p["largest_step"],
        safety=p["safety"],
    )
    block, impactor = scene.block, scene.impactor
    x = (np.arange(block.columns) - 0.5 * (block.columns - 1)) * block.dx
    y = (np.arange(block.rows) + 0.5) * block.dy
    start = np.zeros((block.columns, block.rows, 4))
    start[..., 0], start[..., 1] = np.meshgrid(x, y, indexing="ij")
    body = np.zeros(2)
    if impactor is not None:
        body[:] = scene.contact_height + impactor.gap, -impactor.velocity
    edges = np.ascontiguousarray(impactor_edges(scene)[: p["impactor_edges"]], dtype=np.float64)
    return Case(block.columns, block.rows, constants, edges, start, body)
