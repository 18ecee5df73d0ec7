"""Every scene of the gallery runs and gives what its text promises.

Those with a closed form run to their end, the drops on the paper's block for their first 12 ms,
and the big one for a few steps.
"""

import math
import runpy
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from taichi_foam.analysis.impact import impact
from taichi_foam.analysis.loads import compression_curve
from taichi_foam.catalogue import load_scene
from taichi_foam.picture.look import Look
from taichi_foam.results.result import Result
from taichi_foam.scene import Curve, Scene
from taichi_foam.simulation.simulate import run, run_drops
from taichi_foam.units import STANDARD_GRAVITY

SCENES = Path(__file__).parents[2] / "scenes"
CLOSED_FORMS = ("uniaxial_crush", "shear_patch", "wave_bar")
DROPS = ("rectangular", "cylinder", "wedge", "corner_drop")
BIG = ("fine_wedge",)
TABLES = (
    "flat_tall_block",
    "i_shape_off_centre",
    "own_foam",
    "edge_pad",
    "corner_pad",
    "layered_pad",
    "five_drops",
    "compression_test",
)

# Kelvin-Voigt: a bond's dashpot adds this much stress per strain rate, tau K.
VISCOSITY = 2.78e6 * 1e-6 / 0.057  # Pa s


def script(name: str) -> SimpleNamespace:
    """Everything that a scene's script defines."""
    return SimpleNamespace(**runpy.run_path(str(SCENES / f"{name}.py"), run_name="scene"))


@cache
def whole_run(name: str) -> Result:
    """The run of a script's scene, to its end."""
    return run(script(name).scene)


def test_no_scene_is_forgotten_here() -> None:
    assert {p.stem for p in SCENES.glob("*.py")} == {*CLOSED_FORMS, *DROPS, *BIG}
    assert {p.stem for p in SCENES.glob("*.toml")} == {*TABLES}


def test_uniaxial_crush_gives_back_its_stress_strain_curve() -> None:
    """Nominal stress within 0.1 % of Eq. 26 plus the dashpots' tau K times the strain rate.

    The strain is of the top row, which the penalty lets into the plate by force over stiffness. On
    the way to yield the plate's arrival rings in the column: rho c v = 8.4 kPa, to and fro.
    """
    crush = script("uniaxial_crush")
    history = run(crush.scene).history
    penalty = crush.scene.numerics.contact_stiffness * 2.78e6 * 0.057 * crush.block.columns
    top = history["displacement_m"] - history["contact_force_N"] / penalty
    strain = np.array([crush.nominal_strain(d) for d in top])
    stress = -history["contact_force_N"] / crush.section
    exact = np.array([crush.exact_stress(e) for e in strain])
    sound = 25.6 * math.sqrt(2.78e6 / 25.6) * crush.SPEED
    elastic = (strain > -0.05) & (strain < 0)
    assert np.abs(stress - exact)[elastic].max() < sound
    crushed = strain < -0.06
    viscous = VISCOSITY * crush.SPEED / crush.gauge_length
    np.testing.assert_allclose(stress[crushed], exact[crushed] - viscous, rtol=1e-3)
    assert strain[-1] == pytest.approx(-crush.FINAL_STRAIN, abs=0.002)
    assert exact[-1] < 1.4 * exact[crushed][0]  # it ends deep in densification


