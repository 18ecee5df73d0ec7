"""The measures against histories with closed forms and lattices made by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from taichi_foam.analysis import impact, loads, measures, soundness
from taichi_foam.records.ending import Ending
from taichi_foam.results.result import Result
from taichi_foam.scene import Base, Block, Cylinder, FlatBlock, Numerics, Scene, Wedge

V0, A, MASS, Z = 3.03, 74.0, 6.0, 0.057
STOP = V0 / A  # 40.9 ms, between two rows
DEPTH = V0**2 / (2 * A)
ENERGY = 0.5 * MASS * V0**2


def scene_with(impactor, **parts) -> Scene:
    return Scene(name="hand-made", impactor=impactor, **parts)


@pytest.fixture
def braked(make_result):
    """Constant deceleration A from contact to 5 ms after the stop, for a given impactor."""

    def make(impactor=None, contact: float = 0.0, end: float | None = None, **more) -> Result:
        impactor = impactor or FlatBlock(velocity=V0)
        end = contact + STOP + 5e-3 if end is None else end
        t = np.append(np.arange(0.0, end - 1e-9, 1e-4), end)
        since = np.clip(t - contact, 0, None)
        v = V0 - A * since
        columns = {
            "displacement_m": V0 * t - 0.5 * A * since**2,
            "velocity_m_s": v,
            "deceleration_m_s2": np.where(t > contact, A, 0.0),
            "contact_force_N": np.where(t > contact, MASS * A, 0.0),
            "impactor_kinetic_J": 0.5 * MASS * v**2,
        }
        return make_result(scene=scene_with(impactor), time=t, **(columns | more))

    return make


@pytest.fixture
def slowed(make_result):
    """A flat block with an initial velocity and a deceleration in each row, always in contact."""

    def make(t: np.ndarray, v0: float, a: np.ndarray) -> Result:
        v = v0 - np.cumsum(np.append(0.0, a[1:] * np.diff(t)))
        way = np.append(0.0, np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t)))
        columns = {"velocity_m_s": v, "displacement_m": way, "deceleration_m_s2": a}
        return make_result(scene=scene_with(FlatBlock()), time=t, contact_force_N=1.0, **columns)

    return make


# --- constant deceleration --------------------------------------------------------------------


def test_duration_displacement_and_energy(braked) -> None:
    result = braked()
    assert impact.impact(result).duration == pytest.approx(V0 / A, rel=1e-12)
    assert loads.max_displacement(result) == pytest.approx(V0**2 / (2 * A), rel=1e-12)
    assert loads.energy_absorbed(result) == pytest.approx(ENERGY, rel=1e-12)  # Eq. 7


@pytest.mark.parametrize("impactor", [FlatBlock(), Cylinder(), Wedge()], ids=lambda i: i.shape)
def test_plateau_is_the_deceleration(braked, impactor) -> None:
    assert loads.plateau(braked(impactor)) == pytest.approx(A, rel=1e-12)


@pytest.mark.parametrize(
    ("impactor", "area"),
    [
        (FlatBlock(), 0.05 * DEPTH),  # Eq. 4
        (Cylinder(), math.pi * 0.025**2 / 2 + (DEPTH - 0.025) * 0.05),  # Eq. 5, d > R
        (Wedge(), DEPTH * 0.05 - 0.05**2 / 4),  # Eq. 6, d > W/2
    ],
    ids=lambda value: getattr(value, "shape", ""),
)
def test_volume_and_energy_per_volume(braked, impactor, area: float) -> None:
    result = braked(impactor)
    assert loads.crushed_volume(result) == pytest.approx(area * Z, rel=1e-9)
    assert loads.energy_per_volume(result) == pytest.approx(ENERGY / (area * Z), rel=1e-9)


def test_shallow_noses_use_the_first_branch_of_eqs_5_and_6(make_result) -> None:
    v, a = 1.0, 50.0  # stops at 10 mm
    t = np.linspace(0, 0.021, 211)
    columns = {
        "time": t,
        "velocity_m_s": v - a * t,
        "displacement_m": v * t - 0.5 * a * t**2,
        "deceleration_m_s2": a,
        "contact_force_N": MASS * a,
    }
    d, R = 0.01, 0.025
    segment = math.acos(1 - d / R) * R**2 - (R - d) * math.sqrt(2 * R * d - d**2)
    for impactor, area in ((Cylinder(), segment), (Wedge(), d**2)):
        result = make_result(scene=scene_with(impactor), **columns)
        assert loads.crushed_volume(result) == pytest.approx(area * Z, rel=1e-9)
        assert loads.plateau(result) is None  # the nose never went in


def test_absorption_curve_of_a_flat_block_is_straight(braked) -> None:
    """Fig. 13: the force M A over the area W Z is its slope, here everywhere."""
    curve = loads.absorption_curve(braked())
    assert curve is not None
    volume, energy = curve
    assert volume[[0, -1]] == pytest.approx([0.0, 0.05 * Z * DEPTH])
    assert energy == pytest.approx(volume * MASS * A / (0.05 * Z), rel=1e-9, abs=1e-12)
    slope = loads.energy_volume_slope(braked())
    assert slope == pytest.approx(MASS * A / (0.05 * Z), rel=1e-9)


def test_rebound_velocity_change_restitution_and_drop_height(braked) -> None:
    """A constant deceleration A gives back A times what the record lasts beyond the stop."""
    rebound = A * 5e-3
    assert loads.rebound_velocity(braked()) == pytest.approx(rebound)
    assert loads.velocity_change(braked()) == pytest.approx(V0 + rebound)
    assert loads.restitution(braked()) == pytest.approx(rebound / V0)
    height = loads.equivalent_drop_height(braked())
    assert height == pytest.approx(V0**2 / (2 * 9.80665), rel=1e-12)


def test_a_gap_delays_and_deepens_nothing(braked) -> None:
    """Contact 1.234 ms after the start, between two rows: all measures count from there."""
    gap = V0 * 1.234e-3
    late = braked(FlatBlock(velocity=V0, gap=gap), contact=1.234e-3)
    found = impact.impact(late)
    assert found.contact == pytest.approx(1.234e-3, rel=1e-9)
    assert found.duration == pytest.approx(STOP, rel=1e-9)
    assert found.depth == pytest.approx(DEPTH, rel=1e-9)
    assert loads.energy_absorbed(late) == pytest.approx(ENERGY, rel=1e-12)
    assert loads.plateau(late) == pytest.approx(A, rel=1e-12)


@pytest.mark.parametrize("end", [0.02, STOP - 1e-4])
def test_a_run_that_ends_before_the_stop_has_but_its_displacement(braked, end: float) -> None:
    result = braked(end=end)
    for measure in (
        impact.impact,
        loads.plateau,
        loads.initial_peak,
        loads.energy_absorbed,
        loads.crushed_volume,
        loads.energy_per_volume,
        loads.energy_volume_slope,
        loads.rebound_velocity,
        loads.velocity_change,
        loads.restitution,
    ):
        assert measure(result) is None
    # a number for whatever has touched: scripts go on with it
    assert loads.max_displacement(result) == pytest.approx(V0 * end - 0.5 * A * end**2)
    assert loads.came_to_rest(result) is False
    assert loads.came_to_rest(braked()) is True


# --- peaks, and what became of the impactor ---------------------------------------------------


def test_peaks_in_the_middle_of_their_rows_and_in_g(braked) -> None:
    """The raw peak is a row's mean; neither looks at what was before contact."""
    t = braked(contact=2e-3).history["time_s"]
    raw, smooth = np.where(t > 2e-3, A, 0.0), np.where(t > 2e-3, A, 0.0)
    raw[10], raw[200], smooth[5], smooth[210] = 5e3, 980.665, 5e3, 490.3325
    result = braked(
        FlatBlock(velocity=V0, gap=V0 * 2e-3),
        contact=2e-3,
        deceleration_m_s2=raw,
        deceleration_smoothed_m_s2=smooth,
    )
    found = measures.summary(result)
    assert found["peak_deceleration_g"] == pytest.approx(100.0)
    assert found["peak_deceleration_m_s2"] == pytest.approx(980.665)
    assert found["peak_deceleration_time_s"] == pytest.approx(t[200] - 0.5e-4 - 2e-3)
    assert found["peak_deceleration_cfc180_g"] == pytest.approx(50.0)
    assert found["peak_deceleration_cfc180_time_s"] == pytest.approx(t[210] - 2e-3)


