"""Model: the constants of a scene, as values and as fields.

They are data, not compile-time constants: the scenes of a batch may differ in any of them, and a
study that varies one recompiles nothing. `Features` lists what kernels are compiled for.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.backend import ti
from taichi_foam.engine.features import Features, features_of
from taichi_foam.engine.grading import A, B, Grading, grading, limits, rate_shares, strengths
from taichi_foam.engine.layout import Layout
from taichi_foam.laws.bond import BondFoam, BondLaw
from taichi_foam.laws.bond.base import TABLE_ROWS
from taichi_foam.laws.bond.curve import SHEAR
from taichi_foam.laws.shape.base import MOST_CORNERS, SURFACE_ROWS, Impactor
from taichi_foam.laws.shape.edges import edges_of, surface_of
from taichi_foam.laws.shape.outline import convex_hull
from taichi_foam.scene import Block, Scene
from taichi_foam.scene.filling import filling
from taichi_foam.scene.options import MOST_PULSE_POINTS

# RK4 is stable for |h lambda| <= 2.61 everywhere in the left half-plane (2.79 on the real axis,
# 2.83 on the imaginary one); see docs/model.md for the bound on lambda.
RK4_RADIUS = 2.61
RK4_DECAY = 2.785

# In a step no node moves further than this fraction of a cell: half the skin, within which the
# neighbour list misses no pair.
MOST_WAY = 0.05

# An impactor HEAVY times as heavy as the nodes it may touch does not oscillate on them. The
# oscillation of a lighter one carries all of the impact's energy and must be resolved: steps are
# FOLLOWED times shorter than stability requires.
HEAVY = 100.0
FOLLOWED = 4.0

# The support stops the impactor as hard as it can without requiring a shorter step: the impactor
# oscillates on it this many times as slowly as a node on the impactor.
SLOWNESS = 20.0

Array = NDArray[np.float64]

vec2 = ti.types.vector(2, ti.f64)
vec3 = ti.types.vector(3, ti.f64)

MEMBERS = {
    # SI units; the first of a pair is for the bonds along x (A), the second for those along y (B)
    "cell": vec2,  # (dx, dy), also the bonds' lengths
    "area": vec2,  # of the bonds' faces
    "node_mass": ti.f64,
    "drag": ti.f64,  # on a node's own velocity [N s/m]
    "gravity": ti.f64,
    "hold_x": ti.i32,  # of the bottom row
    "hold_y": ti.i32,
    "floor_friction": ti.f64,
    "contact_stiffness": ti.f64,  # node against impactor, and of the friction springs [N/m]
    "contact_dashpot": ti.f64,  # parallel to that spring, over its stiffness [s]
    "support_stiffness": ti.f64,  # impactor against the support [N/m]
    # 32-bit integers come in pairs: Vulkan misreads floats that are not aligned to 64 bits
    "impactor": ti.i32,  # whether there is one
    "end_at_rebound": ti.i32,
    "impactor_x": ti.f64,
    "impactor_half_width": ti.f64,
    "impactor_height": ti.f64,
    "impactor_centre": vec2,  # of mass, relative to the reference point at the start
    "impactor_reach": ti.f64,  # distance of the furthest point from there
    "impactor_inertia": ti.f64,
    "pulse_points": ti.f64,  # number in `ModelFields.pulse`; a float, for integers see Layout
    "hull_corners": ti.f64,  # number in `ModelFields.hull`; a float, for integers see Layout
    "support_rows": ti.f64,  # number in `ModelFields.support`; a float, for integers see Layout
    "support_low": vec2,  # corners of the box around the support with an outline
    "support_high": vec2,
    "impactor_mass": ti.f64,
    "impactor_rate": ti.f64,  # squared, of its oscillation on touched nodes [1/s2]; 0: heavy
    "impactor_friction": ti.f64,
    "crosshead": ti.f64,  # 1: the impactor keeps its velocity; a float, for integers see Layout
    "surface_rows": ti.f64,  # number in `ModelFields.surface`; a float, for integers see Layout
    "piece_area": ti.f64,  # of the contact between two nodes [m2]
    "piece_length": ti.f64,
    "piece_size": ti.f64,  # radius of a node in contact over half its cell
    "piece_friction": ti.f64,
    "piece_dashpot": ti.f64,  # between pieces that slide, up to the friction limit [N s/m]
    "thickness": ti.f64,
    "skin": ti.f64,  # gap up to which the neighbour list contains pairs [m]
    "step": ti.f64,  # given step size [s], or 0: automatic
    "largest_step": ti.f64,
    "safety": ti.f64,
    "end_time": ti.f64,
    "row_interval": ti.f64,
}


SHARES = (
    # how a bond's length changes its limits, see `laws.bond.base.Limit`
    "tensile_share",  # limit over the law's limit
    "shear_share",
    "tensile_tail",  # where the stress has fallen to zero, over the limit; at least 1
    "shear_tail",
    "flow_share",  # time over which worst strains flow, over the step
    "dashpot",  # along a bond with a whole face [N s/m]
    "shear_viscosity",  # of the cells [Pa s], the same for both axes
)
"""Values for the bonds of a foam along one axis."""


@cache
def foam_type(law: type[BondLaw]) -> Any:
    """Taichi record of a foam: its law's constants as `bond`, SHARES of bonds A and B as `a`, `b`.

    The masses [kg] are minima over the mass points that have bonds of this foam: of the mass over
    the mean share of the point's two faces along an axis (`bond_mass`), over the mean share of its
    four cells (`cell_mass`), and over the share of its own cell (`piece_mass`). In a plain block
    all three are the mass of a whole cell.
    """
    shares = ti.types.struct(**dict.fromkeys(SHARES, ti.f64))
    masses = dict.fromkeys(("bond_mass", "cell_mass", "piece_mass"), ti.f64)
    return ti.types.struct(bond=law.Constants, a=shares, b=shares, **masses)


@cache
def parameters_type(law: type[BondLaw]) -> Any:
    """Taichi record of a lattice's constants: those of its first foam, then MEMBERS."""
    return ti.types.struct(**foam_type(law).members, **MEMBERS)


