"""`taichi-foam serve` refuses bad input before it computes or writes anything."""

from __future__ import annotations

import os
import signal
import socket
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from command_line import assert_refused


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["no/such"], "no such file and no built-in scene"),
        (["paper/wedge-2.86", "--set", "impactor.mass=-1"], "impactor.mass = -1"),
        (["paper/wedge-2.86", "--choices", "mine"], "choices = 'mine'"),
        (["paper/wedge-2.86", "--dt", "1"], "numerics.dt"),
        (["paper/wedge-2.86", "--port", "70000"], "port = 70000: must be 0 to 65535"),
        (
            ["paper/wedge-2.86", "--port", "0", "--host", "no.such.invalid"],
            "this machine has no such address",
        ),
        (["paper/wedge-2.86", "--port", "0", "--host", "192.0.2.1"], "cannot be used"),
        (["paper/wedge-2.86", "--port", "0", "--out", "file/below"], "a file, not a folder"),
        (["paper/wedge-2.86", "--port", "0", "--threads", "0"], "threads = 0: choose"),
        (["paper/wedge-2.86", "--port", "0", "--arch", "abacus"], "arch = 'abacus': choose one"),
    ],
)
def test_what_cannot_be_is_refused_with_a_reason(
    invoke: Callable, arguments: list[str], words: str
) -> None:
    Path("file").touch()
    assert_refused(invoke("serve", *arguments, "--no-open"), words)
    assert [path.name for path in Path().iterdir()] == ["file"]


def test_a_port_in_use_is_named(invoke: Callable) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        result = invoke("serve", "paper/wedge-2.86", "--port", str(port), "--no-open")
    assert_refused(result, f"port = {port}: in use; choose another, or 0 for any free port")


def test_ctrl_c_while_the_device_is_awaited_ends_it(
    invoke: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    from taichi_foam.live.page.view import PageView

    def press_soon(view: PageView) -> None:
        threading.Timer(0.3, os.kill, [os.getpid(), signal.SIGINT]).start()

    # a device that never says anything
    monkeypatch.setattr(PageView, "start", press_soon)
    monkeypatch.setattr(PageView, "close", lambda view: False)
    start = time.monotonic()
    result = invoke("serve", "paper/wedge-2.86", "--port", "0", "--threads", "1", "--no-open")
    assert time.monotonic() - start < 20.0
    assert result.exit_code == 130
    assert "there was nothing to save yet" in result.stderr


def test_the_page_is_part_of_the_package() -> None:
    from taichi_foam.live.page import server

    for name in server._PARTS:
        plain, packed, tag = server._read(name)
        assert plain
        assert packed
        assert tag
