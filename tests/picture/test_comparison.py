"""Runs side by side: each in its place, on one scale and key, and no word over another."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from picture_states import dented, intact, scene_of, split
from picture_words import check_words, meet
from PIL import Image

from taichi_foam import catalogue, load_scene
from taichi_foam.errors import UserError
from taichi_foam.picture import annotate, comparison, films, raster
from taichi_foam.picture.comparison import Lineup
from taichi_foam.picture.look import Look
from taichi_foam.picture.modes import MODES
from taichi_foam.picture.naming import Caption
from taichi_foam.records.history import HISTORY_COLUMNS
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.results.result import Result
from taichi_foam.scene import Block, FlatBlock, Output, Scene, Wedge

SIZE = (1280, 720)


def shown_as(lineup: Lineup, mode: str = "worst-strain", theme: str = "light") -> Lineup:
    """The same runs with colours of another quantity, or on a page of another colour."""
    output = {"output.mode": mode, "output.theme": theme}
    runs = [replace(run, scene=run.scene.with_values(output)) for run in lineup.runs]
    return replace(lineup, runs=tuple(runs))


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


def cut(name: str = "cut", count: int = 31, **parts: object) -> Result:
    """A block whose halves lean outwards more and more."""
    scene = scene_of(20, 10, **parts).model_copy(update={"name": name})
    return result_of(scene, [split(scene, 0.004 * k, time=1e-3 * k) for k in range(count)], 40.0)


def lean(name: str = "lean", count: int = 26) -> Result:
    """A block with a dent, cut and leaning, with the impactor standing still."""
    scene = scene_of(20, 10).model_copy(update={"name": name})
    return result_of(scene, [split(scene, 0.1, time=1e-3 * k) for k in range(count)], 55.0)


def shallow(name: str = "shallow", count: int = 16) -> Result:
    """A flat block that sinks 1 mm every millisecond."""
    scene = scene_of(20, 10).model_copy(update={"name": name})
    return result_of(scene, [dented(scene, 0.001 * k, time=1e-3 * k) for k in range(count)], 30.0)


def lineup_of(count: int) -> Lineup:
    """So many different runs."""
    return Lineup.of([dent(), cut(), lean(), shallow()][:count])


def of_paper(name: str, *settings: str) -> Result:
    """A test of the paper on a coarse lattice, before anything has happened."""
    scene = load_scene(f"paper/{name}", overrides=["block.columns=20", *settings])
    return result_of(scene, [intact(scene)])


def layout_of(lineup: Lineup, image: np.ndarray) -> comparison._Layout:
    """Where the parts of a frame lie."""
    return comparison._Layout.best(lineup, (image.shape[1], image.shape[0]))


def fields_of(image: np.ndarray, lineup: Lineup) -> list[np.ndarray]:
    """The fields of a frame."""
    fields = layout_of(lineup, image).fields
    return [image[box.top : box.bottom, box.left : box.right] for box in fields]


def differing(one: np.ndarray, other: np.ndarray) -> float:
    """Share of pixels that differ by more than the rounding of a line's place."""
    return float(np.mean(np.any(np.abs(one.astype(int) - other) > 8, axis=-1)))


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("size", [SIZE, (1200, 432), (720, 1280)])
@pytest.mark.parametrize("order", [(1, 0), (1, 2, 0), (2, 0, 3, 1)])
def test_when_the_runs_change_places_the_fields_do(order: tuple, size, theme: str) -> None:
    one = shown_as(lineup_of(len(order)), theme=theme)
    other = Lineup.of([one.runs[k] for k in order])
    before = fields_of(comparison.frame(one, 0.015, size), one)
    after = fields_of(comparison.frame(other, 0.015, size), other)
    for place, k in enumerate(order):
        assert differing(after[place], before[k]) < 3e-3
        assert differing(after[place], before[place]) > 0.01


@pytest.mark.parametrize(
    ("count", "size", "grid"),
    [
        (2, (1280, 720), (2, 1)), (2, (720, 1280), (1, 2)), (2, (1200, 432), (2, 1)),
        (3, (1280, 720), (3, 1)), (3, (720, 1280), (1, 3)), (3, (1200, 432), (3, 1)),
        (4, (1280, 720), (2, 2)), (4, (720, 1280), (2, 2)), (4, (1600, 500), (4, 1)),
    ],
)  # fmt: skip
def test_fields_stand_as_the_page_has_room_for_them(count: int, size, grid) -> None:
    lineup = lineup_of(count)
    boxes = comparison._Layout.best(lineup, size).fields
    assert (len({box.left for box in boxes}), len({box.top for box in boxes})) == grid
    assert [(box.top, box.left) for box in boxes] == sorted((box.top, box.left) for box in boxes)
    assert len({(box.width, box.height) for box in boxes}) == 1