FILLING = ("mass", "face_a", "face_b", "share", "cell", "reach", "edge")
"""Values of the mass points of a shaped block, by the names of `Filling`."""


@dataclass(frozen=True)
class Model:
    """The constants of a scene, as the device takes them.

    numbers    (n,) every member of `parameters_type`, in its order
    lists      by the names of `ModelFields.lists`, (n, m) each; mobilities (J,)
    tables     (TABLE_ROWS, columns) for each foam, if its law is tabulated
    of_nodes   by the names of fields, (I, J), or (1, J) where columns are identical: those of
               `ModelFields.filling` and `mobility`, unless the block is plain; strengths of the
               bonds over their mean, (I, J), if they are scattered
    foams      (foams, n) every member of `foam_type`; None: there is one foam
    places     (2, J) index of the foam of bonds A and B of each row
    """

    numbers: Array
    lists: Mapping[str, Array]
    tables: Sequence[Array]
    of_nodes: Mapping[str, Array]
    foams: Array | None
    places: NDArray[np.int32]


def model_of(scene: Scene) -> Model:
    """The model of a scene."""
    law, graded = type(scene.foam.law_for(scene.model)), grading(scene)
    features = features_of(scene)
    record, outline = parameters_type(law), scene.support.outline_under(scene.block)
    lists, of_nodes = {"surface": _surface(scene)}, {}
    if scene.turns:
        lists["hull"] = _hull(scene)
    if scene.base.shaking is not None:
        lists["pulse"] = np.column_stack([scene.base.shaking.time, scene.base.shaking.acceleration])
    if outline is not None:
        lists["support"] = edges_of(outline)
    if features.shaped:
        of_nodes = _filled(scene, features.alike)
    else:
        rows = np.arange(scene.block.rows)
        lists |= _moved(scene, np.full(len(rows), _whole_mass(scene.block)), rows == 0)
    if features.scattered:
        drawn = strengths(scene)
        of_nodes |= {"strength_a": drawn[..., A], "strength_b": drawn[..., B]}
    return Model(
        numbers=np.array([*_numbers(record, parameters_of(scene))], dtype=np.float64),
        lists=lists,
        tables=_tables(scene, graded),
        of_nodes=of_nodes,
        foams=_foams(scene, graded) if len(graded.foams) > 1 else None,
        places=graded.places,
    )


