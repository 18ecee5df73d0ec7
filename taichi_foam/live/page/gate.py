"""Connections before they have shown a token: few, short, and never in the owner's way."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from uvicorn.protocols.http.h11_impl import H11Protocol

if TYPE_CHECKING:
    from starlette.types import Scope

#: How long a connection may take until a request of its has shown the token [s].
MOST_SECONDS = 5.0
#: Most connections without a token, from one address and in all. One more closes the oldest. Who
#: has the token shows it at once, and so gets in however many others are silent.
MOST_OF_ADDRESS, MOST_STRANGERS = 40, 120


class Gate:
    """The connections that have not shown a token yet."""

    def __init__(self) -> None:
        self._strangers: dict[_Connection, str] = {}  # with their addresses, the oldest first

    def protocol(self) -> Callable[..., asyncio.Protocol]:
        """What uvicorn makes for each connection."""

        def connection(*given: Any, **named: Any) -> asyncio.Protocol:
            return _Connection(self, *given, **named)

        return connection

    def come(self, stranger: _Connection, address: str) -> None:
        """A connection has been made: make room for it."""
        of_address = [each for each, other in self._strangers.items() if other == address]
        if len(of_address) >= MOST_OF_ADDRESS:
            of_address[0].end()
        elif len(self._strangers) >= MOST_STRANGERS:
            next(iter(self._strangers)).end()
        self._strangers[stranger] = address

    def forget(self, stranger: _Connection) -> None:
        """It is no stranger any more, or has gone."""
        self._strangers.pop(stranger, None)


class _Connection(H11Protocol):
    """HTTP that is given up unless it is admitted soon."""

    def __init__(self, gate: Gate, *given: Any, **named: Any) -> None:
        super().__init__(*given, **named)
        self._gate = gate
        self._deadline: asyncio.TimerHandle | None = None
        # reaches the guard with each request, and with the WebSocket that may take over
        self.app_state = {**self.app_state, "connection": self}

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._deadline = self.loop.call_later(MOST_SECONDS, self.end)
        self._gate.come(self, self.client[0] if self.client else "")

    def connection_lost(self, exc: Exception | None) -> None:
        self._settle()
        super().connection_lost(exc)

    def admit(self) -> None:
        """A request has shown the token."""
        self._settle()

    def end(self) -> None:
        """Close it, whatever goes on."""
        self._settle()
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

    def _settle(self) -> None:
        self._gate.forget(self)
        if self._deadline is not None:
            self._deadline.cancel()
        self._deadline = None


def admit(scope: Scope) -> None:
    """The request or WebSocket of this scope has shown the token."""
    connection = scope.get("state", {}).get("connection")
    if connection is not None:
        connection.admit()


class NoNoise(logging.Filter):
    """Leaves out what viewers can bring uvicorn to log: that their text is not UTF-8."""

    def filter(self, record: logging.LogRecord) -> bool:
        return "Invalid UTF-8" not in record.getMessage()
