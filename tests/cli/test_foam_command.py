"""`taichi-foam foam`: what there is, what is known of it, and foam files out of tests."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command_line import COARSE_OPTIONS, assert_refused, fill_disk, tree
from matplotlib.figure import Figure

from taichi_foam.catalogue import load_scene
from taichi_foam.engine.stresses import normal_stresses
from taichi_foam.laws.bond import Curve
from taichi_foam.laws.bond.fit import crushable_fit
from taichi_foam.laws.bond.kinds.tabulated import TabulatedFoam
from taichi_foam.picture.figures import compression_test
from taichi_foam.scene.foam_file import read_foam
from taichi_foam.scene.library import listed
from taichi_foam.scene.measured import read_curve

STRAIN = np.round(np.arange(0.0, 0.881, 0.02), 3)
# elastic to 4 %, a plateau of 150 kPa that hardens, densification from 0.64
STRESS = np.where(STRAIN < 0.04, 150e3 * STRAIN / 0.04, 150e3 * (1.0 + 0.3 * (STRAIN - 0.04)))
STRESS *= np.exp(0.9 * np.maximum(STRAIN - 0.64, 0.0) / (0.97 - STRAIN))


def write(
    path: Path,
    strain: np.ndarray = STRAIN,
    stress: np.ndarray = STRESS,
    head: str = "strain,stress",
) -> None:
    lines = [head, *(f"{e!r},{s!r}" for e, s in zip(strain.tolist(), stress.tolist(), strict=True))]
    path.write_text("\n".join(line for line in lines if line) + "\n", encoding="utf-8")


@pytest.fixture
def test_file(tmp_path: Path) -> Path:
    """A test in percent and MPa, as its header says."""
    path = tmp_path / "pu.csv"
    write(path, 100.0 * STRAIN, 1e-6 * STRESS, "Strain (%),Stress [MPa]")
    return path


def test_list_has_every_foam(invoke: Callable) -> None:
    done = invoke("foam", "list")
    assert (done.exit_code, done.stderr) == (0, "")
    for name in listed():
        assert any(line.startswith(f"{name} ") for line in done.stdout.splitlines())
    assert "118 kPa" in done.stdout
    assert "rigid-pu-NN: rigid polyurethane of NN kg/m3, 20 to 100" in done.stdout
    assert "eps-NN: expanded polystyrene of NN kg/m3, 14.4 to 38.4" in done.stdout
    assert max(map(len, done.stdout.splitlines())) <= 80


def test_show_says_all_that_the_file_says(invoke: Callable) -> None:
    done = invoke("foam", "show", "shim2000-pu")
    assert (done.exit_code, done.stderr) == (0, "")
    words = " ".join(done.stdout.split())
    for fragment in (
        "the paper's", "Shim, Tu & Lim 2000", "figures as published", "25.6 kg/m3", "rise",
        "nine impacts", "youngs_modulus 2.78e6 Pa given", "yield_strain -0.0425 assumed",
        "crush_band 0.005 m assumed", "densification -80 %", "plateau 118 kPa",
        "foam.crush_band 0.005 m the paper's cells",
    ):  # fmt: skip
        assert fragment in words, fragment
    assert max(map(len, done.stdout.splitlines())) <= 80


def test_show_tells_what_is_derived_from_what_is_assumed(invoke: Callable) -> None:
    words = " ".join(invoke("foam", "show", "eps-20").stdout.split())
    for fragment in (
        "ASTM D6817", "least resistance, which most foam exceeds: 44.9 kPa at 1 %",
        "youngs_modulus 4.4922e6 Pa derived", "curve 165 points assumed",
        "foam.tensile_strain 0.02995 typical tension of its density, 135 kPa",
        "foam.locking_strain -0.97333 1 - 1.4 times the relative density",
    ):  # fmt: skip
        assert fragment in words, fragment


def test_show_of_a_scaled_foam_and_of_none(invoke: Callable) -> None:
    assert "by the scaling" in invoke("foam", "show", "rigid-pu-40").stdout
    assert_refused(invoke("foam", "show", "shim200-pu"), "did you mean shim2000-pu?")
    refused = invoke("foam", "show", "NONSENSE")
    assert_refused(refused, "foam 'NONSENSE': not in the library; known: ", "foam list")
    assert_refused(invoke("foam", "show", "nowhere.toml"), "nowhere.toml: cannot be read")


def test_import_writes_a_foam_and_a_picture(
    invoke: Callable, test_file: Path, tmp_path: Path
) -> None:
    done = invoke(
        "foam", "import", "pu.csv", "--density", "30", "--name", "PU [30]", "--source", "A. Tester",
        "--licence", "CC0", "--rate", "0.001", "--direction", "rise",
    )  # fmt: skip
    assert (done.exit_code, done.stderr) == (0, "")
    assert set(tree(tmp_path)) == {"pu.csv", "pu.toml", "pu.png"}
    assert (tmp_path / "pu.png").read_bytes().startswith(b"\x89PNG")
    file = read_foam(tmp_path / "pu.toml")
    assert (file.title, file.source, file.licence) == ("PU [30]", "A. Tester", "CC0")
    assert (file.density, file.rate, file.direction) == (30.0, 0.001, "rise")
    assert file.measured == ("stress up to a strain of 0.88, 45 points",)
    assert {each.key: each.why for each in file.assumed} == {
        f"foam.{key}": why for key, why in TabulatedFoam.unless_given.items()
    }
    assert isinstance(file.foam, TabulatedFoam)
    assert file.foam.curve == read_curve(test_file)
    words = " ".join(done.stdout.split())
    for fragment in (
        "45 points, up to a strain of 0.88", "strain in % (column 1, 'Strain (%)')",
        "stress in MPa (column 2, 'Stress [MPa]')",
        "Young's modulus K 3.75 MPa", "Eq. 26 fitted", "median error",
        "foam.shear_modulus 1.4062e6 Pa 3/8 of Young's modulus", "pu.toml, pu.png",
        'foam = "pu.toml"',
    ):  # fmt: skip
        assert fragment in words, fragment
    shown = " ".join(invoke("foam", "show", "pu.toml").stdout.split())
    assert "PU [30]" in shown
    assert "curve 45 points given" in shown


def test_a_scene_with_the_file_has_the_stresses_of_the_test(
    invoke: Callable, test_file: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "foams"
    folder.mkdir()
    done = invoke("foam", "import", "pu.csv", "--density", "30", "--out", "foams/mine.toml")
    assert done.exit_code == 0, done.output
    assert 'foam = "mine.toml"' in done.stdout
    scene_file = folder / "drop.toml"
    scene_file.write_text('foam = "mine.toml"\n[impactor]\nshape = "flat"\n', encoding="utf-8")
    scene = load_scene(str(scene_file))
    assert scene.block.density == 30.0
    found = normal_stresses(scene, -STRAIN, -STRAIN)
    np.testing.assert_allclose(-found, STRESS, rtol=1e-9, atol=1e-6)


def test_noise_is_smoothed_and_said(invoke: Callable, tmp_path: Path) -> None:
    strain = np.linspace(0.0, 0.85, 600)
    noise = 1.0 + 0.1 * np.random.default_rng(2).standard_normal(strain.size)
    write(tmp_path / "noisy.csv", strain, np.interp(strain, STRAIN, STRESS) * noise)
    done = invoke("foam", "import", "noisy.csv", "--density", "30")
    assert done.exit_code == 0, done.output
    assert "smoothed by at most" in done.stdout
    assert "thinned to" in done.stdout
    assert "fewer --points" in done.stderr
    measured = read_foam(tmp_path / "noisy.toml").measured
    assert measured[0] == "stress up to a strain of 0.85, 600 points"
    assert "smoothed by at most" in measured[-1]
    again = invoke(
        "foam", "import", "noisy.csv", "--density", "30", "--points", "60", "--overwrite"
    )
    assert (again.exit_code, again.stderr) == (0, "")
    assert len(read_foam(tmp_path / "noisy.toml").foam.curve.strain) <= 61


def test_all_that_is_read_is_said(invoke: Callable, tmp_path: Path) -> None:
    """A machine's file: Latin-1, free text, decimal commas, force and displacement, unloading."""
    area, height = 2.5e-3, 0.05
    rows = list(zip(STRAIN.tolist(), STRESS.tolist(), strict=True))
    back = [(0.35, 60e3), (0.3, 0.0), (0.35, 50e3)]
    rows = [*rows[:21], *back, *rows[20:], (0.8, 0.0)]
    body = [f"{1e3 * height * e:.6f};{area * s:.6f}".replace(".", ",") for e, s in rows]
    text = ["Prüfer;Müller", "Temperatur;23 °C", "", "Weg [mm];Kraft [N]", *body]
    (tmp_path / "pu.csv").write_bytes("\r\n".join(text).encode("latin-1"))
    done = invoke(
        "foam", "import", "pu.csv", "--density", "30", "--area", "2.5e-3", "--height", "0.05"
    )
    assert (done.exit_code, done.stderr) == (0, "")
    words = " ".join(done.stdout.split())
    for fragment in (
        "pu.csv, read as Latin-1: 50 points, up to a strain of 0.88",
        "2 lines of text above the header skipped",
        "strain: displacement in mm (column 1, 'Weg [mm]'), over 0.05 m",
        "stress: force in N (column 2, 'Kraft [N]'), over 0.0025 m2",
        "left out of the curve: 2 unloading branches (5 points, with reloading), strain from 0.4 "
        "to 0.3, from 0.88 to 0.8",
    ):
        assert fragment in words, fragment
    file = read_foam(tmp_path / "pu.toml")
    assert file.measured[1].startswith("strain: displacement in mm")
    assert file.measured[3].startswith("left out of the curve: 2 unloading branches")
    np.testing.assert_allclose(file.foam.curve.strain, STRAIN, rtol=1e-9)
    np.testing.assert_allclose(file.foam.curve.stress, STRESS, rtol=1e-5, atol=1e-3)


