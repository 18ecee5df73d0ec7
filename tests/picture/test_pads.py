"""Pictures of blocks with outlines, holes and layers: what is not there is not drawn."""

from __future__ import annotations

import numpy as np
import pytest
from picture_states import colour_at

from taichi_foam.picture import printed
from taichi_foam.picture.look import THEMES, Look
from taichi_foam.picture.modes import MODES
from taichi_foam.picture.raster import Layout, frame
from taichi_foam.picture.view import fit, window
from taichi_foam.scene import Block, FlatBlock, Foam, Layer, Scene

SIZE = (640, 360)
CELLS = {"width": 0.12, "height": 0.06, "columns": 24, "rows": 12}
PAD = Block(
    **CELLS,
    outline=[(-0.06, 0), (0.06, 0), (0.035, 0.06), (-0.035, 0.06)],
    holes=[[(-0.015, 0.015), (0.015, 0.015), (0.0, 0.045)]],
)
LAYERED = Block(**CELLS, layers=(Layer(bottom=0.0, top=0.03, foam=Foam(youngs_modulus=4e6)),))


def scene_of(block: Block) -> Scene:
    return Scene(block=block, impactor=FlatBlock(width=0.05, velocity=3.0, gap=0.01))


def seen(image: np.ndarray, scene: Scene, x: float, y: float) -> tuple[int, ...]:
    return colour_at(image, fit(window(scene), Layout(SIZE).field), x, y)


def test_foam_is_drawn_inside_its_outline_only(make_snapshot) -> None:
    scene = scene_of(PAD)
    image = frame(make_snapshot(PAD, impactor_y=0.08), scene, SIZE, look=Look("stress", grid=False))
    field = THEMES["light"].field
    for place in ((0.055, 0.05), (-0.055, 0.05), (0.0, 0.022), (0.005, 0.02)):
        assert seen(image, scene, *place) == field, place
    foam = seen(image, scene, 0.0, 0.008)
    assert foam != field
    # along the slanted side, a millimetre and a half inside and outside of it
    for share in (0.2, 0.4, 0.6, 0.8):
        x, y = 0.06 - share * 0.025, share * 0.06
        # cells that share a side leave a trace of it in the mean of samples
        np.testing.assert_allclose(np.array(seen(image, scene, x - 0.002, y), float), foam, atol=3)
        assert seen(image, scene, x + 0.002, y) == field, share


def test_a_pad_that_is_its_mirror_image_is_drawn_so(make_snapshot) -> None:
    image = frame(make_snapshot(PAD), scene_of(PAD), (600, 400), look=Look("strain", words=False))
    np.testing.assert_array_equal(image, image[:, ::-1])


def test_a_line_runs_between_layers(make_snapshot) -> None:
    layered, plain = scene_of(LAYERED), scene_of(LAYERED.model_copy(update={"layers": ()}))
    look = Look("strain", grid=False)
    images = [frame(make_snapshot(LAYERED), s, SIZE, look=look) for s in (layered, plain)]
    differs = np.any(images[0] != images[1], axis=2)
    view = fit(window(layered), Layout(SIZE).field)
    rows, columns = np.nonzero(differs)
    assert np.abs(rows - (view.y_zero - view.scale * 0.03)).max() <= 2
    assert np.ptp(columns) >= view.scale * 0.115


def test_print_shows_the_same(make_snapshot) -> None:
    figure = printed.montage([make_snapshot(PAD)], scene_of(PAD), n=1)
    cells = figure.axes[0].collections[0]
    assert len(cells.get_paths()) < PAD.columns * PAD.rows
    layers = printed.montage([make_snapshot(LAYERED)], scene_of(LAYERED), n=1)
    assert len(layers.axes[0].collections) == len(figure.axes[0].collections) + 1


@pytest.mark.parametrize("mode", MODES)
def test_whole_foam_shows_nothing_in_any_mode(make_snapshot, mode: str) -> None:
    for block in (PAD, LAYERED):
        scene = scene_of(block)
        values = MODES[mode].values(make_snapshot(block), scene)
        assert values.shape == (24, 12)
        np.testing.assert_allclose(values, 0.0, atol=1e-9 * MODES[mode].key(scene).top)


def test_the_key_holds_for_every_layer() -> None:
    """That of the foam with the largest figures."""
    key = MODES["stress"].key(scene_of(LAYERED))
    assert key.top == pytest.approx(2 * 4e6 * 0.05)
