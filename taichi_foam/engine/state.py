"""State: everything in a lattice that changes from step to step, as a value and as fields.

A `State` can be taken from the device, stored, loaded, put back and continued: the steps that
follow are the same to the last bit.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from types import SimpleNamespace
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.analysis.impact import contact_height
from taichi_foam.backend import ti
from taichi_foam.engine.features import Features
from taichi_foam.engine.grading import cuts
from taichi_foam.engine.layout import Layout
from taichi_foam.laws.bond import BondLaw
from taichi_foam.records.cushion import (
    BONDS_A,
    BONDS_B,
    CELLS,
    NODES,
    Cushion,
    Per,
    declared,
    remembered,
)
from taichi_foam.records.history import BOOKED
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Scene
from taichi_foam.scene.filling import Filling, filling

Array = NDArray[np.float64]

# Values of a bond's `condition`.
ABSENT = -1
BROKEN = 0
WHOLE = 1
BREAKING = 2  # whole until the end of this step

NEVER = 1e30
UNLISTED = -1  # in place of a node's place in a list

# Values of a lattice's `status`: whether it still steps, and if not, why.
RUNNING = 0
AT_END_TIME = 1
AT_REBOUND = 2
DIVERGED = 3
CROWDED = 4
EMPTY = 5  # nothing is loaded

WORK = SimpleNamespace(**{name: n for n, name in enumerate(BOOKED)})
"""Index of each member of a strip's work [J], see `records.history.BOOKED`."""
WORKS = len(BOOKED)
HELD_AFTER = [WORK.held_by_base, WORK.held_by_base_friction, WORK.held_by_pieces]
"""What is kept for the next impact."""


@ti.dataclass
class Body:
    """The impactor's vertical degree of freedom: y of its lowest point [m], upward velocity."""

    y: ti.f64
    v: ti.f64
    trial_y: ti.f64
    trial_v: ti.f64
    rate_y: ti.f64  # weighted sums of the RK4 stages
    rate_v: ti.f64
    force: ti.f64  # on the impactor at the current stage [N]
    support_work: ti.f64  # energy that the support has taken from it [J]


@ti.dataclass
class Turn:
    """The other degrees of freedom of an unguided impactor, see `engine.turning`."""

    x: ti.f64  # horizontal displacement since the start [m]
    angle: ti.f64  # rotation since the start, counter-clockwise [rad]
    u: ti.f64  # velocity to the right [m/s]
    spin: ti.f64  # [rad/s]
    trial_x: ti.f64
    trial_angle: ti.f64
    trial_u: ti.f64
    trial_spin: ti.f64
    rate_x: ti.f64  # weighted sums of the RK4 stages
    rate_angle: ti.f64
    rate_u: ti.f64
    rate_spin: ti.f64
    cosine: ti.f64  # of the trial angle
    sine: ti.f64


@ti.dataclass
class Clock:
    """Time, step sizes and counters of one lattice."""

    time: ti.f64
    step: ti.f64
    shortest: ti.f64
    longest: ti.f64
    stable: ti.f64  # shortest stable step so far [s]
    next_row: ti.f64
    last_contact: ti.f64
    reversal: ti.f64  # time of the impactor's zero velocity, NEVER before it
    drift: ti.f64  # how far any node can have moved since the neighbours were listed [m]
    stiffest: ti.f64  # stiffest stiffened bond at the end of the last step [N/m]; < 0: unknown
    crush: ti.f64  # largest -strain of a bond then, or so far (BondLaw.shears_stiffer)
    speed: ti.f64  # of the fastest node in the last step [m/s]
    pause: ti.f64  # time at which a call stops stepping the lattice
    steps: ti.i32
    status: ti.i32
    broken: ti.i32  # bonds broken so far
    bad_node: ti.i32  # the first node that diverged
    stale: ti.i32  # the neighbour list must be rebuilt
    candidates: ti.i32  # nodes that have a pair in the neighbour list
    pairs: ti.i32  # in the list
    rows: ti.i32  # rows of the history on the device
    active: ti.i32  # takes part in the current step (staged stepping)
    spare: ti.i32  # makes the number of 32-bit members even, see Layout


def _members(record: Any, *passing: str) -> tuple[str, ...]:
    return tuple(name for name in record.members if name not in passing)