def _tables(scene: Scene, graded: Grading) -> Sequence[Array]:
    found = [foam.table for foam in graded.foams]
    if any(table is None for table in found):
        return ()
    tables = np.array(found)
    if scene.across.foam is not None:  # both foams get the larger rise in shear stiffness
        pair = [*{*graded.places[:, graded.places[A] != graded.places[B]].ravel().tolist()}]
        tables[pair, :, SHEAR] = tables[pair, :, SHEAR].max(axis=0)
    return tables


def _moved(scene: Scene, mass: Array, stands: Array) -> dict[str, Array]:
    """`ModelFields.mobility` of mass points of given mass [kg]; `stands`: which are on the base."""
    kind = scene.base.kind
    free = np.divide(1.0, mass, out=np.zeros_like(mass), where=mass > 0.0)
    y = np.where(stands, 0.0, free) if kind in ("held", "gripped") else free
    return {
        "mobility.x": np.where(stands, 0.0, free) if kind == "gripped" else free,
        "mobility.y": y,
        "mobility.gravity": np.where(y > 0.0, scene.numerics.gravity, 0.0),
    }


def _filled(scene: Scene, alike: bool) -> dict[str, Array]:
    """The part of `Model.of_nodes` for a block that is not plain."""
    filled, shape = filling(scene.block), (scene.block.columns, scene.block.rows)
    if alike:
        shape = 1, scene.block.rows

    def padded(values: Array) -> Array:
        found, kept = np.zeros(shape), values[: shape[0]]
        found[: kept.shape[0], : kept.shape[1]] = kept
        return found

    return {
        **{f"filling.{name}": padded(getattr(filled, name)) for name in FILLING},
        **_moved(scene, padded(filled.mass), padded(filled.on_base) > 0.0),
    }


def _foams(scene: Scene, graded: Grading) -> Array:
    record = foam_type(type(scene.foam.law_for(scene.model)))
    rows = (_foam(scene, graded, n) for n in range(len(graded.foams)))
    return np.array([[*_numbers(record, row)] for row in rows])


def _numbers(record: Any, values: dict[str, Any]) -> Iterator[float]:
    """The numbers of a record, nested records and vectors included, in the record's order."""
    for name, kind in record.members.items():
        value = values[name]
        if isinstance(value, dict):
            yield from _numbers(kind, value)
        elif isinstance(value, list):
            yield from value
        else:
            yield value


