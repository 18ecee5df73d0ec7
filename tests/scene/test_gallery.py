"""The gallery's closed forms, against numbers worked out by hand and what must hold of them."""

import math
import runpy
from pathlib import Path

import pytest

from taichi_foam.scene import Scene

SCENES = Path(__file__).parents[2] / "scenes"


def gallery(name):
    return runpy.run_path(str(SCENES / f"{name}.py"), run_name="gallery")


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.py")), ids=lambda p: p.stem)
def test_scripts_say_what_they_are(path):
    names = gallery(path.stem)
    assert isinstance(names["scene"], Scene)
    for word in ("Physics:", "Run time:"):
        assert word in names["__doc__"]
    assert "Exact answer:" in names["__doc__"] or "Measured" in names["__doc__"]


def test_uniaxial_curve():
    """Eq. 26 at its corners; half way from densification to locking, the exponent is a = 0.5."""
    stress = gallery("uniaxial_crush")["exact_stress"]
    assert stress(0.01) == pytest.approx(2.78e4)
    assert stress(-0.02) == pytest.approx(-5.56e4)
    assert stress(-0.4) == pytest.approx(-1.39e5)
    assert stress(-0.8) == pytest.approx(-1.39e5)
    assert stress(-0.875) == pytest.approx(-1.39e5 * math.exp(0.5))
    assert stress(-0.9) == pytest.approx(-1.39e5 * math.e)


def test_uniaxial_crush_ends_deep_in_densification_and_hardly_slows_down():
    names = gallery("uniaxial_crush")
    scene = names["scene"]
    assert names["nominal_strain"](scene.numerics.end * scene.impactor.velocity) == pytest.approx(
        -0.87
    )
    work = 0.8 * 0.139e6 + 0.07 * -names["exact_stress"](-0.87)  # an upper bound, J/m3
    work *= scene.block.width * scene.block.height * scene.block.depth
    assert work / (0.5 * scene.impactor.mass * scene.impactor.velocity**2) < 0.01


def test_released_shear_patch():
    names = gallery("shear_patch")
    top, u, layer = names["exact_top_displacement"], names["exact_displacement"], names["layer"]
    c = names["wave_speed"]
    transit = layer / c
    assert c == pytest.approx(181.14, rel=1e-4)
    assert top(0.0) == pytest.approx(0.05 * 0.0975)
    assert top(0.5 * transit) == pytest.approx(0.05 * 0.0975 / 2)
    assert top(2 * transit) == pytest.approx(-top(0.0))
    assert top(4 * transit) == pytest.approx(top(0.0))
    for time in (0.0, 1e-4, 7e-4, 3e-3):
        assert u(0.0025, time) == pytest.approx(0.0, abs=1e-15)
    # Ahead of the front nothing has moved; behind it the shear is gone.
    assert u(0.03, 0.5 * transit) == pytest.approx(0.05 * (0.03 - 0.0025))
    assert u(0.06, 0.5 * transit) == pytest.approx(u(0.09, 0.5 * transit))


def test_shear_patch_ends_before_the_side_waves_arrive_and_stays_whole():
    names = gallery("shear_patch")
    scene = names["scene"]
    assert names["side_wave_arrival"] == pytest.approx(0.3 / 329.54, rel=1e-4)
    assert scene.numerics.end < names["layer"] / names["wave_speed"] < names["side_wave_arrival"]
    assert names["GAMMA"] < scene.foam.shear_strain
    assert scene.start.strains[1] < scene.foam.tensile_strain


def test_wave_bar():
    names = gallery("wave_bar")
    scene = names["scene"]
    assert names["wave_speed"] == pytest.approx(329.54, rel=1e-4)
    assert names["exact_force"](0.0) == pytest.approx(24.04, rel=1e-3)
    # After the time M / (rho c A) the velocity has fallen to 1/e.
    assert names["exact_velocity"](0.5 / names["impedance"]) == pytest.approx(math.exp(-1))
    assert scene.numerics.end < names["reflection_time"]
    stress = names["exact_force"](0.0) / (scene.block.width * scene.block.depth)
    assert 2 * stress < 0.2 * scene.foam.plateau_stress


def test_corner_drop_lands_on_its_corner():
    """A square's corner at 30 degrees: depth s cos 30, width s (cos 30 + sin 30)."""
    impactor = gallery("corner_drop")["scene"].impactor
    assert impactor.nose_depth == pytest.approx(0.05 * math.cos(math.pi / 6))
    assert impactor.extent == pytest.approx(0.05 * (math.cos(math.pi / 6) + 0.5))