CLOCK = _members(Clock, "pause", "rows", "active", "spare")
"""Members of a clock that a state holds."""

BODY = _members(Body, "trial_y", "trial_v", "rate_v")
"""Members of a body that a state holds."""

TURN = _members(
    Turn, "trial_x", "trial_angle", "trial_u", "trial_spin", "rate_u", "rate_spin", "cosine", "sine"
)
"""Members of a turn that a state holds, if the impactor is unguided."""


@dataclass(frozen=True)
class Kept(Per):
    """Annotation that declares an array of a state.

    device  names of its components on the device, see `StateFields`
    start   its value at the start, and in scenes whose features do not use it
    beyond  its value outside the block
    seen    whether snapshots contain it
    """

    device: tuple[str, ...] = ()
    start: float = 0.0
    beyond: float = 0.0
    seen: bool = False

    @classmethod
    def at(cls, places: tuple[int, int], *device: str, **told: Any) -> "Kept":
        numbers = (len(device),) if len(device) > 1 else ()
        return cls(places, numbers, device=device, **told)


@dataclass(frozen=True)
class State:
    """One lattice of I x J nodes between two steps. SI units.

    position, velocity  (I, J, 2)
    increment       (I, J, 2) displacement in the last step, which the friction springs follow [m]
    stretch         (I, J, 2) stretch of the friction springs: impactor, floor [m]
    room            (I, J) upper limit of a node's contact radius [m], NEVER if there is none
    surface         (I, J) whether the node can touch others, see `engine.contact`
    hold            (I-1, J-1) fraction of its forces that a cell still carries, see `engine.cells`
    shear_set       (I-1, J-1) lasting shear strain of a cell
    worst_a, worst_b            (I-1, J), (I, J-1) most compressive strain so far
    break_time_a, break_time_b  (I-1, J), (I, J-1) time of breaking [s], NaN while whole
    intact_a, intact_b          (I-1, J), (I, J-1) share of a whole bond's face that carries
                    tension and shear: less than 1 only where bonds soften beyond their limits
    clock, body     numbers by name, see CLOCK and BODY
    turn            numbers by name, see TURN; empty if the impactor does not turn
    work            (strips, WORKS) work of each strip of nodes [J], see `records.history.BOOKED`;
                    one strip at the start, since the number of strips depends on the device
    overlap         (strips,) largest overlap with the impactor so far [m], likewise
    neighbours      the neighbour list as the device keeps it, by field
    own             what bonds remember besides, by the names of `records.cushion.remembered`

    Every array declared here goes to the device and comes back, and is in checkpoints. Those that
    `Cushion` also has are carried over to the next impact.
    """

    position: Annotated[Array, Kept.at(NODES, "motion.x", "motion.y", seen=True)]
    velocity: Annotated[Array, Kept.at(NODES, "motion.u", "motion.v", seen=True)]
    increment: Annotated[Array, Kept.at(NODES, "increment.x", "increment.y")]
    stretch: Annotated[Array, Kept.at(NODES, "slip.impactor", "slip.floor")]
    room: Annotated[Array, Kept.at(NODES, "room", start=NEVER, beyond=NEVER)]
    surface: Annotated[Array, Kept.at(NODES, "surface")]
    hold: Annotated[Array, Kept.at(CELLS, "hold", start=1.0)]
    shear_set: Annotated[Array, Kept.at(CELLS, "shear_set", seen=True)]
    worst_a: Annotated[Array, Kept.at(BONDS_A, "bond_a.worst", seen=True)]
    worst_b: Annotated[Array, Kept.at(BONDS_B, "bond_b.worst", seen=True)]
    break_time_a: Annotated[Array, Kept.at(BONDS_A, "bond_a.break_time", start=np.nan, seen=True)]
    break_time_b: Annotated[Array, Kept.at(BONDS_B, "bond_b.break_time", start=np.nan, seen=True)]
    intact_a: Annotated[Array, Kept.at(BONDS_A, "bond_a.intact", start=1.0, beyond=1.0)]
    intact_b: Annotated[Array, Kept.at(BONDS_B, "bond_b.intact", start=1.0, beyond=1.0)]
    clock: Mapping[str, float]
    body: Mapping[str, float]
    turn: Mapping[str, float]
    work: Array
    overlap: Array
    neighbours: Mapping[str, NDArray[Any]]
    own: Mapping[str, Array]

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """Everything as arrays by name, as `numpy.savez` takes them."""
        found: dict[str, NDArray[Any]] = {}
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, Mapping):
                found |= {f"{field.name}.{key}": np.asarray(one) for key, one in value.items()}
            else:
                found[field.name] = value
        return found

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> "State":
        """The state from the arrays of `to_arrays`. Raises KeyError: an array is missing."""
        nested = {"clock": float, "body": float, "turn": float}
        nested |= dict.fromkeys(("neighbours", "own"), np.asarray)
        values: dict[str, Any] = {}
        for field in fields(cls):
            if field.name in nested:
                prefix, kind = f"{field.name}.", nested[field.name]
                values[field.name] = {
                    name.removeprefix(prefix): kind(array)
                    for name, array in arrays.items()
                    if name.startswith(prefix)
                }
            else:
                values[field.name] = arrays[field.name]
        return cls(**values)

    def cushion(self) -> Cushion:
        """The block as this state leaves it for the next impact."""
        return Cushion(
            **{name: getattr(self, name) for name in ARRAYS if name in _CARRIED},
            **{name: self.clock[name] for name in CLOCK if name in _CARRIED},
            floor_stretch=self.stretch[..., 1],
            broken_a=1.0 - np.isnan(self.break_time_a),
            broken_b=1.0 - np.isnan(self.break_time_b),
            held=self.work[:, HELD_AFTER].sum(axis=0),
            own=self.own,
        )

    def snapshot(self) -> Snapshot:
        """A snapshot of the state. Without an impactor, `impactor_y` is NaN."""
        return snapshot_of(vars(self), self.own, self.clock, self.body, self.turn)