def test_the_picture_shows_the_plateau() -> None:
    """A test to a hundred plateaus: the plateau has its place on both axes of stress."""
    strain = np.append(STRAIN, [0.9, 0.92])
    stress = np.append(STRESS, [50 * 150e3, 100 * 150e3])
    foam = TabulatedFoam(curve=Curve(strain=tuple(strain.tolist()), stress=tuple(stress.tolist())))
    loading = np.ones(strain.size, dtype=bool)
    figure = compression_test(strain, stress, loading, foam, crushable_fit(foam.curve), "PU")
    left, middle, _ = figure.axes
    plateau = foam.landmarks.plateau_stress
    for axis, scale in ((left, 1e3), (middle, 1e6)):
        low, high = axis.transData.transform([(0.0, s) for s in axis.get_ylim()])[:, 1]
        place = axis.transData.transform((0.0, plateau / scale))[1]
        assert 0.25 <= (place - low) / (high - low) <= 0.6
    assert middle.get_ylim()[1] * 1e6 > stress.max()


def test_columns_by_number_and_name(invoke: Callable, tmp_path: Path) -> None:
    lines = [f"0,{s!r},{e!r}" for e, s in zip(STRAIN.tolist(), STRESS.tolist(), strict=True)]
    (tmp_path / "a.csv").write_text("\n".join(["time,load,squash", *lines]), encoding="utf-8")
    given = ["--density", "30"]
    by_number = invoke("foam", "import", "a.csv", *given, "--strain", "3", "--stress", "2")
    assert by_number.exit_code == 0, by_number.output
    assert "strain in fractions, as no unit is given (column 3, 'squash')" in by_number.stdout
    assert "stress in Pa, as no unit is given (column 2, 'load')" in by_number.stdout
    first = read_foam(tmp_path / "a.toml")
    by_name = invoke(
        "foam", "import", "a.csv", *given, "--strain", "squash", "--stress", "load", "--overwrite"
    )
    assert by_name.exit_code == 0, by_name.output
    assert read_foam(tmp_path / "a.toml") == first