def test_four_tall_windows_stand_in_a_row() -> None:
    tall = Scene(name="tall", block=Block(width=0.1, height=0.3, columns=10, rows=30),
                 impactor=FlatBlock(width=0.03))  # fmt: skip
    run = result_of(tall, [intact(tall)])
    boxes = comparison._Layout.best(Lineup.of([run] * 4), SIZE).fields
    assert len({box.top for box in boxes}) == 1


def test_a_field_is_what_the_renderer_draws_of_that_run() -> None:
    lineup = Lineup.of([dent(), cut()])
    image = comparison.frame(lineup, 0.012, SIZE)
    shape = image.shape[:2]
    for box, run in zip(layout_of(lineup, image).fields, lineup.runs, strict=True):
        alone = annotate.blank(shape[1], shape[0])
        view = raster.fit(lineup.window, box)
        annotate.field(alone, view, 1.0)
        raster.draw(alone, run.snapshots[12], run.scene, view, 1.0)
        part = (slice(box.top, box.bottom), slice(box.left, box.right))
        np.testing.assert_array_equal(image[part], alone[part])


@pytest.mark.parametrize("count", [2, 3, 4])
def test_a_run_that_has_ended_stays_as_it_ended(count: int) -> None:
    lineup = Lineup.of([dent(count=11), cut(), cut("other"), cut("third")][:count])
    assert lineup.times == pytest.approx([1e-3 * k for k in range(31)])
    last = fields_of(comparison.frame(lineup, 0.010, SIZE), lineup)
    later = fields_of(comparison.frame(lineup, 0.025, SIZE), lineup)
    np.testing.assert_array_equal(last[0], later[0])
    for one, other in zip(last[1:], later[1:], strict=True):
        assert differing(one, other) > 0.005
    first = lineup.runs[0].snapshots
    assert comparison.at(first, 0.025) is first[-1]


def test_the_clock_is_that_of_the_finer_run_and_goes_on_to_the_end_of_the_longer() -> None:
    coarse = dent(count=31)
    fine = cut(count=11)
    output = fine.scene.output.model_copy(update={"snapshot_interval": 5e-4})
    half = [replace(s, time=s.time / 2) for s in fine.snapshots]
    fine = replace(fine, scene=fine.scene.model_copy(update={"output": output}), snapshots=half)
    lineup = Lineup.of([coarse, fine])
    expected = [5e-4 * k for k in range(11)] + [1e-3 * k for k in range(6, 31)]
    assert lineup.times == pytest.approx(expected)
    assert comparison.at(coarse.snapshots, 0.0025).time == pytest.approx(0.002)
    assert comparison.at(coarse.snapshots, -1.0) is coarse.snapshots[0]


def test_runs_of_different_steps_are_shown_at_one_instant() -> None:
    """Snapshots come with the first step after their time, and steps differ from run to run."""
    runs = [dent(), cut("b", 21)]
    late = [replace(s, time=1e-3 * k + 3e-6) for k, s in enumerate(runs[0].snapshots)]
    for order in (
        [replace(runs[0], snapshots=late), runs[1]],
        [runs[1], replace(runs[0], snapshots=late)],
    ):
        lineup = Lineup.of(order)
        assert len(lineup.times) == 21
        for k, time in enumerate(lineup.times):
            for place, run in enumerate(lineup.runs):
                assert comparison.at(run.snapshots, time) is run.snapshots[k]
                assert not lineup.has_ended(place, time)


def test_all_fields_have_one_scale_though_the_blocks_differ() -> None:
    small = Scene(name="small", impactor=FlatBlock(width=0.03), block=Block(
        width=0.1, height=0.05, columns=20, rows=10, mass_points="cells"))  # fmt: skip
    lineup = Lineup.of([dent(), result_of(small, [intact(small)])])
    image = comparison.frame(lineup, 0.0, SIZE)
    wide = [np.ptp(np.flatnonzero(_foam(field).any(axis=0))) for field in fields_of(image, lineup)]
    assert wide[0] / wide[1] == pytest.approx(2.0, rel=0.02)
    feet = [np.flatnonzero(_foam(field).any(axis=1)).max() for field in fields_of(image, lineup)]
    assert abs(feet[0] - feet[1]) <= 1