ARRAYS: dict[str, Kept] = declared(State)
"""The declaration of each array of a state."""

_CARRIED = {*declared(Cushion)}


def own_arrays(law: BondLaw) -> dict[str, Kept]:
    """The declaration of each array of `State.own`."""
    return {
        name: Kept.at(per.places, f"bond_{name[-1]}.{name[:-2]}", seen=True)
        for name, per in remembered(law).items()
        if per.places is not None
    }


def snapshot_of(
    arrays: Mapping[str, Any],
    own: Mapping[str, Array],
    clock: Mapping[str, float],
    body: Mapping[str, float],
    turn: Mapping[str, float],
    stress: NDArray[np.float32] | None = None,
) -> Snapshot:
    """A snapshot from parts of a state; of the arrays, only the `seen` ones are needed."""
    same = {name: arrays[name] for name in declared(Snapshot) if name in ARRAYS}
    return Snapshot(
        time=clock["time"],
        impactor_y=np.nan if body["y"] == NEVER else body["y"],
        e_min_a=arrays["worst_a"],
        e_min_b=arrays["worst_b"],
        impactor_shift=turn.get("x", 0.0),
        impactor_angle=turn.get("angle", 0.0),
        own=own,
        stress=stress,
        **same,
    )


def initial_state(scene: Scene) -> State:
    """The state at a scene's start; nodes that the base holds are at rest.

    The start's displacement gradient F - I is applied to the reference positions, so that an
    undeformed block starts exactly at its reference positions.
    """
    block, start, impactor = scene.block, scene.start, scene.impactor
    columns, rows = block.columns, block.rows
    X = block.positions
    arm = X - np.array([0.0, block.foot])
    position = X + _product(arm, np.array(start.deformation_gradient) - np.eye(2))
    velocity = _product(arm, np.array(start.velocity_gradient))
    filled = filling(block)
    velocity[filled.on_base, 0] *= scene.base.kind != "gripped"
    velocity[filled.on_base, 1] *= scene.base.kind == "floor"
    worst = [min(0.0, strain) for strain in start.strains]
    if scene.foam.law_for(scene.model).heeds_rate:
        worst = [0.0, 0.0]  # rate-dependent foam has had no time to flow
    cut = np.where(cuts(scene), 0.0, np.nan)
    cut[:-1, :, 0][filled.face_a == 0.0] = np.nan
    cut[:, :-1, 1][filled.face_b == 0.0] = np.nan
    clock = dict.fromkeys(CLOCK, 0.0)
    clock["crush"] = max(0.0, *(-strain for strain in start.strains))
    clock["speed"] = float(np.hypot(velocity[..., 0], velocity[..., 1]).max())
    clock |= {"shortest": NEVER, "stable": NEVER, "reversal": NEVER, "stale": 1}
    clock["stiffest"] = -1.0 if any(start.strains) else 0.0
    clock["bad_node"] = columns * rows
    body = dict.fromkeys(BODY, 0.0)
    body["y"] = NEVER if impactor is None else scene.contact_height + impactor.gap
    body["v"] = 0.0 if impactor is None else -impactor.velocity
    turn = {}
    if impactor is not None and scene.turns:
        turn = dict.fromkeys(TURN, 0.0) | {"u": impactor.velocity_x, "spin": impactor.spin}
    arrays = {
        "position": position,
        "velocity": velocity,
        "hold": _held(filled),
        "worst_a": np.where(filled.face_a > 0.0, worst[0], 0.0),
        "worst_b": np.where(filled.face_b > 0.0, worst[1], 0.0),
        "break_time_a": cut[:-1, :, 0],
        "break_time_b": cut[:, :-1, 1],
    }
    others = {
        name: np.broadcast_to(told.start, told.shape(columns, rows))
        for name, told in ARRAYS.items()
        if name not in arrays
    }
    return State(
        **arrays,
        **others,
        clock=clock,
        body=body,
        turn=turn,
        work=np.zeros((1, WORKS)),
        overlap=np.zeros(1),
        neighbours={},
        own={
            name: np.broadcast_to(told.start, told.shape(columns, rows))
            for name, told in own_arrays(scene.foam.law_for(scene.model)).items()
        },
    )


