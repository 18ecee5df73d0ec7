"""The viewers of the page: each is sent what is new, as fast as it takes it and no faster."""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from collections import deque
from typing import TYPE_CHECKING

from starlette.websockets import WebSocket, WebSocketDisconnect

from taichi_foam.live.page import commands
from taichi_foam.live.page.numbers import Cursor

if TYPE_CHECKING:
    from taichi_foam.live.page.view import PageView

MOST_VIEWERS = 100
#: A viewer that takes longer to acknowledge a picture, or to take a message, is let go [s].
MOST_WAIT = 30.0
#: Answers that wait for a viewer; older ones give way.
MOST_ANSWERS = 16
#: Messages that a viewer is heard in a second; what it says beyond that waits at its end.
MOST_HEARD = 200

TRY_LATER, TOO_SLOW = 1013, 1008  # close codes of WebSockets


class Viewer:
    """One page that is open somewhere. Costs a few numbers and, on its way, one picture."""

    def __init__(self, socket: WebSocket, view: PageView) -> None:
        self._socket = socket
        self._view = view
        self._tone = "light"
        self._is_watching = False
        self._sent_at: float | None = None  # when the picture went that is not acknowledged yet
        self._has: dict[str, int] = {}  # of each note the number that was sent
        self._has_picture = 0
        self._cursor = Cursor()
        self._answers: deque[str] = deque(maxlen=MOST_ANSWERS)
        self._news = asyncio.Event()
        self._news.set()

    def wake(self) -> None:
        """The view state has changed."""
        self._news.set()

    def answer(self, problem: str) -> None:
        """Tell this viewer, and no other, what is wrong with its message."""
        self._answers.append(json.dumps({"kind": "problem", "text": problem}))
        self._news.set()

    async def serve(self) -> None:
        """Send and listen, until the viewer leaves or is too slow."""
        await self._socket.accept()
        tasks = [asyncio.create_task(each) for each in (self._send_all(), self._hear_all())]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        except (TimeoutError, asyncio.TimeoutError):  # Python 3.10 has two
            with contextlib.suppress(Exception):
                close = self._socket.close(TOO_SLOW, "too slow: no answer for too long")
                await asyncio.wait_for(close, 1.0)
        except (WebSocketDisconnect, RuntimeError, OSError):
            pass  # it has left
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _hear_all(self) -> None:
        loop = asyncio.get_running_loop()

        def reply(problem: str) -> None:
            with contextlib.suppress(RuntimeError):  # the loop has gone
                loop.call_soon_threadsafe(self.answer, problem)

        second, heard = loop.time(), 0
        while True:
            message = await self._socket.receive()
            heard += 1
            if loop.time() >= second + 1.0:
                second, heard = loop.time(), 1
            elif heard > MOST_HEARD:
                # one who talks without end must not keep the others from their pictures
                await asyncio.sleep(second + 1.0 - loop.time())
            if message["type"] == "websocket.disconnect":
                return
            text = message.get("text")
            try:
                if text is None:
                    raise ValueError("message refused: must be text, not binary")
                command = commands.read(text)
            except ValueError as error:
                self.answer(str(error))
                continue
            if isinstance(command, commands.Next):
                self._sent_at = None
                self._news.set()
            elif isinstance(command, commands.Watch):
                if command.tone != self._tone:
                    self._has_picture = 0
                self._is_watching, self._tone = command.on, command.tone
                self._news.set()
            else:
                self._view.tell(command, reply)

    async def _send_all(self) -> None:
        view_state = self._view.view_state
        while True:
            await self._wait()
            while self._answers:
                await self._send(self._answers.popleft())
            for kind, (number, text) in tuple(view_state.notes.items()):
                if self._has.get(kind) != number:
                    self._has[kind] = number
                    await self._send(text)
            number, curve = view_state.curve
            if self._has.get("curve") != number:
                self._has["curve"] = number
                text, self._cursor = curve.since(self._cursor)
                await self._send(text)
            if self._is_watching and self._sent_at is None:
                number, picture = view_state.pictures.get(self._tone, (0, b""))
                if number > self._has_picture:
                    self._has_picture, self._sent_at = number, time.monotonic()
                    await self._send(picture)
                else:
                    view_state.want(self._tone)

    async def _wait(self) -> None:
        """Until there is news. Raises TimeoutError if a picture stays unacknowledged."""
        left = None
        if self._sent_at is not None:
            left = max(0.0, self._sent_at + MOST_WAIT - time.monotonic())
            if left == 0.0:
                raise TimeoutError
        await asyncio.wait_for(self._news.wait(), left)
        self._news.clear()

    async def _send(self, content: str | bytes) -> None:
        """Raises TimeoutError if the viewer does not take it."""
        binary = isinstance(content, bytes)
        send = self._socket.send_bytes(content) if binary else self._socket.send_text(content)
        await asyncio.wait_for(send, MOST_WAIT)


class Viewers:
    """All viewers of the page."""

    def __init__(self, view: PageView) -> None:
        self._view = view
        self._viewers: set[Viewer] = set()

    def open(self) -> None:
        """Begin to listen to the view state; in the loop that serves."""
        loop = asyncio.get_running_loop()
        is_due = False

        def wake_all() -> None:
            nonlocal is_due
            is_due = False
            for viewer in self._viewers:
                viewer.wake()

        def wake() -> None:
            nonlocal is_due
            if not is_due:  # once is enough for all that comes until then
                is_due = True
                with contextlib.suppress(RuntimeError):  # the loop has gone
                    loop.call_soon_threadsafe(wake_all)

        self._view.view_state.wake = wake

    async def serve(self, socket: WebSocket) -> None:
        """One viewer, from its coming to its going."""
        if len(self._viewers) >= MOST_VIEWERS:
            await socket.accept()
            await socket.close(TRY_LATER, f"there are {MOST_VIEWERS} viewers already")
            return
        viewer = Viewer(socket, self._view)
        self._viewers.add(viewer)
        self._view.watchers = len(self._viewers)
        try:
            await viewer.serve()
        finally:
            self._viewers.discard(viewer)
            self._view.watchers = len(self._viewers)