def _foam(image: np.ndarray) -> np.ndarray:
    """Pixels in the colour of unloaded foam: much less blue than red."""
    return image[..., 0].astype(int) - image[..., 2] > 40


def test_a_colour_means_one_figure_in_all_fields() -> None:
    """The key goes to the largest top, wherever that is."""
    slow, fast = (dent(str(v), impactor=FlatBlock(velocity=v)) for v in (2.0, 5.0))
    for order in ([slow, fast], [fast, slow], [slow, fast, slow]):
        assert shown_as(Lineup.of(order), "speed").key.top == pytest.approx(5.0)
    same = shown_as(Lineup.of([slow, fast]), "strain")
    assert same.key == MODES["strain"].key(slow.scene)


@pytest.mark.parametrize("count", [2, 3, 4])
def test_all_curves_grow_on_one_pair_of_axes(count: int) -> None:
    lineup = lineup_of(count)
    names = ["dent", "cut", "lean", "shallow"][:count]
    assert [curve.name for curve in lineup.curves] == names
    assert [curve.last for curve in lineup.curves] == pytest.approx([0.03] * count)
    assert [curve.place for curve in lineup.curves] == list(range(count))
    tones = Look().tones
    image = comparison.frame(lineup, 0.020, SIZE)
    box = layout_of(lineup, image).diagram
    assert box is not None
    strip = image[box.top : box.bottom, box.left : box.right]
    for tone in tones.curves[:count]:
        assert np.all(strip == tone, axis=-1).sum() > 100
    before, now, later = (
        np.all(comparison.frame(lineup, t, SIZE) == tones.curves[1], axis=-1).sum()
        for t in (0.010, 0.020, 0.030)
    )
    assert before < now < later


LONG = "a name that somebody has made rather longer than anybody needs it to be"


SIZES = [(1280, 720), (1920, 1080), (640, 360), (720, 1280), (1200, 432), (1280, 480)]


@pytest.mark.usefixtures("words_alone")
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("count", [2, 3, 4])
def test_no_word_of_a_frame_overlaps_or_is_cut(count: int, mode: str, size, written: list) -> None:
    runs = [dent(LONG, count=11), cut("b" + LONG), lean("short"), shallow("flat block, 3.03 m/s")]
    lineup = shown_as(Lineup.of(runs[:count]), mode, "dark")
    image = comparison.frame(lineup, 0.025, size)
    check_words(written)
    said = {text for _, text, _ in written}
    assert {"25.0 ms", "2.00 cm"} <= said
    assert said & {"displacement ", "moved "}
    assert said & {"ended at 10.0 ms", "ended"}
    fields = [(b.left, b.top, b.right, b.bottom) for b in layout_of(lineup, image).fields]
    for picture, text, box in written:
        if picture.shape == image.shape:
            assert not any(meet(box, field) for field in fields), text


@pytest.mark.usefixtures("words_alone")
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("width", [640, 1800])
@pytest.mark.parametrize("count", [2, 3, 4])
def test_no_word_of_a_montage_overlaps_or_is_cut(
    count: int, mode: str, width: int, written: list
) -> None:
    lineup = Lineup.of([dent(LONG), cut("cut"), lean(), shallow()][:count])
    comparison.instants(shown_as(lineup, mode), width=width)
    check_words(written)


@pytest.mark.usefixtures("words_alone")
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("count", [2, 4])
def test_times_are_as_fine_as_the_finest_run_and_clear_of_all_else(
    count: int, size: tuple, written: list
) -> None:
    fine = Output(history_interval=1e-5, snapshot_interval=2.5e-5)
    lineup = Lineup.of([dent(count=6), cut(output=fine), lean(), shallow()][:count])
    comparison.frame(lineup, 0.012125, size)
    check_words(written)
    assert "12.125 ms" in [text for _, text, _ in written]
    assert "ended at 5.000 ms" in [text for _, text, _ in written] or count == 4


def test_a_name_is_followed_by_what_else_there_is_to_say(written: list) -> None:
    """What differs is whole even where the title that all share has no room."""
    runs = [of_paper("wedge-2.86", f"impactor.gap={gap}") for gap in (0.01, 0.02, 0.03, 0.04)]
    for count, size, titles in ((2, SIZE, 2), (4, (1600, 500), 0)):
        written.clear()
        captions = [Caption("wedge, 2.86 m/s")] * count
        lineup = Lineup.of(runs[:count], captions=captions)
        comparison.frame(lineup, 0.0, size)
        said = [text for _, text, _ in written]
        assert {f"gap = 0.0{k + 1} m" for k in range(count)} <= set(said)
        assert said.count("wedge, 2.86 m/s") == titles
        check_words(written)