def state_after(scene: Scene, cushion: Cushion) -> State:
    """The state at a scene's start, on a block as another run has left it.

    The block continues exactly as it was. Broken bonds count as broken from the start, as cuts do.
    The clock, the works and the impactor start afresh: the impactor's friction springs are slack,
    the floor's keep their stretch. Contacts with the floor and between pieces keep their stored
    energy. Raises ValueError: no part of the block is beneath the impactor.
    """
    start = initial_state(scene)
    stretch = np.zeros_like(start.stretch)
    stretch[..., 1] = cushion.floor_stretch
    body = dict(start.body)
    if scene.impactor is not None:
        height = contact_height(scene.block, scene.impactor, cushion)
        body["y"] = height + scene.impactor.gap
    work = np.zeros((1, WORKS))
    work[0, HELD_AFTER] = cushion.held
    clock = {name: getattr(cushion, name) for name in CLOCK if name in _CARRIED}
    return replace(
        start,
        **{name: getattr(cushion, name) for name in ARRAYS if name in _CARRIED},
        stretch=stretch,
        break_time_a=np.where(cushion.broken_a > 0.0, 0.0, np.nan),
        break_time_b=np.where(cushion.broken_b > 0.0, 0.0, np.nan),
        clock={**start.clock, **clock},
        body=body,
        work=work,
        own=cushion.own,
    )


def _held(filled: Filling) -> Array:
    """`State.hold` at the start: 0 where a corner of the cell has no foam."""
    there = filled.there
    return (there[:-1, :-1] & there[1:, :-1] & there[:-1, 1:] & there[1:, 1:]).astype(float)


def _product(vectors: Array, matrix: Array) -> Array:
    """matrix . vector for each of `vectors`, summed in the same order on every machine."""
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([x * row[0] + y * row[1] for row in matrix], axis=-1)


