"""The engine against independent implementations that share none of its code."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np
import pytest
from peers import Batch, Choices, Extent, Plain, Skipped, Vectors, native, scene_with, updated
from peers.check import (
    BATCH_EXTENTS,
    CASES,
    PEERS,
    SOFTENING,
    WIDTHS,
    compare,
    compare_batch,
)
from peers.compile import CompileError
from peers.constants import case_of


def loaded(kind: type, *options: int) -> Any:
    """A peer; a test of one that is not installed is skipped."""
    peer = kind.load(*options)
    if isinstance(peer, Skipped):
        pytest.skip(peer.reason)
    return peer


@pytest.mark.parametrize("choices", get_args(Choices))
@pytest.mark.parametrize("kind", PEERS)
@pytest.mark.parametrize("name", CASES)
def test_peer_moves_nodes_and_impactor_as_the_engine_does(
    name: str, kind: type, choices: Choices
) -> None:
    peer = loaded(kind)
    outcome = compare(peer, name, choices, threads=1)
    assert outcome.passed, outcome
    assert outcome.intact > 1, "bonds broke at once: nothing was compared before that"
    assert outcome.broken > 10, "too few bonds have broken to see what follows"
    # without a rate the worst strain is behind by the last step at most
    assert (outcome.lagging > 6e-3) == (choices == "rated")


@pytest.mark.parametrize("kind", SOFTENING)
@pytest.mark.parametrize("name", CASES)
def test_peer_keeps_room_and_softens_as_the_engine_does(name: str, kind: type) -> None:
    peer = loaded(kind)
    outcome = compare(peer, name, "calibrated", threads=1, extent="room")
    assert outcome.passed, outcome
    assert outcome.intact > 1
    assert outcome.broken > 2, "bonds hold longer, but some have to have gone"
    assert peer.state().works["room"] > 0.0, "no cell has pressed"


@pytest.mark.parametrize("extent", BATCH_EXTENTS)
@pytest.mark.parametrize("bits", WIDTHS)
@pytest.mark.parametrize("name", CASES)
def test_each_lane_moves_its_lattice_as_the_engine_does(
    name: str, bits: int, extent: Extent
) -> None:
    peer = loaded(Batch, bits)
    outcomes = compare_batch(peer, name, extent, threads=1, count=3)
    assert all(outcome.passed for outcome in outcomes), outcomes
    assert all(outcome.intact > 1 for outcome in outcomes)
    # by when softening foam has to be left, few of its bonds have broken
    assert all(outcome.broken > (10 if extent == "peers" else 2) for outcome in outcomes)
    heights = {state.impactor_y for state in peer.states()}
    assert len(heights) == 3, "the lattices do not differ"


def test_batch_refuses_lattices_that_differ_in_their_choices() -> None:
    peer = loaded(Batch)
    scenes = [scene_with("calibrated", extent=extent) for extent in BATCH_EXTENTS]
    with pytest.raises(ValueError, match="one size and one set of choices"):
        peer.prepare(scenes)
    other = updated(scenes[0], {"foam": {"densification_b": 2.0}})
    with pytest.raises(ValueError, match="densification_b"):
        peer.prepare([other])


@pytest.mark.parametrize("kind", [Plain, Vectors])
def test_two_threads_give_the_numbers_of_one(kind: type) -> None:
    peer = loaded(kind)
    states = []
    for threads in (1, 2):
        peer.prepare(scene_with("calibrated"))
        peer.advance(200, threads)
        states.append(peer.state())
    np.testing.assert_array_equal(states[0].position, states[1].position)
    assert states[0].impactor_y == states[1].impactor_y


@pytest.mark.parametrize(
    ("part", "field", "value"),
    [
        ("model", "self_contact", True),
        ("model", "crushed_room", True),
        ("foam", "softening", True),
        ("model", "damping", "absolute"),
        ("model", "shear", "face"),
        ("block", "mass_points", "faces"),
        ("foam", "rate_exponent", 4.0),
        ("foam", "overshoot_strain", 0.02),
        ("foam", "strength_scatter", 0.1),
    ],
)
def test_peers_refuse_choices_that_they_do_not_have(part: str, field: str, value: object) -> None:
    scene = updated(scene_with("rated"), {part: {field: value}})
    with pytest.raises(ValueError, match="the peers do not know"):
        case_of(scene)


def test_peers_refuse_a_circle() -> None:
    with pytest.raises(ValueError, match="no polygon"):
        case_of(scene_with("rated", "paper/cylinder-2.94"))


def test_absent_compiler_is_skipped_and_one_that_fails_is_an_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("peers.compile.shutil.which", lambda name: None)
    assert isinstance(Plain.load(), Skipped)
    monkeypatch.undo()
    monkeypatch.setenv("CXX", "false")  # a program that is there and fails
    monkeypatch.setattr(native, "_library", native._library.__wrapped__)  # none that is loaded
    peer = Plain.load()
    assert isinstance(peer, Plain)
    with pytest.raises(CompileError, match=r"false cannot compile plain\.cpp"):
        peer.prepare(scene_with("rated"))
