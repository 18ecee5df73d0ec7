"""Contact with impactor and floor: distances of every shape, and Coulomb friction."""

import math

import numpy as np
import pytest
import shapely
import shapely.ops
from bench import (
    ALL_A,
    ALL_B,
    COLUMNS,
    FREE,
    PLAIN,
    ROUNDING,
    ROWS,
    bench,
    node_forces,
    numerics,
    small_scene,
)
from reference_lattice import reference_positions

from taichi_foam.scene import (
    Base,
    Cylinder,
    Ellipse,
    FlatBlock,
    Foam,
    Impactor,
    IShape,
    Outline,
    Polygon,
    Wedge,
)

STIFF = numerics(contact_stiffness=40.0, contact_damping=0.0)
SLOW = 1e-6  # m/s: over the bench's instant, an impactor that hardly moves
SHAPES = {
    "flat": FlatBlock(velocity=SLOW, width=0.03, height=0.02),
    "tilted": FlatBlock(velocity=SLOW, width=0.03, height=0.02, rotation_deg=17),
    "off centre": FlatBlock(velocity=SLOW, width=0.03, height=0.02, x=0.008),
    "cylinder": Cylinder(velocity=SLOW, radius=0.014),
    "cylinder off centre": Cylinder(velocity=SLOW, radius=0.014, x=-0.006),
    "wedge": Wedge(velocity=SLOW, angle_deg=70, shank_width=0.03, height=0.05),
    "corner": Polygon(
        velocity=SLOW,
        vertices=((0, 0), (0.02, 0), (0.02, 0.015), (0.01, 0.03), (0, 0.02)),
        rotation_deg=40,
    ),
    "i-shape": IShape(velocity=SLOW, width=0.04, height=0.05, flange=0.006, web=0.01),
    "i-shape tilted": IShape(
        velocity=SLOW, width=0.04, height=0.05, flange=0.006, web=0.01, rotation_deg=-25
    ),
    "outline": Outline(
        velocity=SLOW,
        vertices=((0, 0), (0.012, 0.013), (0.03, -0.004), (0.032, 0.03), (0.013, 0.018), (0, 0.03)),
        rotation_deg=12,
    ),
    "ellipse": Ellipse(velocity=SLOW, width=0.035, height=0.02, rotation_deg=25),
    "upright ellipse": Ellipse(velocity=SLOW, width=0.02, height=0.06, rotation_deg=-10, x=0.003),
    "round ellipse": Ellipse(velocity=SLOW, width=0.03, height=0.03, rotation_deg=33),
}


def depth_and_normal(impactor: Impactor, point: np.ndarray) -> tuple[float, np.ndarray]:
    """How deep a point is inside, and the way out: to the nearest point of the boundary.

    `point` is about the impactor's reference point. The depth is negative outside.
    """
    if isinstance(impactor, Cylinder):
        away = point - [0.0, impactor.radius]
        length = float(np.linalg.norm(away))
        return impactor.radius - length, away / length
    if isinstance(impactor, Ellipse):
        return from_ellipse(impactor, point)
    outline = shapely.Polygon(impactor.outline())
    place = shapely.Point(point)
    nearest = shapely.ops.nearest_points(outline.exterior, place)[0]
    away = np.array([nearest.x, nearest.y]) - point
    depth = float(np.linalg.norm(away))
    return (depth if outline.contains(place) else -depth), away / depth


def from_ellipse(ellipse: Ellipse, point: np.ndarray) -> tuple[float, np.ndarray]:
    """The same by minimising over the ellipse's own angle, from the best of many."""
    a, b, t = ellipse.width / 2, ellipse.height / 2, math.radians(ellipse.rotation_deg)
    level = math.hypot(a * math.sin(t), b * math.cos(t))
    turn = np.array([[math.cos(t), -math.sin(t)], [math.sin(t), math.cos(t)]])
    own = turn.T @ (point - [0.0, level])

    def away(angle: float) -> np.ndarray:
        return np.array([a * math.cos(angle), b * math.sin(angle)]) - own

    best = min(np.linspace(0, 2 * math.pi, 400), key=lambda angle: float(away(angle) @ away(angle)))
    for _ in range(20):  # Newton, on the tangent's component
        tangent = np.array([-a * math.sin(best), b * math.cos(best)])
        bend = -np.array([a * math.cos(best), b * math.sin(best)])
        best -= (away(best) @ tangent) / (tangent @ tangent + away(best) @ bend)
    inside = (own[0] / a) ** 2 + (own[1] / b) ** 2 < 1
    depth = float(np.linalg.norm(away(best)))
    return (depth if inside else -depth), turn @ away(best) / depth


