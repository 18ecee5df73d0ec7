"""The renderer against areas, symmetries and colours that are known without it."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from picture_states import (
    alone,
    colour_at,
    dented,
    intact,
    reference,
    scene_of,
    shattered,
    snapshot_of,
    split,
)  # fmt: skip
from picture_words import check_words, meet

from taichi_foam.analysis.impact import impactor_now
from taichi_foam.engine import runtime
from taichi_foam.errors import UserError
from taichi_foam.picture import annotate, inset, raster
from taichi_foam.picture.look import THEMES, Look, shades
from taichi_foam.picture.modes import MODES
from taichi_foam.picture.polygons import paint
from taichi_foam.picture.view import Box, View, Window, fit, window
from taichi_foam.scene import (
    Base,
    Cylinder,
    FlatBlock,
    IShape,
    Output,
    Scene,
    Start,
    Support,
    Wedge,
)  # fmt: skip

LIGHT = THEMES["light"]
NO_SHAPE = np.empty((0, 2))
#: A view in which a metre is a pixel and y points up from the bottom left.
PLAIN = View(Box(0, 0, 300, 200), 1.0, 0.0, 200.0)


def painted(quads: np.ndarray, shape: np.ndarray = NO_SHAPE) -> np.ndarray:
    """White polygons on black: the share of each pixel that they cover, in quarters."""
    image = annotate.blank(300, 200, (0, 0, 0))
    white = np.full(len(quads), 0xFFFFFF, dtype=np.int32)
    none = np.zeros(len(quads), dtype=np.int32)
    paint(
        image,
        PLAIN,
        quads,
        np.stack([white, white, white, none, none], axis=-1),
        np.arange(len(quads), dtype=np.int32),
        shape=shape,
    )
    return np.round(image[..., 0] / 255.0 * 4) / 4


def turned(points: np.ndarray, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, s], [-s, c]])


@pytest.mark.parametrize("angle", [0.0, 0.1, 0.5, 0.9, 1.4, 2.2])
def test_area_of_a_quadrilateral(angle: float) -> None:
    square = np.array([[-60.0, -40.0], [60.0, -40.0], [60.0, 40.0], [-60.0, 40.0]])
    quad = turned(square, angle) + np.array([150.3, 100.2])
    assert painted(quad[None]).sum() == pytest.approx(120 * 80, rel=2e-3)


@pytest.mark.parametrize(
    ("impactor", "exact"),
    [
        (FlatBlock(width=0.5, height=0.4), 0.5 * 0.4),
        (FlatBlock(width=0.5, height=0.4, rotation_deg=30), 0.5 * 0.4),
        (Cylinder(radius=0.3), np.pi * 0.3**2),
        (Wedge(shank_width=0.5, height=0.6), 0.5 * 0.35 + 0.5 * 0.5 * 0.25),
        (IShape(width=0.4, height=0.5, flange=0.1, web=0.08), 2 * 0.4 * 0.1 + 0.3 * 0.08),
        (
            IShape(width=0.4, height=0.5, flange=0.1, web=0.08, rotation_deg=63),
            2 * 0.4 * 0.1 + 0.3 * 0.08,
        ),
    ],
)
def test_area_of_an_impactor(impactor, exact: float) -> None:
    image = painted(np.zeros((1, 4, 2)), 200 * impactor.outline() + [150.0, 20.0])
    seen = (image > 0).sum()  # its own colours: count pixels, partly covered ones too
    edge = 200 * np.linalg.norm(np.diff(impactor.outline(), axis=0, append=impactor.outline()[:1]))
    assert seen == pytest.approx(200**2 * exact, abs=2.5 * edge + 1)


def test_cells_that_share_corners_leave_no_hole_and_draw_no_sample_twice() -> None:
    """Every sample within a torn-up but closed lattice is covered once, whatever the order."""
    rng = np.random.default_rng(5)
    x, y = np.meshgrid(np.linspace(20, 280, 27), np.linspace(20, 180, 17), indexing="ij")
    nodes = np.stack([x, y], axis=-1)
    nodes[1:-1, 1:-1] += rng.uniform(-2.5, 2.5, (25, 15, 2))
    quads = np.stack([nodes[:-1, :-1], nodes[1:, :-1], nodes[1:, 1:], nodes[:-1, 1:]], axis=2)
    quads = quads.reshape(-1, 4, 2)
    whole = painted(quads)
    assert np.all(whole[20:180, 20:280] == 1.0)
    assert whole.sum() == 260 * 160
    single = sum(painted(quads[k::7]).sum() for k in range(7))
    assert single == pytest.approx(260 * 160, abs=1e-9)


def test_a_pixel_counts_the_samples_whose_middles_lie_in_a_shape() -> None:
    """Rectangles that begin and end at any sample, of one sample and more, also at the rims."""
    rng = np.random.default_rng(8)
    middles_x, middles_y = np.arange(600) / 2 + 0.25, 200 - (np.arange(400) / 2 + 0.25)
    for _ in range(40):
        left, low = rng.uniform(-4, 298), rng.uniform(-4, 198)
        right, high = left + rng.choice([0.5, 1.0, 1.7, 40]), low + rng.choice([0.5, 1.2, 30])
        quad = np.array([[left, low], [right, low], [right, high], [left, high]])
        across = (middles_x >= left) & (middles_x < right)
        up = (middles_y >= low) & (middles_y < high)
        covered = np.outer(up, across).reshape(200, 2, 300, 2).mean(axis=(1, 3))
        np.testing.assert_array_equal(painted(quad[None]), covered)


def view_of(scene: Scene) -> View:
    """The block's middle on the middle of a picture of 640 x 360 pixels."""
    return fit(window(scene), Box(0, 0, 640, 360))


