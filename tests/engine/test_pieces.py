"""Two mass points of different pieces that meet: their size, and how they rub."""

import math

import numpy as np
import pytest
from bench import ALL_A, ALL_B, COLUMNS, ROWS, bench, numerics, small_scene
from reference_lattice import reference_positions

from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Base, Model

ONE, OTHER = (3, 5), (6, 12)

CELL, STIFFNESS = 0.005, 2.78e6 * 0.057  # N/m, of two points of square cells
STEP = 1e-7


def meeting(
    model: Model,
    distance: float,
    velocity: np.ndarray,
    steps: int,
    turn: float = 0.4,
    height: float = 1.0,
) -> tuple[Snapshot, np.ndarray]:
    """A dust in which two points are at a distance, one moving against the other.

    Distance and velocity are along and across their line, which is turned by an angle. With the
    state comes the matrix that turns it back. Of the other point's cell a `height` is left.
    """
    scene = small_scene(base=Base(kind="floor"), model=model, numerics=numerics(dt=STEP))
    position = reference_positions(scene) * 3.0
    worst = np.zeros((COLUMNS, ROWS - 1))
    worst[OTHER] = height - 1.0
    c, s = math.cos(turn), math.sin(turn)
    way = np.array([[c, -s], [s, c]])
    position[OTHER] = position[ONE] + way @ [distance, 0.0]
    speeds = np.zeros_like(position)
    speeds[ONE] = way @ velocity
    with bench(
        scene,
        position=position,
        velocity=speeds,
        worst_b=worst,
        broken_a=ALL_A,
        broken_b=ALL_B,
    ) as loaded:
        after = loaded.step(steps)
    return after, way.T


MASS = small_scene().block.node_mass
TOUCH = math.pi * math.sqrt(MASS / 2 / STIFFNESS)  # s, that two masses on a spring come and go
SPEED = 4.0

# At first and last touch a step holds a kink: w dt = 9e-3, squared.
SWING_ERROR = 1e-4


def level_with_large_ones(one: float, two: float) -> float:
    """Where points of two radii touch.

    Equal ones do at the sum of their radii. One of no size that lies in the dent between two large
    ones, which touch each other, is as far from their line as they reach.
    """
    large, small = max(one, two), min(one, two)
    in_the_dent = math.hypot(large, large)
    return in_the_dent + small / large * (2.0 * large - in_the_dent)


@pytest.mark.parametrize("height", [1.0, 0.16])
@pytest.mark.parametrize("size", [1.0, 0.5])
def test_points_meet_where_their_radii_say(size: float, height: float) -> None:
    """Half the cell's mean side times the size, each: until then nothing, then swapped velocities.

    Radii follow the crush every fourth step, and only where the list has them near each other.
    """
    model = Model(piece_size=size)
    radius = 0.5 * size * CELL
    touch = level_with_large_ones(radius, radius * math.sqrt(height))
    room = 0.2e-3
    arrival = room / SPEED
    velocity = np.array([SPEED, 0.0])
    steps = int(0.98 * arrival / STEP)
    before, turned = meeting(model, touch + room, velocity, steps, height=height)
    np.testing.assert_allclose(turned @ before.velocity[ONE], velocity, rtol=0, atol=1e-12)
    assert not before.velocity[OTHER].any()
    steps = math.ceil((arrival + 1.05 * TOUCH) / STEP)
    after, turned = meeting(model, touch + room, velocity, steps, height=height)
    np.testing.assert_allclose(after.velocity[ONE], 0.0, atol=SWING_ERROR * SPEED)
    np.testing.assert_allclose(
        turned @ after.velocity[OTHER], velocity, rtol=0, atol=SWING_ERROR * SPEED
    )


