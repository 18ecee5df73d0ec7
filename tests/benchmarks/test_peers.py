"""The engine against an independent implementation: plain C++ that shares none of its code."""

import numpy as np
import pytest

from taichi_foam.shim2000.tests import paper_scene
from taichi_foam.simulation.simulate import simulate

END = 3e-3  # s: later the motion is chaotic, and grows the last bit into another crack
TOLERANCE = 1e-9  # m: both give the same numbers but for the last bits, about 1e-16 m


@pytest.mark.parametrize("name", ["paper/rectangular-3.03", "paper/wedge-2.86"])
def test_plain_cpp_moves_nodes_and_impactor_as_the_engine_does(name: str) -> None:
    from peers import Plain, Skipped
    from peers.check import bare

    peer = Plain.load()
    if isinstance(peer, Skipped):
        pytest.skip(peer.reason)
    scene = bare(paper_scene(name))
    numerics = scene.numerics.model_copy(update={"end": END})
    peer.prepare(scene)
    for snapshot in simulate(scene.model_copy(update={"numerics": numerics})):
        while (state := peer.state()).time < snapshot.time - 0.5 * state.step:
            peer.advance(1)
        assert state.time == pytest.approx(snapshot.time, abs=1e-12)
        breaks = (snapshot.break_time_a, snapshot.break_time_b)
        assert state.broken == sum(np.isfinite(times).sum() for times in breaks)
        apart = np.abs(state.position - snapshot.position).max()
        assert apart < TOLERANCE
        assert abs(state.impactor_y - snapshot.impactor_y) < TOLERANCE
    assert snapshot.time >= END
    assert state.broken > 0, "nothing has broken: the test is too short to see it"