def changed(place: int, strain: float) -> np.ndarray:
    return np.where(np.arange(STRAIN.size) == place, strain, STRAIN)


# Others have their messages in tests/scene/test_measured.py.
BAD_TESTS = {
    "text": ("strain,stress\n0,0\n0.1,broken\n0.2,2e5\n", ("line 3: 'broken' in column 2",)),
    "unsorted": (
        (changed(9, 0.5), STRESS),
        ("line 12: the strain is smaller than", "sort the lines"),
    ),
    "percent without a unit": ((100 * STRAIN, STRESS), ("must be below 1", "80 % is 0.80")),
    "unknown unit": ("strain,stress (ksi)\n0,0\n0.5,1\n", ("unit 'ksi'",)),
    "no area": ("strain,load [N]\n0,0\n0.5,90\n", ("'load [N]'", "give --area")),
}


@pytest.mark.parametrize("case", BAD_TESTS)
def test_a_bad_test_is_refused(case: str, invoke: Callable, tmp_path: Path) -> None:
    content, fragments = BAD_TESTS[case]
    path = tmp_path / "pu.csv"
    if isinstance(content, str):
        path.write_text(content, encoding="utf-8")
    else:
        write(path, *content)
    before = tree(tmp_path)
    assert_refused(invoke("foam", "import", "pu.csv", "--density", "30"), "pu.csv", *fragments)
    assert tree(tmp_path) == before


BAD_OPTIONS = {
    "no density": ([], ("--density: missing; must be", "kg/m3", "0.0256 g/cm3 is 25.6")),
    "density in g/cm3": (["--density", "0.03"], ("--density = 0.03: must be", "at least 1")),
    "density a word": (
        ["--density", "thirty"],
        ("--density = 'thirty': must be a number, at least 1",),
    ),
    "rate": (["--density", "30", "--rate", "-1"], ("--rate = -1.0: must be", "1/s")),
    "no title": (["--density", "30", "--name", ""], ("--name = '': must be", "1 to 200")),
    "points": (["--density", "30", "--points", "3"], ("--points = 3: must be at least 20",)),
    "no such column": (["--density", "30", "--strain", "9"], ("no such column",)),
    "no such unit": (["--density", "30", "--stress-unit", "ksi"], ("stress_unit", "'ksi'")),
    "no .toml": (["--density", "30", "--out", "pu.csv"], ("must end in .toml",)),
    "no path": (["--density", "30", "--out", ""], ("not a possible file name",)),
    "no folder": (["--density", "30", "--out", "none/pu.toml"], ("cannot be written", "--out")),
    "/proc": (["--density", "30", "--out", "/proc/pu.toml"], ("/proc/pu.toml: cannot be",)),
}


