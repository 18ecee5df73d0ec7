"""Two runs side by side: each on its side, on one scale and key, and no word over another."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from picture_states import dented, intact, scene_of, split

from taichi_foam import load_scene
from taichi_foam.errors import UserError
from taichi_foam.picture import annotate, comparison, inset, raster
from taichi_foam.picture.comparison import Pair, told_apart
from taichi_foam.picture.look import Look
from taichi_foam.picture.modes import MODES
from taichi_foam.result import HISTORY_COLUMNS, Result, Snapshot
from taichi_foam.scene import Block, FlatBlock, Scene, Wedge

SIZE = (1280, 720)


def result_of(scene: Scene, snapshots: list[Snapshot], top: float = 70.0) -> Result:
    """A run with these snapshots whose deceleration rises to `top` [m/s2] at its end."""
    time = np.linspace(0, snapshots[-1].time if snapshots else 0.01, 200)
    history = dict.fromkeys(HISTORY_COLUMNS, np.zeros_like(time))
    history |= {"time_s": time, "deceleration_smoothed_m_s2": top * time / (time[-1] or 1.0)}
    return Result(scene, history, snapshots, {})


def dent(name: str = "dent", count: int = 21, **parts: object) -> Result:
    """A flat block that sinks 2 mm every millisecond."""
    scene = scene_of(20, 10, **parts).model_copy(update={"name": name})
    return result_of(scene, [dented(scene, 0.002 * k, time=1e-3 * k) for k in range(count)])


def cut(name: str = "cut", count: int = 31) -> Result:
    """A block whose halves lean outwards more and more."""
    scene = scene_of(20, 10).model_copy(update={"name": name})
    return result_of(scene, [split(scene, 0.004 * k, time=1e-3 * k) for k in range(count)], 40.0)


def layout_of(pair: Pair, image: np.ndarray) -> comparison._Layout:
    """Where the parts of a frame lie."""
    world = pair.window
    shape = (world.y_max - world.y_min) / (world.x_max - world.x_min)
    return comparison._Layout((image.shape[1], image.shape[0]), True, shape)


def halves(image: np.ndarray, pair: Pair) -> list[np.ndarray]:
    """The two fields of a frame."""
    fields = layout_of(pair, image).fields
    return [image[box.top : box.bottom, box.left : box.right] for box in fields]


def differing(one: np.ndarray, other: np.ndarray) -> float:
    """Share of pixels that differ by more than the rounding of a line's place."""
    return float(np.mean(np.any(np.abs(one.astype(int) - other) > 8, axis=-1)))


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_when_the_runs_change_places_the_halves_do(theme: str) -> None:
    a, b = dent(), cut()
    one, other = Pair.of(a, b), Pair.of(b, a)
    look = Look(theme=theme)
    left, right = halves(comparison.frame(one, 0.015, SIZE, look=look), one)
    left_2, right_2 = halves(comparison.frame(other, 0.015, SIZE, look=look), other)
    assert differing(left, right_2) < 2e-3
    assert differing(right, left_2) < 2e-3
    assert differing(left, right) > 0.02


def test_a_half_is_what_the_renderer_draws_of_that_run() -> None:
    pair = Pair.of(dent(), cut())
    image = comparison.frame(pair, 0.012, SIZE)
    shape = image.shape[:2]
    for box, run in zip(layout_of(pair, image).fields, pair.runs, strict=True):
        alone = annotate.blank(shape[1], shape[0])
        view = raster.fit(pair.window, box)
        annotate.field(alone, view, 1.0)
        raster.draw(alone, run.snapshots[12], run.scene, view, 1.0)
        part = (slice(box.top, box.bottom), slice(box.left, box.right))
        np.testing.assert_array_equal(image[part], alone[part])


def test_a_run_that_has_ended_stays_as_it_ended() -> None:
    pair = Pair.of(dent(count=11), cut(count=31))
    assert pair.times == pytest.approx([1e-3 * k for k in range(31)])
    last = halves(comparison.frame(pair, 0.010, SIZE), pair)
    later = halves(comparison.frame(pair, 0.025, SIZE), pair)
    np.testing.assert_array_equal(last[0], later[0])
    assert differing(last[1], later[1]) > 0.005
    assert comparison.at(pair.a.snapshots, 0.025) is pair.a.snapshots[-1]


