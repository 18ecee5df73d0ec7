"""Cells: the room that crushed foam keeps, when a cell lets go, and how it yields in shear."""

import math

import numpy as np
import pytest
from bench import (
    ALL_A,
    ALL_B,
    COLUMNS,
    FREE,
    LIFT,
    PLAIN,
    ROWS,
    bench,
    node_forces,
    numerics,
    small_scene,
)
from reference_lattice import ReferenceLattice, reference_positions

from taichi_foam.engine import transfer
from taichi_foam.engine.state import WORK, State, state_after
from taichi_foam.laws.bond import Curve
from taichi_foam.laws.bond.by_curve import CurveFoam
from taichi_foam.laws.bond.kinds.tabulated import TabulatedFoam
from taichi_foam.scene import (
    Across,
    Foam,
    Model,
    Numerics,
    Output,
    RecoveringFoam,
    Scene,
    Start,
    Wedge,
)
from taichi_foam.shim2000.impacts import paper_scene
from taichi_foam.simulation.simulate import run

UNBREAKABLE = Foam(tensile_strain=2.0, shear_strain=2.0, shear_modulus=1e3)
ROOMY = Model(self_contact=False)

K, THICKNESS, CELL = 2.78e6, 0.057, 0.005
CELLS = [(i, j) for i in range(COLUMNS - 1) for j in range(ROWS - 1)]
ROUNDING = 1e-7  # N, of bond forces of up to 50 K A beside those of cells
# 1e-9 of a cell may be lacking without pressure: by q K Z dX / 2 on each of four cells
SLACK = 1e-9 * 4 * 0.5 * 4.0 * K * THICKNESS * CELL


STEPS = numerics(dt=5e-8, damping_time=0.0)


def crushed(scene: Scene, position: np.ndarray, seed: int) -> dict[str, np.ndarray]:
    """Worst strains of bonds that have met at least their strain now."""
    rng = np.random.default_rng(seed)
    block = scene.block
    found = {}
    for axis, length in enumerate((block.dx, block.dy)):
        strain = np.linalg.norm(np.diff(position, axis=axis), axis=-1) / length - 1.0
        history = -rng.uniform(0.0, 0.9, strain.shape)
        found[("worst_a", "worst_b")[axis]] = np.minimum(history, strain)
    return found


def folded(dx: float = CELL, seed: int = 1) -> tuple[Scene, dict]:
    """Dust without order: cells squeezed, folded and turned inside out, some torn open."""
    scene = small_scene(dx=dx, base=FREE, foam=UNBREAKABLE, model=ROOMY)
    rng = np.random.default_rng(seed)
    position = reference_positions(scene) @ np.array([[0.8, 0.3], [0.1, 0.6]]) + LIFT
    position += rng.uniform(-0.5, 0.5, position.shape) * [dx, CELL]
    some = {kind: {at for at in all_of if rng.random() < 0.3}
            for kind, all_of in (("broken_a", ALL_A), ("broken_b", ALL_B))}  # fmt: skip
    return scene, {"position": position, **crushed(scene, position, seed), **some}


def without_cells(scene: Scene) -> Scene:
    return scene.model_copy(update={"model": PLAIN})


def of_cells(scene: Scene, start: dict) -> np.ndarray:
    """What the cells' room alone adds to the forces on the nodes [N]."""
    return node_forces(scene, **start) - node_forces(without_cells(scene), **start)


@pytest.mark.parametrize("dx", [0.005, 0.003])
def test_forces_are_the_gradient_of_the_cells_energy(dx: float) -> None:
    """q K (room - a)^2 / 2 on the volume of each cell, in NumPy by differences of corners."""
    scene, start = folded(dx)
    expected = ReferenceLattice(scene, **start).room_forces()
    assert (np.abs(expected).max(axis=-1) > 1.0).mean() > 0.5
    np.testing.assert_allclose(of_cells(scene, start), expected, atol=SLACK)


def test_forces_of_cells_keep_momentum_and_angular_momentum() -> None:
    """The area does not change when the cell is moved or turned."""
    scene, start = folded(seed=4)
    forces = of_cells(scene, start)
    x = start["position"] - start["position"].mean(axis=(0, 1))
    turning = x[..., 0] * forces[..., 1] - x[..., 1] * forces[..., 0]
    np.testing.assert_allclose(forces.sum(axis=(0, 1)), 0.0, atol=ROUNDING)
    assert np.abs(turning).sum() > 1.0
    assert abs(turning.sum()) < 1e-9 * np.abs(turning).sum()


