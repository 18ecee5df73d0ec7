"""How long a frame takes, and what a live view costs the run: `python benchmarks/frames.py`.

Frames are those of the wedge at 2.86 m/s after 20 ms, on its own 800 cells and on cells cut into
many smaller ones, so that all show the same picture. Beside them stands Matplotlib, which fills
the same cells as polygons at 720p. Films are those of its whole run, the processor's time that of
this process and of the encoders. The view's cost is that of a whole run in the live view's
process as fast as it goes, watched at 30 frames a second over unwatched; rounds alternate.
The tables go to standard output and to results/frames.md. `--quick` takes fewer of all, `--smoke`
a few of each, to see whether they run, not how fast; both write nothing.
"""

import argparse
import math
import os
import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from peers import scene_with, updated
from timing.engine import settings, start_taichi
from timing.table import Table, write
from timing.workers import compile_thoroughly

from taichi_foam.analysis import cell_shapes
from taichi_foam.live.messages import Frame
from taichi_foam.live.screen import FPS, Screen
from taichi_foam.live.session import Session
from taichi_foam.picture import films, raster
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Scene
from taichi_foam.simulation.simulate import run, simulate

CASE = "paper/wedge-2.86"
SIZES = {"720p": (1280, 720), "1080p": (1920, 1080)}
RESULTS = Path(__file__).parent / "results" / "frames.md"


@dataclass(frozen=True)
class Mode:
    """How much is measured."""

    time: float = 0.020  # s: crushed along the faces, a crack below the tip
    finer: tuple[int, ...] = (1, 10, 50)  # cells on a side of one of the 800: to 2,000,000 cells
    rounds: int = 15
    film_rounds: int = 5
    view_rounds: int = 7
    end: float | str = "rebound"  # of the run that is watched


MODES = {
    "full": Mode(),
    "quick": Mode(rounds=3, film_rounds=2, view_rounds=2),
    "smoke": Mode(time=1e-3, finer=(1, 2), rounds=1, film_rounds=1, view_rounds=1, end=2e-3),
}


def finer(snapshot: Snapshot, scene: Scene, times: int) -> tuple[Snapshot, Scene]:
    """The same picture with each cell cut into `times` by `times`; cracks stay where they are."""
    block = scene.block
    counts = {"columns": times * block.columns, "rows": times * block.rows}
    fine = updated(scene, {"block": counts})

    def cut(values: np.ndarray) -> np.ndarray:
        return np.repeat(np.repeat(values, times, axis=0), times, axis=1)

    shift = snapshot.position - block.positions
    broken_a, broken_b = (
        np.full(shape, math.nan)
        for shape in ((counts["columns"] - 1, counts["rows"]),
                      (counts["columns"], counts["rows"] - 1))
    )  # fmt: skip
    broken_a[times - 1 :: times] = np.repeat(snapshot.break_time_a, times, axis=1)
    broken_b[:, times - 1 :: times] = np.repeat(snapshot.break_time_b, times, axis=0)
    return Snapshot(
        time=snapshot.time,
        impactor_y=snapshot.impactor_y,
        position=fine.block.positions + cut(shift),
        velocity=cut(snapshot.velocity),
        e_min_a=cut(np.pad(snapshot.e_min_a, ((0, 1), (0, 0)), mode="edge"))[:-1],
        e_min_b=cut(np.pad(snapshot.e_min_b, ((0, 0), (0, 1)), mode="edge"))[:, :-1],
        break_time_a=broken_a,
        break_time_b=broken_b,
        shear_set=np.zeros((fine.block.columns - 1, fine.block.rows - 1)),
    ), fine


def by_matplotlib(snapshot: Snapshot, scene: Scene) -> None:
    """Fill the cells and nothing else."""
    width, height = SIZES["720p"]
    figure = Figure(figsize=(width / 100, height / 100), dpi=100)
    canvas = FigureCanvasAgg(figure)
    axis = figure.add_axes((0, 0, 1, 1))
    shapes = cell_shapes.shapes_of(snapshot, scene.block)[0].reshape(-1, 4, 2)
    worst = np.zeros(shapes.shape[0])
    axis.add_collection(PolyCollection(list(shapes), array=worst, cmap=mpl.colormaps["magma_r"]))
    axis.set_xlim(-0.125, 0.125)
    axis.set_ylim(-0.01, 0.16)
    canvas.draw()


def timed(work: Callable[[], object], rounds: int) -> list[float]:
    """Wall times of `work` [s], once warm."""
    work()
    found = []
    for _ in range(rounds):
        start = time.perf_counter()
        work()
        found.append(time.perf_counter() - start)
    return found