def test_the_clock_is_that_of_the_finer_run_and_goes_on_to_the_end_of_the_longer() -> None:
    coarse = dent(count=31)
    fine = cut(count=11)
    output = fine.scene.output.model_copy(update={"snapshot_interval": 5e-4})
    half = [replace(s, time=s.time / 2) for s in fine.snapshots]
    fine = replace(fine, scene=fine.scene.model_copy(update={"output": output}), snapshots=half)
    pair = Pair.of(coarse, fine)
    expected = [5e-4 * k for k in range(11)] + [1e-3 * k for k in range(6, 31)]
    assert pair.times == pytest.approx(expected)
    assert comparison.at(coarse.snapshots, 0.0025).time == pytest.approx(0.002)
    assert comparison.at(coarse.snapshots, -1.0) is coarse.snapshots[0]


def test_both_halves_have_one_scale_though_the_blocks_differ() -> None:
    small = Scene(name="small", block=Block(width=0.1, height=0.05, columns=20, rows=10),
                  impactor=FlatBlock(width=0.03))  # fmt: skip
    pair = Pair.of(dent(), result_of(small, [intact(small)]))
    image = comparison.frame(pair, 0.0, SIZE)
    wide = [np.ptp(np.flatnonzero(_foam(half).any(axis=0))) for half in halves(image, pair)]
    assert wide[0] / wide[1] == pytest.approx(2.0, rel=0.02)
    feet = [np.flatnonzero(_foam(half).any(axis=1)).max() for half in halves(image, pair)]
    assert abs(feet[0] - feet[1]) <= 1


def _foam(image: np.ndarray) -> np.ndarray:
    """Pixels in the colour of unloaded foam: much less blue than red."""
    return image[..., 0].astype(int) - image[..., 2] > 40


def test_a_colour_means_one_figure_on_both_sides() -> None:
    """The key goes to the larger top, whichever side that is on."""
    slow, fast = (dent(str(v), impactor=FlatBlock(velocity=v)) for v in (2.0, 5.0))
    for pair in (Pair.of(slow, fast), Pair.of(fast, slow)):
        assert pair.key(Look("speed")).top == pytest.approx(5.0)
    same = Pair.of(slow, fast)
    assert same.key(Look("strain")) == MODES["strain"].key(slow.scene)


def test_both_curves_grow_on_one_pair_of_axes() -> None:
    pair = Pair.of(dent(count=21), cut(count=31))
    first, second = pair.curves
    assert (first.name, second.name) == ("dent", "cut")
    assert first.last == second.last == pytest.approx(0.03)
    assert (first.second, second.second) == (False, True)
    tones = Look().tones
    image = comparison.frame(pair, 0.020, SIZE)
    strip = image[layout_of(pair, image).strip.top :, :640]
    for tone in (tones.curve, tones.other_curve):
        assert np.all(strip == tone, axis=-1).sum() > 200
    before, now, later = (
        np.all(comparison.frame(pair, t, SIZE) == tones.other_curve, axis=-1).sum()
        for t in (0.010, 0.020, 0.030)
    )
    assert before < now < later


class TestNames:
    def test_are_those_of_the_scenes(self) -> None:
        pair = Pair.of(dent("one"), cut("two"), ("runs/a", "runs/b"))
        assert (pair.names, pair.shared) == (("one", "two"), "")

    def test_are_those_of_the_choice_sets(self) -> None:
        scenes = [load_scene("paper/wedge-2.86", s) for s in ("calibrated", "paper-literal")]
        assert told_apart(*scenes) == ("calibrated", "paper-literal")

    @pytest.mark.parametrize(
        ("settings", "expected"),
        [
            (["model.damping=absolute"], ("model.damping = stiffness", "model.damping = absolute")),
            (
                ["impactor.velocity=3"],
                ("impactor.velocity = 2.86 m/s", "impactor.velocity = 3 m/s"),
            ),
            (
                ["impactor.shape=cylinder"],
                ("impactor.shape = wedge", "impactor.shape = cylinder"),
            ),
            (["model.self_contact=false", "block.rows=40"],
             ("block.rows = 20, model.self_contact = true",
              "block.rows = 40, model.self_contact = false")),
            (["output.mode=stress"], None),
            (["block.rows=40", "block.columns=80", "foam.rate=none"], None),
        ],
    )  # fmt: skip
    def test_are_what_differs(self, settings: list[str], expected: tuple | None) -> None:
        a = load_scene("paper/wedge-2.86")
        assert told_apart(a, load_scene(a, overrides=settings)) == expected

    def test_are_the_folders_where_nothing_else_helps(self) -> None:
        one = dent()
        pair = Pair.of(one, one, ("runs/a", "runs/b"))
        assert (pair.names, pair.shared) == (("runs/a", "runs/b"), "dent")


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch) -> Iterator[list]:
    """(picture, words, box) of every text that is written."""
    texts: list[tuple[np.ndarray, str, tuple[float, float, float, float]]] = []
    write = annotate.write

    def record(image, xy, string, face, *, anchor="ls", colour=(0, 0, 0)) -> None:
        left, top, right, bottom = face.getbbox(string, anchor=anchor)
        x, y = round(xy[0]), round(xy[1])
        texts.append((image, string, (x + left, y + top, x + right, y + bottom)))
        write(image, xy, string, face, anchor=anchor, colour=colour)

    monkeypatch.setattr(annotate, "write", record)
    inset._panel.cache_clear()
    yield texts
    inset._panel.cache_clear()


