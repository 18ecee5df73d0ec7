"""Serving the page: the address, the token, and a clean end."""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import secrets
import signal
import socket
import sys
import threading
import time
import webbrowser
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import uvicorn

from taichi_foam.errors import UserError
from taichi_foam.live.page.app import app_of
from taichi_foam.live.page.gate import Gate, NoNoise
from taichi_foam.live.page.guard import LOOPBACK, Guard
from taichi_foam.live.page.view import PageView

if TYPE_CHECKING:
    from taichi_foam.scene import Scene

#: Longest message that a viewer may send [bytes].
MOST_BYTES = 64 * 1024
#: What the system may hold back for a viewer that does not read [bytes], and for how long [ms].
SEND_BUFFER, MOST_SILENCE = 256 * 1024, 30_000
#: How long a device may take to say that it is there [s].
PATIENCE = 60.0
#: Between two looks whether somebody wants to stop meanwhile [s].
TURN = 0.1


class Server:
    """A scene, served. `run` returns when the server has been told to stop.

    token    without which nothing is served
    address  to open, with the token
    is_open  whether other machines reach it
    """

    def __init__(
        self,
        scene: Scene,
        out: str | Path,
        host: str = "127.0.0.1",
        port: int = 8000,
        arch: str = "cpu",
        threads: int | None = None,
    ) -> None:
        """Check everything and take the port. Raises UserError for what cannot be done."""
        self.view = PageView(scene, Path(out), arch, threads)
        self.view.archive.check(scene)
        self._is_plain = (arch, threads) == ("cpu", None)
        self._socket = _bound(host, port)
        self.token = secrets.token_urlsafe(24)
        self.is_open = not _is_loopback(self._socket)
        bound_port = self._socket.getsockname()[1]
        self.address = _address(host, bound_port, self.token)
        guarded = Guard(app_of(self.view), self.token, bound_port, is_open=self.is_open)
        logging.getLogger("uvicorn.error").addFilter(NoNoise())
        self._server = _Quiet(
            uvicorn.Config(
                guarded,
                log_level="error",
                access_log=False,  # addresses hold the token
                server_header=False,
                http=Gate().protocol(),  # type: ignore[arg-type]
                ws="websockets-sansio",
                ws_max_size=MOST_BYTES,
                ws_max_queue=16,
                ws_per_message_deflate=False,  # pictures are packed already
                timeout_graceful_shutdown=2,
            )
        )

    def run(self, on_ready: Callable[[], object] = lambda: None) -> bool:
        """Drop the scene and serve until `stop`; whether this has cut a drop short.

        `on_ready` is called when the address can be opened. Raises UserError if what is to
        compute is not there, or if results could not be saved; KeyboardInterrupt if it was told to
        stop before there was anything.
        """
        # until all is saved: a second signal must not end what the first one has begun
        with _stops_on_signals(self.stop):
            try:
                self.view.start()
                if not self._is_plain:
                    self._wait_for_device()
                if self.view.controller.refusal is not None:
                    raise UserError(self.view.controller.refusal)
                was_stopped = self._server.should_exit
                if not was_stopped:
                    on_ready()
                    self._server.run([self._socket])
            finally:
                was_cut, lost = self.close()
        if lost:
            raise UserError(f"not saved: {'; '.join(lost)}")
        if was_stopped and not was_cut:
            raise KeyboardInterrupt
        return was_cut

    def _wait_for_device(self) -> None:
        """Until the first frame or a refusal is there, or somebody has told to stop."""
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until and not self._server.should_exit:
            if self.view.controller.state != "preparing":
                return
            time.sleep(TURN)

    def stop(self) -> None:
        """Come to an end soon; any thread, or a signal, may say so."""
        self._server.should_exit = True

    def close(self) -> tuple[bool, list[str]]:
        """End and save the drop: whether it was cut short, and why some could not be saved."""
        self._socket.close()
        was_cut = self.view.close()
        problems = {drop.number: drop.problem or "" for drop in self.view.archive.close()}
        problems |= self.view.controller.lost
        return was_cut, [f"drop {number}: {why}" for number, why in problems.items()]


class _Quiet(uvicorn.Server):
    """Leaves signals to `Server.run`."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


@contextlib.contextmanager
def _stops_on_signals(stop: Callable[[], object]) -> Iterator[None]:
    """Ctrl-C, a polite end of the process and a lost terminal call `stop` during the block."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = [signal.SIGINT, signal.SIGTERM]
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        numbers.append(signal.SIGHUP)  # a terminal, or the line to it, has gone
    before = [signal.signal(number, lambda *_: stop()) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


def open_browser(address: str) -> None:
    """Show an address in a browser, where there is a display to show it on."""
    has_display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if has_display or not sys.platform.startswith("linux"):
        webbrowser.open(address)


def _bound(host: str, port: int) -> socket.socket:
    """A socket on this address. Raises UserError if it cannot be had."""
    if not 0 <= port <= 65535:
        raise UserError(f"port = {port}: must be 0 to 65535; 0 takes any that is free")
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except (socket.gaierror, UnicodeError):
        raise UserError(f"host = {host}: no such address here; try 127.0.0.1") from None
    family, kind, protocol, _, address = found[0]
    bound = socket.socket(family, kind, protocol)
    if os.name == "posix":  # elsewhere it would let two servers have one port
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    # connections inherit both: a viewer that never reads costs little, and is given up
    bound.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
    if hasattr(socket, "TCP_USER_TIMEOUT"):
        bound.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, MOST_SILENCE)
    try:
        bound.bind(address)
        bound.listen()  # who comes before the loop runs waits
    except OSError as error:
        bound.close()
        if error.errno == errno.EADDRINUSE:
            what = f"port = {port}: in use; choose another, or 0 for any that is free"
        elif error.errno == errno.EACCES:
            what = f"port = {port}: not allowed; choose one above 1023"
        else:
            what = f"host = {host}: cannot be used ({error.strerror}); try 127.0.0.1"
        raise UserError(what) from None
    return bound


def _is_loopback(bound: socket.socket) -> bool:
    return str(bound.getsockname()[0]) in LOOPBACK


def _address(host: str, port: int, token: str) -> str:
    """What to open. An address that stands for all of the machine's is replaced by its name."""
    name = socket.gethostname() if host in ("0.0.0.0", "::", "") else host
    name = f"[{name}]" if ":" in name else name
    return f"http://{name}:{port}/?token={token}"