@pytest.mark.parametrize("name", SHAPES)
def test_every_shape_pushes_along_the_way_out(name: str) -> None:
    """A block lifted 21 mm into the impactor, at odds with its grid: k times depth, no friction.

    The only other forces would be the faces', and an undeformed block has none.
    """
    scene = small_scene(base=FREE, impactor=SHAPES[name], model=PLAIN, numerics=STIFF)
    position = reference_positions(scene) + np.array([0.0013, 0.0211])
    lowest = scene.contact_height
    stiffness = 40.0 * scene.foam.youngs_modulus * scene.block.depth
    expected = np.zeros_like(position)
    for index in np.ndindex(COLUMNS, ROWS):
        depth, out = depth_and_normal(SHAPES[name], position[index] - [SHAPES[name].x, lowest])
        if depth > 0:
            expected[index] = stiffness * depth * out
    assert np.count_nonzero(expected.any(axis=-1)) >= 8
    np.testing.assert_allclose(node_forces(scene, position=position), expected, atol=ROUNDING)


@pytest.mark.parametrize(
    "body",
    [
        SHAPES["wedge"],
        Outline(velocity=SLOW, vertices=((0, 0), (0.02, 0.03), (0, 0.02), (-0.02, 0.03))),
    ],
    ids=["wedge", "arrow"],
)
def test_a_point_under_a_tip_is_pushed_straight_down(body: Impactor) -> None:
    """It is as near to both faces; the points beside it are pushed to either side, and alike.

    Its depth grows by the cosine of half the turn for each metre down, and the force is the slope
    of the energy of that depth. Beside it that is the vertical part of the push along a normal.
    """
    scene = small_scene(base=FREE, impactor=body, model=PLAIN, numerics=STIFF)
    position = reference_positions(scene) + np.array([0.0, 0.004])
    middle = COLUMNS // 2
    position[..., 0] = (np.arange(COLUMNS) - middle)[:, None] * 0.002
    forces = node_forces(scene, position=position) - node_forces(
        small_scene(base=FREE, model=PLAIN, numerics=STIFF), position=position
    )
    depth, out = depth_and_normal(body, position[middle, -1] - [0.0, scene.contact_height])
    push = 40.0 * scene.foam.youngs_modulus * scene.block.depth * depth * abs(out[1])
    assert push > 10.0
    np.testing.assert_allclose(forces[middle, -1], [0.0, -push], atol=ROUNDING)
    flip = np.array([-1.0, 1.0])
    left, right = forces[middle - 2 : middle, -1], forces[middle + 1 : middle + 3, -1]
    assert left[1, 0] < 0.0
    np.testing.assert_allclose(left[::-1], right * flip, atol=ROUNDING)


K, FACE = 2.78e6, 0.005 * 0.057  # Pa, m2


@pytest.mark.parametrize(
    ("sunk", "shares"),
    [
        (0.0, []),
        (0.05e-3, [0.02]),  # half a cell of 2.5 mm, elastic
        (0.125e-3, [0.05]),
        (1.5e-3, [0.05]),  # the plateau
        (2.0e-3, [0.05]),  # crushed to 0.2: from here on 4 K more
        (2.25e-3, [0.45]),
        # two rows and a half, those below the floor at -9.8 and -4.8 mm
        (12.3e-3, [0.05 + 4 * 4.12, 0.05 + 4 * 2.12, 0.05 + 4 * 0.12]),
    ],
)
def test_the_floor_pushes_up_with_half_a_cell_of_foam(sunk: float, shares: list[float]) -> None:
    """By K times the face times the shares, row by row from below, all worked out by hand."""
    scene = small_scene(base=Base(kind="floor"))
    position = reference_positions(scene) - [0.0, sunk]
    expected = np.zeros_like(position)
    expected[:, : len(shares), 1] = K * FACE * np.array(shares)
    np.testing.assert_allclose(node_forces(scene, position=position), expected, atol=ROUNDING)


