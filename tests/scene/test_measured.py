"""Compression tests in CSV files: columns, units, what is refused and how."""

import re
from pathlib import Path

import numpy as np
import pytest

from taichi_foam.errors import UserError
from taichi_foam.scene import Scene
from taichi_foam.scene.files import scene_from_text, scene_from_toml, scene_to_toml
from taichi_foam.scene.measured import Branch, Columns, read_curve, read_test

STRAIN = [0.0, 0.05, 0.4, 0.6, 0.8]
STRESS = [0.0, 100e3, 120e3, 160e3, 800e3]


@pytest.fixture
def csv(tmp_path: Path):
    """Write text as a CSV file."""

    def write(text: str) -> Path:
        path = tmp_path / "test.csv"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def lines(factor: float = 1.0, scale: float = 1.0, between: str = ",") -> str:
    return "\n".join(
        f"{factor * e:g}{between}{scale * s:g}" for e, s in zip(STRAIN, STRESS, strict=True)
    )


@pytest.mark.parametrize(
    "text",
    [
        lines(),
        "strain,stress\n" + lines(),
        "Strain [%],Stress [MPa]\n" + lines(100, 1e-6),
        "# made up\nstrain_percent;stress_kPa\n" + lines(100, 1e-3, ";"),
        "ε (-)\tσ (N/mm²)\n" + lines(1, 1e-6, "\t"),
        "strain stress\n- kPa\n" + lines(1, 1e-3, " "),
        "Strain [%];Stress [kPa]\n" + lines(100, 1e-3, ";").replace(".", ","),
        "strain,stress\n" + lines(-1, -1),
        'strain,"stress\n' + lines(),  # a quote that is not closed ends with its line
        "\ufeffstrain,stress\r\n" + lines().replace("\n", "\r\n"),
    ],
)
def test_units_and_separators_are_those_of_the_header(csv, text: str) -> None:
    curve = read_curve(csv(text))
    np.testing.assert_allclose(curve.strain, STRAIN, rtol=1e-12)
    np.testing.assert_allclose(curve.stress, STRESS, rtol=1e-12)


def test_columns_and_units_may_be_named(csv) -> None:
    rows = "\n".join(
        f"{k},{s / 1e6:g},{100 * e:g}" for k, (e, s) in enumerate(zip(STRAIN, STRESS, strict=True))
    )
    path = csv("time,load cell,crosshead\n" + rows)
    for strain, stress in (("crosshead", "load"), (3, 2)):
        found = read_curve(path, Columns(strain, stress, "%", "MPa"))
        np.testing.assert_allclose(found.stress, STRESS, rtol=1e-12)


def test_a_long_test_is_read_as_means_of_parts(csv) -> None:
    """Noise of 1 % of 20,000 points; the curve stays within it, its ends are kept."""
    strain = np.linspace(0.0, 0.8, 20_001)
    rng = np.random.default_rng(1)
    stress = np.interp(strain, STRAIN, STRESS) * (1 + 0.01 * rng.standard_normal(strain.size))
    path = csv(
        "strain,stress\n"
        + "\n".join(f"{e:.9f},{s:.3f}" for e, s in zip(strain, stress, strict=True))
    )
    curve = read_curve(path)
    assert len(curve.strain) <= 501
    assert curve.strain[-1] == 0.8
    shown = np.interp(curve.strain, STRAIN, STRESS)
    inside = slice(1, -1)
    # 40 points a mean: 1 % / sqrt(40) is 0.16 %, four times that for the worst of 500, and a
    # monotone regression is nearer to a rising curve than its data are
    assert np.abs(np.array(curve.stress)[inside] / shown[inside] - 1).max() < 0.008


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "empty"),
        ("strain,stress\n", "no numbers"),
        ("strain,stress\n0,0\n0.1,high\n0.5,3e5", "line 3: 'high' in column 2: must be a number"),
        ("strain,stress\n0,0\n0.1,\n0.5,3e5", "line 3: '' in column 2: must be a number"),
        ("strain,stress\n0,0\n0.1,nan\n0.5,3e5", "line 3: nan in column 2: must be finite"),
        ("strain,stress\n0,0\n0.3,2e5\n0.2,2e5\n0.5,3e5", "line 4: the strain is smaller"),
        ("strain,stress\n0.5,3e5\n0.3,1e4\n0,0", "line 2: the largest strain is on the first"),
        ("strain,stress\n0,broken\n0.3,2e5\n0.5,3e5", "line 2: 'broken' in column 2"),
        ("strain,stress\n0,0\n0.5," + 200_000 * "1", "line 3: not CSV"),
        (lines(100), "strains are fractions"),
        (lines(1, 1e-6), "stresses are in pascals"),
        ("strain [ft],stress\n" + lines(), "unit 'ft'"),
        ("time,force\n" + lines(), "no column of strain"),
        ("strain,true strain,stress\n0,0,0\n0.5,0.6,2e5", "2 columns of strain"),
    ],
)
def test_what_cannot_be_read_is_told_with_its_line(csv, text: str, told: str) -> None:
    path = csv(text)
    with pytest.raises(UserError) as caught:
        read_curve(path)
    assert str(caught.value).startswith(str(path))
    assert told in str(caught.value)