@pytest.mark.parametrize("case", BAD_OPTIONS)
@pytest.mark.usefixtures("test_file")
def test_bad_options_are_refused(case: str, invoke: Callable, tmp_path: Path) -> None:
    options, fragments = BAD_OPTIONS[case]
    before = tree(tmp_path)
    assert_refused(invoke("foam", "import", "pu.csv", *options), *fragments)
    assert tree(tmp_path) == before


def test_a_test_that_is_not_there(invoke: Callable, tmp_path: Path) -> None:
    assert_refused(invoke("foam", "import", "no.csv", "--density", "30"), "no.csv: cannot be read")
    assert tree(tmp_path) == {}


@pytest.mark.usefixtures("test_file")
@pytest.mark.parametrize("taken", ["pu.toml", "pu.png"])
def test_files_that_are_there_are_kept(taken: str, invoke: Callable, tmp_path: Path) -> None:
    (tmp_path / taken).write_text("old", encoding="utf-8")
    before = tree(tmp_path)
    command = ["foam", "import", "pu.csv", "--density", "30"]
    assert_refused(invoke(*command), f"{taken}: already exists", "--overwrite")
    assert tree(tmp_path) == before
    assert invoke(*command, "--overwrite").exit_code == 0
    assert set(tree(tmp_path)) == {"pu.csv", "pu.toml", "pu.png"}
    assert (tmp_path / taken).read_bytes() != b"old"


def test_the_test_itself_is_never_replaced(invoke: Callable, tmp_path: Path) -> None:
    write(tmp_path / "pu.toml")
    before = tree(tmp_path)
    done = invoke("foam", "import", "pu.toml", "--density", "30", "--overwrite")
    assert_refused(done, "is the test itself")
    assert tree(tmp_path) == before


@pytest.mark.usefixtures("test_file")
def test_a_full_disk_leaves_what_there_was(
    invoke: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "pu.toml").write_text("old", encoding="utf-8")
    before = tree(tmp_path)

    monkeypatch.setattr(Figure, "savefig", lambda figure, path, **more: fill_disk(Path(path)))
    done = invoke("foam", "import", "pu.csv", "--density", "30", "--overwrite")
    assert_refused(done, "figure pu.png: it could not be written")
    assert tree(tmp_path) == before


def test_what_a_scene_assumes_is_one_line_after_its_run_and_a_command(
    invoke: Callable, tmp_path: Path
) -> None:
    done = invoke(
        "run", "paper/wedge-2.86", "--out", "of pu", "--no-film", "--set", "foam=rigid-pu-40",
        "--set", "numerics.end=0.001", *COARSE_OPTIONS,
        "--set", "foam.rate=7", "--set", "foam.overshoot_strain=0.014",  # has others' kernels
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assumed = json.loads((tmp_path / "of pu" / "summary.json").read_text())["assumed"]
    said = (
        f"{len(assumed)} values of the foam are assumed: `taichi-foam foam assumed 'of pu'` shows"
    )
    assert [line for line in done.stdout.splitlines() if "assumed" in line] == [f"{said} them"]
    shown = invoke("foam", "assumed", "of pu")
    assert (shown.exit_code, shown.stderr) == (0, "")
    words = " ".join(shown.stdout.split())
    assert len(assumed) >= 12
    for text in assumed:
        key, _, rest = text.partition(" = ")
        assert f"{key} {rest.partition(': ')[0]} " in words
    assert "foam.densification_strain -0.8 that of the paper's foam, -0.80: the scaling" in words


def test_what_scenes_assume_without_a_run(invoke: Callable, tmp_path: Path) -> None:
    own = " ".join(invoke("foam", "assumed", "gallery/own-foam").stdout.split())
    assert "foam.shear_modulus 1.2675e6 Pa 3/8 of Young's modulus" in own
    assert "numerics.damping_time 1.7544e-5 s that of the paper's foam" in own
    papers = invoke("foam", "assumed", "paper/wedge-2.86")
    assert papers.stdout == "no value of the foam is assumed\n"
    assert_refused(invoke("foam", "assumed", str(tmp_path)), "has no scene.toml", "Fix: ")
    assert_refused(invoke("foam", "assumed", "nowhere.toml"), "nowhere.toml: no such file")