class ModelFields:
    """The constants of a batch of lattices on the device.

    parameters  (batch,) records of `parameters_type`
    surface     (batch, SURFACE_ROWS) three numbers each, see `Impactor.surface`
    hull        (batch, MOST_CORNERS) corners of the impactor's convex hull, if impactors turn
    pulse       (batch, MOST_PULSE_POINTS) time and acceleration of the base, if it is shaken
    support     (batch, SURFACE_ROWS) three numbers each, as in `surface`, if it has an outline
    mobility    (batch, packs) per row of nodes: inverse mass along x and y [1/kg], 0 where the node
                is held, and gravity [m/s2]; in a shaped block (batch, I, packs), per node
    filling     (batch, I, packs) of a shaped block: mass of each mass point [kg], shares of the
                faces of bonds A and B, share of its cell, share of the lattice cell to the right
                of and above it, distance of the foam's face [m], and how far the foam reaches to a
                body [m]; I is 1 if columns are identical, see `makeup.column`
    foams       (batch, foams) records of `foam_type`, if there are several
    graded      (batch, 2 * packs) the same in packs by row, for bonds A, then for bonds B
    foam_of_row (batch, 2 * rows) index in `foams` for bonds A, then bonds B of each row
    strength_a, strength_b, strengths   (batch, I, packs) of bonds over their mean, if they are
                scattered
    table       (batch * foams, TABLE_ROWS) numbers of a row each, if the law is tabulated
    law         the bond law, with that table
    lists       names and fields of the constants that come as lists
    """

    def __init__(self, layout: Layout, features: Features) -> None:
        pack, small_pack = layout.pack, layout.small_pack
        self.parameters = parameters_type(type(features.law)).field()
        self.surface = vec3.field()
        self.mobility = ti.types.struct(x=pack, y=pack, gravity=pack).field()
        layout.of_lattices(self.parameters)
        layout.listed(SURFACE_ROWS, self.surface)
        if features.shaped:
            self.filling = ti.types.struct(**dict.fromkeys(FILLING, pack)).field()
            place = layout.of_rows if features.alike else layout.of_nodes
            place(self.mobility, self.filling)
        else:
            layout.listed(layout.packs, self.mobility)
        if features.foams > 1:
            self._place_foams(layout, features)
        if features.turns:
            self.hull = vec2.field()
            layout.listed(MOST_CORNERS, self.hull)
        if features.shaken:
            self.pulse = vec2.field()
            layout.listed(MOST_PULSE_POINTS, self.pulse)
        if features.supported:
            self.support = vec3.field()
            layout.listed(SURFACE_ROWS, self.support)
        if features.scattered:
            self.strength_a, self.strength_b = small_pack.field(), small_pack.field()
            self.strengths = (self.strength_a, self.strength_b)
            layout.of_nodes(*self.strengths)
        self.law = features.law
        if features.law.tabulated:
            self.table = ti.Vector.field(features.law.table_columns, ti.f64)
            layout.of_foams(features.foams, TABLE_ROWS, self.table)
            self.law = features.law.with_table(self.table)
        self.members = list(_members(self.parameters))
        names = ("surface", "hull", "pulse", "support")
        self.lists = [(name, getattr(self, name)) for name in names if hasattr(self, name)]
        if not features.shaped:
            for name in self.mobility.keys:
                self.lists += [(f"mobility.{name}", self.mobility.get_member_field(name))]

    def _place_foams(self, layout: Layout, features: Features) -> None:
        record = foam_type(type(features.law))
        pack = layout.pack
        in_packs = dict.fromkeys(record.members["bond"].members, pack)
        self.foams = record.field()
        self.graded = ti.types.struct(
            bond=ti.types.struct(**in_packs),
            shares=ti.types.struct(**dict.fromkeys(SHARES, pack)),
        ).field()
        self.foam_of_row = ti.field(ti.i32)
        layout.listed(features.foams, self.foams)
        layout.listed(2 * layout.packs, self.graded)
        layout.listed(2 * layout.rows, self.foam_of_row, whole=True)
        self.foam_members = list(_members(self.foams))
        packs = list(_members(self.graded))[:: layout.lanes]  # `_members` yields every lane
        self.graded_members = [
            [
                (pack[0], source[0])
                for pack, source in zip(
                    packs, [*_members(self._of("bond")), *_members(self._of(axis))], strict=True
                )
            ]
            for axis in "ab"
        ]

    def _of(self, part: str) -> Any:
        return self.foams.get_member_field(part)


def _members(record: Any) -> Iterator[tuple]:
    """The scalar members of a record field, nested ones included: field, vector component, kind."""
    for name in record.keys:
        member = record.get_member_field(name)
        if isinstance(member, ti.StructField):
            yield from _members(member)
        elif isinstance(member, ti.MatrixField):
            yield from ((member, component, "vector") for component in range(member.n))
        else:
            yield member, 0, "integer" if member.dtype == ti.i32 else "number"