def test_a_peak_at_the_end_leaves_no_plateau(slowed) -> None:
    """Free down to the last millimetre, then 600 g: 0.6 m/s2 is no plateau."""
    t = np.arange(0.0, 0.0405, 1e-4)
    found = measures.summary(slowed(t, 3.0, np.where(t > 0.0395 + 1e-9, 6000.0, 0.6)))
    assert found["plateau_deceleration_m_s2"] is None
    assert found["bottomed_out"] is True  # 11.8 cm into a block of 10: on the support
    assert found["statement"].startswith("the foam bottomed out: its deceleration peaked at")
    assert "no plateau: most of the velocity was lost in a peak" in found["statement"]


def test_foam_bottoms_out_when_it_is_used_up_and_presses(braked, make_snapshot) -> None:
    """Crushed to -0.8 in the mean of a column under the face, and above twice its plateau."""
    block, foam = Block(), scene_with(FlatBlock()).foam
    enough = 2.0 * foam.plateau_stress * 0.05 * block.depth
    strains = np.zeros((block.columns, block.rows - 1))

    def found(column: int, strain: float, force: float) -> bool | None:
        crushed = strains.copy()
        crushed[column] = strain
        snapshot = make_snapshot(block, e_min_b=crushed)
        return impact.bottomed_out(braked(snapshots=[snapshot], contact_force_N=force))

    middle = block.columns // 2
    assert found(middle, -0.81, 1.1 * enough) is True
    assert found(middle, -0.79, 1.1 * enough) is False
    assert found(middle, -0.81, 0.9 * enough) is False
    assert found(0, -0.81, 1.1 * enough) is False  # beside the face
    assert impact.bottomed_out(braked()) is None  # nothing to tell by