def field_of(snapshot, scene, look: Look | None = None) -> np.ndarray:
    """Only block and impactor on white, in that view."""
    image = annotate.blank(640, 360, LIGHT.field)
    raster.draw(image, snapshot, scene, view_of(scene), look=look)
    return image


@pytest.mark.parametrize("state", [intact, dented, split])
@pytest.mark.parametrize("impactor", [FlatBlock(), Cylinder(), Wedge()])
def test_a_symmetric_state_gives_a_symmetric_picture(state, impactor) -> None:
    scene = scene_of(impactor=impactor)
    image = field_of(state(scene), scene)
    np.testing.assert_array_equal(image, image[:, ::-1])


def test_the_frame_around_a_symmetric_state_is_symmetric_too() -> None:
    scene = scene_of()
    image = raster.frame(dented(scene), scene)
    field = image[62:702, 18:1030]
    np.testing.assert_array_equal(field, field[:, ::-1])


def test_each_node_has_the_colour_of_its_worst_strain() -> None:
    scene = scene_of(10, 5)
    e_min_a, e_min_b = np.zeros((9, 5)), np.zeros((10, 4))
    e_min_a[3, 2], e_min_b[7, 1] = -0.4, -0.95
    snapshot = snapshot_of(scene, reference(scene), e_min_a=e_min_a, e_min_b=e_min_b)
    view = view_of(scene)
    image = field_of(snapshot, scene)
    table = shades("heat")
    expected = {(0, 0): 0, (3, 2): 107, (4, 2): 107, (7, 1): 255, (7, 2): 255, (5, 2): 0}
    for (i, j), level in expected.items():
        assert colour_at(image, view, *snapshot.position[i, j]) == tuple(table[level])


@pytest.mark.parametrize(("name", "lightest"), [("heat", 230), ("cool", 200)])
def test_the_colours_grow_steadily_darker(name: str, lightest: float) -> None:
    luminance = shades(name).astype(float) @ [0.2126, 0.7152, 0.0722]
    assert np.all(np.diff(luminance) < 0.5)
    assert luminance[0] > lightest
    assert luminance[-1] < 40


def test_a_crack_shows_the_background_and_whole_foam_does_not() -> None:
    scene = alone()
    view = view_of(scene)
    row = int(view.y_zero - view.scale * 0.8 * scene.block.height)
    middle = slice(316, 324)
    opened = field_of(split(scene, 0.1), scene)[row, middle]
    closed = field_of(intact(scene), scene)[row, middle]
    assert np.all(opened == 255)
    assert not np.any(np.all(closed == 255, axis=-1))