def test_no_such_file_and_no_text(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="cannot be read"):
        read_curve(tmp_path / "none.csv")
    (tmp_path / "table.xlsx").write_bytes(b"PK\x03\x04\x00\x00")
    with pytest.raises(UserError, match="not a text file; save the table as CSV"):
        read_curve(tmp_path / "table.xlsx")


@pytest.mark.parametrize(
    ("codec", "encoding"), [("latin-1", "Latin-1"), ("utf-8", "UTF-8"), ("utf-16", "UTF-16")]
)
def test_other_encodings(tmp_path: Path, codec: str, encoding: str) -> None:
    path = tmp_path / "test.csv"
    head = "Prüfer: Müller, 23 °C\nstrain [%],stress [N/mm²]\n"
    path.write_bytes((head + lines(100, 1e-6)).encode(codec))
    read = read_test(path)
    assert (read.encoding, read.skipped) == (encoding, 1)
    np.testing.assert_allclose(read.curve.stress, STRESS, rtol=1e-12)


FREE_TEXT = {
    "commas": "Compression of PU, block 3\nSize, 50, 50\nDate, 2024-05-06\n\nstrain,stress\n",
    "semicolons": "Operator;A. Tester\nSize;50 x 50 x 50\n---\nstrain;stress\n",
    "tabs and units": "Report of 12 tests\n\nstrain\tstress\n-\tPa\n",
    "as many cells as the columns": "Operator;A. Tester\nstrain;stress\n[-];[Pa]\n",
}


@pytest.mark.parametrize("case", FREE_TEXT)
def test_free_text_above_the_columns_is_skipped(csv, case: str) -> None:
    between = {"semicolons": ";", "tabs and units": "\t", "as many cells as the columns": ";"}
    read = read_test(csv(FREE_TEXT[case] + lines(1, 1, between.get(case, ","))))
    of_header = 2 if "Pa" in FREE_TEXT[case] else 1
    assert read.skipped == sum(map(bool, FREE_TEXT[case].splitlines())) - of_header
    np.testing.assert_allclose(read.curve.strain, STRAIN, rtol=1e-12)
    np.testing.assert_allclose(read.curve.stress, STRESS, rtol=1e-12)


def with_unloading() -> list[tuple[float, float]]:
    """The test with unloading and reloading from 0.4 to 0.3, a hold there, and to rest at last."""
    back = [(0.4, 115e3), (0.35, 60e3), (0.3, 0.0), (0.35, 50e3), (0.4, 110e3)]
    last = [(0.75, 300e3), (0.7, 0.0)]
    points = list(zip(STRAIN, STRESS, strict=True))
    return [*points[:3], *back, *points[3:], *last]


@pytest.mark.parametrize("sign", [1, -1])
def test_unloading_branches_are_told_apart(csv, sign: int) -> None:
    rows = "\n".join(f"{sign * e:g},{sign * s:g}" for e, s in with_unloading())
    read = read_test(csv("strain,stress\n" + rows))
    np.testing.assert_allclose(read.curve.strain, STRAIN, rtol=1e-12)
    np.testing.assert_allclose(read.curve.stress, STRESS, rtol=1e-12)
    assert read.loading.tolist() == [True] * 3 + [False] * 5 + [True] * 2 + [False] * 2
    assert read.branches == (Branch(0.4, 0.3, 5), Branch(0.8, 0.7, 2))


def test_a_strain_that_goes_back_without_unloading_is_a_mistake(csv) -> None:
    rows = [(0.0, 0.0), (0.05, 1e5), (0.4, 1.2e5), (0.1, 1.3e5), (0.6, 1.6e5), (0.8, 8e5)]
    path = csv("strain,stress\n" + "\n".join(f"{e:g},{s:g}" for e, s in rows))
    with pytest.raises(
        UserError, match=r"line 5: the strain is smaller .* \(0\.4\).*does not fall"
    ):
        read_curve(path)


def test_the_same_strain_again_is_left_out(csv) -> None:
    read = read_test(csv("strain,stress\n0,0\n0.3,2e5\n0.3,1.9e5\n0.5,3e5"))
    assert read.curve.points[1].tolist() == [0.0, 2e5, 3e5]
    assert (read.loading.sum(), read.branches) == (3, ())


AREA, HEIGHT = 2.5e-3, 0.05


