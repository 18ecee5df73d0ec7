"""Serving the page: the address, the token, its routes, and a clean end."""

from __future__ import annotations

import contextlib
import errno
import gzip
import hashlib
import json
import logging
import os
import secrets
import signal
import socket
import sys
import time
import webbrowser
from collections.abc import AsyncIterator, Callable, Iterator
from functools import lru_cache, partial
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute

from taichi_foam.errors import UserError
from taichi_foam.interrupts import handled, listening
from taichi_foam.live.page.archive import FILES, FILMS, Films
from taichi_foam.live.page.guard import LOOPBACK, MOST_STRANGERS, Connection, Guard, NoNoise
from taichi_foam.live.page.view import PageView
from taichi_foam.live.page.viewers import Viewers

if TYPE_CHECKING:
    from starlette.requests import Request

    from taichi_foam.scene import Scene

#: Longest message that a viewer may send [bytes].
MOST_BYTES = 64 * 1024
#: Connections of people with the token at a time.
MOST_INSIDE = 300
#: What the system may hold back for a viewer that does not read [bytes], and for how long [ms].
SEND_BUFFER, MOST_SILENCE = 256 * 1024, 30_000
#: How long a device may take to say that it is there [s].
PATIENCE = 60.0
#: Between two looks whether somebody wants to stop meanwhile [s].
TURN = 0.1

_TYPES = {
    "html": "text/html; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "svg": "image/svg+xml",
}
_ASSETS = resources.files("taichi_foam.live.page") / "assets"
# Plotly is looked for on import: a missing package is told before the page is served.
_PLOTLY = resources.files("plotly") / "package_data" / "plotly.min.js"
# What the page is made of, by name.
_PARTS = {part.name: part for part in (*_ASSETS.iterdir(), _PLOTLY)}


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
        host: str,
        port: int,
        arch: str,
        threads: int | None,
    ) -> None:
        """Check everything and take the port. Raises UserError for what cannot be done."""
        self.view = PageView(scene, Path(out), arch, threads)
        self.view.archive.check(scene)
        self._is_plain = (arch, threads) == ("cpu", None)
        self._socket = _bound(host, port)
        self.token = secrets.token_urlsafe(24)
        name, bound_port = self._socket.getsockname()[:2]
        self.is_open = name not in LOOPBACK
        self.address = _address(host, bound_port, self.token)
        guarded = Guard(_app_of(self.view), self.token, bound_port, is_open=self.is_open)
        logging.getLogger("uvicorn.error").addFilter(NoNoise())
        self._server = _Quiet(
            uvicorn.Config(
                guarded,
                log_level="error",
                access_log=False,  # addresses hold the token
                server_header=False,
                http=partial(Connection, {}),  # type: ignore[arg-type]
                limit_concurrency=MOST_INSIDE + MOST_STRANGERS,
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
        # until all is saved: a second signal must not end what the first one has begun;
        # Ctrl-C also where a shell, which began this in the background, has it ignored
        with handled({signal.SIGINT, signal.SIGTERM, *listening()}, lambda *_: self.stop()):
            try:
                self.view.start()
                if not self._is_plain:
                    self._wait_for_device()
                if self.view.session.refusal is not None:
                    raise UserError(self.view.session.refusal)
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
            if self.view.session.state != "preparing":
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
        problems |= self.view.session.lost
        return was_cut, [f"drop {number}: {why}" for number, why in problems.items()]


class _Quiet(uvicorn.Server):
    """Leaves signals to `Server.run`."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


def open_browser(address: str) -> None:
    """Show an address in a browser, where there is a display to show it on."""
    has_display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if has_display or not sys.platform.startswith("linux"):
        webbrowser.open(address)


def _bound(host: str, port: int) -> socket.socket:
    """A socket on this address. Raises UserError if it cannot be had."""
    if not 0 <= port <= 65535:
        raise UserError(f"port = {port}: must be 0 to 65535; 0 takes any free port")
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except (socket.gaierror, UnicodeError):
        raise UserError(f"host = {host}: this machine has no such address; try 127.0.0.1") from None
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
            what = f"port = {port}: in use; choose another, or 0 for any free port"
        elif error.errno == errno.EACCES:
            what = f"port = {port}: not allowed; choose one above 1023"
        else:
            what = f"host = {host}: cannot be used ({error.strerror}); try 127.0.0.1"
        raise UserError(what) from None
    return bound


def _address(host: str, port: int, token: str) -> str:
    """What to open. An address that stands for all of the machine's is replaced by its name."""
    name = socket.gethostname() if host in ("0.0.0.0", "::", "") else host
    name = f"[{name}]" if ":" in name else name
    return f"http://{name}:{port}/?token={token}"


def _app_of(view: PageView) -> Starlette:
    """The page and its files."""
    viewers, films = Viewers(view), Films(view.archive)

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        viewers.open()
        yield
        await films.close()

    async def download(request: Request) -> Response:
        name = request.path_params["name"]
        number = request.path_params["number"]
        # more digits than any drop has, Python may refuse to read
        is_number = number.isascii() and number.isdecimal() and len(number) < 10
        drop = view.archive.find(int(number)) if is_number else None
        if drop is None or drop.folder is None or name not in (*FILES, *FILMS):
            return PlainTextResponse("no saved drop has such a file", 404)
        path = drop.folder / name
        try:
            if name in FILMS:
                path = await films.film(drop, name)
        except UserError as error:
            return PlainTextResponse(str(error), 503)
        if not path.is_file():
            return PlainTextResponse(f"{path} no longer exists", 410)
        return FileResponse(path, filename=f"{drop.folder.name}-{name}")

    return Starlette(
        routes=[
            Route("/", _part),
            Route("/assets/{name}", _part),
            Route("/drops/{number}/{name}", download),
            WebSocketRoute("/live", viewers.serve),
        ],
        lifespan=lifespan,
    )


async def _part(request: Request) -> Response:
    """What the page is made of; without a name the page itself."""
    name = request.path_params.get("name", "page.html")
    if name not in _PARTS:
        return PlainTextResponse("there is no such page", 404)
    plain, packed, tag = await run_in_threadpool(_read, name)
    headers = {
        "ETag": tag,
        "Cache-Control": "no-cache",  # ask each time whether it is still the same
        "Vary": "Accept-Encoding",
    }
    if request.headers.get("if-none-match") == tag:
        return Response(status_code=304, headers=headers)
    content = plain
    if "gzip" in request.headers.get("accept-encoding", ""):
        content, headers["Content-Encoding"] = packed, "gzip"
    return Response(content, headers=headers, media_type=_TYPES[name.rpartition(".")[2]])


@lru_cache(maxsize=16)
def _read(name: str) -> tuple[bytes, bytes, str]:
    """A file of the page: plain, packed, and a mark of its content."""
    plain = _PARTS[name].read_bytes()
    tag = json.dumps(hashlib.sha256(plain).hexdigest()[:16])
    return plain, gzip.compress(plain, 6), tag