@pytest.mark.parametrize("shear", [0.3, -0.8, 2.0])
@pytest.mark.parametrize("worst", [-0.85, -0.8, -0.65])
def test_a_sheared_block_has_the_pressure_of_what_its_cells_lack(
    shear: float, worst: float
) -> None:
    """Columns of crushed bonds B lean over: lengths stay, the area falls by their angle's cosine.

    It resists with q K (0.2 - a), q = 4, once it is smaller than 0.2, at which foam is crushed
    through; and with q K (room - a) where its bonds have left it less.
    """
    scene = small_scene(base=FREE, foam=UNBREAKABLE, model=ROOMY)
    angle = math.atan(shear)
    room = 1.0 + worst
    F = np.array([[1.0, room * math.sin(angle)], [0.0, room * math.cos(angle)]])
    position = reference_positions(scene) @ F.T + LIFT
    start = {
        "position": position,
        "worst_b": np.full((COLUMNS, ROWS - 1), worst),
        "worst_a": np.zeros((COLUMNS - 1, ROWS)),
    }
    pressure = 4.0 * K * max(min(room, 0.2) - room * math.cos(angle), 0.0)
    found = of_cells(scene, start)
    # inside pressures balance; the left side is pushed along the normals of its faces
    side = F[:, 1] * CELL * THICKNESS
    outward = np.array([-side[1], side[0]])
    np.testing.assert_allclose(found[0, 5:15], np.tile(pressure * outward, (10, 1)), atol=SLACK)
    np.testing.assert_allclose(found[3:7, 5:15], 0.0, atol=SLACK)


