"""How strong bonds are: Weibull's distribution, and saw cuts."""

import math
import subprocess
import sys

import numpy as np
import pytest
from bench import bench, numerics, small_scene
from reference_lattice import reference_positions
from scipy.stats import kstest, weibull_min

from taichi_foam.analysis.fragments import pieces
from taichi_foam.engine.grading import cuts, strengths, weibull_modulus
from taichi_foam.scene import Base, Block, Foam, Model, Numerics, Scene, Start
from taichi_foam.simulation.simulate import run

BIG = Block(mass_points="cells", width=1.0, height=1.0, columns=200, rows=200)
COUNT = 2 * 200 * 200


def scattered(scatter: float, seed: int = 0, block: Block = BIG) -> np.ndarray:
    foam = Foam(strength_scatter=scatter, strength_seed=seed)
    return strengths(Scene(block=block, foam=foam, numerics=Numerics(end=1e-3)))


@pytest.mark.parametrize("scatter", [1e-12, 1e-5, 1e-3, 0.05, 0.2, 0.5])
def test_the_modulus_gives_the_scatter(scatter: float) -> None:
    """By SciPy's moments, whose difference rounds by 1e-16 over the scatter's square.

    Below 1e-4 the modulus is pi / sqrt(6) over the scatter, to the first order of the scatter.
    """
    found = weibull_modulus(scatter)
    assert found == pytest.approx(math.pi / math.sqrt(6.0) / scatter, rel=scatter)
    if scatter >= 1e-3:
        mean, variance = weibull_min(found).stats("mv")
        assert math.sqrt(variance) / mean == pytest.approx(scatter, rel=1e-15 / scatter**2 + 1e-10)


@pytest.mark.parametrize("scatter", [0.05, 0.2, 0.5])
def test_a_big_blocks_strengths_have_the_mean_and_the_scatter(scatter: float) -> None:
    """Within four standard errors: of the mean s / sqrt(n), of s by the fourth moment."""
    found = scattered(scatter).ravel()
    assert len(found) == COUNT
    assert found.mean() == pytest.approx(1.0, abs=4 * scatter / math.sqrt(COUNT))
    kurtosis = float(weibull_min(weibull_modulus(scatter)).stats("k")) + 3.0
    error = 0.5 * scatter * math.sqrt((kurtosis - 1.0) / COUNT)
    assert found.std() == pytest.approx(scatter, abs=4 * error)


@pytest.mark.parametrize("scatter", [0.05, 0.2, 0.5])
def test_strengths_are_weibulls(scatter: float) -> None:
    """Kolmogorov-Smirnov: a fixed draw, as likely as one in a thousand or more."""
    modulus = weibull_modulus(scatter)
    law = weibull_min(modulus, scale=1 / math.gamma(1 + 1 / modulus))
    assert kstest(scattered(scatter).ravel(), law.cdf).pvalue > 1e-3


def test_a_seed_draws_the_same_again_and_another_others() -> None:
    first = scattered(0.2, seed=1)
    np.testing.assert_array_equal(scattered(0.2, seed=1), first)
    other = scattered(0.2, seed=2)
    assert not np.any(other == first)
    # independent: their correlation is 0 within four of its standard errors
    correlation = np.corrcoef(first.ravel(), other.ravel())[0, 1]
    assert abs(correlation) < 4 / math.sqrt(COUNT)


def test_without_scatter_all_are_equally_strong_whatever_the_seed() -> None:
    np.testing.assert_array_equal(scattered(0.0, seed=7), np.ones((200, 200, 2)))


@pytest.mark.parametrize("scatter", [1e-300, 1e-9, 1e-5])
def test_hardly_any_scatter_is_hardly_any(scatter: float) -> None:
    """The weakest of n lies by ln(n) / modulus below the others, some 12 scatters."""
    assert np.abs(scattered(scatter) - 1.0).max() < 20 * scatter + 1e-15


@pytest.mark.parametrize(("axis", "within"), [(0, (9, 20)), (1, (10, 19))])
def test_a_block_breaks_connection_by_connection_at_its_own_strength(
    axis: int, within: tuple[int, int]
) -> None:
    """Pulled by 4.5 % along one axis: the breaks are those below 0.9 of the mean."""
    foam = Foam(softening=False, strength_scatter=0.2, strength_seed=3)
    scene = small_scene(
        base=Base(kind="floor"), foam=foam, model=Model(self_contact=False),
        numerics=numerics(dt=1e-9),
    )  # fmt: skip
    stretch = np.ones(2)
    stretch[axis] = 1.045
    with bench(scene, position=reference_positions(scene) * stretch + [0.0, 0.5]) as loaded:
        after = loaded.step(1)
    weak = strengths(scene)[: within[0], : within[1], axis] < 0.9
    broken = (after.broken_a, after.broken_b)[axis]
    np.testing.assert_array_equal(broken, weak)
    assert 0.1 < broken.mean() < 0.5
    assert not (after.broken_b, after.broken_a)[axis].any()