@pytest.mark.parametrize("axis", [0, 1])
def test_crushed_feet_stand_lower_on_the_floor(axis: int) -> None:
    """Feet once crushed by 40 % of their height: the floor meets them only at 1.5 mm.

    Those crushed sideways have all their height, and are met at 2.5 mm. Their own bonds are
    broken, and hold nothing at a strain beyond that of zero stress.
    """
    scene = small_scene(base=Base(kind="floor"))
    worst = np.zeros((COLUMNS - 1, ROWS) if axis == 0 else (COLUMNS, ROWS - 1))
    worst[:, 0] = -0.4
    crushed = {("worst_a", "worst_b")[axis]: worst, "broken_a": ALL_A, "broken_b": ALL_B}
    shares = {0: (0.04, 0.05, 0.05, 0.05), 1: (0.0, 0.0, 0.02, 0.05)}[axis]
    for height, share in zip((2.4e-3, 1.51e-3, 1.45e-3, 1.0e-3), shares, strict=True):
        position = reference_positions(scene)
        position[:, 0, 1] = height
        position[:, 1:, 1] += 0.01
        expected = np.zeros_like(position)
        expected[:, 0, 1] = share * K * FACE
        np.testing.assert_allclose(
            node_forces(scene, position=position, **crushed), expected, atol=ROUNDING
        )


def test_the_held_row_lets_the_impactor_pass() -> None:
    """A block lifted by its whole height: a cylinder pushes all its rows aside but the held one."""
    cylinder = SHAPES["cylinder"]
    scene = small_scene(impactor=cylinder, base=Base(kind="held"), numerics=STIFF)
    position = reference_positions(scene) + np.array([0.0, 0.105])
    inside = [
        depth_and_normal(cylinder, point - [0.0, scene.contact_height])[0] > 0
        for point in position[:, 0]
    ]
    assert any(inside)
    found = node_forces(scene, position=position)
    np.testing.assert_allclose(found[:, 0], 0.0, atol=ROUNDING)
    free = node_forces(scene.model_copy(update={"base": Base(kind="floor")}), position=position)
    assert np.abs(free[inside, 0]).max() > 100.0
    np.testing.assert_allclose(found[:, 1:], free[:, 1:], atol=ROUNDING)


def test_the_support_stops_the_impactor_and_throws_it_back() -> None:
    """With the block out of the way, from 0.1 mm above the bottom: nothing, then half a swing.

    Its frequency is a twentieth of that of a node on the impactor, so that contacts rule the step:
    w = 20.8e3 / s, 151 us, v / w = 144 um deep; w dt is 0.004, its square the kinks' error.
    """
    speed, mass, dt = 3.0, 6.0, 2e-7
    face = FlatBlock(velocity=speed, mass=mass, width=0.03)
    stiff = numerics(contact_stiffness=40.0, dt=dt)
    scene = small_scene(impactor=face, numerics=stiff)
    w = math.sqrt(40 * K * 0.057 / scene.block.node_mass) / 20
    aside = reference_positions(scene) + np.array([1.0, 0.0])
    heights, speeds = [], []
    with bench(scene, position=aside) as loaded:
        member = loaded.lattice.state.body.get_member_field
        y, v, support_work = member("y"), member("v"), member("support_work")
        y[0] = member("trial_y")[0] = 1e-4
        for _ in range(120):
            loaded.step(10)
            heights.append(y[0])
            speeds.append(v[0])
        work = support_work[0]
    heights, speeds = np.array(heights), np.array(speeds)
    falling = np.arange(10, 160, 10) * dt
    np.testing.assert_allclose(heights[:15], 1e-4 - speed * falling, rtol=0, atol=1e-12)
    assert heights.min() == pytest.approx(-speed / w, rel=1e-3)
    assert heights[-1] == pytest.approx(speed * (1200 * dt - math.pi / w) - 1e-4, rel=1e-3)
    assert speeds[-1] == pytest.approx(speed, rel=2e-5)
    assert work == pytest.approx(0.5 * mass * (speed**2 - speeds[-1] ** 2), abs=1e-3)