@pytest.mark.parametrize("columns", [160, 400, 2000])
def test_outlines_and_closed_cracks_of_tiny_cells_are_unbroken_lines(columns: int) -> None:
    scene = alone(columns, columns // 2)
    view = view_of(scene)
    image = field_of(split(scene, 0.0), scene, look=Look(grid=False))
    top = int(view.y_zero - view.scale * scene.block.height) + 3
    rows = slice(top, int(view.y_zero) - 3)
    dark = image[rows].max(axis=-1) < 128
    for x in (-scene.block.width / 2, 0.0, scene.block.width / 2):
        column = round(view.x_zero + view.scale * x)
        assert dark[:, column - 2 : column + 2].any(axis=1).all()
    assert dark.any(axis=0).sum() <= 3 * 3  # three lines, and nothing but lines


def test_loose_tiny_cells_show_their_colour() -> None:
    scene = alone(200, 100)
    image = field_of(shattered(scene), scene)
    middle = image[200:300, 250:390].reshape(-1, 3)
    assert not np.any(np.all(middle == LIGHT.crack, axis=-1))


def test_tiny_cells_have_the_grid_of_many_of_them_symmetric_and_deformed_with_them() -> None:
    scene = scene_of(400, 200)
    flat = field_of(intact(scene), scene, look=Look(grid=True))
    np.testing.assert_array_equal(flat, flat[:, ::-1])
    bare = field_of(intact(scene), scene, look=Look(grid=False))
    lines = np.any(flat != bare, axis=-1)
    # 16 px apart or a little more: every 20 cells of 1 px
    view = view_of(scene)
    row = int(view.y_zero - view.scale * 0.0505)
    edges = np.flatnonzero(np.diff(lines[row].astype(int)) == 1)
    np.testing.assert_allclose(np.diff(edges), 20 * view.scale * scene.block.dx, atol=1)


@pytest.mark.parametrize("theme", THEMES)
def test_a_frame_without_words_is_all_field(theme: str) -> None:
    scene = scene_of()
    tones = THEMES[theme]
    image = raster.frame(intact(scene), scene, (640, 320), look=Look(theme=theme, words=False))
    assert not np.any(np.all(image == tones.page, axis=-1))
    assert np.mean(np.all(image == tones.field, axis=-1)) > 0.2


def test_a_note_stands_at_the_right_of_the_title_and_nowhere_else() -> None:
    scene = scene_of()
    plain = raster.frame(intact(scene), scene)
    noted = raster.frame(intact(scene), scene, note="paused")
    rows, columns = np.nonzero(np.any(plain != noted, axis=-1))
    assert rows.max() < 62
    assert columns.min() > 1100
    assert columns.max() < 1263


def test_the_impactor_is_drawn_on_top_of_the_cells() -> None:
    scene = scene_of()
    view = view_of(scene)
    image = field_of(intact(scene), scene)
    y = scene.contact_height + scene.block.dy / 4  # within the top cells' outer half
    assert colour_at(image, view, 0.0, y + 1 / view.scale) == LIGHT.steel


def test_a_support_is_drawn_in_place_of_the_floor() -> None:
    """Ribs and gaps below y = 0 where they are, and the window holds them."""
    ribs = Support(kind="ribs", pitch=0.05, width=0.02, depth=0.02)
    scene = scene_of(base=Base(kind="floor"), support=ribs)
    assert window(scene).y_min < -0.02
    image = raster.frame(intact(scene), scene, (1280, 720))
    view = fit(window(scene), raster.Layout((1280, 720)).field)
    tones = Look.of(scene).tones
    for x in (-0.05, 0.0, 0.05):
        assert colour_at(image, view, x, -0.01) == tones.frame
        assert colour_at(image, view, x + 0.025, -0.01) == tones.field
        assert colour_at(image, view, x + 0.025, -0.025) == tones.frame


def test_nothing_is_drawn_outside_the_field() -> None:
    scene = scene_of()
    pages = [raster.frame(s, scene) for s in (intact(scene), shattered(scene))]
    changed = np.any(pages[0] != pages[1], axis=-1)
    changed[62:702, 18:1030] = False
    rows, columns = np.nonzero(changed)
    assert columns.min() > 1030  # only the two numbers beside it
    assert rows.max() < 280


def test_the_same_picture_again() -> None:
    scene = scene_of()
    first = raster.frame(shattered(scene), scene)
    raster.frame(dented(scene), scene)
    np.testing.assert_array_equal(raster.frame(shattered(scene), scene), first)


@pytest.mark.parametrize("columns", [40, 200])
def test_an_instant_drawn_at_several_sizes_looks_as_drawn_for_each(columns: int) -> None:
    scene = scene_of(columns, columns // 2)
    snapshot = shattered(scene)
    shown = raster.Shown.of(snapshot, scene)
    for size in ((640, 360), (320, 180), (640, 360)):
        fresh = raster.frame(snapshot, scene, size)
        np.testing.assert_array_equal(raster.frame(snapshot, scene, size, shown=shown), fresh)


def digest() -> str:
    """Of two pictures, with few cells and with many."""
    states = [(dented, scene_of()), (shattered, scene_of(100, 50))]
    pictures = [raster.frame(state(scene), scene).tobytes() for state, scene in states]
    return hashlib.sha256(b"".join(pictures)).hexdigest()


_DIGEST = """
import sys
sys.path.insert(0, sys.argv[2])
from test_raster import digest, runtime
runtime.start(threads=int(sys.argv[1]))
print(digest())
"""


def test_any_number_of_threads_gives_the_same_picture() -> None:
    own = str(runtime.settings()["threads"])
    for threads in {"1", "2", "3"} - {own}:
        command = [sys.executable, "-c", _DIGEST, threads, str(Path(__file__).parent)]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        assert done.stdout.strip() == digest()


@pytest.mark.parametrize("size", [(64, 64), (161, 121), (640, 360), (720, 1280), (1920, 1080)])
def test_frames_of_any_size(size: tuple[int, int]) -> None:
    scene = scene_of()
    image = raster.frame(dented(scene), scene, size)
    assert image.shape == (size[1], size[0], 3)
    assert image.dtype == np.uint8
    assert np.all(image == LIGHT.steel, axis=-1).sum() > 0.01 * size[0] * size[1]


def test_a_frame_too_small_is_refused() -> None:
    scene = scene_of()
    with pytest.raises(UserError, match="at least 64 x 64"):
        raster.frame(intact(scene), scene, (63, 100))


def test_the_window_holds_block_floor_and_room_for_the_impactor() -> None:
    seen = window(scene_of())
    assert seen.x_min == pytest.approx(-0.125)
    assert seen.x_max == pytest.approx(0.125)
    assert seen.y_min < 0
    assert seen.y_max == pytest.approx(0.16)


@pytest.mark.parametrize(
    ("guided", "angle"), [(True, 30.0), (True, 45.0), (False, 0.0), (False, 30.0)]
)
def test_the_window_holds_a_tilted_product_at_all_instants(guided: bool, angle: float) -> None:
    """One three times as high as its cushion, as it starts, turns, slides off and rebounds."""
    product = FlatBlock(width=0.2, height=0.3, rotation_deg=angle, guided=guided)
    scene = scene_of(impactor=product)
    states = [
        replace(intact(scene), impactor_y=scene.contact_height + up, **moved)
        for up, moved in (
            (0.0, {}),
            (0.1, {}),
            (0.02, {} if guided else {"impactor_angle": 0.8, "impactor_shift": 0.2}),
            (-0.04, {} if guided else {"impactor_angle": -1.5, "impactor_shift": -0.3}),
        )
    ]
    for seen in (window(scene, states), window(scene, states, side=0.14, above=0.42)):
        for state in states:
            body = impactor_now(state, scene)
            assert body is not None
            (left, low), (right, high) = body.min(axis=0), body.max(axis=0)
            assert seen.x_min < left < right < seen.x_max
            assert seen.y_min < low < high < seen.y_max
    live = window(scene)  # which knows of no instant to come
    body = impactor_now(states[0], scene)
    assert body is not None
    assert live.y_max > body[:, 1].max()


def test_the_window_shows_a_platen_to_its_ends_and_a_tilted_block_to_its_corners() -> None:
    platen = window(scene_of(impactor=FlatBlock(width=0.3)))
    assert platen.x_min < -0.15
    c, s = np.cos(0.5), np.sin(0.5)
    seen = window(alone(start=Start(deformation_gradient=((c, -s), (s, c)))))
    corner = np.array([0.0, 0.0025]) + np.array([[c, -s], [s, c]]) @ [0.1, 0.0975]
    assert seen.x_max > corner[0]
    assert seen.y_max > corner[1]


@pytest.mark.parametrize("box", [Box(0, 0, 200, 100), Box(10, 20, 110, 420)])
def test_a_view_shows_its_whole_window_at_one_scale(box: Box) -> None:
    world = Window(-0.2, 0.3, -0.1, 0.5)
    view = fit(world, box)
    left, right = (view.x_zero + view.scale * x for x in (world.x_min, world.x_max))
    top, bottom = (view.y_zero - view.scale * y for y in (world.y_max, world.y_min))
    assert left >= box.left - 1e-9
    assert right <= box.right + 1e-9
    assert top >= box.top - 1e-9
    assert bottom <= box.bottom + 1e-9
    assert left + right == pytest.approx(box.left + box.right)


@pytest.mark.parametrize(
    ("longest", "length", "text"),
    [(0.047, 0.02, "2 cm"), (0.05, 0.05, "5 cm"), (0.0012, 0.001, "1 mm"), (3.0, 2.0, "2 m")],
)
def test_scale_bars_have_round_lengths(longest: float, length: float, text: str) -> None:
    assert annotate.round_length(longest) == pytest.approx(length)
    assert annotate.length_text(annotate.round_length(longest)) == text


@pytest.mark.usefixtures("words_alone")
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("size", [(512, 288), (512, 512), (640, 288), (480, 270), (1280, 720)])
def test_no_word_of_a_frame_overlaps_or_is_cut(mode: str, size: tuple, written: list) -> None:
    """Words that are drawn are whole, whatever the size; those of the smallest can be read."""
    scene = scene_of()
    time = np.linspace(0, 0.0125, 50)
    curve = inset.Curve(time, 6e3 * time, 0.0125, 120.0)
    image = raster.frame(
        dented(scene), scene, size, look=Look(mode), note="paused", curve=curve, title="a title"
    )
    if size < raster.SMALLEST_WITH_TEXT:
        assert written == []
        return
    check_words(written)
    field = raster.Layout(size).field
    for picture, text, box in written:
        assert box[3] - box[1] >= 3, text
        if picture.shape == image.shape:
            assert not meet(box, (field.left, field.top, field.right, field.bottom)), text


@pytest.mark.parametrize(
    ("interval", "texts"),
    [
        (1e-3, ["0.0 ms", "1.0 ms", "2.0 ms"]),
        (5e-4, ["0.0 ms", "0.5 ms", "1.0 ms"]),
        (2.5e-4, ["0.00 ms", "0.25 ms", "0.50 ms"]),
        (1e-4, ["0.0 ms", "0.1 ms", "0.2 ms"]),
        (2.5e-5, ["0.000 ms", "0.025 ms", "0.050 ms"]),
        (1e-3 / 30, ["0.00 ms", "0.03 ms", "0.07 ms"]),
        (1e-6, ["0.000 ms", "0.001 ms", "0.002 ms"]),
    ],
)
def test_no_two_instants_of_a_run_read_the_same(interval: float, texts: list[str]) -> None:
    assert [annotate.time_text(k * interval, interval) for k in range(3)] == texts
    assert len({annotate.time_text(k * interval, interval) for k in range(100)}) == 100


def test_a_frame_says_its_time_as_finely_as_its_run_goes(written: list) -> None:
    scene = scene_of(output=Output(history_interval=1e-5, snapshot_interval=2.5e-5))
    raster.frame(dented(scene, time=1.25e-4), scene)
    assert "0.125 ms" in [text for _, text, _ in written]


def test_a_long_title_is_cut_to_its_room() -> None:
    face = annotate.font(20)
    cut = annotate.shortened("a very long title indeed", face, 120)
    assert cut.endswith("…")
    assert face.getlength(cut) <= 120
    assert annotate.shortened("short", face, 120) == "short"
