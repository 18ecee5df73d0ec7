"""Two mass points of different pieces that meet: their size, and how they rub."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
import pytest
from bench import ALL_A, ALL_B, COLUMNS, ROWS, bench, numerics, small_scene
from reference_lattice import reference_positions

from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Base, Foam, Model

ONE, OTHER = (3, 5), (6, 12)
TOP = (3, ROWS - 1)

CELL, STIFFNESS = 0.005, 2.78e6 * 0.057  # N/m, of two points of square cells
STEP = 1e-7


def meeting(
    model: Model,
    distance: float,
    velocity: np.ndarray,
    steps: int,
    turn: float = 0.4,
    height: float = 1.0,
    layers: Sequence[Mapping[str, object]] = (),
) -> tuple[Snapshot, np.ndarray]:
    """A dust in which two points are at a distance, one moving against the other.

    Distance and velocity are along and across their line, which is turned by an angle. With the
    state comes the matrix that turns it back. Of the other point's cell a `height` is left.
    """
    scene = small_scene(base=Base(kind="floor"), model=model, numerics=numerics(dt=STEP))
    scene = scene.with_values(block__layers=layers)
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
@pytest.mark.parametrize(("size", "speed"), [(1.0, SPEED), (0.5, SPEED), (1.04, 10 * SPEED)])
def test_points_meet_where_their_radii_say(size: float, speed: float, height: float) -> None:
    """Half the cell's mean side times the size, each: until then nothing, then swapped velocities.

    The spring is linear, also where foam itself would have yielded: the fastest overlap by 0.086 of
    a cell. Radii follow the crush every fourth step, and only where the list has them near each
    other.
    """
    model = Model(piece_size=size)
    radius = 0.5 * size * CELL
    touch = level_with_large_ones(radius, radius * math.sqrt(height))
    room = 0.2e-3
    arrival = room / speed
    velocity = np.array([speed, 0.0])
    steps = int(0.98 * arrival / STEP)
    before, turned = meeting(model, touch + room, velocity, steps, height=height)
    np.testing.assert_allclose(turned @ before.velocity[ONE], velocity, rtol=0, atol=1e-12)
    assert not before.velocity[OTHER].any()
    steps = math.ceil((arrival + 1.05 * TOUCH) / STEP)
    after, turned = meeting(model, touch + room, velocity, steps, height=height)
    np.testing.assert_allclose(after.velocity[ONE], 0.0, atol=SWING_ERROR * speed)
    np.testing.assert_allclose(
        turned @ after.velocity[OTHER], velocity, rtol=0, atol=SWING_ERROR * speed
    )


def test_points_of_two_foams_push_as_the_softer_one() -> None:
    """The upper one has a quarter of the stiffness: two masses on that spring take twice as long.

    They have half of the push, and half of the speed, when the spring is shortest.
    """
    soft = [{"bottom": 0.05, "top": 0.1, "foam": Foam(youngs_modulus=0.25 * 2.78e6)}]
    room = 0.2e-3
    velocity = np.array([SPEED, 0.0])
    for share, handed_over in ((0.5, 0.5), (1.0, 1.0)):
        steps = round((room / SPEED + share * 2.0 * TOUCH) / STEP)
        after, turned = meeting(Model(piece_size=1.0), CELL + room, velocity, steps, layers=soft)
        np.testing.assert_allclose(
            turned @ after.velocity[OTHER], handed_over * velocity, rtol=0, atol=5e-3 * SPEED
        )


def test_no_pair_is_missed_wherever_it_is_in_the_search_grid() -> None:
    """Thirty pairs, every 0.2 mm along more than a bin of the grid, all of which come apart again.

    Points with the largest radii are listed from 6 mm on, when they are 5.95 mm apart, and meet
    before they have moved so far that the list would be made anew.
    """
    scene = small_scene(
        base=Base(kind="floor"), model=Model(piece_size=1.1), numerics=numerics(dt=STEP)
    )
    position, velocity = reference_positions(scene), np.zeros((COLUMNS, ROWS, 2))
    pairs = 30
    apart = np.arange(COLUMNS * ROWS) * 4.0 * CELL  # no two rows' points meet
    position[..., 0], position[..., 1] = 0.0, 0.05 + apart.reshape(COLUMNS, ROWS)
    one, other = (slice(0, 3), slice(0, 20, 2)), (slice(3, 6), slice(0, 20, 2))
    touch, room = 1.1 * CELL, 0.45e-3
    position[one][..., 0] = 0.2e-3 * np.arange(pairs).reshape(3, 10)
    position[other][..., 0] = position[one][..., 0] + touch + room
    position[other][..., 1] = position[one][..., 1]
    velocity[one][..., 0], velocity[other][..., 0] = SPEED, -SPEED
    with bench(
        scene, position=position, velocity=velocity, broken_a=ALL_A, broken_b=ALL_B
    ) as loaded:
        after = loaded.step(math.ceil((room / (2.0 * SPEED) + 1.05 * TOUCH) / STEP)).velocity
    np.testing.assert_allclose(after, -velocity, rtol=0, atol=SWING_ERROR * SPEED)


def test_points_that_were_torn_too_near_have_their_radii_back_once_free() -> None:
    """Torn at 0.7 of a cell they do not push; a third point meets the free one a cell away.

    The list is made anew when a point has moved by half the skin, 0.05 of a cell, and each time the
    radius grows by half the gap: after eight of them it lacks less than half a hundredth of a cell.
    """
    scene = small_scene(
        base=Base(kind="floor"), model=Model(piece_size=1.0), numerics=numerics(dt=STEP)
    )
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

    The dashpot tau K Z, at 3 m/s, could give 8 N where mu times the push is 0.25 N at most:
    they slide all the time. Meanwhile the normal turns by 3 m/s * 35 us over 5 mm, 0.02, half of it
    until the push is largest: of mu v there is an error of 0.01 v, and in v one of 0.01 times the
    sideways speed, which is kept from the test by taking the turned normal.
    """
    approach = 0.5
    room = 1e-6
    steps = math.ceil((room / approach + 1.05 * TOUCH) / STEP)
    velocity = np.array([approach, sideways])
    model = Model(piece_size=1.0, piece_friction=friction)
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
    """c = tau K Z, a bond's, on the relative speed: over the touch it falls by exp(-2 c T / m).

    Friction 5 holds what the dashpot gives but where the push is small, at both ends of the touch:
    where 5 k v sin(w t) / w is below c u, for 0.2 % of it each.
    """
    approach, sideways, room = 2.0, 0.02, 1e-6
    steps = math.ceil((room / approach + 1.05 * TOUCH) / STEP)
    after, turned = meeting(
        Model(piece_size=1.0, piece_friction=5.0),
        CELL + room,
        np.array([approach, sideways]),
        steps,
    )
    one, other = turned @ after.velocity[ONE], turned @ after.velocity[OTHER]
    dashpot = 1e-6 / 0.057 * STIFFNESS
    # the normal turns by u T / 5 mm, some 1e-4, and takes 2e-4 m/s of the approach with it
    left = sideways * math.exp(-2.0 * dashpot * TOUCH / MASS)
    assert left < 0.1 * sideways
    assert one[1] - other[1] == pytest.approx(left, abs=0.02 * sideways)
    np.testing.assert_allclose(one + other, [approach, sideways], rtol=1e-12)