def parameters_of(scene: Scene) -> dict:
    """Every member of `parameters_type` for one scene, by name; 0 if the scene does not use it."""
    block, foam, model, numerics = scene.block, scene.foam, scene.model, scene.numerics
    impactor, base = scene.impactor, scene.base
    stiffness = foam.youngs_modulus * block.depth  # of a square cell's bond [N/m]
    area_a, area_b = block.dy * block.depth, block.dx * block.depth
    drag = numerics.damping_time * stiffness
    contact = numerics.contact_stiffness * stiffness
    at_rebound = numerics.end == "rebound"
    cell = min(block.dx, block.dy)
    values = {name: [0.0, 0.0] if kind is vec2 else 0 for name, kind in MEMBERS.items()}
    values |= {
        **_foam(scene, grading(scene), 0),
        "cell": [block.dx, block.dy],
        "area": [area_a, area_b],
        "node_mass": _whole_mass(block),
        "drag": drag if model.damping == "absolute" else 0.0,
        "gravity": numerics.gravity,
        "hold_x": int(base.kind == "gripped"),
        "hold_y": int(base.kind in ("held", "gripped")),
        "floor_friction": base.friction,
        "contact_stiffness": contact,
        "contact_dashpot": 2.0 * numerics.contact_damping * _swing(scene, contact),
        "pulse_points": 0.0 if base.shaking is None else len(base.shaking.time),
        "impactor_mass": 1.0,
        "impactor_inertia": 1.0,
        "piece_area": math.sqrt(area_a * area_b),
        "piece_length": math.sqrt(block.dx * block.dy),
        "piece_size": model.piece_size,
        "piece_friction": model.piece_friction,
        "piece_dashpot": _piece_dashpot(scene),
        "thickness": block.depth,
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
        half_width, height = impactor.box
        answering = _answering_mass(impactor)
        values |= {
            "impactor": 1,
            "impactor_x": impactor.x,
            "impactor_half_width": half_width,
            "impactor_height": height,
            "impactor_mass": impactor.mass,
            "impactor_rate": _impactor_rate(scene, contact),
            "impactor_friction": impactor.friction,
            "crosshead": float(impactor.motion == "crosshead"),
            "surface_rows": len(_surface(scene)),
            "support_stiffness": (
                contact * answering / block.node_mass / SLOWNESS**2 if base.stops_impactor else 0.0
            ),
        }
    if impactor is not None and scene.turns:
        values |= {
            "impactor_centre": impactor.centre_of_mass.tolist(),
            "impactor_reach": impactor.reach,
            "impactor_inertia": impactor.moment_of_inertia,
            "hull_corners": len(_hull(scene)),
        }
    outline = scene.support.outline_under(block)
    if outline is not None:
        values |= {
            "support_rows": len(edges_of(outline)),
            "support_low": outline.min(axis=0).tolist(),
            "support_high": outline.max(axis=0).tolist(),
        }
    return values


def _surface(scene: Scene) -> NDArray[np.float64]:
    """The impactor's surface (n, 3), see `laws.shape.edges.surface_of`."""
    if scene.impactor is None:
        return np.zeros((1, 3))
    cell = min(scene.block.dx, scene.block.dy)
    return surface_of(scene.impactor, cell, filling(scene.block).has_edges)


def _hull(scene: Scene) -> Array:
    """Corners of the impactor's convex hull (n, 2), relative to its reference point [m]."""
    assert scene.impactor is not None
    return convex_hull(scene.impactor.outline())


def _answering_mass(impactor: Impactor) -> float:
    """The smallest effective mass [kg] at any point of an impactor.

    A free impactor also turns: a point at distance r from its centre of mass has the effective mass
    1 / (1/m + r^2/I).
    """
    if impactor.guided:
        return impactor.mass
    return 1 / (1 / impactor.mass + impactor.reach**2 / impactor.moment_of_inertia)


def _impactor_rate(scene: Scene, contact: float) -> float:
    """The squared rate [1/s2] at which the impactor oscillates on the nodes it may touch.

    Each node is a spring of `contact` [N/m]. The sum of this and the squared rate of the nodes'
    fastest mode on a fixed impactor bounds the squared rate of the coupled system. The rate is
    taken FOLLOWED times as fast. It is 0 for a heavy impactor.
    """
    block, impactor = scene.block, scene.impactor
    assert impactor is not None
    width, depth = impactor.extent, impactor.nose_depth
    if not impactor.guided:  # any of its sides may touch
        width = depth = 2 * impactor.reach
    touching = _touching(block, width, depth)
    mass = _answering_mass(impactor)
    if mass > HEAVY * touching * block.node_mass:
        return 0.0
    return FOLLOWED**2 * touching * contact / mass


def _foam(scene: Scene, graded: Grading, n: int) -> dict:
    """Every member of `foam_type` for foam `n` of a scene's block, by name."""
    block, foam = scene.block, graded.foams[n]
    areas = block.dy * block.depth, block.dx * block.depth
    along, across = _viscosities(scene, foam)
    tension, shear = limits(foam, block)
    rates = rate_shares(foam, block)
    shares = [
        {
            "tensile_share": tension[axis].share,
            "shear_share": shear[axis].share,
            "tensile_tail": tension[axis].tail,
            "shear_tail": shear[axis].tail,
            "flow_share": 1.0 / rate,
            "dashpot": along * (areas[axis] / (block.dx, block.dy)[axis]) * rate,
            "shear_viscosity": across * math.sqrt(math.prod(rates)),
        }
        for axis, rate in enumerate(rates)
    ]
    return {
        "bond": foam.constants(scene.model),
        "a": shares[A],
        "b": shares[B],
        **_masses(block, graded.places == n),
    }


def _piece_dashpot(scene: Scene) -> float:
    """Dashpot [N s/m] between whole nodes that rub: the least of a bond's, without any limit.

    Foam by its curve limits those of bonds (`BondFoam.most_damping`); with Model.damping =
    "absolute" there are none.
    """
    block = scene.block
    aspect = block.dy / block.dx
    least = min(
        foam.youngs_modulus * min(aspect * rate_a, rate_b / aspect)
        for foam in grading(scene).foams
        for rate_a, rate_b in [rate_shares(foam, block)]
    )
    return scene.numerics.damping_time * least * block.depth


def _whole_mass(block: Block) -> float:
    """Mass [kg] of a mass point whose cell is full, of the block's lightest foam."""
    filled = filling(block)
    whole = filled.mass[filled.share >= 1.0]
    return float(whole.min() if whole.size else filled.mass.max())


def _swing(scene: Scene, contact: float) -> float:
    """Inverse angular frequency [s] of a whole mass point and the impactor on contacts [N/m]."""
    block, impactor = scene.block, scene.impactor
    squared = contact / _whole_mass(block)
    if impactor is not None:
        squared += _touching(block, impactor.extent, impactor.nose_depth) * contact / impactor.mass
    return 1.0 / math.sqrt(squared)


def _touching(block: Block, width: float, depth: float) -> int:
    """Most mass points that a body of this width touches, with flanks of this depth [m]."""
    width += 2 * float(filling(block).edge.max())
    across = min(block.columns, math.floor(width / block.dx) + 1)
    flanks = 2 * min(block.rows, math.ceil(depth / block.dy))
    return max(across, flanks)


def _masses(block: Block, here: NDArray[np.bool_]) -> dict[str, float]:
    """The masses of `foam_type`; `here` (2, J): the rows whose bonds A and B are of the foam."""
    filled = filling(block)
    faces = np.zeros((2, *filled.mass.shape))
    met = np.zeros(filled.mass.shape, dtype=bool)
    for axis, shares in enumerate((filled.face_a, filled.face_b)):
        mine = (shares > 0.0) & here[axis, : shares.shape[1]]
        for end in (slice(None, -1), slice(1, None)):
            ends = (end, slice(None)) if axis == A else (slice(None), end)
            faces[axis][ends] += 0.5 * shares
            met[ends] |= mine
    if not met.any():  # the foam has no bonds, but contacts may still use it
        met = filled.there
    mass = filled.mass[met]
    cells = np.pad(filled.cell, 1)
    around = 0.25 * (cells[:-1, :-1] + cells[1:, :-1] + cells[:-1, 1:] + cells[1:, 1:])

    def least(shares: Array) -> float:
        """The smallest mass of a mass point over its share."""
        there = shares[met] > 0.0
        return float(min(mass.max(), (mass[there] / shares[met][there]).min(initial=np.inf)))

    return {
        "bond_mass": least(faces.max(axis=0)),
        "cell_mass": least(around),
        "piece_mass": least(np.minimum(filled.share, 1.0)),
    }


def _viscosities(scene: Scene, foam: BondFoam) -> tuple[float, float]:
    """Viscosities [Pa s] of a foam: along its bonds, and of its cells in shear."""
    if scene.model.damping == "absolute":
        return 0.0, 0.0
    time, most = scene.numerics.damping_time, foam.most_damping
    if most is not None:
        cell = min(scene.block.dx, scene.block.dy)
        rate = max(rate_shares(foam, scene.block))
        time = min(time, most * cell / (foam.youngs_modulus * rate))
    return time * foam.youngs_modulus, time * foam.shear_modulus


@ti.func
def fastest_rate(
    lattice: ti.template(), b, stiffened: ti.f64, crush: ti.f64, p: ti.template()
) -> ti.f64:
    """Upper bound on the rate [1/s] of every mode.

    `stiffened` is the stiffness of the stiffest stiffened bond [N/m]; no foam is crushed beyond the
    strain `-crush`.
    """
    rate = 0.0
    if ti.static(lattice.features.foams > 1):
        for n in range(lattice.features.foams):
            rate = ti.max(
                rate, _fastest_rate(lattice, stiffened, crush, lattice.model.foams[b, n], p)
            )
    else:
        rate = _fastest_rate(lattice, stiffened, crush, p, p)
    return rate


@ti.func
def _fastest_rate(
    lattice: ti.template(), stiffened: ti.f64, crush: ti.f64, foam: ti.template(), p: ti.template()
) -> ti.f64:
    """The same for the mass points that have bonds of one foam, a record of `foam_type`.

    Gershgorin's theorem bounds the modes by the row sum of a node's stiffness: at most 4 k from its
    bonds, 4 r G Z from its cells' shear (twice that if bonds carry it), 4 r k_r from the cells'
    room, where r is a cell's longer side over its shorter one, 16 k from pieces, and once
    the contact with a body (its normal and friction forces act at right angles). A light impactor's
    oscillation adds to it. Dashpots are bounded likewise, of four bonds or of pieces that rub in
    their place, with a drag at C / m.
    """
    per_length = p.area / p.cell
    elastic = lattice.law.largest_stiffness(foam.bond) * per_length.max()
    sheared = ti.static(8.0 if lattice.features.faces else 4.0) * per_length.max()
    modulus = lattice.law.shear_modulus(foam.bond)
    if ti.static(lattice.law.shears_stiffer):
        rise, _ = lattice.law.shear_rise(foam.bond, -crush)
        modulus += 2.0 * rise
    sheared *= modulus
    stiffest = ti.max(elastic, stiffened)
    if ti.static(lattice.law.heeds_rate):
        stiffest = elastic + stiffened  # the overstress adds to it
    of_bonds, of_cells, of_pieces = 4.0 * stiffest, 0.0, 0.0
    if ti.static(lattice.features.faces):
        of_bonds += sheared
    else:
        of_cells += sheared
    if ti.static(lattice.features.self_contact):
        of_pieces = 16.0 * lattice.law.piece_stiffness(foam.bond) * per_length.max()
    if ti.static(lattice.features.crushed_room):
        ratio = p.cell.max() / p.cell.min()
        of_cells += 4.0 * ratio * lattice.law.room_stiffness(foam.bond) * p.thickness
    # a mass point of little mass has small faces and cells, and proportionally softer contacts
    squared = of_bonds / foam.bond_mass + of_cells / foam.cell_mass + of_pieces / foam.piece_mass
    squared += p.contact_stiffness / p.node_mass
    along_a, along_b = foam.a.dashpot, foam.b.dashpot
    if ti.static(lattice.features.self_contact) and p.piece_friction > 0.0:
        # in place of broken bonds' dashpots, which may be less or none
        along_a = ti.max(along_a, p.piece_dashpot)
        along_b = ti.max(along_b, p.piece_dashpot)
    decays = 4.0 * (along_a + along_b) / foam.bond_mass
    decays += 4.0 * per_length.max() * foam.b.shear_viscosity / foam.cell_mass
    decays += p.drag / foam.piece_mass
    return ti.max(ti.sqrt(squared + p.impactor_rate), decays * (RK4_RADIUS / RK4_DECAY))


@ti.func
def automatic_step(
    lattice: ti.template(), b, rate: ti.f64, speed: ti.f64, crush: ti.f64, p: ti.template()
) -> ti.f64:
    """Step size [s] for a lattice whose fastest mode has the rate `rate` [1/s].

    It also looks ahead: no node moves by more than MOST_WAY cells in a step at the largest nodal
    speed [m/s]; and the step stays stable (without the safety margin) if both nodes of the most
    crushed bond, at the strain `-crush`, close on each other at that speed.
    """
    step = ti.min(p.safety * RK4_RADIUS / rate, p.largest_step)
    cell = p.cell.min()
    if speed * step > MOST_WAY * cell:
        step = MOST_WAY * cell / speed
    if ti.static(lattice.law.stiffens):
        closing = 2.0 * speed / cell
        if not _stays_stable(lattice, b, step, crush, closing, p):
            # the step and the stiffness at its end depend on each other: bisection
            low, high = 0.0, step
            for _ in range(20):
                middle = 0.5 * (low + high)
                if _stays_stable(lattice, b, middle, crush, closing, p):
                    low = middle
                else:
                    high = middle
            step = low
    return step


@ti.func
def _stays_stable(
    lattice: ti.template(), b, step: ti.f64, crush: ti.f64, closing: ti.f64, p: ti.template()
) -> ti.i32:
    """Whether a step is stable to its end if a bond at the strain `-crush` closes at a rate [1/s].

    `closing` is that rate.
    """
    strain = -crush - closing * step
    stable = 1
    if ti.static(lattice.features.foams > 1):
        for n in range(lattice.features.foams):
            stable &= _foam_stays_stable(lattice, step, strain, lattice.model.foams[b, n], p)
    else:
        stable = _foam_stays_stable(lattice, step, strain, p, p)
    return stable


@ti.func
def _foam_stays_stable(
    lattice: ti.template(), step: ti.f64, strain: ti.f64, foam: ti.template(), p: ti.template()
) -> ti.i32:
    stable = 1
    if strain < lattice.law.stiffens_below(foam.bond) or ti.static(lattice.law.shears_stiffer):
        history = lattice.law.History(worst=strain)
        _, slope = lattice.law.stiffening(foam.bond, strain, history, 0)
        stiffened = slope * (p.area / p.cell).max()
        rate = _fastest_rate(lattice, stiffened, -strain, foam, p)
        stable = ti.i32(step * rate <= RK4_RADIUS)
    return stable