@pytest.mark.parametrize("rate", [None, 3000.0])
@pytest.mark.parametrize("axes", [(0,), (1,), (0, 1)])
def test_straight_cells_never_meet_the_law(axes: tuple[int, ...], rate: float | None) -> None:
    """Crush along one axis or both, and its rebound: the same to the last bit with and without.

    A free block runs into itself at up to 200 m/s, beyond densification. Its cells stay rectangles.
    """
    states = []
    for model in (ROOMY, PLAIN):
        foam = Foam(rate=rate, tensile_strain=1.0)
        scene = small_scene(base=FREE, foam=foam, model=model, numerics=STEPS)
        position = reference_positions(scene) + LIFT
        velocity = np.array([-8000.0, -4000.0]) * (position - position.mean(axis=(0, 1)))
        velocity[..., [axis for axis in (0, 1) if axis not in axes]] = 0.0
        with bench(scene, position=position, velocity=velocity) as loaded:
            states.append([loaded.step(500) for _ in range(10)])
            assert not loaded.work[..., WORK.room].any()
    for one, other in zip(*states, strict=True):
        for name in ("position", "velocity", "e_min_a", "e_min_b"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    last = states[0][-1]
    for axis, worst in enumerate((last.e_min_a, last.e_min_b)):
        assert (worst.min() < -0.8) == (axis in axes)


def folding(steps: int) -> Scene:
    """A loose column of crushed foam that sways and is pressed at 20 m/s: its cells fold."""
    return small_scene(
        base=FREE,
        foam=UNBREAKABLE,
        model=ROOMY,
        numerics=Numerics(dt=1e-3 / steps, end=1e-3 * (1 - 1e-9), damping_time=0.0),
        output=Output(history_interval=1e-4, snapshot_interval=1e-3),
        start=Start(
            deformation_gradient=((1.0, 0.4), (0.0, 0.3)),
            velocity_gradient=((0.0, 80.0), (0.0, -200.0)),
        ),
    )


def test_the_ledger_of_folding_cells_closes_by_the_order_of_the_step() -> None:
    """What cells store and lose for their room has columns of its own, and is none of the crushing.

    A kink, where a cell meets its room, costs more than the smooth motion: second order at least.
    """
    residuals = []
    for steps in (800, 1600, 3200):
        history = run(folding(steps)).history
        brought = history["foam_kinetic_J"][0]
        residuals.append(np.abs(history["residual_J"]).max() / brought)
    assert (history["room_J"] + history["folding_J"]).max() > 0.05 * brought
    assert residuals[2] < 1e-5
    assert math.log2(residuals[0] / residuals[2]) / 2.0 > 2.0


def pulled_apart(size: float, opened: bool = False) -> dict:
    """A block of crushed, broken bonds; one corner has left its cell: by so many cells, or open."""
    scene = small_scene(base=FREE, model=ROOMY)
    position = reference_positions(scene) * 0.5 + LIFT
    corner = size * CELL / math.sqrt(2.0)
    if opened:  # 1.26 by 1.26 cells: by its diagonal, 1.78 cells, it would hold most
        position[1, :2, 0] = position[0, 0, 0] + 1.26 * CELL
        position[:2, 1, 1] = position[0, 0, 1] + 1.26 * CELL
    else:
        position[0, 0] = position[1, 1] - corner
    half = {"worst_a": np.full((COLUMNS - 1, ROWS), -0.5),
            "worst_b": np.full((COLUMNS, ROWS - 1), -0.5)}  # fmt: skip
    return {"position": position, **half, "broken_a": {(0, 0)}}


def hold_after_a_step(scene: Scene, **start: object) -> np.ndarray:
    with bench(scene, **start) as loaded:
        loaded.step(1)
        return transfer.take(loaded.lattice, 0).hold


@pytest.mark.parametrize(
    ("size", "hold"), [(1.9, 1.0), (2.0, 1.0), (3.0, 0.5), (3.8, 0.1), (4.2, 0.0)]
)
def test_a_torn_cell_lets_go_by_its_longer_diagonal(size: float, hold: float) -> None:
    scene = small_scene(base=FREE, model=ROOMY, numerics=numerics(dt=1e-12))
    found = hold_after_a_step(scene, **pulled_apart(size))
    assert found[0, 0] == pytest.approx(hold, abs=1e-6)
    found[0, 0] = 1.0
    np.testing.assert_array_equal(found, 1.0)  # all others are as they were


def test_an_opened_crack_lets_go_at_once_and_whole_foam_never() -> None:
    scene = small_scene(base=FREE, model=ROOMY, foam=UNBREAKABLE, numerics=numerics(dt=1e-12))
    opened = pulled_apart(0.0, opened=True)
    assert hold_after_a_step(scene, **opened)[0, 0] == 0.0
    whole = {**opened, "broken_a": set()}
    np.testing.assert_array_equal(hold_after_a_step(scene, **whole), 1.0)


def test_what_a_cell_has_let_go_of_it_never_holds_again() -> None:
    """Inside out, at a hold of 1, 0.5 and 0: forces in proportion, and the hold stays as it is."""
    scene = small_scene(base=FREE, model=ROOMY, numerics=numerics(dt=1e-12))
    start = pulled_apart(1.0)
    start["position"][0, 0] = start["position"][1, 1] + 0.2 * CELL
    pushed = {}
    for hold in (1.0, 0.5, 0.0):
        holds = np.ones((COLUMNS - 1, ROWS - 1))
        holds[0, 0] = hold
        pushed[hold] = of_cells(scene, {**start, "hold": holds})[0, 0]
        assert hold_after_a_step(scene, **start, hold=holds)[0, 0] == hold
    assert np.linalg.norm(pushed[1.0]) > 10.0
    np.testing.assert_allclose(pushed[0.5], 0.5 * pushed[1.0], atol=ROUNDING)
    np.testing.assert_allclose(pushed[0.0], 0.0, atol=ROUNDING)


def test_a_crushed_layer_keeps_its_room() -> None:
    """Under the flat face at 3.03 m/s, after 40 ms: from the face to the lowest crushed bond.

    Foam crushed to three quarters leaves a third of the way of the face. Points that fold through
    one another leave a tenth or less.
    """
    scene = paper_scene("paper/rectangular-3.03")
    scene = scene.model_copy(
        update={"numerics": Numerics(end=40e-3), "output": Output(snapshot_interval=40e-3)}
    )
    last = run(scene).snapshots[-1]
    way = scene.contact_height - last.impactor_y
    middle = np.abs(scene.block.positions[:, 0, 0]) < 0.02
    lowest = (last.e_min_b[middle] < -0.4).argmax(axis=1)
    level = np.take_along_axis(last.position[middle, :, 1], lowest[:, None], axis=1)
    assert way > 0.05
    assert 0.2 < float(np.median(last.impactor_y - level)) / way < 0.45


YIELDING = small_scene(
    base=FREE, model=Model(self_contact=False, shear_yield=True), numerics=numerics(dt=1e-12)
)
SOFTER = YIELDING.model_copy(
    update={
        "across": Across(foam=Foam(youngs_modulus=1.8e6, yield_strain=-0.03)),
        "model": Model(),
    }
)
"""Foam that is softer across: bonds A yield sooner, at a lower stress."""


def after_a_step(
    scene: Scene, F: np.ndarray, worst_a: float, worst_b: float, shear_set: float = 0.0
) -> State:
    """A block whose bonds A and B were once strained by `worst`, after a step at the gradient F."""
    start = {
        "position": scene.block.positions @ F.T + LIFT,
        "worst_a": np.full((COLUMNS - 1, ROWS), worst_a),
        "worst_b": np.full((COLUMNS, ROWS - 1), worst_b),
        "shear_set": np.full((COLUMNS - 1, ROWS - 1), shear_set),
    }
    with bench(scene, **start) as loaded:
        loaded.step(1)
        state = transfer.take(loaded.lattice, 0)
    next_impact = state_after(scene, state.cushion())
    np.testing.assert_array_equal(next_impact.shear_set, state.shear_set)
    return state


def crushed_and_sheared(crush_a: float, crush_b: float, gamma: float) -> np.ndarray:
    """Gradient with these strains of the bonds A and B, and gamma = 2 E_12."""
    a = 1.0 - crush_a
    return np.array([[a, gamma / a], [0.0, math.sqrt((1.0 - crush_b) ** 2 - (gamma / a) ** 2)]])


@pytest.mark.parametrize("grown", [(0.0, 0.003), (0.003, 0.0), (0.001, 0.003)])
@pytest.mark.parametrize("scene", [YIELDING, SOFTER], ids=["alike", "softer across"])
def test_shear_yields_as_foam_crushes(scene: Scene, grown: tuple[float, float]) -> None:
    """By the flow rule of docs/model.md, each axis with its own Y.

    At a constant gradient it is linear in the elastic strain, so it has a closed form. What an
    implicit step takes is right to the square of the crush over Y / (2 G), and the shear is so
    small that bonds yield no sooner for it.
    """
    across, modulus, gamma = scene.across.foam or scene.foam, scene.foam.shear_modulus, 1e-4
    a, b = 0.8, 0.7
    stress_a, stress_b = across.plateau_stress, scene.foam.plateau_stress
    M = 2.0 * modulus * (b**2 * grown[0] / stress_a + a**2 * grown[1] / stress_b)
    T = 2.0 * (grown[0] / a + grown[1] / b)
    exact = gamma * (1.0 - T / M) * (1.0 - math.exp(-M))
    state = after_a_step(
        scene, crushed_and_sheared(1.0 - a, 1.0 - b, gamma), a - 1.0 + grown[0], b - 1.0 + grown[1]
    )
    np.testing.assert_allclose(state.shear_set, state.shear_set[0, 0], rtol=2e-5)  # in 32 bits
    assert state.shear_set[0, 0] == pytest.approx(exact, rel=M)
    assert 0.0 < state.shear_set[0, 0] < exact


def balance(a: float, b: float) -> float:
    """Shear stress [Pa] over gamma at which a crush along the column of length b shears no further.

    It balances the column's own compression, which leans with it.
    """
    return YIELDING.foam.plateau_stress / (a**2 * b)


@pytest.mark.parametrize("a", [1.0, 0.8])
@pytest.mark.parametrize("lean", [0.01, -0.02])
def test_a_column_that_is_crushed_along_itself_leans_no_further(lean: float, a: float) -> None:
    """Nor does one with less shear stress; nothing yields that would gain elastic strain."""
    b, grown = 0.7, 0.01
    F = crushed_and_sheared(1.0 - a, 1.0 - b, lean)
    in_balance = balance(a, b) / YIELDING.foam.shear_modulus
    for share, yields in ((1.0, False), (0.5, False), (-0.5, True), (1.5, True)):
        before = np.float32(lean * (1.0 - share * in_balance))
        state = after_a_step(YIELDING, F, a - 1.0, b - 1.0 + grown, before)
        changed = state.shear_set[0, 0] - before
        assert (abs(changed) > 1e-3 * abs(lean)) == yields, share
        assert changed * (lean - before) >= -1e-8 * lean**2, share


def test_foam_that_crushes_no_further_keeps_its_shear() -> None:
    F = crushed_and_sheared(0.0, 0.4, 0.05)
    state = after_a_step(YIELDING, F, 0.0, -0.45)
    np.testing.assert_array_equal(state.shear_set, 0.0)


@pytest.mark.parametrize("a", [1.0, 0.85])
@pytest.mark.parametrize("elastic", [1.0, 0.2, 1e-6, -1e-6, -0.5])
@pytest.mark.parametrize("gamma", [0.03, -0.09])
def test_bonds_in_shear_yield_sooner(gamma: float, elastic: float, a: float) -> None:
    """Between two cells with the same shear, at sigma = sqrt(Y^2 - 2 tau^2).

    tau is the distance of the shear stress from what lies between none and balance.
    """
    foam, b, lasting = YIELDING.foam, 0.75, np.float32(gamma * (1.0 - elastic))
    F = crushed_and_sheared(1.0 - a, 1.0 - b, gamma)
    state = after_a_step(YIELDING, F, a - 1.0, 0.05 + b - 1.0, lasting)
    stress = foam.shear_modulus * (gamma - float(lasting)) * math.copysign(1.0, gamma)
    tau = max(stress - balance(a, b) * abs(gamma), -stress, 0.0)
    expected = math.sqrt(foam.plateau_stress**2 - 2.0 * tau**2)
    assert (tau > 1.0) == (elastic in (1.0, -0.5))
    inner = state.worst_b[1:-1]  # the outer ones have a cell on one side only
    found = foam.youngs_modulus * (b - 1.0 - (inner - foam.yield_strain))
    np.testing.assert_allclose(found, -expected, rtol=1e-5)


def test_packed_foam_in_shear_yields_no_sooner() -> None:
    """Though its shear stress is beyond balance, as that of the same foam less crushed."""
    gamma, lasting = 0.08, 0.16
    for crush, sooner in ((0.5, True), (0.85, False)):
        F = crushed_and_sheared(0.0, crush, gamma)
        state = after_a_step(YIELDING, F, 0.0, -crush, lasting)
        assert (state.worst_b[1:-1] < -crush - 0.01).all() == sooner
        assert (state.worst_b[1:-1] < -crush - 1e-9).any() == sooner


def test_shear_that_has_yielded_breaks_no_bond() -> None:
    """Bonds fail by the elastic part, of the cells beside them.

    Sheared by 0.25, all break; those between cells in which all of it lasts do not.
    """
    F = np.array([[1.0, 0.25], [0.0, 1.0]])
    lasts = np.zeros((COLUMNS - 1, ROWS - 1))
    lasts[:5, :12] = 0.25
    start = {"position": YIELDING.block.positions @ F.T + LIFT, "shear_set": lasts}
    with bench(YIELDING, **start) as loaded:
        after = loaded.step(2)
    whole_a, whole_b = np.isnan(after.break_time_a), np.isnan(after.break_time_b)
    assert whole_a[:5, :12].all()
    assert whole_b[:5, :12].all()
    assert not whole_a[5:].any()
    assert not whole_a[:, 13:].any()
    assert not whole_b[6:].any()
    assert not whole_b[:, 12:].any()


# mass points as in tests of drops on such foams, whose kernels these are
@pytest.mark.parametrize(
    ("law", "mass_points"), [(RecoveringFoam, "faces"), (TabulatedFoam, "cells")]
)
def test_foam_by_its_curve_yields_in_no_shear(law: type[CurveFoam], mass_points: str) -> None:
    block = small_scene().block.model_copy(update={"mass_points": mass_points})
    curve = Curve(strain=(0, 0.05, 0.6, 0.8), stress=(0, 1e5, 1.2e5, 5e5))
    parts = {"impactor": Wedge(angle_deg=80, shank_width=0.03, mass=0.2, velocity=6.0),
             "block": block, "foam": law(curve=curve), "numerics": Numerics(end=2e-3)}  # fmt: skip
    elastic, yielding = (
        run(small_scene(model=Model(self_contact=False, shear_yield=on), **parts))
        for on in (False, True)
    )
    assert elastic.history["displacement_m"][-1] > 2 * CELL
    np.testing.assert_array_equal(
        yielding.history["displacement_m"], elastic.history["displacement_m"]
    )
