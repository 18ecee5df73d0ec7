"""One lattice's constants as a Taichi record, made from its scene.

They are data, not compile-time constants: a batch may differ in every one of them, and a study
that varies one compiles nothing again.
"""

import math

import numpy as np
import taichi as ti

from taichi_foam.laws import foam as foam_law
from taichi_foam.scene import Cylinder, Scene

MAX_EDGES = 16

# When cross differences are left out (Model.broken_halves).
EITHER = 0
BOTH = 1
EACH = 2

NO_IMPACTOR = 0
CIRCLE = 1
POLYGON = 2

# RK4 is stable for |h lambda| <= 2.61 everywhere in the left half-plane (2.79 on the real axis,
# 2.83 on the imaginary one); see docs/model.md for the bound on lambda.
RK4_RADIUS = 2.61

# The support stops the impactor as hard as it can without asking for a shorter step: the impactor
# swings on it this many times as slowly as a node on the impactor.
SLOWNESS = 20.0

vec2 = ti.types.vector(2, ti.f64)


@ti.dataclass
class Parameters:
    """SI units; of a pair, the first is of the bonds along x (A), the second along y (B)."""

    foam: foam_law.Foam
    cell: vec2  # (dx, dy), also the bonds' lengths
    area: vec2  # of the bonds' faces
    node_mass: ti.f64
    variational: ti.i32  # shear forces on all six nodes
    halves: ti.i32  # which of them Eq. 27 leaves out
    cross_dashpot: vec2  # on the relative velocity of a bond's nodes [N s/m]
    excess_dashpot: vec2  # on its part along the bond, beyond that
    drag: ti.f64  # on a node's own velocity [N s/m]
    gravity: ti.f64
    hold_x: ti.i32  # of the bottom row
    hold_y: ti.i32
    floor_friction: ti.f64
    contact_stiffness: ti.f64  # node against impactor, and of the friction springs [N/m]
    support_stiffness: ti.f64  # impactor against the support [N/m]
    impactor_kind: ti.i32
    impactor_x: ti.f64
    impactor_radius: ti.f64
    impactor_half_width: ti.f64
    impactor_edges: ti.i32
    impactor_mass: ti.f64
    impactor_friction: ti.f64
    self_contact: ti.i32
    piece_area: ti.f64  # of the contact of node with node [m2]
    piece_length: ti.f64
    piece_size: ti.f64  # radius of a node in contact over half its cell
    piece_friction: ti.f64
    piece_dashpot: ti.f64  # between pieces that rub, up to what friction holds [N s/m]
    skin: ti.f64  # how far beyond touch the neighbour list looks [m]
    step: ti.f64  # given step size [s], or 0: automatic
    largest_step: ti.f64
    safety: ti.f64
    end_time: ti.f64
    end_at_rebound: ti.i32
    row_interval: ti.f64


def parameters_of(scene: Scene) -> dict:
    """Every member of `Parameters` for one scene, nested as the record is."""
    block, foam, model, numerics = scene.block, scene.foam, scene.model, scene.numerics
    impactor, base = scene.impactor, scene.base
    stiffness = foam.youngs_modulus * block.thickness  # of a square cell's bond [N/m]
    area_a, area_b = block.dy * block.thickness, block.dx * block.thickness
    per_length = np.array([area_a / block.dx, area_b / block.dy])
    along, across = _viscosities(scene)
    drag = numerics.damping_time * stiffness
    contact = numerics.contact_stiffness * stiffness
    at_rebound = numerics.end == "rebound"
    cell = min(block.dx, block.dy)
    values = {
        "foam": _foam(scene),
        "cell": [block.dx, block.dy],
        "area": [area_a, area_b],
        "node_mass": block.node_mass,
        "variational": int(model.shear == "variational"),
        "halves": {"either": EITHER, "both": BOTH, "each": EACH}[model.broken_halves],
        "cross_dashpot": (across * per_length).tolist(),
        "excess_dashpot": ((along - across) * per_length).tolist(),
        "drag": drag if model.damping == "absolute" else 0.0,
        "gravity": numerics.gravity,
        "hold_x": int(base.kind == "gripped"),
        "hold_y": int(base.kind in ("held", "gripped")),
        "floor_friction": base.friction,
        "contact_stiffness": contact,
        "support_stiffness": 0.0,
        "impactor_kind": NO_IMPACTOR,
        "impactor_x": 0.0,
        "impactor_radius": 0.0,
        "impactor_half_width": 0.0,
        "impactor_edges": 0,
        "impactor_mass": 1.0,
        "impactor_friction": 0.0,
        "self_contact": int(model.self_contact),
        "piece_area": math.sqrt(area_a * area_b),
        "piece_length": math.sqrt(block.dx * block.dy),
        "piece_size": model.piece_size,
        "piece_friction": model.piece_friction,
        # half a bond's: the eight that the step's bound counts are four bonds' worth
        "piece_dashpot": 0.5 * numerics.damping_time * stiffness,
        "skin": 0.1 * cell,
        "step": 0.0 if numerics.dt == "auto" else numerics.dt,
        # no step jumps over a row of the history, however soft the foam
        "largest_step": 0.5 * scene.output.history_interval,
        "safety": numerics.safety,
        "end_time": numerics.time_limit if at_rebound else numerics.end,
        "end_at_rebound": int(at_rebound),
        "row_interval": scene.output.history_interval,
    }
    if impactor is not None:
        is_circle = isinstance(impactor, Cylinder)
        values |= {
            "impactor_kind": CIRCLE if is_circle else POLYGON,
            "impactor_x": impactor.x,
            "impactor_radius": impactor.radius if is_circle else 0.0,
            "impactor_half_width": float(np.abs(impactor.outline()[:, 0]).max()),
            "impactor_edges": 0 if is_circle else len(impactor.outline()),
            "impactor_mass": impactor.mass,
            "impactor_friction": impactor.friction,
            "support_stiffness": (
                contact * impactor.mass / block.node_mass / SLOWNESS**2
                if base.stops_impactor
                else 0.0
            ),
        }
    return values


