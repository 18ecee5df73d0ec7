"""Bodies without rails that slide, roll and rock on foam, against closed forms.

The foam is stiff beside their weight: they sink by a quarter of a millimetre at most, and nothing
yields.
"""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from bench import PLAIN, bench, numerics

from taichi_foam.engine import transfer
from taichi_foam.engine.state import State
from taichi_foam.scene import (
    Block,
    Cylinder,
    FlatBlock,
    Foam,
    Impactor,
    Output,
    Polygon,
    Scene,
)

GRAVITY = 9.81
FRICTION = 0.22
SPEED = 0.6


def on_foam(
    body: Impactor,
    cell: float,
    width: float = 0.12,
    height: float | None = None,
    foam: Foam | None = None,
) -> Scene:
    """A body on a block of square cells, ten to a column, with gravity."""
    height = 10 * cell if height is None else height
    block = Block(
        mass_points="cells",
        width=width,
        height=height,
        columns=round(width / cell),
        rows=round(height / cell),
    )
    return Scene(
        block=block,
        impactor=body,
        model=PLAIN,
        foam=foam or Foam(),
        numerics=numerics(gravity=GRAVITY),
        output=Output(history_interval=1e-3, snapshot_interval=1.0),
    )


def at_rest(scene: Scene, stops: int = 4) -> State:
    """The state in which a body lies still: all is stopped whenever it is fastest.

    The stops damp a swing at its middle, where all its energy is that of motion.
    """
    body = scene.impactor
    assert body is not None
    still = body.model_copy(update={"velocity": 0.0, "velocity_x": 0.0, "spin": 0.0})
    scene = scene.model_copy(update={"impactor": still})
    with bench(scene) as loaded:
        state = transfer.take(loaded.lattice, 0)
        for _ in range(stops):
            fastest = -1.0
            while abs(state.body["v"]) > fastest:
                fastest = abs(state.body["v"])
                loaded.step(40)
                state = transfer.take(loaded.lattice, 0)
            state = replace(
                state,
                velocity=0.0 * state.velocity,
                increment=0.0 * state.increment,
                body={**state.body, "v": 0.0, "rate_y": 0.0},
                turn={**state.turn, "u": 0.0, "spin": 0.0, "rate_x": 0.0, "rate_angle": 0.0},
            )
            transfer.load(loaded.lattice, 0, scene, state)
            transfer.set_pause(loaded.lattice, np.full(1, 1e30))
    return state


NUMBERS = ("time", "x", "u", "y", "v", "angle", "spin")


def followed(scene: Scene, start: State, time: float, rows: int) -> dict[str, np.ndarray]:
    """A body that is pushed off from rest, as its scene says: NUMBERS at even times, from 0 on."""
    body = scene.impactor
    assert body is not None
    start = replace(
        start,
        clock={**start.clock, "time": 0.0, "next_row": 0.0},
        turn={**start.turn, "u": body.velocity_x, "spin": body.spin},
    )
    found = []
    with bench(scene) as loaded:
        transfer.load(loaded.lattice, 0, scene, start)
        for n in range(rows + 1):
            transfer.set_pause(loaded.lattice, np.full(1, n * time / rows))
            loaded.step(1_000_000)
            now = transfer.take(loaded.lattice, 0)
            assert now.clock["broken"] == 0
            at = (now.turn["x"], now.turn["u"], now.body["y"], now.body["v"])
            found.append((now.clock["time"], *at, now.turn["angle"], now.turn["spin"]))
    return dict(zip(NUMBERS, np.array(found).T, strict=True))


# The centre of mass in the sole, so that friction does not tip the body over its leading edge.
SLIDER = {
    "mass": 2.0,
    "velocity": 0.0,
    "velocity_x": SPEED,
    "friction": FRICTION,
    "guided": False,
    "centre": (0.0, 0.0),
    "inertia": 0.02,
    "x": -0.02,
}
CHAMFERED = (
    (-0.02, 0.0), (0.02, 0.0), (0.025, 0.005), (0.025, 0.05), (-0.025, 0.05), (-0.025, 0.005),
)  # fmt: skip
SLIDERS = {
    "box": FlatBlock(width=0.05, height=0.05, **SLIDER),
    "odd box": FlatBlock(width=0.0473, height=0.05, **SLIDER),
    "chamfers": Polygon(vertices=CHAMFERED, **SLIDER),
    "plate": FlatBlock(width=0.2, height=0.02, **{**SLIDER, "x": -0.008}),
}


@cache
def resting(name: str, cell: float) -> State:
    return at_rest(on_foam(SLIDERS[name], cell))


@pytest.mark.parametrize(
    ("name", "cell"),
    [
        ("box", 0.005),
        ("odd box", 0.005),
        ("chamfers", 0.005),
        ("plate", 0.005),
        ("box", 0.0025),
        ("chamfers", 0.0025),
    ],
)
def test_a_sliding_body_slows_by_mu_g(name: str, cell: float) -> None:
    """Within 2 % over several cells, and from millisecond to millisecond by a sixth at most.

    The plate's edges hang over those of the block; of the others two edges are always on foam.
    What swings there too is the body on the foam that the friction has begun to shear.
    """
    scene = on_foam(SLIDERS[name], cell)
    found = followed(scene, resting(name, cell), 0.04, 40)
    assert found["x"][-1] > 4 * cell
    braking = -np.diff(found["u"]) / np.diff(found["time"])
    assert braking.mean() == pytest.approx(FRICTION * GRAVITY, rel=0.02)
    np.testing.assert_allclose(braking, FRICTION * GRAVITY, rtol=1 / 6)


