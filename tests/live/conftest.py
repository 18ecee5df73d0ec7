"""One session for all tests of a module; who kills its worker has it replaced."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from processes import until
from sessions import ENDLESS, PACE, Keeper

from taichi_foam.live.messages import Pace
from taichi_foam.live.screen import Screen
from taichi_foam.live.session import Session
from taichi_foam.results.result import Result


@pytest.fixture(scope="module")
def keeper() -> Keeper:
    return Keeper()


@pytest.fixture(scope="module")
def shared(keeper: Keeper) -> Iterator[Session]:
    with Session(ENDLESS, keeper, pace=PACE) as session:
        yield session


@pytest.fixture
def session(shared: Session, keeper: Keeper) -> Session:
    """As it is at first, but for its number: an endless drop, being prepared."""
    seen = Screen(shared)
    until(lambda: shared.state != "preparing", "nothing is computed", turn=seen.update)
    keeper.first = lambda: None
    shared.save()
    shared.tell(Pace(PACE))
    shared.drop(shared.given)
    keeper.kept.clear()
    shared.failures.clear()
    shared.was_cut = False
    return shared


@pytest.fixture
def kept(keeper: Keeper) -> list[Result]:
    return keeper.kept
