"""The pictures of a report: drawn into figures/, and as data that a page carries inside."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from PIL import Image

from taichi_foam import films
from taichi_foam.measures import NOSE_RISE_LIMIT_M, absorption_curve, impact
from taichi_foam.paper import MEASURED
from taichi_foam.picture import figures
from taichi_foam.picture.figures import Absorption, Deceleration
from taichi_foam.picture.montage import montage
from taichi_foam.result import Result
from taichi_foam.study import law_curve

#: Width of the report's GIFs [pixels]; they show every second frame.
GIF_WIDTH, GIF_EVERY = 480, 2
_MONTAGE_COLOURS = 192


@dataclass(frozen=True)
class Kind:
    """An impactor's shape: its name, the paper's figures of it, and the test they show."""

    name: str
    curves_figure: int
    montage_figure: int
    shown_case: str


KINDS: Mapping[str, Kind] = {
    "rectangular": Kind("Flat block", 21, 22, "paper/rectangular-3.03"),
    "cylinder": Kind("Cylinder", 23, 24, "paper/cylinder-3.32"),
    "wedge": Kind("Wedge", 25, 26, "paper/wedge-2.86"),
}


@dataclass(frozen=True)
class Plate:
    """A picture in figures/.

    source   data URI of the whole file
    still    data URI of a still picture, for an animated one
    size     width and height [pixels]
    """

    file: str
    caption: str
    alt: str
    source: str
    size: tuple[int, int]
    still: str | None = None


def grouped(results: Sequence[Result]) -> dict[str, list[Result]]:
    """Results by key of `KINDS`, in its order, each group by rising velocity."""
    groups: dict[str, list[Result]] = {}
    for key in KINDS:
        group = [r for r in results if r.scene.name.startswith(f"paper/{key}-")]
        if group:
            groups[key] = sorted(group, key=_velocity)
    return groups


def shown(key: str, group: Sequence[Result]) -> Result:
    """The run of a group that its montage and film show: the paper's, or else the fastest."""
    return next((r for r in group if r.scene.name == KINDS[key].shown_case), group[-1])


def jobs(folder: Path, groups: Mapping[str, Sequence[Result]]) -> dict[str, Callable[[], Plate]]:
    """What draws each plate into `folder`, by the plate's name.

    For each kind of impactor "<kind>-curves", "-montage", "-film" and "-ledger"; and "histories"
    (flat block), "energy" (impacts that came to rest) and "law".
    """
    found: dict[str, Callable[[], Plate]] = {}
    for key, group in groups.items():
        one = shown(key, group)
        found[f"{key}-curves"] = partial(_curves, folder, key, group)
        found[f"{key}-montage"] = partial(_montage, folder, key, one)
        found[f"{key}-film"] = partial(_film, folder, key, one)
        found[f"{key}-ledger"] = partial(_ledger, folder, key, one)
    if "rectangular" in groups:
        found["histories"] = partial(_histories, folder, groups["rectangular"])
    stopped = {key: [r for r in group if impact(r)] for key, group in groups.items()}
    stopped = {key: group for key, group in stopped.items() if group}
    if stopped:
        found["energy"] = partial(_energy, folder, stopped)
    if groups:
        found["law"] = partial(_law, folder, next(iter(groups.values()))[0])
    return found


def _curves(folder: Path, key: str, group: Sequence[Result]) -> Plate:
    kind = KINDS[key]
    figure = figures.decelerations([_deceleration(result) for result in group], kind.name)
    return _saved(
        figure,
        folder / f"decelerations-{key}.png",
        f"Deceleration over time, as in Fig. {kind.curves_figure} (CFC 180 filter). Of the test, "
        "the tabled figures are marked.",
        f"{kind.name}: curves of computed deceleration over time at {_velocities(group)}, "
        "with the measured figures marked on them.",
    )


def _montage(folder: Path, key: str, result: Result) -> Plate:
    kind, title = KINDS[key], f"{KINDS[key].name}, {_velocity(result):.2f} m/s"
    path = folder / f"montage-{key}.png"
    picture = Image.fromarray(montage(result.snapshots, result.scene, title=title))
    # Flat colours: a palette takes a third of the bytes and no eye sees it.
    picture = picture.quantize(_MONTAGE_COLOURS, dither=Image.Dither.NONE)
    picture.save(path, optimize=True)
    return _plate(
        path,
        f"{title}, as in Fig. {kind.montage_figure}. Each cell has the colour of the worst "
        "compressive strain that it has met; gaps are cracks.",
        f"Eight instants of the {kind.name.lower()} sinking into the foam at "
        f"{_velocity(result):.2f} m/s.",
    )


