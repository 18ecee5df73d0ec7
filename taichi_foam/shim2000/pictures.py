"""The pictures of a report: drawn into figures/, and as data embedded in the page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from taichi_foam.analysis.bands import band_of_curves
from taichi_foam.analysis.impact import impact
from taichi_foam.analysis.loads import FLAT_RISE_S, absorption_curve, rise_depth
from taichi_foam.analysis.measures import DISPLACEMENT, DURATION, SLOPE
from taichi_foam.catalogue import title
from taichi_foam.picture import figures, films, style
from taichi_foam.picture.document import data_address
from taichi_foam.picture.figures import Absorption
from taichi_foam.picture.montage import montage
from taichi_foam.records.history import FILTER
from taichi_foam.shim2000.figures import Deceleration, Whisker, branches, decelerations, errors
from taichi_foam.shim2000.impacts import TESTS, PaperTest
from taichi_foam.shim2000.study import Case, from_contact

#: Width of the report's GIFs [pixels]; they show every second frame.
GIF_WIDTH, GIF_EVERY = 480, 2
_MONTAGE_COLOURS = 192


@dataclass(frozen=True)
class Kind:
    """An impactor's shape: its name, the paper's figures of its curves and of one of its tests.

    `specimens` is the paper's description of the foam after that test, shown below the pictures.
    """

    name: str
    curves_figure: int
    montage_figure: int
    specimens: str


KINDS: Mapping[str, Kind] = {
    "rectangular": Kind(
        "Flat block", 21, 22,
        "Specimens (section 3.2): crushed only beneath the impactor, in a rectangle with a "
        "sharp boundary; height one third of the displacement; no split.",
    ),
    "cylinder": Kind(
        "Cylinder", 23, 24,
        "Specimens (section 3.3): crushed in a thin layer around the path, most of it beneath; "
        "most were split by a vertical crack down from the tip.",
    ),
    "wedge": Kind(
        "Wedge", 25, 26,
        "Specimens (section 3.4): crushed along the sides of the cavity, hardly ahead of the "
        "tip; a crack runs from the tip; small tensile cracks on top.",
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Picture:
    """A picture of the page.

    source   data URI of the whole file
    still    data URI of a still picture, for an animated one
    size     width and height [pixels]
    """

    caption: str
    alt: str
    source: str
    size: tuple[int, int]
    still: str | None = None


def short(name: str, is_test: bool = True) -> str:
    """Readable form of "paper/wedge-2.86"; marks a case that settings have changed."""
    test = TESTS[name]
    return f"{KINDS[test.kind].name} {test.velocity:.2f}{'' if is_test else ', changed'}"


def grouped(cases: Sequence[Case]) -> dict[str, list[Case]]:
    """Cases by key of `KINDS`, in its order, each group by rising velocity."""
    groups: dict[str, list[Case]] = {}
    for key in KINDS:
        group = [case for case in cases if TESTS[case.name].kind == key]
        if group:
            groups[key] = sorted(group, key=lambda case: case.velocity)
    return groups


def shown(group: Sequence[Case]) -> Case:
    """The case of a group that its montage and film show: the paper's, or else the fastest."""
    return next((case for case in group if TESTS[case.name].picture), group[-1])


def jobs(
    folder: Path, groups: Mapping[str, Sequence[Case]], with_films: bool
) -> dict[str, Callable[[], Picture]]:
    """Functions that draw the pictures into `folder`, by the picture's name.

    For each kind of impactor "<kind>-curves", "-montage", "-film" and "-ledger"; and "histories"
    (flat block), "energy" (impacts that came to rest) and "law".
    """
    found: dict[str, Callable[[], Picture]] = {}
    for key, group in groups.items():
        one = shown(group)
        found[f"{key}-curves"] = partial(_curves, folder, key, group)
        found[f"{key}-montage"] = partial(_montage, folder, key, one)
        if with_films:
            found[f"{key}-film"] = partial(_film, folder, key, one)
        found[f"{key}-ledger"] = partial(_ledger, folder, key, one)
    if "rectangular" in groups:
        found["histories"] = partial(_histories, folder, groups["rectangular"])
    stopped = {
        key: [case for case in group if impact(case.result)] for key, group in groups.items()
    }
    stopped = {key: group for key, group in stopped.items() if group}
    if stopped:
        found["energy"] = partial(_energy, folder, stopped)
    if groups:
        found["law"] = partial(_law, folder, next(iter(groups.values()))[0])
    return found


