"""What a run warns of: each condition, from figures made by hand and from runs that meet it."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import taichi_foam as tf
from taichi_foam.analysis import soundness
from taichi_foam.cli.outcome import Terminal
from taichi_foam.scene import Block, Curve, FlatBlock, Model, Numerics, Scene, TabulatedFoam
from taichi_foam.shim2000.impacts import paper_scene


def with_residual(make_result, share: float, **parts):
    scene = Scene(name="hand-made", impactor=FlatBlock(), **parts)
    run = {"dt_stable_min_s": 5e-6}
    return make_result(scene=scene, run=run, strain_J=1.0, residual_J=(0.0, share))


@pytest.mark.parametrize(
    ("parts", "cure"),
    [
        ({}, "numerics.safety = 0.2"),
        ({"numerics": Numerics(dt=1e-5)}, "numerics.dt = 'auto'"),
        ({"numerics": Numerics(dt=4e-6)}, "numerics.dt = 1e-06"),
        ({"model": Model(broken_contact="jump")}, "model.broken_contact = 'reload'"),
    ],
    ids=["auto", "above stable", "below stable", "jump"],
)
def test_a_residual_is_told_with_what_helps(make_result, parts: dict, cure: str) -> None:
    """Never "or auto" to who has it."""
    assert not any("energy" in text for text in with_residual(make_result, 0.01, **parts).warnings)
    text = with_residual(make_result, -0.0123, **parts).warnings[-1]
    assert text.startswith("1.2% of the impact energy is unaccounted for")
    assert text.endswith(f"set {cure}") or f"set {cure}, " in text


@pytest.mark.parametrize(
    ("parts", "cure"),
    [
        ({}, "numerics.safety = 0.2, for a step a quarter as long"),
        ({"model": Model(shear="face")}, "model.shear = 'cell'"),
        ({"model": Model(shear="face", broken_contact="jump")}, "model.shear = 'cell'"),
        ({"model": Model(broken_contact="jump")}, "model.broken_contact = 'reload'"),
    ],
    ids=["auto", "face", "both", "jump"],
)
def test_what_is_lost_and_comes_back_is_told_with_what_helps(
    make_result, parts: dict, cure: str
) -> None:
    """Below what it has been at any time, not below the row before; the worst mechanism."""
    scene = Scene(name="hand-made", impactor=FlatBlock(), **parts)

    def found(fall: float) -> list[str]:
        columns = {
            "crushing_J": (0.0, 0.4, 0.4 - 0.5 * fall, 0.4 - fall),
            "damping_J": (0.0, 0.1, 0.1 - 0.5 * fall, 0.2),
        }
        time = (0.0, 1e-4, 2e-4, 3e-4)
        made = make_result(scene=scene, time=time, impactor_kinetic_J=1.0, **columns)
        fallen = soundness.largest_fall(made)
        assert fallen is not None
        column, share = fallen
        assert column.name == "crushing_J"
        assert share == pytest.approx(fall, rel=1e-9)
        return made.warnings

    assert not found(0.9e-3)
    (text,) = found(1.23e-2)
    assert text.startswith(
        "crushing (crushing_J) fell by 1.2 % of the impact energy, but dissipated"
    )
    assert text.endswith(f"set {cure}")


def test_without_impact_energy_nothing_falls(make_result) -> None:
    made = make_result(crushing_J=(1.0, 0.0))
    assert soundness.largest_fall(made) is None
    assert made.warnings == []


@pytest.mark.usefixtures("taichi_runtime")
def test_shear_by_faces_makes_energy_and_says_so() -> None:
    """The paper as it is worded: cracked foam gives back more shear than it took."""
    scene = paper_scene("paper/wedge-2.86", choices="paper-literal")
    values = {"block.columns": 20, "block.rows": 10, "numerics.end": 20e-3}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = tf.run(scene.with_values(values)).warnings
    assert any("model.shear = 'cell'" in text for text in found)


def test_a_step_above_the_stable_one(make_result) -> None:
    found = with_residual(make_result, 0.0, numerics=Numerics(dt=1e-5)).warnings
    assert len(found) == 1
    assert "1e-05 s is 2 times the stable step, which fell to 5e-06 s" in found[0]
    assert not with_residual(make_result, 0.0, numerics=Numerics(dt=5e-6)).warnings


def test_overlap_names_the_stiffness_that_halves_the_limit(make_result) -> None:
    """At a given force the overlap falls with the stiffness: 0.2 cells ask for four times 40."""
    cell = Block().dx

    def found(overlap: float, stiffness: float = 40.0) -> list[str]:
        scene = Scene(impactor=FlatBlock(), numerics=Numerics(end=1.0, contact_stiffness=stiffness))
        return make_result(scene=scene, run={"max_overlap_m": overlap * cell}).warnings

    assert not found(0.099)
    assert found(0.2)[0].endswith("set numerics.contact_stiffness = 200")
    assert found(0.2, 5e3)[0].endswith("use a slower or lighter impactor")


def test_points_without_bonds_are_no_foam(make_result, make_snapshot) -> None:
    block = Block(columns=4, rows=4)
    scene = Scene(block=block, impactor=FlatBlock(width=0.2))
    a, b = (
        [(i, j) for i in range(3) for j in range(4)],
        [(i, j) for i in range(4) for j in range(3)],
    )

    def found(broken_a: list, broken_b: list) -> tuple[float, list[str]]:
        snapshot = make_snapshot(block, a=broken_a, b=broken_b)
        result = make_result(scene=scene, snapshots=[snapshot])
        return soundness.loose_share(snapshot, block), result.warnings

    assert found(a, []) == (0.0, [])
    share, sentences = found(a, [bond for bond in b if bond[0] < 2])  # two columns of four
    assert share == 0.5
    assert sentences[0].startswith("50% of the mass points have no unbroken bond left")


@pytest.mark.parametrize(("end", "told"), [(0.65, True), (0.9, False)])
def test_crush_beyond_the_test_is_said(make_result, make_snapshot, end: float, told: bool) -> None:
    block = Block(columns=10, rows=10, mass_points="cells")
    curve = Curve(strain=(0, 0.05, end), stress=(0, 1e5, 2e5))
    scene = Scene(block=block, foam=TabulatedFoam(curve=curve), impactor=FlatBlock(width=0.2))
    strain = np.zeros((10, 9))
    strain[:, 8] = -0.7
    found = make_result(scene=scene, snapshots=[make_snapshot(block, e_min_b=strain)]).warnings
    assert len(found) == told
    assert all("0.65, where the foam's test curve ends" in text for text in found)


@pytest.fixture(scope="module")
def steep() -> Scene:
    """The paper's wedge on a coarse block, with 1.4 times the stable step."""
    values = {
        "block.columns": 10, "block.rows": 5, "numerics.dt": 2.4e-5, "numerics.end": 4e-3,
        "output.snapshot_interval": 1e-3,
    }  # fmt: skip
    return paper_scene("paper/wedge-2.86").with_values(values)


@pytest.mark.usefixtures("taichi_runtime")
def test_python_warns_once_where_it_was_called(steep: Scene, capsys) -> None:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = tf.run(steep)
    assert [entry.category for entry in caught] == [tf.RunWarning]
    assert caught[0].filename == __file__
    assert str(caught[0].message) == "\n  ".join((f"{steep.name}:", *result.warnings))
    assert result.summary["warnings"] == result.warnings
    assert result.run["dt_stable_min_s"] < steep.numerics.dt
    assert "times the stable step" in result.warnings[0]
    Terminal(errors=_console()).warn(result.warnings)
    said = capsys.readouterr().out.splitlines()
    assert said == [f"warning: {text}" for text in result.warnings]


def _console():
    from rich.console import Console

    return Console(width=10_000)


@pytest.mark.usefixtures("taichi_runtime")
def test_a_sound_run_has_nothing_to_say(steep: Scene) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = tf.run(steep.with_values(numerics__dt="auto"))
    assert result.warnings == []
    assert result.run["dt_stable_min_s"] == pytest.approx(result.run["dt_min_s"] / 0.8)
    assert np.isfinite(result.summary["max_displacement_m"])
