"""Progress without a terminal, interrupts that wait, and the package's public names."""

from __future__ import annotations

import re
import signal
from io import StringIO
from time import sleep

import pytest
from rich.console import Console

import taichi_foam
from taichi_foam.interrupts import held_interrupts
from taichi_foam.simulation import progress
from taichi_foam.simulation.progress import Bars
from taichi_foam.simulation.simulate import Progress


def test_a_log_gets_one_line_for_each_stage() -> None:
    log = StringIO()
    bars = Bars(Console(file=log))
    with bars.computing("9 impacts") as update:
        update(Progress(time=0.01, fraction=0.5, steps=6_000, wall=1.0))
        update(Progress(time=0.02, fraction=1.0, steps=24_000, wall=2.0))
    with bars.counting("films", "drawing films", 2, "frames") as advance:
        advance()
        advance()
    first, second = log.getvalue().splitlines()
    assert first.startswith("computing 9 impacts: ")
    assert "24,000 steps, 12k steps/s" in first
    assert second.startswith("drawing films: ")
    assert second.endswith("(2 frames)")
    assert list(bars.seconds) == ["computing", "films"]


def test_a_log_is_told_every_so_often_how_far_a_count_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(progress, "LINE_S", 0.2)
    log = StringIO()
    with Bars(Console(file=log)).counting("computing", "drops", 1200, "drops") as advance:
        sleep(0.3)
        advance(300)
        sleep(0.2)
    first, second, last = log.getvalue().splitlines()
    assert first == "0 of 1,200 drops"
    # 300 in 0.4 s: the other 900 take three times as long
    found = re.fullmatch(r"300 of 1,200 drops, (\d+)/s, about (1\.\d) s left", second)
    assert found is not None
    assert float(found[1]) * float(found[2]) == pytest.approx(900, rel=0.06)
    assert last.startswith("drops: ")


def test_a_terminal_of_80_columns_sees_time_rate_and_time_left() -> None:
    screen = StringIO()
    console = Console(file=screen, force_terminal=True, width=80, color_system=None)
    with Bars(console).computing("a scene with a rather long name") as update:
        update(Progress(time=0.0100, fraction=0.4, steps=6_000, wall=0.8))
        sleep(0.01)
        update(Progress(time=0.0123, fraction=0.5, steps=7_500, wall=1.0))
    assert "12.3 ms, 7.5k steps/s" in screen.getvalue()
    assert re.search(r"\d:\d\d:\d\d\s+(\x1b\S*)?left", screen.getvalue())


def test_a_stage_that_fails_says_nothing_and_keeps_its_time() -> None:
    log = StringIO()
    bars = Bars(Console(file=log))
    with pytest.raises(KeyboardInterrupt), bars.counting("films", "drawing", 2, "frames"):
        raise KeyboardInterrupt
    assert log.getvalue() == ""
    assert bars.seconds["films"] >= 0


def test_ctrl_c_waits_for_the_block_to_end() -> None:
    done = False
    with held_interrupts() as pressed:
        assert not pressed.is_set()
        signal.raise_signal(signal.SIGINT)
        done = True
    assert done
    assert pressed.is_set()
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_the_outer_of_two_holds_tells() -> None:
    with held_interrupts() as outer:
        with held_interrupts() as inner:
            signal.raise_signal(signal.SIGINT)
        assert not inner.is_set()
        assert outer.is_set()


def test_a_process_that_ignores_interrupts_goes_on_ignoring_them() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with held_interrupts() as pressed:
            signal.raise_signal(signal.SIGINT)
        assert not pressed.is_set()
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_the_package_shows_its_public_names_and_nothing_else() -> None:
    assert dir(taichi_foam) == sorted(taichi_foam.__all__)
    assert {"init", "load", "run", "simulate_many", "Ending", "Snapshot"} <= set(dir(taichi_foam))


def test_every_public_name_is_there() -> None:
    for name in taichi_foam.__all__:
        assert getattr(taichi_foam, name) is not None
    assert callable(taichi_foam.run)
    with pytest.raises(AttributeError, match="no attribute 'runn'"):
        _ = taichi_foam.runn
