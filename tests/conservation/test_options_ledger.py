"""Mirror symmetry holds with every option that acts on breaking foam and has a mirror image."""

import pytest
from bench import small_scene
from test_momentum import is_mirrored

from taichi_foam.scene import FlatBlock, Foam, Model, Numerics, Output
from taichi_foam.simulation.simulate import simulate

SENSITIVE = {"rate": 200.0, "rate_exponent": 2.0, "overshoot_strain": 0.02}


@pytest.mark.parametrize("shear", ["cell", "face"])
def test_mirror_symmetry_holds_to_the_last_bit(shear: str) -> None:
    """Without self-contact, whose lists have an order; scatter would have no mirror image."""
    scene = small_scene(
        impactor=FlatBlock(width=0.02, mass=0.2, velocity=10.0),
        foam=Foam(**SENSITIVE),
        model=Model(self_contact=False, shear=shear, shear_failure="angle"),
        numerics=Numerics(end=5e-3),
        output=Output(snapshot_interval=5e-4),
    )
    snapshots = list(simulate(scene))
    assert [is_mirrored(each) for each in snapshots] == [True] * len(snapshots)
    assert snapshots[-1].broken_a.sum() + snapshots[-1].broken_b.sum() > 10