def errors_at_a_glance(
    folder: Path, panels: Mapping[str, Sequence[Whisker]], tolerance: float
) -> Picture:
    """All errors of an ensemble's medians with their bands, one panel per figure."""
    span = f"±{100 * tolerance:.0f} %"
    return _saved(
        errors(panels, tolerance),
        folder / "errors.png",
        f"Error of each median, and of 5 and 95 % of the runs; shaded: {span}. Medians beyond it "
        "are diamonds with their error. Tests with open marks were left out of the score of "
        "choices.",
        f"Dots and whiskers of errors in {', '.join(panels)} for each test, with a band of {span}.",
    )


def _curves(folder: Path, key: str, group: Sequence[Case]) -> Picture:
    kind = KINDS[key]
    what = "Median and 5–95 % band of the decelerations" if group[0].members else "Deceleration"
    return _saved(
        decelerations([_deceleration(case) for case in group], kind.name),
        folder / f"decelerations-{key}.png",
        f"{what} over time, as in Fig. {kind.curves_figure} ({FILTER} filter). Of the test, "
        "the tabled figures are marked.",
        f"{kind.name}: curves of computed deceleration over time at {_velocities(group)}, "
        "with the measured figures marked on them.",
    )


def _montage(folder: Path, key: str, case: Case) -> Picture:
    kind, head = KINDS[key], _title(case)
    path = folder / f"montage-{key}.png"
    scene, snapshots = case.result.scene, case.result.snapshots
    note = (_measured(case.test), kind.specimens) if case.test and case.test.picture else ()
    picture = Image.fromarray(montage(snapshots, scene, title=head, note=note))
    # With flat colours, a palette takes a third of the bytes without visible loss.
    picture = picture.quantize(_MONTAGE_COLOURS, dither=Image.Dither.NONE)
    picture.save(path, optimize=True)
    return _picture(
        path,
        f"{head}{_which(case)}, as in Fig. {kind.montage_figure}. Each cell has the colour of the "
        "worst compressive strain that it has met; gaps are cracks.",
        f"Eight instants of the {kind.name.lower()} sinking into the foam at "
        f"{case.velocity:.2f} m/s.",
    )


def _measured(test: PaperTest) -> str:
    """A sentence on how a test ended."""
    duration, depth = test.measured[DURATION.key], test.measured[DISPLACEMENT.key]
    own = test.simulated_duration
    words = f" (the paper's own simulation: {1e3 * own:.1f} ms)" if own else ""
    return f"Measured: at rest after {1e3 * duration:.0f} ms, {1e2 * depth:.1f} cm deep{words}."


def _film(folder: Path, key: str, case: Case) -> Picture:
    output = case.result.scene.output
    path = folder / f"film-{key}.gif"
    reel = films.Reel.of(case.result, title(case.scene))
    small = replace(reel, gif_width=GIF_WIDTH, gif_every=GIF_EVERY)
    small.write(folder, names=films.Names(gif=path.name))
    still = path.with_suffix(".png")
    with Image.open(path) as film:
        film.seek(getattr(film, "n_frames", 1) - 1)
        film.convert("RGB").quantize(64, dither=Image.Dither.NONE).save(still, optimize=True)
    slower = 1 / (output.fps * output.snapshot_interval)
    caption = f"{_title(case)}{_which(case)}, slowed down {slower:.0f} times."
    alt = f"Animation of the {KINDS[key].name.lower()} sinking into the foam."
    picture = _picture(path, caption, alt, still=_uri(still))
    still.unlink()
    return picture


