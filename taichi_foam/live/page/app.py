"""Routes: the page and what it is made of, the WebSocket, and what drops have left."""

from __future__ import annotations

import contextlib
import gzip
import hashlib
import json
from collections.abc import AsyncIterator
from functools import lru_cache
from importlib import resources
from typing import TYPE_CHECKING

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute

from taichi_foam.errors import UserError
from taichi_foam.live.page.archive import FILES, FILMS
from taichi_foam.live.page.films import Films
from taichi_foam.live.page.viewers import Viewers

if TYPE_CHECKING:
    from starlette.requests import Request
    from starlette.websockets import WebSocket

    from taichi_foam.live.page.view import PageView

_TYPES = {
    "html": "text/html; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "svg": "image/svg+xml",
}
_ASSETS = ("page.css", "page.js", "controls.js", "typed.js", "curve.js", "tables.js", "icon.svg")
_PLOTLY = "plotly.min.js"
# Looked for on import: a missing package is told before the page is served.
_PLOTLY_FOLDER = resources.files("plotly") / "package_data"


def app_of(view: PageView) -> Starlette:
    """The page and its files."""
    viewers, films = Viewers(view), Films(view.archive)

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        viewers.open()
        yield
        await films.close()

    async def page(request: Request) -> Response:
        return await _asset(request, "page.html")

    async def asset(request: Request) -> Response:
        return await _asset(request, request.path_params["name"])

    async def download(request: Request) -> Response:
        name = request.path_params["name"]
        number = request.path_params["number"]
        # more digits than any drop has, Python may refuse to read
        is_number = number.isascii() and number.isdecimal() and len(number) < 10
        drop = view.archive.find(int(number)) if is_number else None
        if drop is None or drop.folder is None or name not in (*FILES, *FILMS):
            return PlainTextResponse("there is no such file of a drop that is saved", 404)
        path = drop.folder / name
        try:
            if name in FILMS:
                path = await films.film(drop, name)
        except UserError as error:
            return PlainTextResponse(str(error), 503)
        if not path.is_file():
            return PlainTextResponse(f"{path} is not there any more", 410)
        return FileResponse(path, filename=f"{drop.folder.name}-{name}")

    async def live(socket: WebSocket) -> None:
        await viewers.serve(socket)

    return Starlette(
        routes=[
            Route("/", page),
            Route("/assets/{name}", asset),
            Route("/drops/{number}/{name}", download),
            WebSocketRoute("/live", live),
        ],
        lifespan=lifespan,
    )


async def _asset(request: Request, name: str) -> Response:
    if name not in (*_ASSETS, "page.html", _PLOTLY):
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
    if name == _PLOTLY:
        file = _PLOTLY_FOLDER / name
    else:
        file = resources.files("taichi_foam.live.page") / "assets" / name
    plain = file.read_bytes()
    tag = json.dumps(hashlib.sha256(plain).hexdigest()[:16])
    return plain, gzip.compress(plain, 6), tag
