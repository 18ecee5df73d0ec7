"""Compression tests in CSV files: columns, units, what is refused and how."""

from pathlib import Path

import numpy as np
import pytest

from taichi_foam.errors import UserError
from taichi_foam.scene import Scene
from taichi_foam.scene.files import scene_from_text, scene_from_toml, scene_to_toml
from taichi_foam.scene.measured import Columns, read_curve

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
        ("strain,stress\n0,0\n0.3,2e5\n0.2,2e5\n0.5,3e5", "line 4: a smaller strain"),
        ("strain,stress\n0,0\n0.3,2e5\n0.3,2e5\n0.5,3e5", "line 4: the same strain"),
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


def test_no_such_file_and_other_encodings(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="cannot be read"):
        read_curve(tmp_path / "none.csv")
    (tmp_path / "latin.csv").write_bytes(b"strain,stress in \xb0\n0,0\n")
    with pytest.raises(UserError, match="not UTF-8"):
        read_curve(tmp_path / "latin.csv")


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
    with pytest.raises(UserError) as caught:
        Scene.checked({"foam": {"curve": curve}, "numerics": {"end": 0.01}}, "scene")
    assert told in str(caught.value)


def test_an_exact_name_of_a_column_goes_before_parts_of_names(csv) -> None:
    rows = "\n".join(f"{e / 10:g},{e:g},{s:g}" for e, s in zip(STRAIN, STRESS, strict=True))
    path = csv("strain rate [1/s],strain [-],stress [Pa]\n" + rows)
    assert read_curve(path, Columns(strain="strain")).strain[-1] == 0.8
