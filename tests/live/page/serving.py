"""A server in a process of its own, and viewers that are nothing but a WebSocket."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
from processes import ENVIRONMENT
from websockets.sync.client import ClientConnection, connect

from taichi_foam.live.page.view import LENGTH

PATIENCE = 60.0  # a busy machine that compiles [s]

#: A lattice so small that it needs little of the machine.
SMALL = (
    "block.columns=10",
    "block.rows=5",
    "output.snapshot_interval=5e-3",
    "output.width=320",
    "output.height=180",
)
#: At the pace that a server begins with it goes on for a quarter of an hour.
ENDLESS = (*SMALL, "numerics.end=10.0")


class Served:
    """`taichi-foam serve` on a free port.

    address  as it was printed
    out      where it saves
    """

    def __init__(self, out: Path, *settings: str, options: tuple[str, ...] = ()) -> None:
        self.out = out
        given = [word for setting in settings for word in ("--set", setting)]
        serve = ("-m", "taichi_foam", "serve", "paper/wedge-2.86", "--no-open", "--port", "0")
        self.process = subprocess.Popen(
            [sys.executable, *serve, "--out", str(out), *given, *options],
            env=ENVIRONMENT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,  # a group of its own, which a test may signal as a whole
        )
        assert self.process.stdout is not None
        self.address = self.process.stdout.readline().split(" ")[0]
        assert self.address.startswith("http://"), self.stop()

    def __enter__(self) -> Served:
        return self

    def __exit__(self, *_: object) -> None:
        """Leave nothing behind, whatever a test has come to."""
        if self.process.poll() is None:
            self.process.terminate()
            self.wait()

    @property
    def base(self) -> str:
        """The address without its token."""
        return self.address.partition("?")[0].rstrip("/")

    @property
    def port(self) -> int:
        return int(self.base.rpartition(":")[2])

    @property
    def token(self) -> str:
        return self.address.partition("?token=")[2]

    @property
    def cookie(self) -> dict[str, str]:
        """What the browser of one who has opened the address sends."""
        return {"Cookie": f"taichi-foam-{self.port}={self.token}"}

    def get(self, path: str, headers: dict[str, str] | None = None) -> httpx.Response:
        """What one gets who has the token."""
        return self.get_as_stranger(path, self.cookie | (headers or {}))

    def get_as_stranger(self, path: str, headers: dict[str, str] | None = None) -> httpx.Response:
        return httpx.get(f"{self.base}{path}", timeout=PATIENCE, headers=headers)

    @contextlib.contextmanager
    def viewer(
        self, watches: bool = True, headers: dict[str, str] | None = None
    ) -> Iterator[Viewer]:
        """A viewer, who watches from the first moment on; `headers` instead of the cookie."""
        sent = self.cookie if headers is None else headers
        address = f"ws://127.0.0.1:{self.port}/live"
        # without a bound on what it has not read yet a viewer could not hear that it is let go
        with connect(
            address,
            max_size=None,
            max_queue=None,
            compression=None,
            proxy=None,
            additional_headers=sent,
        ) as socket:
            found = Viewer(socket)
            if watches:
                found.say(do="watch", on=True, tone="light")
            yield found

    def stop(self, number: int = signal.SIGINT) -> tuple[int, str]:
        """Press Ctrl-C; the exit code, and what was said on stderr."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        return self.wait()

    def kill(self) -> None:
        """End it at once, as the machine would; its worker sees that and leaves."""
        self.process.kill()
        self.wait()

    def wait(self) -> tuple[int, str]:
        """Wait for the end; the exit code, and what was said on stderr."""
        _, said = self.process.communicate(timeout=PATIENCE)
        return self.process.returncode, said

    @property
    def memory(self) -> int:
        """What the server's process holds in memory [bytes]."""
        pages = Path(f"/proc/{self.process.pid}/statm").read_text().split()[1]
        return int(pages) * os.sysconf("SC_PAGE_SIZE")


class Viewer:
    """One end of a WebSocket."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.last: dict[str, Any] = {}  # by kind

    def say(self, **message: Any) -> None:
        self.socket.send(json.dumps(message))

    def hear(self, patience: float = PATIENCE) -> dict[str, Any]:
        """The next message. Pictures are acknowledged; they come as kind "picture"."""
        content = self.socket.recv(timeout=patience)
        if isinstance(content, str):
            message = json.loads(content)
            self.last[message["kind"]] = message
            return message
        self.say(do="next")
        (length,) = LENGTH.unpack_from(content)
        readouts, image = content[LENGTH.size :][:length], content[LENGTH.size + length :]
        self.last["picture"] = {"kind": "picture", **json.loads(readouts), "image": image}
        return self.last["picture"]

    def wait_for(self, kind: str, is_it: Callable[[dict[str, Any]], Any] = bool) -> dict[str, Any]:
        """The first message of a kind that `is_it`."""
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until:
            message = self.hear()
            if message["kind"] == kind and is_it(message):
                return message
        raise AssertionError(f"no such {kind} came")

    def see(self, is_it: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
        """The latest message of each kind, as soon as they are as they should be."""
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until:
            with contextlib.suppress(KeyError):
                if is_it(self.last):
                    return self.last
            self.hear()
        raise AssertionError(f"it did not come to that: {self.last}")

    def pictures(self, seconds: float) -> list[dict[str, Any]]:
        """What pictures come within so many seconds."""
        found, until = [], time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0:
            with contextlib.suppress(TimeoutError):
                message = self.hear(left)
                if message["kind"] == "picture":
                    found.append(message)
        return found