LONG = "a name that somebody has made rather longer than anybody needs it to be"


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("size", [(1280, 720), (1920, 1080), (640, 360), (720, 1280)])
def test_no_word_of_a_frame_overlaps_or_is_cut(mode: str, size, written: list) -> None:
    pair = Pair.of(dent(LONG, count=11), cut("b" + LONG))
    image = comparison.frame(pair, 0.025, size, look=Look(mode, "dark"))
    check_words(written)
    assert {"displacement ", "ended at 10.0 ms", "25.0 ms", "2.00 cm"} <= {t for _, t, _ in written}
    fields = [(b.left, b.top, b.right, b.bottom) for b in layout_of(pair, image).fields]
    for picture, text, box in written:
        if picture.shape == image.shape:
            assert not any(_meet(box, field) for field in fields), text


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("width", [640, 1800])
def test_no_word_of_a_montage_overlaps_or_is_cut(mode: str, width: int, written: list) -> None:
    comparison.instants(Pair.of(dent(LONG), cut("cut")), width=width, look=Look(mode))
    check_words(written)


def check_words(written: list) -> None:
    assert len(written) > 10
    for (first, a, box_a), (second, b, box_b) in itertools.combinations(written, 2):
        assert first is not second or not _meet(box_a, box_b), f"{a!r} over {b!r}"
    for picture, text, (left, top, right, bottom) in written:
        height, width = picture.shape[:2]
        assert left >= 0, text
        assert top >= 0, text
        assert right <= width, text
        assert bottom <= height, text


def _meet(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def test_a_montage_has_the_first_run_above_at_the_same_instants(written: list) -> None:
    pair = Pair.of(dent(count=11), cut(count=31))
    image = comparison.instants(pair, n=4, width=1000)
    assert image.shape[1:] == (1000, 3)
    assert image.shape[0] % 2 == 0
    times = [text for _, text, _ in written if text.endswith(" ms")]
    assert times == ["0.0 ms", "10.0 ms", "10.0 ms", "10.0 ms",
                     "0.0 ms", "10.0 ms", "20.0 ms", "30.0 ms"]  # fmt: skip
    high = {text: box[1] for _, text, box in written}
    assert high["dent"] < high["cut"]


def test_small_frames_have_fields_only(written: list) -> None:
    pair = Pair.of(dent(), cut())
    assert comparison.frame(pair, 0.01, (638, 360)).shape == (360, 638, 3)
    assert comparison.frame(pair, 0.01, (64, 64)).shape == (64, 64, 3)
    assert written == []


def test_runs_without_impactor_have_no_curves(written: list) -> None:
    scene = load_scene("gallery/shear-patch")
    start = result_of(scene, [intact(scene)])
    pair = Pair.of(start, dent())
    assert [curve.name for curve in pair.curves] == ["dent"]
    comparison.frame(pair, 0.01)
    assert [text for _, text, _ in written].count("displacement ") == 1


def test_what_cannot_be_is_refused() -> None:
    pair = Pair.of(dent(), cut())
    with pytest.raises(UserError, match="at least 64 x 64"):
        comparison.frame(pair, 0.01, (63, 64))
    with pytest.raises(UserError, match="n = 0; must be at least 1"):
        comparison.instants(pair, n=0)
    with pytest.raises(UserError, match="width = 639 pixels; must be at least 640"):
        comparison.instants(pair, width=639)
    scene = Scene(impactor=Wedge())
    with pytest.raises(UserError, match="empty: the run has no snapshots"):
        Pair(dent(), result_of(scene, []), ("dent", "empty"))