@pytest.mark.parametrize(
    ("mass_points", "one", "foam", "crowd"), [("cells", ONE, 1.0, 6), ("faces", TOP, 0.5, 5)]
)
def test_a_point_in_a_crowd_rubs_as_if_it_had_its_bonds(
    mass_points: str, one: tuple[int, int], foam: float, crowd: int
) -> None:
    """Six others close in on it: its four bonds are broken, so each has 4/6 of a bond's dashpot c.

    The six lines have directions that add up to 3 along any other: it is braked by 3 * 4/6 c. A
    point on a face with half a cell of foam has room for five. It has two bonds with half a face
    each, and one with a whole face: by 5/2 * 2/5 c, half as much, as its mass is. The points'
    springs then act too, by 3 k v t, up to 0.9 % of that; friction holds from 1 % of the time on.
    """
    approach, room, step, steps = 20.0, 1e-9, 1e-9, 100
    plain = small_scene(
        base=Base(kind="floor"),
        model=Model(piece_size=1.0, piece_friction=5.0),
        numerics=numerics(dt=step),
    )
    scene = plain.with_values(
        block__mass_points=mass_points, block__height=0.005 * (ROWS - 2 + 2 * foam)
    )
    position = scene.block.positions * 3.0
    velocity = np.zeros_like(position)
    touch = 0.5 * CELL * (1.0 + math.sqrt(foam) + (math.sqrt(2.0) - 1.0) * (1.0 - math.sqrt(foam)))
    for n, node in enumerate([(6, 12), (6, 14), (6, 10), (3, 12), (3, 9), (6, 8)][:crowd]):
        angle = 0.4 + n * 2.0 * math.pi / crowd
        way = np.array([math.cos(angle), math.sin(angle)])
        position[node] = position[one] + (touch + room) * way
        velocity[node] = -approach * way
    velocity[one] = [0.003, 0.004]
    with bench(
        scene, position=position, velocity=velocity, broken_a=ALL_A, broken_b=ALL_B
    ) as loaded:
        after = loaded.step(steps)
    dashpot = 1e-6 / 0.057 * STIFFNESS
    braked = 2.0 * dashpot * (step * steps - room / approach) / MASS
    np.testing.assert_allclose(
        after.velocity[one], (1.0 - braked) * velocity[one], rtol=0.02 * braked
    )
