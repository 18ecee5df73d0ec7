"""Pads from the formulas: curves, ranges, choice, what to relax; heights and own tests."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from taichi_foam.cushions import handling, own_tests, sizing
from taichi_foam.errors import UserError
from taichi_foam.formulas import energy
from taichi_foam.laws.bond.kinds.tabulated import TabulatedFoam
from taichi_foam.scene.measured import read_curve
from taichi_foam.units import STANDARD_GRAVITY

FOAM_NAMES = ("shim2000-pu", "rigid-pu-20", "rigid-pu-40", "rigid-pu-80", "rigid-pu-100")
OWN = Path(__file__).parents[2] / "scenes" / "own_foam.csv"

PRODUCTS = [
    (0.05, 150), (0.2, 100), (0.5, 80), (1.0, 60), (2.0, 50),
    (5.0, 40), (10.0, 30), (18.0, 40), (30.0, 25), (60.0, 15),
]  # fmt: skip
"""Masses [kg] and fragilities [g] of ten products of very different size."""


@pytest.fixture(scope="module")
def foams() -> list[sizing.Cushioning]:
    return [sizing.cushioning(name) for name in FOAM_NAMES]


def wish(mass: float, fragility: float, **more: Any) -> sizing.Wish:
    given = {"drop": handling.drop_height(mass), "drops": 1, "stock": handling.STOCK["si"]}
    return sizing.Wish(mass=mass, fragility=fragility, **{**given, **more})


def largest(pad: sizing.Pad, mass: float, thickness: float) -> float:
    """The peak [g] of another mass on another thickness of a pad; inf where the foam is used up."""
    static = mass * STANDARD_GRAVITY / pad.area
    found = energy.stop(pad.foam.strain, pad.foam.stress, static, pad.wish.drop, thickness)
    return float("inf") if found is None else found.g


def test_the_curve_over_strains_is_the_balance_over_static_stresses(
    foams: list[sizing.Cushioning],
) -> None:
    for foam in foams:
        curve = sizing.response(foam, 0.05, 0.76)
        for at in (50, 300, 600, 798):
            stop = energy.stop(foam.strain, foam.stress, float(curve.static[at]), 0.76, 0.05)
            assert stop is not None
            assert stop.g == pytest.approx(curve.g[at], rel=1e-9)
            assert stop.strain == pytest.approx(curve.strain[at], rel=1e-9)


def test_five_drops_are_those_of_the_balance_drop_by_drop() -> None:
    """The scene `five_drops` states the strains and peaks of its balance."""
    made = TabulatedFoam.model_validate({"curve": read_curve(OWN), "crush_band": 0.0075})
    own = sizing.Cushioning("own", "own", "", (), 35.0, made)
    static = 8.0 * STANDARD_GRAVITY / 0.015
    found = [sizing.response(own, 0.05, 0.3, drops).at(static) for drops in range(1, 6)]
    assert [strain for _, strain in found] == pytest.approx(
        [0.26, 0.46, 0.62, 0.76, 0.84], abs=0.01
    )
    assert [g for g, _ in found] == pytest.approx([26, 30, 35, 44, 69], rel=0.02)


@pytest.mark.parametrize(("mass", "fragility"), PRODUCTS)
def test_pads_protect_the_masses_they_state_and_half_of_them_does_not(
    foams: list[sizing.Cushioning], mass: float, fragility: float
) -> None:
    found = sizing.candidates(foams, wish(mass, fragility))
    assert found
    assert found == sorted(found, key=lambda each: (each.thickness, each.volume))
    for pad in found:
        assert largest(pad, mass, pad.thickness) <= (1 - sizing.RESERVE) * fragility * 1.01
        low, high = pad.masses
        assert low < mass < high / (1 + 0.99 * sizing.HEAVIER)
        for edge, beyond in ((low, 0.97 * low), (high, 1.03 * high)):
            inside = 1.003 * edge if edge == low else 0.997 * edge
            assert largest(pad, inside, pad.thickness) <= fragility
            assert largest(pad, beyond, pad.thickness) > fragility
        assert pad.area >= (sizing.SLENDER * pad.thickness) ** 2 * 0.995
        assert largest(pad, mass, pad.thickness / 2) > fragility


def test_a_miss_says_what_to_relax_by_how_much(foams: list[sizing.Cushioning]) -> None:
    asked = wish(5.0, 40.0, max_thickness=0.02, max_area=5e-4)
    assert sizing.candidates(foams, asked) == []
    found = sizing.relaxed(foams, wish(5.0, 40.0, max_thickness=0.02))
    assert {each.key for each in found} == {"fragility", "drop", "max_thickness"}
    assert [abs(each.by) for each in found] == sorted(abs(each.by) for each in found)
    for each in found:
        enough = wish(5.0, 40.0, max_thickness=0.02).with_computed(**{each.key: each.value})
        assert sizing.candidates(foams, enough)
        if each.key != "max_thickness":
            nearly = {each.key: each.value * (0.98 if each.by > 0 else 1.02)}
            assert not sizing.candidates(foams, enough.with_computed(**nearly))


def test_a_light_fragile_product_needs_pads_that_are_held(foams: list[sizing.Cushioning]) -> None:
    asked = wish(0.05, 15.0)
    assert sizing.candidates(foams, asked) == []
    assert "braced" in {each.key for each in sizing.relaxed(foams, asked)}


def test_a_test_in_a_file_is_called_as_the_file_whatever_the_case_of_its_ending(
    tmp_path: Path,
) -> None:
    """Its name also names a folder: the whole path would lead out of the design's own."""
    file = tmp_path / "FOAM.CSV"
    file.write_bytes(OWN.read_bytes())
    assert sizing.cushioning(str(file)).label == "FOAM"


def test_drop_heights_are_those_of_ista_1a() -> None:
    assert [handling.drop_height(m) for m in (10.0, 10.1, 28.0, 45.0, 68.0)] == [
        0.76, 0.61, 0.46, 0.31, 0.20,
    ]  # fmt: skip
    with pytest.raises(UserError, match=r"68 kg.*give drop="):
        handling.drop_height(70.0)


def test_own_tests_are_read_with_their_units(tmp_path: Path) -> None:
    file = tmp_path / "tests.csv"
    file.write_text(
        "height [cm],thickness [mm],static stress [psi],G\n76,50,1.0,45\n30,25,0.5,60\n"
    )
    found = own_tests.read(file)
    assert found.height == pytest.approx([0.76, 0.3])
    assert found.static == pytest.approx([6894.757, 3447.379])
    assert found.g == pytest.approx([45, 60])
    assert found.alike(0.76, 0.05).tolist() == [True, False]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("height [m],thickness [mm],peak [g]\n0.76,50,40\n", "no column for the static stress"),
        ("height,thickness [mm],static stress [kPa],G\n0.76,50,5,40\n", "has no unit"),
        ("height [m],thickness [mm],static stress [kPa],G\n0.76,-50,5,40\n", "line 2.*above 0"),
        ("height [m],thickness [mm],static stress [kPa],G\n0.76,thick,5,40\n", "line 2"),
    ],
)
def test_own_tests_that_cannot_be_read_say_why(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "tests.csv"
    file.write_text(text)
    with pytest.raises(UserError, match=said):
        own_tests.read(file)