def test_without_a_stop_the_impactor_goes_on() -> None:
    """The same, with a base that lets it pass: to the last bit at its speed, below the bottom."""
    speed, dt = 3.0, 2e-7
    scene = small_scene(
        base=Base(stops_impactor=False),
        impactor=FlatBlock(velocity=speed, mass=6.0, width=0.03),
        numerics=numerics(contact_stiffness=40.0, dt=dt),
    )
    aside = reference_positions(scene) + np.array([1.0, 0.0])
    with bench(scene, position=aside) as loaded:
        member = loaded.lattice.state.body.get_member_field
        member("y")[0] = member("trial_y")[0] = 1e-4
        loaded.step(1200)
        assert member("v")[0] == -speed
        assert member("y")[0] == pytest.approx(1e-4 - speed * 1200 * dt, abs=1e-12)
        assert member("support_work")[0] == 0.0


# One mass point against a slope that comes down on it: contact is half a swing of mass and penalty,
# and the friction spring, as stiff as the penalty, swings along with it.
SPEED = 1.0
SPREAD = 1.01  # of a dust of points that are too far apart to press each other


def point_after_slope(slope_deg: float, friction: float, damping: float = 0.0) -> np.ndarray:
    """Velocity (2,) of the top left point after a heavy face, inclined by an angle, has hit it.

    The face is lowest on its left, 50 um (twenty overlaps) from that point, and touches no other.
    """
    rise = 0.2 * math.tan(math.radians(slope_deg))
    x = -4.5 * 0.005 * SPREAD
    face = Polygon(
        vertices=((0.0, 0.0), (0.2, rise), (0.2, rise + 0.3), (0.0, 0.3)),
        mass=1e6,
        velocity=SPEED,
        friction=friction,
        x=x - 5e-5 + 0.1,
        gap=19 * 0.005 * (SPREAD - 1),
    )
    scene = small_scene(
        base=Base(kind="floor"),
        impactor=face,
        numerics=numerics(dt=2e-8, contact_stiffness=40.0, contact_damping=damping),
    )
    half_swing = math.pi * math.sqrt(scene.block.node_mass / (40 * 2.78e6 * 0.057))
    approach = 5e-5 * rise / 0.2 / SPEED
    foot = np.array([0.0, 0.0025])
    position = (reference_positions(scene) - foot) * SPREAD + foot
    with bench(scene, position=position, broken_a=ALL_A, broken_b=ALL_B) as loaded:
        after = loaded.step(round((approach + 1.1 * half_swing) / 2e-8))
    others = after.velocity.copy()
    others[0, -1] = 0.0
    assert not others.any()
    return after.velocity[0, -1]


# At first and last touch a step holds a kink of the force: an error of the order of w dt = 0.008
# squared. Larger is that the body's speed changes by 2 m / M = 1e-10, and nothing else.
SWING_ERROR = 1e-4


@pytest.mark.parametrize("slope", [5.0, 15.0, 16.6])
def test_a_point_sticks_to_a_slope_below_the_friction_angle(slope: float) -> None:
    """mu = 0.3 is 16.7 degrees. What sticks is thrown back the way it was hit: straight down."""
    np.testing.assert_allclose(point_after_slope(slope, 0.3), [0.0, -2 * SPEED], atol=SWING_ERROR)


@pytest.mark.parametrize(("slope", "friction"), [(15.0, 0.0), (35.0, 0.3), (60.0, 0.5)])
def test_a_point_slips_on_a_slope_above_the_friction_angle(slope: float, friction: float) -> None:
    """The impulse lies on the edge of the friction cone: 2 m v cos(s) normal, mu times that along.

    For tan(s) > 2 mu the point still slides when it leaves, so that the slider never sticks.
    """
    s = math.radians(slope)
    assert math.tan(s) > 2 * friction
    normal, along = np.array([math.sin(s), -math.cos(s)]), np.array([-math.cos(s), -math.sin(s)])
    expected = 2 * SPEED * math.cos(s) * (normal + friction * along)
    np.testing.assert_allclose(point_after_slope(slope, friction), expected, atol=SWING_ERROR)