def test_an_impactor_passes_through_or_past(make_result) -> None:
    """Below a block without a support; or clear of all foam for two cells, until the end."""
    t = np.arange(0.0, 0.0505, 1e-3)
    no_support = scene_with(FlatBlock(), base=Base(stops_impactor=False))

    def end(scene: Scene, touches_until: float) -> tuple[bool | None, bool | None]:
        result = make_result(
            scene=scene,
            time=t,
            velocity_m_s=2.0,
            displacement_m=2.0 * t,
            contact_force_N=np.where(t <= touches_until, 1.0, 0.0),
        )
        summary = measures.summary(result)
        assert summary["max_displacement_m"] == pytest.approx(0.1 - scene.impactor.gap)
        assert bool(summary["passed_through"]) == any("left the foam" in w for w in result.warnings)
        return summary["passed_through"], summary["bottomed_out"]

    assert end(no_support, 1.0) == (True, None)
    assert end(scene_with(FlatBlock()), 1.0) == (False, True)  # on the support
    assert end(scene_with(FlatBlock(gap=0.02)), 0.030) == (True, None)
    assert end(scene_with(FlatBlock(gap=0.02)), 0.0499) == (False, None)


def test_a_light_impactor_touches_between_two_rows(make_result) -> None:
    """No row knows of a force; the velocity tells."""
    result = make_result(
        scene=scene_with(FlatBlock(mass=1e-9)),
        time=(0.0, 1e-4, 2e-4),
        velocity_m_s=(3.0, -2.0, -2.0),
        displacement_m=(0.0, -1e-4, -3e-4),
        deceleration_m_s2=(0.0, 5e4, 0.0),
    )
    found = measures.summary(result)
    assert found["came_to_rest"] is True
    assert found["max_displacement_m"] == pytest.approx(0.5 * 3.0 * 6e-5)


# --- other histories --------------------------------------------------------------------------


def test_half_sine_pulse(make_result) -> None:
    """a = P sin(pi t/T) with v0 = P T/pi: stops at T/2, P T^2/pi^2 deep, returns at v0."""
    P, T = 100.0, 0.08
    v0 = P * T / math.pi
    t = np.linspace(0, T, 801)
    w = math.pi / T
    v = v0 * np.cos(w * t)
    result = make_result(
        scene=scene_with(FlatBlock()),
        time=t,
        velocity_m_s=v,
        displacement_m=v0 / w * np.sin(w * t),
        deceleration_m_s2=np.append(0.0, -np.diff(v) / np.diff(t)),
        contact_force_N=MASS * P * np.sin(w * t),
    )
    assert impact.impact(result).duration == pytest.approx(T / 2, rel=1e-9)
    assert loads.max_displacement(result) == pytest.approx(P * T**2 / math.pi**2, rel=1e-9)
    assert loads.rebound_velocity(result) == pytest.approx(v0, rel=1e-12)
    start, end = 3e-3, 0.85 * T / 2
    mean = v0 * (math.cos(w * start) - math.cos(w * end)) / (end - start)
    assert loads.plateau(result) == pytest.approx(mean, rel=1e-9)


def test_plateau_weighs_rows_by_their_length(slowed) -> None:
    """60 m/s2 in short rows, then 80 in long ones, both inside the window for a known time."""
    t = np.concatenate([np.arange(0, 0.02, 1e-4), np.arange(0.02, 0.0601, 1e-3)])
    v0 = 60.0 * 0.02 + 80.0 * 0.02  # stops at 40 ms
    result = slowed(t, v0, np.where(t <= 0.02 + 1e-9, 60.0, 80.0))
    assert impact.impact(result).duration == pytest.approx(0.04)
    # The window runs from 3 ms to 34 ms: 17 ms of the one, 14 ms of the other.
    assert loads.plateau(result) == pytest.approx((17 * 60 + 14 * 80) / 31)


