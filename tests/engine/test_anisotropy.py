"""Foam that rises upwards, and is another one across that."""

import numpy as np
import pytest
from bench import COLUMNS, ROWS, node_forces, small_scene

import taichi_foam as tf
from taichi_foam.laws.bond import Curve
from taichi_foam.scene import Across, Base, Block, FlatBlock, Foam, Scene, TabulatedFoam

STRAINS = (0.0, 0.05, 0.3, 0.6, 0.8, 0.9)
RISE = TabulatedFoam(curve=Curve(strain=STRAINS, stress=(0, 200e3, 210e3, 300e3, 900e3, 3e6)))
ACROSS = TabulatedFoam(curve=Curve(strain=STRAINS, stress=(0, 120e3, 150e3, 250e3, 700e3, 2e6)))
EQ_26 = Foam(), Foam(youngs_modulus=1.8e6, yield_strain=-0.03)


def pulled_by(rise: object, across: object, F: np.ndarray) -> tuple[float, float]:
    """Nominal stress [Pa] along x and along y of a block that is deformed by F from the start."""
    scene = small_scene(foam=rise, across=Across(foam=across), base=Base(kind="floor"))
    X = scene.block.positions - [0.0, 0.1]  # the floor is far below
    forces = node_forces(scene, position=X @ F.T + [0.0, 0.3])
    dx, dy, thickness = scene.block.dx, scene.block.dy, scene.block.depth
    return (
        forces[-1, :, 0].sum() / (ROWS * dy * thickness),
        forces[:, -1, 1].sum() / (COLUMNS * dx * thickness),
    )


@pytest.mark.parametrize(("rise", "across"), [(RISE, ACROSS), EQ_26], ids=["curves", "Eq. 26"])
@pytest.mark.parametrize("strain", [0.02, 0.2, 0.5])
def test_each_direction_has_its_own_curve(rise: object, across: object, strain: float) -> None:
    """Crushed along x, the foam across resists; along y, the foam of the rise. To rounding."""

    def curve(foam: object) -> float:
        if isinstance(foam, TabulatedFoam):
            return float(np.interp(strain, *foam.curve.points))
        return min(foam.youngs_modulus * strain, foam.plateau_stress)

    in_x, _ = pulled_by(rise, across, np.diag([1.0 - strain, 1.0]))
    _, in_y = pulled_by(rise, across, np.diag([1.0, 1.0 - strain]))
    assert in_x == pytest.approx(curve(across), rel=1e-6)
    assert in_y == pytest.approx(curve(rise), rel=1e-6)


def test_shear_does_not_turn_the_foam() -> None:
    """Its modulus is one in both directions: a block sheared at rest has no torque inside."""
    scene = small_scene(foam=RISE, across=Across(foam=ACROSS), base=Base(kind="floor"))
    X = scene.block.positions
    forces = node_forces(scene, position=X @ np.array([[1.0, 0.01], [0.0, 1.0]]).T + [0.0, 0.3])
    inside = np.abs(forces[2:-2, 2:-2]).max()
    assert inside < 1e-6 * np.abs(forces).max()
    arm = X - X.mean(axis=(0, 1))
    by_x, by_y = (arm[..., 1] * forces[..., 0]).sum(), (arm[..., 0] * forces[..., 1]).sum()
    assert by_y / by_x == pytest.approx(1.0, rel=1e-3)


def test_a_drop_on_such_foam_closes_its_ledger() -> None:
    scene = Scene(
        block=Block(mass_points="cells", width=0.05, height=0.1, columns=COLUMNS, rows=ROWS),
        foam=RISE,
        across={"foam": ACROSS},
        impactor=FlatBlock(width=0.02, mass=0.3, velocity=5.0),
        output={"film": False},
    )
    run = tf.run(scene)
    assert abs(run.summary["energy_residual"]) < 1e-3


def test_a_plane_has_one_shear_modulus() -> None:
    with pytest.raises(ValueError, match=r"across.foam.shear_modulus = 1e\+06: must be that of"):
        Scene(impactor=FlatBlock(), across={"foam": {"shear_modulus": 1e6}})


def test_both_directions_need_one_law() -> None:
    with pytest.raises(ValueError, match=r"across.foam: does not match \[foam\]"):
        Scene(impactor=FlatBlock(), across={"foam": ACROSS})