def _film(folder: Path, key: str, result: Result) -> Plate:
    title = f"{KINDS[key].name}, {_velocity(result):.2f} m/s"
    path = films.write_gif(result, folder / f"film-{key}.gif", GIF_WIDTH, GIF_EVERY)
    still = path.with_suffix(".png")
    with Image.open(path) as film:
        film.seek(getattr(film, "n_frames", 1) - 1)
        film.convert("RGB").quantize(64, dither=Image.Dither.NONE).save(still, optimize=True)
    slower = result.scene.output.fps * result.scene.output.snapshot_interval
    caption = f"{title}, slowed down {1 / slower:.0f} times."
    alt = f"Animation of the {KINDS[key].name.lower()} sinking into the foam."
    plate = _plate(path, caption, alt, still=_uri(still))
    still.unlink()
    return plate


def _ledger(folder: Path, key: str, result: Result) -> Plate:
    title = f"{KINDS[key].name}, {_velocity(result):.2f} m/s"
    return _saved(
        figures.energy_ledger(result.history),
        folder / f"energy-ledger-{key}.png",
        f"{title}: where the energy is at each instant.",
        f"Stacked areas of energy by mechanism over time; {title}. Its last instant stands in the "
        "table of energies.",
    )


def _histories(folder: Path, group: Sequence[Result]) -> Plate:
    histories = {_velocity(r): _from_contact(r) for r in group}
    return _saved(
        figures.impact_histories(histories),
        folder / "histories-rectangular.png",
        "Flat block: deceleration (CFC 180 filter), velocity and displacement, as in Fig. 5.",
        f"Computed deceleration, velocity and displacement over time at {_velocities(group)}.",
    )


def _energy(folder: Path, groups: Mapping[str, Sequence[Result]]) -> Plate:
    absorptions, slopes = {}, {}
    for key, group in groups.items():
        name = KINDS[key].name.lower()
        absorptions[name] = [_absorption(r) for r in group]
        slopes[name] = [MEASURED[r.scene.name].energy_per_volume_J_m3 for r in group]
    return _saved(
        figures.energy_against_volume(absorptions, slopes),
        folder / "energy-volume.png",
        "Energy absorbed over volume crushed (Eqs 4-7), as in Fig. 13. The wedge of colour spans "
        "the measured slopes of Table 5.",
        "Nearly straight lines of energy absorbed over volume crushed, a panel for each impactor.",
    )


def _law(folder: Path, result: Result) -> Plate:
    return _saved(
        figures.stress_strain(law_curve.branches(result.scene)),
        folder / "foam-law.png",
        "The foam's law, as in Fig. 19, evaluated by the functions that the runs call.",
        "Compressive stress over compressive strain: elastic to 5 %, a plateau to 80 %, then steep "
        "densification; unloading along the elastic slope; weak tension after crushing.",
    )


def _deceleration(result: Result) -> Deceleration:
    history = _from_contact(result)
    start = 3e-3
    if result.scene.impactor is not None and result.scene.impactor.nose_depth > 0:
        depth = history["displacement_m"]
        sinking = slice(0, int(np.argmax(depth)) + 1)
        time = history["time_s"][sinking]
        start = float(np.interp(NOSE_RISE_LIMIT_M, depth[sinking], time))
    return Deceleration(
        _velocity(result),
        history["time_s"],
        history["deceleration_smoothed_m_s2"],
        MEASURED.get(result.scene.name),
        start,
    )


def _absorption(result: Result) -> Absorption:
    curve = absorption_curve(result)
    assert curve is not None  # only impacts that came to rest are drawn
    return Absorption(_velocity(result), *curve)


def _from_contact(result: Result) -> dict[str, figures.Array]:
    """The history with time and displacement counted from first contact."""
    found = impact(result)
    if found is None:
        return dict(result.history)
    h = result.history
    kept = h["time_s"] >= found.contact
    shifted = {name: column[kept] for name, column in h.items()}
    shifted["time_s"] = shifted["time_s"] - found.contact
    shifted["displacement_m"] = shifted["displacement_m"] - found.depth_0
    return shifted


def _velocity(result: Result) -> float:
    assert result.scene.impactor is not None  # every test has one
    return result.scene.impactor.velocity


def _velocities(group: Sequence[Result]) -> str:
    *head, last = [f"{_velocity(r):.2f}" for r in group]
    return f"{', '.join(head)} and {last} m/s" if head else f"{last} m/s"


def _saved(figure: figures.Figure, path: Path, caption: str, alt: str) -> Plate:
    return _plate(figures.save(figure, path)[0], caption, alt)


def _plate(path: Path, caption: str, alt: str, still: str | None = None) -> Plate:
    with Image.open(path) as picture:
        size = picture.size
    return Plate(f"{path.parent.name}/{path.name}", caption, alt, _uri(path), size, still)


def _uri(path: Path) -> str:
    coded = base64.b64encode(path.read_bytes()).decode("ascii")
    return f"data:image/{path.suffix.removeprefix('.')};base64,{coded}"