@pytest.mark.parametrize(
    ("head", "length", "force"),
    [
        ("displacement [mm],force [kN]", 1e3, 1e-3),
        ("Weg [m];Kraft [N]", 1.0, 1.0),
        ("crosshead mm\tload N", 1e3, 1.0),
    ],
)
def test_force_and_displacement_of_a_specimen(csv, head: str, length: float, force: float) -> None:
    """Nominal strain is displacement over height, nominal stress force over area."""
    between = next(mark for mark in ";\t," if mark in head)
    text = head + "\n" + lines(length * HEIGHT, force * AREA, between)
    read = read_test(csv(text), Columns(area=AREA, height=HEIGHT))
    np.testing.assert_allclose(read.curve.strain, STRAIN, rtol=1e-5)
    np.testing.assert_allclose(read.curve.stress, STRESS, rtol=1e-5)
    assert [column.over for column in read.columns] == [HEIGHT, AREA]
    bare = csv(text.partition("\n")[2])
    units = {"strain_unit": head.partition(between)[0].split()[-1].strip("[]")}
    units["stress_unit"] = head.split()[-1].strip("[]")
    again = read_curve(bare, Columns(area=AREA, height=HEIGHT, **units))
    assert again == read.curve


def test_strain_beside_force(csv) -> None:
    read = read_test(csv("strain [%],force [N]\n" + lines(100, AREA)), Columns(area=AREA))
    np.testing.assert_allclose(read.curve.stress, STRESS, rtol=1e-5)
    assert [column.over for column in read.columns] == [None, AREA]


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({}, "strain also needs the specimen's height [m]: give --height to `foam import`"),
        ({"height": 0.05}, "stress also needs the specimen's area [m2]: give --area"),
        ({"height": 50.0, "area": 1e-3}, "height = 50.0: must be a number from 0.0001 to 5 m"),
        ({"height": 0.05, "area": 2500}, "area = 2500: must be a number from 1e-06 to 25 m2"),
        ({"height": "5 cm", "area": 1e-3}, "height = '5 cm': must be a number"),
        ({"height": 0.05, "area": float("nan")}, "area = nan: must be a number"),
        ({"height": 0.05, "area": 1e-3, "stress_unit": "kPa"}, "stress_unit: unit 'kPa'"),
    ],
)
def test_sizes_that_are_missing_or_cannot_be(csv, given: dict, told: str) -> None:
    path = csv("displacement [mm],force [N]\n" + lines(50, AREA))
    with pytest.raises(UserError, match=re.escape(told)):
        read_curve(path, Columns(**given))
    data = {"foam": {"curve": {"file": str(path), **given}}, "numerics": {"end": 0.01}}
    with pytest.raises(UserError, match=re.escape(told)):
        Scene.checked(data, "scene")


def test_a_scene_gives_the_specimens_sizes(csv) -> None:
    path = csv("displacement [mm],force [kN]\n" + lines(50, 1e-3 * AREA))
    toml = path.with_name("scene.toml")
    toml.write_text(
        '[foam]\ncurve = { file = "test.csv", area = 2.5e-3, height = 0.05 }\n'
        "[numerics]\nend = 0.01\n"
    )
    curve = scene_from_toml(toml).foam.curve
    np.testing.assert_allclose(curve.stress, STRESS, rtol=1e-5)


def test_a_scene_takes_the_file_beside_it_and_holds_all_of_it(csv) -> None:
    path = csv("Strain [%],Stress [MPa]\n" + lines(100, 1e-6))
    toml = path.with_name("scene.toml")
    toml.write_text('[foam]\ncurve = "test.csv"\n[numerics]\nend = 0.01\n')
    scene = scene_from_toml(toml)
    assert scene.foam.law == "tabulated"
    path.unlink()
    assert scene_from_text(scene_to_toml(scene), "copy") == scene


def test_a_table_names_columns_and_units(csv) -> None:
    path = csv("a,b\n" + lines(100, 1e-6))
    given = {"file": str(path), "strain": "a", "stress": "b", "strain_unit": "%"}
    data = {"foam": {"curve": given | {"stress_unit": "MPa"}}, "numerics": {"end": 0.01}}
    assert Scene.checked(data, "scene").foam.landmarks.crush_end == -0.6


@pytest.mark.parametrize(
    ("curve", "told"),
    [
        ("missing.csv", "missing.csv: cannot be read"),
        ({"file": "x.csv", "columns": 3}, "foam.curve.columns: unknown key"),
        ({"file": 3}, "foam.curve.file = 3"),
        ({"strain": [0, 0.5]}, "foam.curve: missing"),
        (3, "foam.curve = 3: must be a file name"),
        ([0, 1], "foam.curve = [0, 1]: must be a file name"),
        ({"strain": [0, 0.5, 0.4], "stress": [0, 1e5, 1e5]}, "foam.curve.strain[2] = 0.4"),
    ],
)
def test_a_curve_that_cannot_be_is_told_by_its_key(curve: object, told: str) -> None:
    with pytest.raises(UserError, match=re.escape(told)):
        Scene.checked({"foam": {"curve": curve}, "numerics": {"end": 0.01}}, "scene")


def test_an_exact_name_of_a_column_goes_before_parts_of_names(csv) -> None:
    rows = "\n".join(f"{e / 10:g},{e:g},{s:g}" for e, s in zip(STRAIN, STRESS, strict=True))
    path = csv("strain rate [1/s],strain [-],stress [Pa]\n" + rows)
    assert read_curve(path, Columns(strain="strain")).strain[-1] == 0.8