def test_points_that_were_torn_too_near_have_their_radii_back_once_free() -> None:
    """Torn at 0.7 of a cell they do not push; a third point meets the free one a cell away.

    The list is made anew when a point has moved by half the skin, 0.05 of a cell, and each time the
    radius grows by half the gap: after eight of them it lacks less than half a hundredth of a cell.
    """
    scene = small_scene(base=Base(kind="floor"), numerics=numerics(dt=STEP))
    position = reference_positions(scene) * 3.0
    wall = (6, 14)
    way = np.array([math.cos(0.4), math.sin(0.4)])
    position[OTHER] = position[ONE] + 0.7 * CELL * way
    free_way = 1.5 * CELL
    position[wall] = position[OTHER] + (CELL + free_way) * way
    velocity = np.zeros_like(position)
    velocity[OTHER] = SPEED * way
    arrival = free_way / SPEED

    def after(time: float) -> np.ndarray:
        with bench(
            scene, position=position, velocity=velocity, broken_a=ALL_A, broken_b=ALL_B
        ) as loaded:
            return loaded.step(math.ceil(time / STEP)).velocity

    np.testing.assert_allclose(after(0.98 * arrival)[OTHER], SPEED * way, rtol=0, atol=1e-12)
    late = 0.005 * CELL / SPEED
    met = after(arrival + late + 0.25 * TOUCH)
    # half of the push is given when the spring is shortest, after half of the touch
    assert SPEED * 0.05 < met[wall] @ way < SPEED * 0.5
    left = after(arrival + late + 1.05 * TOUCH)
    np.testing.assert_allclose(left[wall], SPEED * way, rtol=0, atol=SWING_ERROR * SPEED)
    np.testing.assert_allclose(left[ONE], 0.0, atol=1e-12)


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("sideways", [3.0, -3.0])
def test_points_that_slide_rub_by_mu_times_the_push(friction: float, sideways: float) -> None:
    """One gives the other its speed v along the normal, and mu v of that across.

    The dashpot tau K Z / 2, at 3 m/s, could give 4 N where mu times the push is 0.25 N at most:
    they slide all the time. Meanwhile the normal turns by 3 m/s * 35 us over 5 mm, 0.02, half of it
    until the push is largest: of mu v there is an error of 0.01 v, and in v one of 0.01 times the
    sideways speed, which is kept from the test by taking the turned normal.
    """
    approach = 0.5
    room = 1e-6
    steps = math.ceil((room / approach + 1.05 * TOUCH) / STEP)
    velocity = np.array([approach, sideways])
    model = Model(piece_friction=friction)
    after, turned = meeting(model, CELL + room, velocity, steps)
    one, other = turned @ after.velocity[ONE], turned @ after.velocity[OTHER]
    np.testing.assert_allclose(one + other, velocity, rtol=1e-13)
    # the push's own direction, from the middle of the touch
    middle = -sideways * (room / approach + 0.5 * TOUCH) / CELL
    normal = np.array([math.cos(middle), math.sin(middle)])
    tangent = np.array([-normal[1], normal[0]])
    along = velocity @ normal
    assert other @ normal == pytest.approx(along, rel=0.03)
    rubbed = math.copysign(friction * abs(other @ normal), sideways)
    assert other @ tangent == pytest.approx(rubbed, abs=0.02 * friction * along + 0.005 * along)


def test_points_that_hardly_slide_are_dragged_by_a_dashpot() -> None:
    """c = tau K Z / 2 on the relative speed: over the touch it falls by exp(-2 c T / m).

    Friction 5 holds what the dashpot gives but where the push is small, at both ends of the touch:
    where 5 k v sin(w t) / w is below c u, for 0.2 % of it each.
    """
    approach, sideways, room = 2.0, 0.02, 1e-6
    steps = math.ceil((room / approach + 1.05 * TOUCH) / STEP)
    after, turned = meeting(
        Model(piece_friction=5.0), CELL + room, np.array([approach, sideways]), steps
    )
    one, other = turned @ after.velocity[ONE], turned @ after.velocity[OTHER]
    dashpot = 0.5 * 1e-6 / 0.057 * STIFFNESS
    # the normal turns by u T / 5 mm, some 1e-4, and takes 2e-4 m/s of the approach with it
    left = sideways * math.exp(-2.0 * dashpot * TOUCH / MASS)
    assert left < 0.1 * sideways
    assert one[1] - other[1] == pytest.approx(left, abs=0.02 * sideways)
    np.testing.assert_allclose(one + other, [approach, sideways], rtol=1e-12)