def test_shear_patch_unloads_from_its_top() -> None:
    """Within 2 % of gamma H everywhere at mid-width, within 0.2 % at the top.

    The front is a kink, which the lattice rounds over a few of its 20 cells: half a cell's worth of
    displacement is 1.3 %. Terms of finite strain are of the order of gamma^2 = 0.25 %, of heights
    half that.
    """
    patch, result = script("shear_patch"), whole_run("shear_patch")
    block, full = patch.scene.block, patch.GAMMA * patch.layer
    middle = slice(block.columns // 2 - 1, block.columns // 2 + 1)
    heights = block.positions[0, :, 1]
    assert len(result.snapshots) >= 20
    for state in result.snapshots:
        found = state.position[middle, :, 0].mean(axis=0)
        exact = [patch.exact_displacement(y, state.time) for y in heights]
        assert np.abs(found - exact).max() < 0.02 * full
        assert abs(found[-1] - exact[-1]) < 0.002 * full
    # the top's mass point is half a cell below the top that the front starts from
    later = [s for s in result.snapshots if s.time > 1e-4]
    for state in later:
        top = state.position[middle, -1, 0].mean()
        assert top == pytest.approx(patch.exact_top_displacement(state.time), abs=0.005 * full)


@pytest.mark.parametrize("name", ["shear_patch", "wave_bar"])
def test_pictures_of_waves_show_them(name: str) -> None:
    """Neither crushes its foam, but on its way a wave leaves a part moving and a part at rest."""
    result = whole_run(name)
    look, state = Look.of(result.scene), result.snapshots[len(result.snapshots) // 4]
    shares = look.shown.values(state, result.scene) / look.shown.key(result.scene).top
    assert np.mean(shares > 0.3) > 0.2
    assert np.mean(shares < 0.1) > 0.4


def test_wave_bar_is_a_dashpot_to_its_plate() -> None:
    """Until the reflection, smeared over sqrt(tau t) = 0.3 ms by the dashpots, is felt at 4.5 ms.

    The front takes more momentum than the continuum's, Z tau / 2 for the dashpots' part of the
    impedance Z sqrt(1 + s tau): 0.04 % of the plate's mass, the velocity that it lacks from the
    start.
    """
    bar, history = script("wave_bar"), whole_run("wave_bar").history
    time = history["time_s"]
    felt = (time > 3e-4) & (time < 4.5e-3)
    exact = np.array([bar.exact_velocity(t) for t in time[felt]])
    lack = bar.impedance * bar.scene.numerics.damping_time / (2 * bar.plate.mass)
    assert lack == pytest.approx(0.00042, rel=0.05)
    np.testing.assert_allclose(history["velocity_m_s"][felt], exact * (1 - lack), rtol=2e-4)
    # the plate rings on its penalty, damped away in the first millisecond
    late = felt & (time > 1e-3)
    force = np.array([bar.exact_force(t) for t in time[late]])
    np.testing.assert_allclose(history["contact_force_N"][late], force, rtol=0.005)
    back = time > 2 * (bar.block.height / bar.wave_speed) - 1e-4
    assert np.all(history["contact_force_N"][back] > 1.3 * bar.exact_force(bar.reflection_time))


def first_ms(scene: Scene, milliseconds: float) -> Result:
    short = {**scene.model_dump(), "numerics": {**scene.numerics.model_dump(),
                                                "end": milliseconds * 1e-3}}  # fmt: skip
    return run(Scene.model_validate(short))


@pytest.fixture(scope="module")
def drops() -> dict[str, Result]:
    return {name: first_ms(script(name).scene, 12.0) for name in DROPS}


def mean_deceleration(result: Result, start_ms: float, end_ms: float) -> float:
    """Time mean over an interval [m/s2]: the velocity lost over it."""
    time, velocity = result.history["time_s"], result.history["velocity_m_s"]
    lost = np.interp([start_ms * 1e-3, end_ms * 1e-3], time, velocity)
    return float(lost[0] - lost[1]) / ((end_ms - start_ms) * 1e-3)


def test_the_flat_block_meets_the_plateau_at_once_and_stays_on_it(drops: dict) -> None:
    """On the mean at least K |e_y| on 50 mm, at most that plus what dashpots and flanks can add.

    A row that is crushed alone takes the whole speed: tau K v / dy = 30 kPa on top of 139 kPa. On
    either flank the front shears a cell at its side, to failure at most: G gamma_t = 84 kPa.
    """
    result = drops["rectangular"]
    block, impactor = result.scene.block, result.scene.impactor
    face = impactor.width * block.depth
    plateau = 1.39e5 * face / impactor.mass
    flanks = 2 * 0.84e6 * 0.10 * block.dy * block.depth
    crushing = (1.39e5 + VISCOSITY * impactor.velocity / block.dy) * face
    most = (crushing + flanks) / impactor.mass
    mean = mean_deceleration(result, 1, 12)
    assert plateau < mean < most
    for start, end in ((1, 3), (3, 6), (6, 9), (9, 12)):  # flat: it stays within a quarter of that
        assert mean_deceleration(result, start, end) == pytest.approx(mean, rel=0.25)


@pytest.mark.parametrize("name", ["cylinder", "wedge", "corner_drop"])
def test_pointed_bodies_meet_more_the_deeper_they_are(drops: dict, name: str) -> None:
    """Their width grows with depth; the flat block is ahead of all of them at first."""
    first, later = (mean_deceleration(drops[name], t, t + 3.0) for t in (0.0, 5.0))
    assert first < later
    assert first < 0.7 * mean_deceleration(drops["rectangular"], 0.0, 3.0)


def test_the_wedges_deceleration_rises_linearly_with_its_depth(drops: dict) -> None:
    """Section 3 of the paper: about linearly until 25 mm; here a straight line through zero."""
    history = drops["wedge"].history
    depth = history["displacement_m"]
    nose = depth < 0.025
    line = np.polyfit(depth[nose], history["deceleration_smoothed_m_s2"][nose], 1)
    rest = history["deceleration_smoothed_m_s2"][nose] - np.polyval(line, depth[nose])
    assert rest.std() < 0.15 * line[0] * 0.025
    assert abs(line[1]) < 0.2 * line[0] * 0.025


def test_the_corner_goes_in_off_its_middle(drops: dict) -> None:
    """Crushed is what lies below the face on the right, 30 degrees; the steep one pushes aside.

    The corner is left of the square's middle, by 25 mm (cos - sin) of 30 degrees.
    """
    result = drops["corner_drop"]
    block = result.scene.block
    depth = result.history["displacement_m"][-1]
    corner = -0.025 * (math.cos(math.radians(30)) - math.sin(math.radians(30)))
    left = corner - depth / math.sqrt(3)
    right = corner + min(depth * math.sqrt(3), 0.05 * math.cos(math.radians(30)))
    assert corner - left < 0.02  # the left face is not all in
    columns = np.nonzero((result.snapshots[-1].e_min_b < -0.5).any(axis=1))[0]
    x = (columns - (block.columns - 1) / 2) * block.dx
    assert left - 2 * block.dx < x.min() < corner + 2 * block.dx
    assert x.max() == pytest.approx(right, abs=2 * block.dx)


def test_the_tall_block_is_hit_after_a_fall_of_10_mm() -> None:
    """Free fall from the gap, then at most the plateau and the dashpots' part on the face."""
    scene = load_scene(SCENES / "flat_tall_block.toml")
    result = first_ms(scene, 15.0)
    history, g, v = result.history, scene.numerics.gravity, scene.impactor.velocity
    arrival = (math.sqrt(v**2 + 2 * g * scene.impactor.gap) - v) / g
    free = history["time_s"] < arrival
    assert free.sum() > 30
    time = history["time_s"][free]
    np.testing.assert_allclose(
        history["displacement_m"][free], v * time + g * time**2 / 2, atol=1e-12
    )
    found = impact(run(load_scene(scene, overrides=["block.columns=8", "block.rows=12"])))
    assert found.contact == pytest.approx(arrival, abs=1e-6)
    assert not history["contact_force_N"][free].any()
    face = scene.impactor.width * scene.block.depth
    later = np.nonzero(history["time_s"] > arrival + 2e-3)[0]
    mean = scene.impactor.mass * (
        mean_deceleration(result, history["time_s"][later[0]] * 1e3, 15.0) + g
    )
    assert 1.39e5 * face < mean < (1.39e5 + VISCOSITY * v / scene.block.dy) * face


def test_the_fine_wedge_is_the_wedge_with_smaller_cells() -> None:
    """Same block and impactor; a step is a fifth as long."""
    fine, coarse = script("fine_wedge").scene, script("wedge").scene
    rubbed = {"friction": coarse.impactor.friction}  # one of the readings that its picture has
    assert fine.impactor.model_copy(update=rubbed) == coarse.impactor
    assert (fine.block.width, fine.block.height) == (coarse.block.width, coarse.block.height)
    assert fine.block.columns * fine.block.rows == 20_200
    end = {"numerics": fine.numerics.model_copy(update={"end": 3e-6})}
    result = run(fine.model_copy(update=end))
    assert 0.049 / result.run["dt_max_s"] == pytest.approx(77_000, rel=0.1)
    assert result.run["max_overlap_m"] < 0.02 * fine.block.dx


def coarse(name: str) -> Scene:
    """A pad in cells of 5 mm instead of 2.5 mm."""
    scene = load_scene(SCENES / f"{name}_pad.toml")
    cell, rows = scene.block.cell, scene.block.rows
    fewer = {"block.rows": rows // 2} if cell is None else {"block.cell": 2 * cell}
    return scene.with_values({**fewer, "output.film": False})


def test_an_edge_pad_carries_by_what_is_below_the_product() -> None:
    """The plateau's force on the columns below it and no more, and the depth of that energy.

    Beside crushing, dashpots, and cracks at its edges, take some by the ledger.
    """
    scene = coarse("edge")
    product, plateau = scene.impactor, scene.foam.landmarks.plateau_stress
    weight = product.mass * STANDARD_GRAVITY
    result = run(scene)
    figures, history = result.summary, result.history
    x = scene.block.positions[:, 0, 0]
    below = scene.block.dx * np.count_nonzero(np.abs(x - product.x) < 0.5 * product.width)
    assert below == pytest.approx(product.width, rel=0.03)
    others = ("damping_J", "friction_J", "fracture_J", "self_contact_J", "folding_J")
    stop = int(np.argmax(history["displacement_m"]))
    beside = sum(history[name][stop] for name in others) / history["displacement_m"][stop]
    force = plateau * below * scene.block.depth + beside
    assert beside < 0.1 * force
    assert product.drop_height is not None
    # the fall's energy, less that the force rises to the plateau while the foam yields
    late = -0.5 * scene.foam.landmarks.crush_start * 0.05
    depth = (weight * product.drop_height + force * late) / (force - weight)
    assert figures["max_displacement_m"] == pytest.approx(depth, rel=0.03)
    assert figures["plateau_deceleration_m_s2"] == pytest.approx(
        (force - weight) / product.mass, rel=0.03
    )


def test_a_corner_pad_hardens_as_its_feet_widen() -> None:
    """The feet are crushed from the base up, and the energy has the depth."""
    scene = coarse("corner")
    product, landmarks = scene.impactor, scene.foam.landmarks
    pressure = landmarks.plateau_stress * scene.block.depth
    weight = product.mass * STANDARD_GRAVITY
    s = np.linspace(0.0, 0.05, 5001)
    depth = -landmarks.crush_end * s
    taken = pressure * -landmarks.crush_end * (0.06 * s + 0.75 * s**2)
    end = int(np.argmax(taken >= weight * (product.drop_height + depth)))
    assert s[end] == pytest.approx(0.0399, abs=1e-4)
    figures = run(scene).summary
    whole = -landmarks.crush_start * (scene.block.height - s[end])  # what is not crushed yields
    assert figures["max_displacement_m"] == pytest.approx(depth[end] + whole, rel=0.05)
    last = (pressure * (0.06 + 1.5 * s[end]) - weight) / product.mass
    assert figures["peak_deceleration_m_s2"] == pytest.approx(last, rel=0.08)
    assert not figures["warnings"]


def test_a_layered_pad_has_two_plateaus() -> None:
    """Each that of its foam, with the dashpots of the paper's; the weak layer goes first."""
    scene = coarse("layered")
    product, block = scene.impactor, scene.block
    result = run(scene)
    history = result.history
    depth, deceleration = history["displacement_m"], history["deceleration_m_s2"]
    falling = history["velocity_m_s"] > 0
    strong = block.layers[0].foam
    for foam, window in ((scene.foam, (0.008, 0.018)), (strong, (0.029, 0.037))):
        during = falling & (depth > window[0]) & (depth < window[1])
        force = foam.landmarks.plateau_stress * block.width * block.depth
        expected = force / product.mass - STANDARD_GRAVITY
        assert deceleration[during].mean() == pytest.approx(expected, rel=0.04)
    assert result.summary["pieces"] == 2
    assert any(
        text.startswith("block.layers[0].density = 40") for text in result.summary["assumed"]
    )


def finely(curve: Curve) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Strain, stress [Pa] and the energy taken until then [J/m3], at many points of a test."""
    strain = np.linspace(0.0, curve.tested, 100_001)
    stress = curve.stress_at(strain)
    taken = np.append(0.0, np.cumsum(0.5 * (stress[1:] + stress[:-1]) * np.diff(strain)))
    return strain, stress, taken


def test_own_foam_meets_the_energy_balance() -> None:
    """Depth and raw peak within 1 % of T W(e) = sigma_st (h + e T) and G = s(e) / sigma_st - 1.

    The scene's dashpots are the paper's; they take what the balance does not know.
    """
    scene = load_scene(SCENES / "own_foam.toml")
    thickness = scene.block.height
    height, mass = scene.impactor.drop_height, scene.impactor.mass
    static = mass * STANDARD_GRAVITY / (scene.block.width * scene.block.depth)
    curve = scene.foam.curve
    strain, stress, taken = finely(curve)
    end = int(np.argmax(thickness * taken >= static * (height + strain * thickness)))
    figures = run(scene).summary
    assert figures["max_displacement_m"] == pytest.approx(strain[end] * thickness, rel=0.01)
    assert figures["peak_deceleration_g"] == pytest.approx(stress[end] / static - 1, rel=0.015)
    assert any(text.startswith("foam.shear_modulus = ") for text in figures["assumed"])
    assert not figures["warnings"]


def test_the_i_shape_is_turned_by_the_lever_of_its_flange() -> None:
    """Spin over velocity change is the lever over the squared radius of gyration.

    70 of 120 mm stand on the cushion, 25 mm beside the centre; the foam is whole and even in the
    first millisecond, but for half a cell at the flange's end and the block's. It leaves over the
    edge, clockwise.
    """
    scene = load_scene(SCENES / "i_shape_off_centre.toml")
    flanges, web = 2 * 0.12 * 0.02, 0.06 * 0.02
    moment = flanges * ((0.12**2 + 0.02**2) / 12 + 0.04**2) + web * (0.06**2 + 0.02**2) / 12
    gyration = moment / (flanges + web)
    assert scene.impactor.squared_gyration == pytest.approx(gyration)
    result = run(scene)
    h, figures = result.history, result.summary
    row = int(np.searchsorted(h.time_s, 1e-3))
    lost = h.velocity_m_s[0] + STANDARD_GRAVITY * h.time_s[row] - h.velocity_m_s[row]
    assert -h.spin_rad_s[row] / lost * gyration == pytest.approx(0.025, rel=0.05)
    assert figures["final_angle_rad"] == pytest.approx(-math.radians(41), abs=0.1)
    assert figures["final_velocity_x_m_s"] > 0.5
    assert figures["peak_resultant_g"] < 20
    assert abs(figures["energy_residual"]) < 1e-3
    assert figures["came_to_rest"]
    assert not figures["passed_through"]
    assert not figures["warnings"]


def test_five_drops_meet_the_energy_balance_one_by_one() -> None:
    """Strains and raw peaks within 3 %; each drop harder than the one before.

    A plate that is wider than the cushion crushes it evenly: a narrower one has the same answer.
    Foam unloads with its Young's modulus, or with the steepest slope of its curve so far.
    """
    whole = load_scene(SCENES / "five_drops.toml")
    narrow = {"block.columns": 8, "block.width": 0.15 * 8 / 60, "impactor.mass": 8.0 * 8 / 60}
    scene = whole.with_values(narrow)
    block, curve, height = scene.block, scene.foam.curve, scene.impactor.drop_height
    thickness = block.height
    static = scene.impactor.mass * STANDARD_GRAVITY / (block.width * block.depth)
    strain, stress, taken = finely(curve)
    slope = np.gradient(stress, strain)
    steepest = np.maximum.accumulate(np.maximum(slope, scene.foam.youngs_modulus))
    worst, figures = 0, [result.summary for result in run_drops(scene, 5)]
    for drop in figures:
        short = (scene.contact_height - drop["contact_height_m"]) / thickness
        stored = stress[worst] ** 2 / (2 * steepest[worst])
        absorbed = thickness * (taken - taken[worst] + stored)
        lost = static * (height + (strain - short) * thickness)
        worst = int(np.argmax((absorbed >= lost) & (strain > strain[worst])))
        assert drop["max_strain"] == pytest.approx(strain[worst], rel=0.03)
        assert drop["peak_deceleration_g"] == pytest.approx(stress[worst] / static - 1, rel=0.03)
    assert strain[worst] > curve.densification + 0.1  # where densified foam was a spring once
    peaks = [drop["peak_deceleration_g"] for drop in figures]
    assert peaks == sorted(peaks)
    assert peaks[4] > 2 * peaks[0]


def test_a_compression_test_gives_its_foams_curve() -> None:
    """Within 2 % from a strain of 0.1 on, by means over 0.05 of strain: it rings."""
    scene = load_scene(SCENES / "compression_test.toml")
    found = compression_curve(run(scene))
    assert found is not None
    strain, stress = found
    assert strain[-1] == pytest.approx(0.7, abs=0.002)
    for low in np.arange(0.1, 0.65, 0.05):
        part = (strain >= low) & (strain < low + 0.05)
        exact = scene.foam.curve.stress_at(strain[part])
        assert stress[part].mean() == pytest.approx(exact.mean(), rel=0.02)