def test_plateau_of_a_wedge_begins_when_its_nose_is_in(make_result) -> None:
    """Free of force down to 25 mm, then 70 m/s2."""
    v0, a = 2.5, 70.0
    nose_in = 0.025 / v0
    t = np.linspace(0, 0.05, 501)
    since = np.clip(t - nose_in, 0, None)
    result = make_result(
        scene=scene_with(Wedge()),
        time=t,
        velocity_m_s=v0 - a * since,
        displacement_m=v0 * t - 0.5 * a * since**2,
        deceleration_m_s2=np.where(t > nose_in + 1e-9, a, 0.0),
        contact_force_N=1.0,
    )
    assert loads.plateau(result) == pytest.approx(a, rel=1e-9)


def test_initial_peak_is_the_first_of_a_flat_face(braked) -> None:
    smooth = np.full(braked().history["time_s"].shape, 74.0)
    smooth[20], smooth[80] = 97.0, 120.0  # at 2 and at 8 ms
    peak = loads.initial_peak(braked(deceleration_smoothed_m_s2=smooth))
    assert peak == pytest.approx((97.0, 2e-3))
    nose = braked(Cylinder(), deceleration_smoothed_m_s2=smooth)
    tilted = braked(FlatBlock(rotation_deg=5.0), deceleration_smoothed_m_s2=smooth)
    assert loads.initial_peak(nose) is None
    assert loads.initial_peak(tilted) is None


def test_an_impactor_that_never_touches_has_no_impact(make_result) -> None:
    result = make_result(time=np.linspace(0, 0.01, 11), velocity_m_s=3.0)
    assert impact.impact(result) is None


# --- energy -----------------------------------------------------------------------------------


def test_energy_residual_is_the_worst_with_its_sign(braked) -> None:
    residual = np.zeros(braked().history["time_s"].shape)
    residual[30], residual[200], residual[-1] = 0.01, -0.02, 0.005
    result = braked(residual_J=residual)
    assert soundness.energy_residual(result) == pytest.approx(-0.02 / ENERGY, rel=1e-12)


def test_energy_residual_without_impactor_and_without_energy(make_result) -> None:
    nan = math.nan
    moving = make_result(
        impactor_kinetic_J=[nan, nan], foam_kinetic_J=[2.0, 1.0], residual_J=[0.0, 0.5]
    )
    assert soundness.energy_residual(moving) == pytest.approx(0.25)
    assert soundness.energy_residual(make_result()) is None


# --- the summary ------------------------------------------------------------------------------


def test_summary_of_a_run(braked, make_snapshot) -> None:
    impactor = Wedge(velocity=V0)
    split = make_snapshot(
        Block(), a=[(19, j) for j in range(21)], times=lambda i, j: 1e-3 * (21 - j)
    )
    counts = np.arange(braked().history["time_s"].size)
    plain = braked(impactor, broken_bonds=counts)
    run = {
        "steps": 1234,
        "dt_min_s": 1e-6,
        "dt_max_s": 2e-6,
        "wall_s": 0.5,
        "node_stages_per_s": 4e7,
        "max_overlap_m": 5e-5,
        "interrupted": False,
    }
    found = measures.summary(
        Result(plain.scene, plain.history, [make_snapshot(Block()), split], run)
    )
    assert found["scene"] == "hand-made"
    assert found["impact_duration_s"] == pytest.approx(STOP)
    assert found["max_displacement_m"] == pytest.approx(DEPTH)
    assert found["energy_absorbed_J"] == pytest.approx(ENERGY)
    assert found["pieces"] == 2
    assert found["crack_lowest_height_m"] == pytest.approx(0.0)
    assert found["crack_start_height_m"] == pytest.approx(0.1)
    assert found["crack_start_time_s"] == pytest.approx(1e-3)
    assert found["crushed_width_m"] is None
    assert found["initial_peak_m_s2"] is None
    assert found["broken_bonds"] == counts[-1]
    assert found["max_overlap_cells"] == pytest.approx(0.01)
    assert found["interrupted"] is False
    assert {key: found[key] for key in list(run)[:5]} == dict(list(run.items())[:5])


def test_summary_without_impactor_and_of_nothing(make_result, make_snapshot) -> None:
    scene = Scene(name="bar", numerics=Numerics(end=1e-3))
    without = make_result(
        scene=scene,
        snapshots=[make_snapshot(Block())],
        displacement_m=math.nan,
        velocity_m_s=math.nan,
        deceleration_m_s2=math.nan,
        contact_force_N=math.nan,
        run={"max_overlap_m": 0.0},
    )
    found = measures.summary(without)
    assert found["pieces"] == 1
    known = {"scene", "pieces", "broken_bonds", "interrupted", "warnings", "assumed"}
    assert {key for key, value in found.items() if value is not None} == known

    empty = make_result(time=[], run={"ended_by": Ending.INTERRUPTED})
    found = measures.summary(empty)
    assert found["interrupted"] is True
    assert {key for key, value in found.items() if value is not None} == {
        "scene",
        "drop",
        "contact_height_m",
        "interrupted",
        "warnings",
        "assumed",
    }
