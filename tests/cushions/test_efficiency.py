"""Energy absorption of foams: landmarks against closed forms, figures and reports."""

from pathlib import Path

import numpy as np
import pytest

import taichi_foam as tf
from taichi_foam.errors import UserError
from taichi_foam.laws.bond import Curve
from taichi_foam.laws.bond.kinds.crushable import Foam
from taichi_foam.laws.bond.kinds.tabulated import TabulatedFoam


def test_the_largest_efficiency_of_eq_26_is_its_closed_form() -> None:
    """eta = e_d - e_y / 2 at e_d, if the stress then rises steeply enough: the paper's does."""
    [row] = tf.efficiency(Foam(yield_strain=-0.05, densification_strain=-0.8)).table
    assert row["onset_strain"] == pytest.approx(0.8, abs=1e-12)
    assert row["efficiency"] == pytest.approx(0.775, rel=1e-9)
    assert row["janssen_factor"] == pytest.approx(1 / 0.775, rel=1e-9)
    assert row["ideality"] == pytest.approx(0.775 / 0.8, rel=1e-9)
    assert row["densifies"]


def test_a_line_absorbs_half_of_what_it_could() -> None:
    """W = E e^2 / 2: efficiency e / 2, ideality 1/2, to the end of the curve."""
    found = tf.efficiency(Curve(strain=(0.0, 0.6), stress=(0.0, 60e3)))
    [foam] = found.foams
    assert foam.energy == pytest.approx(0.5e5 * foam.strain**2)
    assert foam.efficiency == pytest.approx(0.5 * foam.strain)
    assert foam.ideality[1:] == pytest.approx(0.5)
    assert not foam.densifies
    assert "the efficiency still rises" in found.caveats[0]


def test_a_foam_is_the_same_by_name_in_a_file_and_as_a_test(tmp_path: Path) -> None:
    foam = tf.efficiency("eps-20").foams[0]
    curve = TabulatedFoam(curve={"strain": [0.0, 0.05, 0.6, 0.8], "stress": [0, 1e5, 2e5, 9e5]})
    lines = ["strain [%],stress [kPa]", "0,0", "5,100", "60,200", "80,900"]
    (tmp_path / "test.csv").write_text("\n".join(lines))
    law, test = tf.efficiency(curve, str(tmp_path / "test.csv")).foams
    assert test.name == "test.csv"
    assert np.array_equal(law.stress, test.stress)
    assert (foam.density, foam.known_to) == (20.0, 0.1)
    assert "assumed beyond 10 % of strain" in (foam.caveat or "")


def test_of_a_family_the_shoulders_share_the_energies() -> None:
    """Plateau foams that lock at one strain: each is best up to its own shoulder."""
    plateaus = (1e5, 2e5, 4e5)
    family = [Curve(strain=(0.0, 0.01, 0.7, 0.71), stress=(0.0, p, p, 50 * p)) for p in plateaus]
    found = tf.efficiency(family)
    assert [each["foam"] for each in found.choice] == ["foam 1", "foam 2", "foam 3"]
    shoulders = [row["energy_J_m3"] for row in found.table]
    assert shoulders == pytest.approx([0.695 * p for p in plateaus])
    # beyond its shoulder a foam takes little more until it is as stressed as the next one
    for each, shoulder, plateau in zip(found.choice, shoulders, plateaus, strict=True):
        assert each["energy_J_m3"][1] >= 0.95 * shoulder
        assert each["stress_Pa"][0] <= plateau
    assert found.choice[0]["energy_J_m3"][1] < 1.1 * shoulders[0]
    assert tf.efficiency("eps-20").choice == []
    assert found.caveats == []
    [caveat] = tf.efficiency("eps-20", "eps-30").caveats
    assert caveat.startswith("eps-20, eps-30: the curve is assumed beyond 10 % of strain")


def test_what_python_refuses() -> None:
    with pytest.raises(UserError, match="0 foams: must be 1 to 40"):
        tf.efficiency()
    with pytest.raises(UserError, match="units = 'imperial'"):
        tf.efficiency("eps-20").plot("imperial")