def frames(mode: Mode) -> Table:
    many = f"{settings()['threads']} threads"
    table = Table(
        ("cells", "720p, 1 thread, ms", f"720p, {many}", "1080p, 1 thread", f"1080p, {many}",
         "Matplotlib's polygons at 720p, over 1 thread")
    )  # fmt: skip
    coarse = scene_with("calibrated", CASE, "whole")
    state = next(s for s in simulate(coarse) if s.time >= mode.time)
    for times in mode.finer:
        snapshot, scene = finer(state, coarse, times)
        found = []
        for size in SIZES.values():
            for threads in (1, None):
                draw = partial(raster.frame, snapshot, scene, size, threads=threads)
                found.append(statistics.median(timed(draw, mode.rounds)))
        ours = found[0]
        others = timed(partial(by_matplotlib, snapshot, scene), min(3, mode.rounds))
        shown = [f"{1e3 * each:.1f}" for each in found]
        cells_drawn = scene.block.columns * scene.block.rows
        table.rows.append((f"{cells_drawn:,}", *shown, f"{statistics.median(others) / ours:.1f}"))
    return table


def processor() -> float:
    """Processor time of this process and of those that it has waited for [s]."""
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system


def in_motion(mode: Mode) -> Table:
    """Films of a run of 800 nodes, each alone and both in one pass."""
    scene = updated(scene_with("calibrated", CASE, "whole"), {"numerics": {"end": mode.end}})
    reel = films.Reel.of(run(scene))
    table = Table(("film", "frames a second", "processor's time a frame, ms"))
    mp4, gif = "film.mp4", "film.gif"
    for label, names in (
        ("MP4, 720p", films.Names(mp4=mp4)),
        ("GIF, 360p", films.Names(gif=gif)),
        ("both", films.Names(mp4=mp4, gif=gif)),
    ):
        count, used, taken = reel.frames_to_draw(names), [], []
        with tempfile.TemporaryDirectory() as folder:
            reel.write(Path(folder), names=names)  # compile
            for _ in range(mode.film_rounds):
                start, before = time.perf_counter(), processor()
                reel.write(Path(folder), names=names)
                taken.append(time.perf_counter() - start)
                used.append(processor() - before)
        pace, cost = count / statistics.median(taken), statistics.median(used) / count
        table.rows.append((label, f"{pace:.0f}", f"{1e3 * cost:.1f}"))
    return table


def run_seconds(
    session: Session, scene: Scene, on_frame: Callable[[], object] | None = None
) -> float:
    """Wall time of the engine in a drop from its first to its last step [s].

    Unwatched, or with `on_frame` called for each frame.
    """
    session.drop(scene)
    while True:
        start = time.perf_counter()
        if on_frame is not None or session.ended:
            session.look()
        for event in session.poll(0.05 if on_frame is None else 0.0):
            if isinstance(event, Frame) and event.drop == session.number:
                if event.ended:
                    return event.wall
                if on_frame is not None:
                    on_frame()
        if on_frame is not None:
            time.sleep(max(0.0, 1 / FPS - (time.perf_counter() - start)))


def view(mode: Mode) -> Table:
    """A run alone, one whose frames are only taken, and one whose pictures are drawn, too."""
    scene = updated(scene_with("calibrated", CASE, "whole"), {"numerics": {"end": mode.end}})
    ratios: dict[str, list[float]] = {"frames taken": [], "frames drawn": []}
    counts: dict[str, list[float]] = {name: [] for name in ratios}
    with Session(scene, pace=None) as session:
        screen = Screen(session)
        while not session.ended:  # compile
            screen.update(0.1)
            screen.picture(SIZES["720p"])
        for _ in range(mode.view_rounds):
            alone = run_seconds(session, scene)
            for name, ratio in ratios.items():
                count = 0

                def on_frame(name: str = name) -> None:
                    nonlocal count
                    count += 1
                    if name == "frames drawn":
                        screen.picture(SIZES["720p"])

                taken = run_seconds(session, scene, on_frame)
                ratio.append(taken / alone)
                counts[name].append(count / taken)
    table = Table(
        ("800 nodes, as fast as they go", "frames a second of the run",
         "time of the run over that unwatched")
    )  # fmt: skip
    for name, ratio in ratios.items():
        spread = f"{statistics.median(ratio):.2f} ({min(ratio):.2f} to {max(ratio):.2f})"
        table.rows.append((name, f"{statistics.median(counts[name]):.0f}", spread))
    return table


def main() -> None:
    """Print the tables, and write those of a full measurement."""
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("quick", "smoke"):
        parser.add_argument(f"--{name}", dest="mode", action="store_const", const=name)
    mode = parser.parse_args().mode or "full"
    if mode != "smoke":
        compile_thoroughly()
    start_taichi()
    tables = [table(MODES[mode]).markdown() for table in (frames, in_motion, view)]
    text = "\n\n".join(tables) + "\n"
    print(text)
    if mode == "full":
        write(RESULTS, text)


if __name__ == "__main__":
    main()