# Four by three nodes, 1 cm apart: x = -15, -5, 5, 15 mm; y = 5, 15, 25 mm.
FEW = Block(mass_points="cells", width=0.04, height=0.03, columns=4, rows=3)
MM = 1e-3
CUTS = {
    "vertical, between the middle columns": (
        (0, 0, 0, 30), [(1, 0), (1, 1), (1, 2)], [],
    ),
    "the same upside down": ((0, 30, 0, 0), [(1, 0), (1, 1), (1, 2)], []),
    "vertical, to the middle of the block": ((0, 40, 0, 12), [(1, 1), (1, 2)], []),
    "horizontal, below the top row": (
        (-20, 20, 20, 20), [], [(0, 1), (1, 1), (2, 1), (3, 1)],
    ),
    "horizontal, short": ((-8, 20, 8, 20), [], [(1, 1), (2, 1)]),
    # node (1, 1) is cut off from its neighbours to the right and above
    "diagonal": ((-7, 22, 2, 13), [(1, 1)], [(1, 1)]),
    "diagonal through the block": ((-15, 0, 15, 30), [(0, 0), (1, 1), (2, 2)], [(1, 0), (2, 1)]),
    # its nodes belong to the left of the cut: upwards that is x < -5 mm, downwards x > -5 mm
    "up through the nodes of a column": ((-5, 0, -5, 30), [(1, 0), (1, 1), (1, 2)], []),
    "down through the nodes of a column": ((-5, 30, -5, 0), [(0, 0), (0, 1), (0, 2)], []),
    "to the right through the nodes of a row": (
        (-20, 15, 20, 15), [], [(0, 0), (1, 0), (2, 0), (3, 0)],
    ),
    "beside the block": ((30, 0, 30, 30), [], []),
    "above the block": ((-20, 40, 20, 40), [], []),
    "between four nodes, touching no line": ((-2, 8, 2, 12), [], []),
    "a point": ((0, 15, 0, 15), [], []),
}  # fmt: skip


def cut_scene(*cuts: tuple, block: Block = FEW, **parts) -> Scene:
    """Cuts in mm."""
    metres = tuple(tuple(c * MM for c in cut) for cut in cuts)
    return Scene(block=block, start=Start(cuts=metres), numerics=Numerics(end=1e-3), **parts)


def cut_bonds(scene: Scene) -> tuple[list, list]:
    found = cuts(scene)
    a, b = found[:-1, :, 0], found[:, :-1, 1]
    np.testing.assert_array_equal(strengths(scene), 1.0)
    return sorted(map(tuple, np.argwhere(a).tolist())), sorted(map(tuple, np.argwhere(b).tolist()))


@pytest.mark.parametrize("name", CUTS)
def test_a_cut_breaks_what_it_crosses(name: str) -> None:
    line, a, b = CUTS[name]
    assert cut_bonds(cut_scene(line)) == (a, b)


def test_two_cuts_that_meet_on_a_connection_cut_it_and_all_others_once() -> None:
    """A cut in two halves is as good as whole, wherever it is divided."""
    whole = cut_bonds(cut_scene((0, 0, 0, 30)))
    for middle in (5, 10, 15):
        halves = cut_scene((0, 0, 0, middle), (0, middle, 0, 30))
        assert cut_bonds(halves) == whole


def test_a_cut_leaves_what_scatter_gave_the_others() -> None:
    foam = Foam(strength_scatter=0.3)
    scene = cut_scene((0, 0, 0, 30), foam=foam)
    np.testing.assert_array_equal(strengths(scene), scattered(0.3, block=FEW))
    assert cuts(scene)[1, :, 0].all()


@pytest.mark.parametrize(
    "line", [(0, -10, 0, 110), (-30, 42, 30, 77), (-50, 100, 40, -20)], ids=str
)
def test_a_block_that_is_cut_through_is_two_pieces_from_the_start(line: tuple) -> None:
    block = small_scene().block
    scene = cut_scene(line, block=block)
    first, *_, last = run(scene).snapshots
    for state in (first, last):
        assert pieces(state, block) == 2
        cut_a, cut_b = (found.tolist() for found in (state.broken_a, state.broken_b))
        assert [cut_a, cut_b] == [
            cuts(scene)[:-1, :, 0].tolist(),
            cuts(scene)[:, :-1, 1].tolist(),
        ]
    # without a load they stay where they are, to rounding
    np.testing.assert_allclose(last.position, first.position, rtol=0, atol=1e-16)


def test_cut_faces_neither_pull_nor_shear() -> None:
    """The halves of a block that is cut from top to bottom, drawn apart: each stays at rest."""
    block = small_scene().block
    scene = cut_scene((0, -10, 0, 110), block=block, base=Base(kind="floor"))
    position = reference_positions(scene) + np.array([0.0, 0.5])
    position[5:] += [1e-3, 2e-3]
    with bench(scene, position=position) as loaded:
        after = loaded.step(50)
    np.testing.assert_allclose(after.velocity, 0.0, atol=1e-9)


def test_the_solver_is_loaded_for_scatter_only() -> None:
    """It takes half a second, which every run would wait for."""
    code = "import sys, taichi_foam.simulation.simulate\nprint('scipy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split()[-1] == "False"