def _ledger(folder: Path, key: str, case: Case) -> Picture:
    head = _title(case)
    return _saved(
        figures.energy_ledger(case.result.history),
        folder / f"energy-ledger-{key}.png",
        f"{head}{_which(case)}: where the energy is at each instant.",
        f"Stacked areas of energy by mechanism over time; {head}. Its last instant stands in the "
        "table of energies.",
    )


def _histories(folder: Path, group: Sequence[Case]) -> Picture:
    histories = {case.velocity: from_contact(case.result) for case in group}
    of_which = " of the runs nearest to the medians" if group[0].members else ""
    return _saved(
        figures.impact_histories(histories),
        folder / "histories-rectangular.png",
        f"Flat block: deceleration ({FILTER} filter), velocity and displacement{of_which}, as in "
        "Fig. 5.",
        f"Computed deceleration, velocity and displacement over time at {_velocities(group)}.",
    )


def _energy(folder: Path, groups: Mapping[str, Sequence[Case]]) -> Picture:
    absorptions, slopes = {}, {}
    for key, group in groups.items():
        name = KINDS[key].name.lower()
        absorptions[name] = [_absorption(case) for case in group]
        tests = [case.test for case in group if case.test]
        if tests:
            slopes[name] = [test.measured[SLOPE.key] for test in tests]
    return _saved(
        figures.energy_against_volume(absorptions, slopes),
        folder / "energy-volume.png",
        "Energy absorbed over volume crushed (Eqs 4-7), as in Fig. 13. The wedge of colour spans "
        "the measured slopes of Table 5.",
        "Nearly straight lines of energy absorbed over volume crushed, a panel for each impactor.",
    )


def _law(folder: Path, case: Case) -> Picture:
    return _saved(
        figures.stress_strain(branches(case.scene)),
        folder / "foam-law.png",
        "The foam's law, as in Fig. 19, evaluated by the functions that the runs call.",
        "Compressive stress over compressive strain: elastic to 5 %, a plateau to 80 %, then steep "
        "densification; unloading along the elastic slope; weak tension after crushing.",
    )


def _deceleration(case: Case) -> Deceleration:
    history = from_contact(case.result)
    start = FLAT_RISE_S
    rise = rise_depth(case.scene.impactor) if case.scene.impactor is not None else 0.0
    if rise > 0:
        depth = history["displacement_m"]
        sinking = slice(0, int(np.argmax(depth)) + 1)
        start = float(np.interp(rise, depth[sinking], history["time_s"][sinking]))
    time, deceleration, band = history["time_s"], history["deceleration_smoothed_m_s2"], None
    if case.members:
        found = band_of_curves([(member.time, member.deceleration) for member in case.members])
        time, deceleration, band = found.time, found.median, (found.low, found.high)
    measured = case.test and case.test.measured
    return Deceleration(case.velocity, time, deceleration, measured, start, band)


def _absorption(case: Case) -> Absorption:
    curve = absorption_curve(case.result)
    assert curve is not None  # only impacts that came to rest are drawn
    return Absorption(case.velocity, *curve)


def _title(case: Case) -> str:
    """A test's name at the beginning of a picture's title or of a sentence."""
    words = title(case.scene)
    return words.capitalize() if case.test else words


def _which(case: Case) -> str:
    """Words for the run of an ensemble that a picture shows."""
    return ", the run nearest to the medians" if case.members else ""


def _velocities(group: Sequence[Case]) -> str:
    *head, last = [f"{case.velocity:.2f}" for case in group]
    return f"{', '.join(head)} and {last} m/s" if head else f"{last} m/s"


def _saved(figure: Figure, path: Path, caption: str, alt: str) -> Picture:
    return _picture(style.save(figure, path)[0], caption, alt)


def _picture(path: Path, caption: str, alt: str, still: str | None = None) -> Picture:
    with Image.open(path) as picture:
        size = picture.size
    return Picture(caption, alt, _uri(path), size, still)


def _uri(path: Path) -> str:
    return data_address(f"image/{path.suffix.removeprefix('.')}", path.read_bytes())