@pytest.mark.parametrize("name", ["box", "chamfers"])
def test_without_friction_a_sliding_body_keeps_its_speed(name: str) -> None:
    """What the leading edge takes to press mass points down the trailing one gives back.

    Kept within 2 % is the loss against what friction would take: the energy is kept within 2e-4.
    """
    body = SLIDERS[name].model_copy(update={"friction": 0.0})
    found = followed(on_foam(body, 0.005), resting(name, 0.005), 0.04, 40)
    assert found["x"][-1] > 4 * 0.005
    lost = 1.0 - found["u"] / SPEED
    assert np.abs(lost).max() < 0.02 * FRICTION * GRAVITY * 0.04 / SPEED


DISC = {"radius": 0.05, "mass": 1.0, "velocity": 0.0, "friction": 0.5, "guided": False, "x": -0.03}


def test_a_sliding_cylinder_takes_up_rolling_at_two_thirds_of_its_speed() -> None:
    """Friction does not change m v r + I w about the line of contact; a uniform disc has m r^2 / 2.

    It slides until v0 / (3 mu g) = 41 ms. From then on its contact sticks, and it swings a little
    on the foam that is sheared there: the mean counts.
    """
    body = Cylinder(velocity_x=SPEED, **DISC)
    scene = on_foam(body, 0.005)
    found = followed(scene, at_rest(scene), 0.1, 50)
    rim = -found["spin"] * 0.05
    np.testing.assert_allclose((2 * found["u"] + rim) / 2, SPEED, rtol=0.01)
    sliding = found["time"] < 0.036
    expected = SPEED - 0.5 * GRAVITY * found["time"][sliding]
    np.testing.assert_allclose(found["u"][sliding], expected, atol=0.02 * SPEED)
    rolling = found["time"] > 0.05
    assert found["u"][rolling].mean() == pytest.approx(2 / 3 * SPEED, rel=0.02)
    assert rim[rolling].mean() == pytest.approx(2 / 3 * SPEED, rel=0.02)


def test_a_rolling_cylinder_rolls_on() -> None:
    """v = w r stays, over eight cells, and the speed within 2 %.

    The spin swings about that on the foam to which the contact sticks, by as much.
    """
    body = Cylinder(velocity_x=0.4, spin=-0.4 / 0.05, **DISC)
    scene = on_foam(body, 0.005)
    found = followed(scene, at_rest(scene), 0.1, 50)
    assert found["x"][-1] > 0.039
    np.testing.assert_allclose(found["u"], 0.4, rtol=0.02)
    rim = -found["spin"] * 0.05
    assert rim[25:].mean() == pytest.approx(found["u"][25:].mean(), rel=0.01)
    np.testing.assert_allclose(rim, 0.4, rtol=0.03)


def test_a_box_rocks_on_foam_as_on_springs() -> None:
    """I a'' = -(sum k x^2 - m g h) a, over the columns of foam below it.

    Low and slack in shear, foam is a row of columns, bonds and contact in series: shear adds
    12 G H^2 / (K W^2), half a hundredth. Of the foam's mass, less than that, a third counts.
    """
    cell, width = 0.005, 0.1
    body = FlatBlock(
        width=width, height=0.03, mass=2.0, velocity=0.0, friction=0.5, guided=False, spin=0.05
    )
    slack = Foam(shear_modulus=5e4, shear_strain=1.0, tensile_strain=1.0)
    scene = on_foam(body, cell, width=width, height=4 * cell, foam=slack)
    block = scene.block
    bond = scene.foam.youngs_modulus * block.depth
    column = bond / (block.rows - 1 + 1 / scene.numerics.contact_stiffness)
    squares = (block.positions[:, 0, 0] ** 2).sum()
    inertia = body.moment_of_inertia + block.rows * block.node_mass * squares / 3
    period = 2 * math.pi * math.sqrt(inertia / (column * squares - 2.0 * GRAVITY * 0.015))
    found = followed(scene, at_rest(scene), 2.5 * period, 100)
    angle, time = found["angle"], found["time"]
    falls = np.flatnonzero((angle[:-1] > 0) & (angle[1:] <= 0))
    crossed = time[falls] + (time[1] - time[0]) * angle[falls] / (angle[falls] - angle[falls + 1])
    assert np.diff(crossed) == pytest.approx(period, rel=0.02)


@pytest.mark.parametrize("place", [0.0, 0.25, 0.5, 0.75])
def test_a_box_on_its_edge_tips_over_beyond_the_angle_of_balance(place: float) -> None:
    """tan a = b / h: let go 2 % on this side of it it falls back, 2 % beyond it on.

    The edge stands anywhere between two mass points, on foam that gives way by half a millimetre.
    """
    half_width, half_height, cell = 0.1, 0.2, 0.0025
    balance = math.degrees(math.atan(half_width / half_height))
    scenes = []
    for share in (0.98, 1.02):
        body = FlatBlock(
            width=2 * half_width, height=2 * half_height, mass=2.0, velocity=0.0, friction=1.0,
            guided=False, rotation_deg=-share * balance,
        )  # fmt: skip
        corners = body.outline()
        edge = corners[corners[:, 1].argmin(), 0]
        body = body.model_copy(update={"x": place * cell - edge})
        scenes.append(on_foam(body, cell, width=0.03, height=0.01))
    with bench(scenes) as loaded:
        transfer.set_pause(loaded.lattice, np.full(2, 0.12))
        loaded.step(1_000_000)
        back, over = (transfer.take(loaded.lattice, b).turn for b in range(2))
    assert min(back["angle"], back["spin"]) > 0.0
    assert max(over["angle"], over["spin"]) < 0.0