def test_the_titles_of_the_papers_tests_are_whole_at_the_usual_size(written: list) -> None:
    names = ("wedge-2.86", "cylinder-3.32", "rectangular-3.03", "wedge-3.60")
    for count in (2, 3, 4):
        written.clear()
        runs = [of_paper(name) for name in names[:count]]
        lineup = Lineup.of(runs, captions=[catalogue.caption(run.scene) for run in runs])
        assert lineup.names[0] == "wedge, 2.86 m/s"
        comparison.frame(lineup, 0.0, SIZE)
        assert set(lineup.names) <= {text for _, text, _ in written}


@pytest.mark.parametrize("count", [2, 3, 4])
def test_a_montage_has_a_row_for_each_run_at_the_same_instants(count: int, written: list) -> None:
    runs = [dent(count=11), cut(count=31), lean(count=21), shallow(count=31)]
    lineup = Lineup.of(runs[:count])
    image = comparison.instants(lineup, n=4, width=1000)
    assert image.shape[1:] == (1000, 3)
    assert image.shape[0] % 2 == 0
    times = [text for _, text, _ in written if re.fullmatch(r"[0-9.]+ ms", text)]
    ends = (10, 30, 20, 30)[:count]
    assert times == [f"{min(t, end):.1f} ms" for end in ends for t in (0, 10, 20, 30)]
    over = [text for _, text, _ in written if text.startswith("ended")]
    assert over == [f"ended at {end:.1f} ms" for end in ends if end < 30]
    high = {text: box[1] for _, text, box in written}
    tops = [high[name] for name in lineup.names]
    assert tops == sorted(tops)
    assert len(set(tops)) == count


def test_small_frames_have_fields_only(written: list) -> None:
    for count in (2, 3, 4):
        lineup = lineup_of(count)
        assert comparison.frame(lineup, 0.01, (638, 360)).shape == (360, 638, 3)
        assert comparison.frame(lineup, 0.01, (64, 64)).shape == (64, 64, 3)
    assert written == []


def test_runs_without_impactor_have_no_curves(written: list) -> None:
    scene = load_scene("gallery/shear-patch")
    start = result_of(scene, [intact(scene)])
    lineup = Lineup.of([start, dent()])
    assert [curve.name for curve in lineup.curves] == ["dent"]
    comparison.frame(lineup, 0.01)
    assert [text for _, text, _ in written].count("displacement ") == 1


def test_what_cannot_be_is_refused() -> None:
    lineup = Lineup.of([dent(), cut()])
    with pytest.raises(UserError, match="at least 64 x 64"):
        comparison.frame(lineup, 0.01, (63, 64))
    with pytest.raises(UserError, match="n = 0; must be at least 1"):
        comparison.instants(lineup, n=0)
    with pytest.raises(UserError, match="width = 639 pixels; must be at least 640"):
        comparison.instants(lineup, width=639)
    scene = Scene(impactor=Wedge())
    with pytest.raises(UserError, match="empty: the run has no snapshots"):
        Lineup((dent(), result_of(scene, [])), ("dent", "empty"))
    for count in (0, 1, 5):
        with pytest.raises(UserError, match=f"compare: {count} given, must be 2 to 4"):
            Lineup.of([dent()] * count)


def test_no_diagram_hides_a_tilted_product(tmp_path: Path) -> None:
    """Where it stands in a film, in steel's colour, with the diagram and without."""
    product = FlatBlock(width=0.15, height=0.25, rotation_deg=20.0, guided=False)
    plain = scene_of(20, 10, impactor=product)
    shown = []
    for curve in (False, True):
        scene = plain.with_values(
            output__curve=curve, output__width=640, output__height=360, name="tilted"
        )
        folder = tmp_path / str(curve)
        folder.mkdir()
        reel = films.Reel.of(result_of(scene, [intact(scene)]))
        reel.write(folder, names=films.Names(frames="frames"))
        with Image.open(folder / "frames" / "frame_00000.png") as picture:
            steel = np.all(np.asarray(picture) == Look().tones.steel, axis=-1)
        shown.append(int(steel.sum()))
    assert shown[0] > 1000
    assert shown[1] == pytest.approx(shown[0], rel=0.02)