@pytest.mark.parametrize("damping", [0.05, 0.2])
def test_a_damped_contact_gives_back_less(damping: float) -> None:
    """A spring and a dashpot that do not pull: Schwager & Poeschel 2007, Granular Matter 9:465.

    e = exp(-b / w (pi - atan(2 b w / (w^2 - b^2)))), b = z w0, w^2 = w0^2 - b^2.
    """
    b, w = damping, math.sqrt(1.0 - damping**2)
    e = math.exp(-b / w * (math.pi - math.atan(2.0 * b * w / (w * w - b * b))))
    thrown = point_after_slope(0.1, 0.0, damping)  # so little inclined, and no friction
    # first touch meets the dashpot at once: a step holds a jump of the force
    assert thrown[1] == pytest.approx(-(1.0 + e) * SPEED, rel=4e-3)


GRAVITY = 9.81


def block_at_rest(friction: float) -> tuple:
    """A stiff block on a floor, at rest under gravity: scene and positions.

    Statics of each column of nodes: bond j carries the weight of the nodes above it, and half a
    bond's length, twice as stiff, lies between the lowest node and the floor. That half has shrunk
    by the strain of the lowest bond: as every radius, by the worst compression of its node.
    """
    scene = small_scene(
        base=Base(kind="floor", friction=friction),
        numerics=numerics(gravity=GRAVITY, dt=2e-6),
        foam=Foam(tensile_strain=1.0, shear_strain=1.0),
    )
    block = scene.block
    stiffness = scene.foam.youngs_modulus * block.depth  # of a bond of a square cell
    weight = block.node_mass * GRAVITY
    shortening = weight * np.arange(ROWS - 1, 0, -1) / stiffness
    shrinking = 0.5 * shortening[0]
    sinking = shrinking + ROWS * weight / (2 * stiffness)
    position = reference_positions(scene)
    position[..., 1] -= sinking + np.concatenate([[0.0], np.cumsum(shortening)])
    return scene, position


def test_a_block_under_gravity_rests() -> None:
    """The static solution moves by no more than rounding: forces of 1e-11 N on 4e-5 kg for 1 ms."""
    scene, position = block_at_rest(0.5)
    with bench(scene, position=position) as loaded:
        after = loaded.step(500)
    np.testing.assert_allclose(after.velocity, 0.0, atol=1e-9)


def test_a_sliding_block_slows_by_mu_g_stops_and_stays() -> None:
    """v0 = 25 mm/s, mu = 0.25: it stops after 10.2 ms and v0^2 / (2 mu g) = 0.127 mm, for good.

    While every foot slides, the friction is mu times the floor's force whatever its distribution,
    so that the mean velocities obey d(v_x + mu v_y) = -mu g dt exactly. Exempt is the very
    first stage, a sixth of a step, whose friction springs are still slack (2e-6 m/s). The feet
    stop one after the other, within a few of the block's shear swings (4 H / c_s = 2.2 ms).
    """
    mu, v0 = 0.25, 0.025  # with 0.5 a block twice as high as wide would tip over
    scene, position = block_at_rest(mu)
    velocity = np.broadcast_to([v0, 0.0], position.shape)
    stop = v0 / (mu * GRAVITY)
    with bench(scene, position=position, velocity=velocity) as loaded:
        for _ in range(7):
            state = loaded.step(500)
            assert state.velocity[:, 0, 0].min() > 0.0  # every foot slides on
            mean = state.velocity.mean(axis=(0, 1))
            expected = v0 - mu * GRAVITY * state.time - mu * mean[1]
            assert mean[0] == pytest.approx(expected, abs=1e-5)
        still = loaded.step(round((stop + 0.02 - state.time) / 2e-6))
        later = loaded.step(10_000)
    way = still.position.mean(axis=(0, 1))[0] - position.mean(axis=(0, 1))[0]
    assert way == pytest.approx(v0**2 / (2 * mu * GRAVITY), rel=0.05)
    creep = later.position[:, 0] - still.position[:, 0]
    assert np.abs(creep).max() < 1e-7