def _viscosities(scene: Scene) -> tuple[float, float]:
    """Viscosity [Pa s] of a bond's dashpots along it and across it."""
    time, foam = scene.numerics.damping_time, scene.foam
    along = time * foam.youngs_modulus
    return {
        "bond": (along, along),
        "stiffness": (along, time * foam.shear_modulus),
        "absolute": (0.0, 0.0),
    }[scene.model.damping]


def _foam(scene: Scene) -> dict:
    foam, model = scene.foam, scene.model
    crushed_strain = foam.crushed_tensile_fraction * foam.tensile_strain
    crushed_stress = foam.crushed_tensile_stress
    return {
        "youngs_modulus": foam.youngs_modulus,
        "shear_modulus": foam.shear_modulus,
        "yield_strain": foam.yield_strain,
        "tensile_strain": foam.tensile_strain,
        "shear_failure_strain": foam.shear_strain,
        "densification_strain": foam.densification_strain,
        "locking_strain": foam.locking_strain,
        "densification_a": foam.densification_a,
        "densification_b": foam.densification_b,
        "crushed_tensile_strain": crushed_strain,
        "crushed_tensile_stress": (
            foam.youngs_modulus * crushed_strain if crushed_stress is None else crushed_stress
        ),
        "crushed_strength": foam.crushed_strength,
        "broken_contact": {"reload": foam_law.RELOAD, "jump": foam_law.JUMP}[model.broken_contact],
        "shear_failure": {
            "tension-only": foam_law.TENSION_ONLY,
            "always": foam_law.ALWAYS,
            "pressure-dependent": foam_law.PRESSURE_DEPENDENT,
            "angle": foam_law.ANGLE,
        }[model.shear_failure],
        "shear_pressure_coefficient": model.shear_pressure_coefficient,
        "rate": foam.rate or 0.0,
        "rate_exponent": foam.rate_exponent,
    }


def impactor_edges(scene: Scene) -> np.ndarray:
    """Outward half-planes (n_x, n_y, offset) of a polygonal impactor, (MAX_EDGES, 3).

    A point p relative to the impactor's lowest point lies inside where n . p < offset for all.
    """
    edges = np.zeros((MAX_EDGES, 3))
    if scene.impactor is None or isinstance(scene.impactor, Cylinder):
        return edges
    outline = scene.impactor.outline()
    following = np.roll(outline, -1, axis=0)
    along = following - outline
    middle = 0.5 * (following + outline)  # not an end: a mirrored edge starts at its other end
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1)
    normals /= np.hypot(along[:, 0], along[:, 1])[:, None]
    count = len(outline)
    edges[:count, :2] = normals
    edges[:count, 2] = normals[:, 0] * middle[:, 0] + normals[:, 1] * middle[:, 1]
    return edges


@ti.func
def stable_step(p: Parameters, densified: ti.f64) -> ti.f64:
    """Step size [s] for a lattice whose stiffest densified bond has `densified` [N/m].

    Gershgorin's theorem bounds the modes: a node answers with at most 4 k of its normal and 8 k_s
    of its shear bonds (20 k_s by the variational form), 8 k of packed pieces and once the
    contact with a body (normal and friction act across each other); dashpots decay at no more than
    8 c / m, with eight more of pieces that rub, a drag at C / m.
    """
    per_length = p.area / p.cell
    elastic = foam_law.elastic_modulus(p.foam) * per_length.max()
    sheared = ti.select(p.variational, 20.0, 8.0) * p.foam.shear_modulus * per_length.max()
    stiffest = ti.max(elastic, densified)
    if p.foam.rate > 0.0:
        stiffest = elastic + densified  # the overstress comes on top
    stiffness = 4.0 * stiffest + sheared + p.contact_stiffness
    if p.self_contact:
        stiffness += 8.0 * foam_law.PACKED * p.foam.youngs_modulus * per_length.max()
    dashpots = ti.max(p.cross_dashpot, p.cross_dashpot + p.excess_dashpot)
    decay = 4.0 * dashpots.sum() + p.drag
    if p.self_contact and p.piece_friction > 0.0:
        decay += 8.0 * p.piece_dashpot
    rate = ti.max(ti.sqrt(stiffness / p.node_mass), decay / p.node_mass)
    return ti.min(p.safety * RK4_RADIUS / rate, p.largest_step)
