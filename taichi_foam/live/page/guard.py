"""Who may come in: only who has the token, and on loopback only pages of this machine.

Connections that have not shown a token yet are few, short, and never in the owner's way.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
from html import escape
from http import HTTPStatus
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders, QueryParams
from starlette.requests import cookie_parser
from starlette.responses import HTMLResponse
from uvicorn.protocols.http.h11_impl import H11Protocol

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

#: Names of this machine for itself. A page elsewhere that has its own name point here (DNS
#: rebinding) still sends that name.
LOOPBACK = ("localhost", "127.0.0.1", "::1")

#: How long a connection may take until a request of its has shown the token [s].
MOST_SECONDS = 5.0
#: Most connections without a token, from one address and in all. One more closes the oldest. Who
#: has the token shows it at once, and so gets in however many others are silent. All who open the
#: page at one moment, a class behind one address, are strangers until their requests are read.
MOST_OF_ADDRESS, MOST_STRANGERS = 100, 200

_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' blob: data:; "
    "style-src 'self' 'unsafe-inline'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",  # the first address holds the token
}


#: For a page without a token, or with that of an earlier start; at most 123 bytes.
_NO_TOKEN = (
    "this page needs the token of the server that is running now: open the address that it printed"
)


class Guard:
    """Lets requests and WebSockets through to an app, or refuses them.

    Every request needs the token, as ?token= or as the cookie that the first one sets. Unless the
    server is open to other machines, it must name this one. A WebSocket must come from this very
    page.
    """

    def __init__(self, app: ASGIApp, token: str, port: int, *, is_open: bool) -> None:
        self._app = app
        self._token = token
        self._is_open = is_open
        self._cookie = f"taichi-foam-{port}"  # cookies of one host are those of all its ports

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        given = QueryParams(scope["query_string"]).get("token")
        problem = self._problem(scope["type"], headers, given)
        if problem is not None:
            await _refuse(scope, receive, send, *problem)
            return
        scope["state"]["connection"].admit()

        async def send_on(message: Message) -> None:
            if message["type"] == "http.response.start":
                answer = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    answer[name] = value
                if given is not None and self._is_token(given):
                    cookie = f"{self._cookie}={self._token}; Path=/; HttpOnly; SameSite=Strict"
                    answer.append("Set-Cookie", cookie)
            await send(message)

        await self._app(scope, receive, send_on)

    def _problem(
        self, kind: str, headers: Headers, given: str | None
    ) -> tuple[HTTPStatus, str] | None:
        """Status and words for what is refused."""
        host = headers.get("host", "")
        origin = headers.get("origin")
        if kind == "websocket" and origin is not None and not _is_at(origin, host):
            return HTTPStatus.FORBIDDEN, "This connection was opened from another site's page."
        if not self._is_open and _name(host) not in LOOPBACK:
            return (
                HTTPStatus.FORBIDDEN,
                "This server only answers requests from its own machine. Open it as localhost, "
                "or start it with another host and use the address that it prints.",
            )
        kept = cookie_parser(headers.get("cookie", "")).get(self._cookie)
        if not any(self._is_token(each) for each in (given, kept)):
            return (
                HTTPStatus.UNAUTHORIZED,
                "This page needs its token. Open the complete address that taichi-foam serve "
                "printed, including ?token= and what follows; the browser remembers it from then "
                "on. The token is new each time the server starts.",
            )
        return None

    def _is_token(self, given: str | None) -> bool:
        """In a time that does not tell how much of it is right."""
        return given is not None and secrets.compare_digest(given.encode(), self._token.encode())


def _is_at(origin: str, host: str) -> bool:
    """Whether a page's Origin is that of this Host header."""
    try:
        return urlsplit(origin).netloc == host
    except ValueError:
        return False


def _name(host: str) -> str:
    """The name in a Host header, without its port."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


async def _refuse(
    scope: Scope, receive: Receive, send: Send, status: HTTPStatus, words: str
) -> None:
    if scope["type"] == "websocket":
        await receive()
        if status is HTTPStatus.UNAUTHORIZED:
            # A page that was open when the server ended can show why it gets nothing more: browsers
            # tell it the reason of a close, and nothing of a refusal.
            await send({"type": "websocket.accept"})
            words = _NO_TOKEN
        await send({"type": "websocket.close", "code": 1008, "reason": words[:100]})
        return
    page = (
        f"<!doctype html><meta charset=utf-8><title>{status.phrase}</title>"
        '<meta name=viewport content="width=device-width">'
        "<body style='font:16px/1.5 system-ui,sans-serif;max-width:34rem;margin:4rem auto;"
        f"padding:0 1rem'><h1>{status.phrase}</h1><p>{escape(words)}</p>"
    )
    # the connection has no other use, and what may still follow of the request is not read
    await HTMLResponse(page, status, {"Connection": "close"})(scope, receive, send)


class Connection(H11Protocol):
    """HTTP that is given up unless a request shows the token soon."""

    def __init__(self, strangers: dict[Connection, str], *given: Any, **named: Any) -> None:
        """`strangers` are those of the server, the oldest first, with their addresses."""
        super().__init__(*given, **named)
        self._strangers = strangers
        self._deadline: asyncio.TimerHandle | None = None
        # reaches the guard with each request, and with the WebSocket that may take over
        self.app_state = {**self.app_state, "connection": self}

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._deadline = self.loop.call_later(MOST_SECONDS, self.end)
        address = self.client[0] if self.client else ""
        of_address = [each for each, other in self._strangers.items() if other == address]
        if len(of_address) >= MOST_OF_ADDRESS:
            of_address[0].end()
        elif len(self._strangers) >= MOST_STRANGERS:
            next(iter(self._strangers)).end()
        self._strangers[self] = address

    def connection_lost(self, exc: Exception | None) -> None:
        self.admit()
        super().connection_lost(exc)

    def admit(self) -> None:
        """It is no stranger any more: a request has shown the token, or it has gone."""
        self._strangers.pop(self, None)
        if self._deadline is not None:
            self._deadline.cancel()

    def end(self) -> None:
        """Close it, whatever goes on."""
        self.admit()
        if self.transport is not None:
            self.transport.abort()

    def send_400_response(self, msg: str) -> None:
        """Answer what is no HTTP. In the midst of another answer there is only one way to end."""
        if self.cycle is not None and not self.cycle.response_complete:
            self.cycle.disconnected = True
            self.cycle.message_event.set()
            self.end()
        else:
            super().send_400_response(msg)


class NoNoise(logging.Filter):
    """Leaves out what viewers can bring uvicorn to log: that their text is not UTF-8."""

    def filter(self, record: logging.LogRecord) -> bool:
        return "Invalid UTF-8" not in record.getMessage()