class StateFields:
    """The states of a batch of lattices on the device.

    motion     position x, y [m] and velocity u, v [m/s] of the nodes
    increment  the current step's weighted sums of their rates; between steps, those of the last
    bond_a, bond_b, bonds   what a bond remembers (`BondLaw.History`), its condition, its time of
               breaking [s]; where bonds soften beyond their limits also `intact`, see State. The
               condition of a whole bond is then the share that will be intact after this step
    History, remembered   record of what a pack of bonds remembers; its members' fields by axis
    grip       share of a cell that carries shear, relative to a whole cell of foam
    slip       stretch of the friction springs: impactor, floor [m]
    room, surface, hold, shear_set   see State
    body, turn, clock, work, overlap   see State
    pairs, candidate_node, candidate, place_in_list   the neighbour list on a CPU: pairs of
               candidates; the candidates' nodes; what pairs read of them, see Candidate; the place
               of each node in the list of candidates, or UNLISTED
    partners, partner_start, partner_count, radius   the neighbour list on a GPU: the nodes that
               each node may touch
    lists      the neighbour list's fields by name
    """

    def __init__(self, layout: Layout, features: Features) -> None:
        pack, small_pack = layout.pack, layout.small_pack
        motion = ti.types.struct(x=pack, y=pack, u=pack, v=pack)
        remembers = dict.fromkeys(features.law.History.members, pack)
        bond = {**remembers, "condition": small_pack, "break_time": small_pack}
        if features.softens:
            bond["intact"] = small_pack
            if layout.on_gpu:
                bond["spare"] = small_pack  # makes the number of 32-bit members even, see Layout
        bond = ti.types.struct(**bond)
        self.motion, self.increment = motion.field(), motion.field()
        layout.by_columns(self.motion, self.increment)
        self.bond_a, self.bond_b = bond.field(), bond.field()
        self.bonds = (self.bond_a, self.bond_b)
        self.History = ti.types.struct(**remembers)
        self.remembered = [
            [each.get_member_field(name) for name in remembers] for each in self.bonds
        ]
        self.slip = ti.types.struct(impactor=pack, floor=pack).field()
        layout.of_nodes(self.bond_a, self.bond_b, self.slip)
        self.body, self.clock = Body.field(), Clock.field()
        layout.of_lattices(self.body, self.clock)
        if features.turns:
            self.turn = Turn.field()
            layout.of_lattices(self.turn)
        self.work = ti.types.vector(WORKS, ti.f64).field()
        self.overlap = ti.field(ti.f64)
        layout.of_strips(self.work, self.overlap)
        if features.cells:
            self.hold, self.grip = small_pack.field(), pack.field()
            layout.of_nodes(self.hold, self.grip)
        if features.shear_yields:
            self.shear_set = small_pack.field()
            layout.of_nodes(self.shear_set)
        if features.self_contact:
            self._place_contact(layout)

    def _place_contact(self, layout: Layout) -> None:
        self.room, self.surface = layout.pack.field(), layout.whole_pack.field()
        layout.of_nodes(self.room)
        layout.of_nodes(self.surface, whole=True)
        if layout.on_gpu:
            self.radius = layout.pack.field()
            layout.of_nodes(self.radius)
            self.partner_start, self.partner_count = ti.field(ti.i32), ti.field(ti.i32)
            layout.listed(layout.nodes, self.partner_start, self.partner_count, whole=True)
            self.partners = ti.field(ti.i32)
            layout.listed(2 * layout.most_pairs, self.partners, whole=True)
            names = ("partners", "partner_start", "partner_count")
            self.lists = {name: getattr(self, name) for name in names}
        else:
            self.pairs = ti.types.vector(2, ti.i32).field()
            layout.listed(layout.most_pairs, self.pairs, whole=True)
            self.candidate_node, self.place_in_list = ti.field(ti.i32), layout.whole_pack.field()
            layout.listed(layout.most_candidates, self.candidate_node, whole=True)
            layout.of_nodes(self.place_in_list, whole=True)
            self.candidate = Candidate.field()
            layout.listed(layout.most_candidates, self.candidate)
            self.lists = {
                "candidate_node": self.candidate_node,
                "radius": self.candidate.get_member_field("radius"),
                "torn": self.candidate.get_member_field("torn"),
                "first": self.pairs.get_scalar_field(0),
                "second": self.pairs.get_scalar_field(1),
            }


@ti.dataclass
class Candidate:
    """A node that may touch others: the values its pairs read, gathered in one place."""

    x: ti.f64  # [m]
    y: ti.f64
    u: ti.f64  # [m/s]
    v: ti.f64
    radius: ti.f64  # [m]
    torn: ti.f64  # faces of broken bonds, in whole ones, over the number of partners


@ti.func
def book(lattice: ti.template(), b, strip, member: ti.template(), work):
    """Add to a member of a strip's work [J]. One thread handles a strip, so no atomics."""
    lattice.state.work[b, strip][member] = lattice.state.work[b, strip][member] + work
