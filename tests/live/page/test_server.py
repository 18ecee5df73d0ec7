"""The server under viewers of all kinds: careless, slow, many, hostile, and gone."""

from __future__ import annotations

import contextlib
import io
import os
import random
import signal
import socket
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from processes import until
from serving import ENDLESS, PATIENCE, SMALL, Served, Viewer
from websockets.exceptions import ConnectionClosed, InvalidStatus

from taichi_foam import load_scene
from taichi_foam.live.page.guard import MOST_SECONDS
from taichi_foam.live.page.numbers import ENERGIES
from taichi_foam.live.page.viewers import MOST_VIEWERS
from taichi_foam.live.session import PACES
from taichi_foam.results.result import Result

on_linux = pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")


def test_everything_that_the_page_is_made_of_is_served(served: Served) -> None:
    page = served.get("/")
    assert page.headers["content-type"].startswith("text/html")
    assert "default-src 'self'" in page.headers["content-security-policy"]
    scripts = ("page.js", "controls.js", "typed.js", "curve.js", "cushion.js", "tables.js")
    for name in ("page.css", "icon.svg", *scripts):
        answer = served.get(f"/assets/{name}")
        assert (answer.status_code, bool(answer.content)) == (200, True)
    plotly = served.get("/assets/plotly.min.js")
    assert b"plotly.js v" in plotly.content[:200]
    assert plotly.headers["content-encoding"] == "gzip"
    tag = {"If-None-Match": plotly.headers["etag"]}
    assert served.get("/assets/plotly.min.js", headers=tag).status_code == 304


@pytest.mark.parametrize(
    "path",
    [
        "/assets/../server.py",
        "/assets/app.py",
        "/drops/1/../x",
        "/drops/99/history.csv",
        "/drops/" + "9" * 5000 + "/history.csv",
        "/drops/-1/history.csv",
        "/drops/%D9%A1/history.csv",
        "/drops/1/%00",
    ],
)
def test_nothing_else_is_served(served: Served, path: str) -> None:
    assert served.get(path).status_code == 404


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("localhost:9000", 200),  # the near end of a tunnel
        ("127.0.0.1", 200),
        ("[::1]:8000", 200),
        ("evil.example", 403),  # a name that was made to point here
        ("localhost.evil.example:8000", 403),
        ("[", 403),
        ("", 403),
    ],
)
def test_on_loopback_only_names_of_this_machine_will_do(
    served: Served, host: str, status: int
) -> None:
    assert served.get("/", headers={"Host": host}).status_code == status


def test_pages_of_others_get_no_socket(served: Served) -> None:
    own = f"http://127.0.0.1:{served.port}"
    with served.viewer(headers={**served.cookie, "Origin": own}) as viewer:
        assert viewer.wait_for("hello")["paces"] == list(PACES)
    elsewhere = ("http://evil.example", f"http://127.0.0.1:{served.port + 1}", "null", "http://[")
    for other in elsewhere:
        with (
            pytest.raises(InvalidStatus, match="403"),
            served.viewer(headers={**served.cookie, "Origin": other}),
        ):
            pass


@pytest.mark.parametrize(
    ("message", "answer"),
    [
        ("[" * 60_000, "recursion limit"),  # refused by `commands.read`
        (b"\x00\xff", "not binary"),
        ('{"do": "look", "mode": "x", "theme": "dark", "grid": true}', "mode = 'x'"),  # by the view
        ('{"do": "set", "shape": "wedge", "values": {"impactor.mass": -1}}', "above 0"),
        ('{"do": "drop", "shape": "wedge", "values": {"block.rows": 40000}}', "at most 100,000"),
    ],
)
def test_a_bad_message_is_answered_to_its_sender_alone(
    served: Served, message: str | bytes, answer: str
) -> None:
    with served.viewer() as sender, served.viewer() as other:
        sender.wait_for("numbers")
        sender.socket.send(message)
        assert answer in sender.wait_for("problem")["text"]
        # the others get what they get anyway, and the sender, too
        kinds = {other.hear()["kind"] for _ in range(15)}
        assert {"numbers", "picture"} <= kinds
        assert "problem" not in kinds
        assert other.wait_for("numbers")["state"] == "running"
        sender.wait_for("picture")


def test_a_message_that_is_too_long_ends_its_sender_alone(served: Served) -> None:
    with served.viewer() as sender, served.viewer() as other:
        sender.socket.send('{"do": "' + "x" * 70_000 + '"}')
        with pytest.raises(ConnectionClosed):
            sender.see(lambda last: False)
        other.wait_for("picture")


def test_pictures_go_one_at_a_time_as_they_are_acknowledged(served: Served) -> None:
    with served.viewer() as viewer:
        first = viewer.wait_for("picture")
        image = Image.open(io.BytesIO(first["image"]))
        assert image.width * image.height == pytest.approx(960 * 540, rel=0.01)
        assert viewer.wait_for("picture")["time"] > first["time"]
    with served.viewer() as silent:
        until, pictures, others = time.monotonic() + 1.5, 0, 0
        while time.monotonic() < until:
            content = silent.socket.recv(timeout=PATIENCE)
            pictures += isinstance(content, bytes)
            others += isinstance(content, str)
        assert pictures == 1
        assert others > 5  # numbers go on


def test_one_who_does_not_look_gets_no_pictures(served: Served) -> None:
    with served.viewer(watches=False) as viewer:
        kinds = [viewer.hear()["kind"] for _ in range(30)]
    assert "picture" not in kinds
    assert kinds.count("numbers") > 3


def test_who_comes_late_gets_the_whole_curve(served: Served) -> None:
    with served.viewer() as first, served.viewer() as late:
        whole = late.wait_for("curve")
        assert whole["from"] == 0
        assert whole["t"][0] == 0.0
        assert np.all(np.diff(whole["t"]) > 0)
        assert len(whole["t"]) == len(whole["a"]) <= 2001
        end = first.wait_for("curve")["t"][-1]
        assert whole["t"][-1] == pytest.approx(end, abs=20.0)
        # then only what is new, from a point on that the viewer has
        more = late.wait_for("curve")
        assert 0 < more["from"] <= len(whole["t"])


def test_key_figures_of_a_paused_drop_are_those_of_its_picture(served: Served) -> None:
    with served.viewer() as viewer:
        new = viewer.wait_for("scene")["drop"] + 1
        viewer.say(do="reset")
        viewer.wait_for("scene", lambda message: message["drop"] == new)
        viewer.wait_for("picture", lambda now: now["drop"] == new and now["time"] > 0.006)
        moving = viewer.see(lambda last: last["numbers"]["figures"])
        assert moving["numbers"]["figures_time"] <= moving["picture"]["time"]
        viewer.say(do="pause", on=True)
        viewer.wait_for("numbers", lambda message: message["state"] == "paused")
        still = viewer.see(lambda last: last["numbers"]["figures_time"] == last["picture"]["time"])
        sunk = still["numbers"]["figures"]["max_displacement_m"]
        assert sunk == pytest.approx(still["picture"]["displacement"], rel=1e-5)
        viewer.say(do="pause", on=False)
        viewer.wait_for("numbers", lambda message: message["state"] == "running")


def test_all_see_the_same_settings(served: Served) -> None:
    with served.viewer() as one, served.viewer() as other:
        one.say(do="set", shape="flat", values={"impactor.velocity": 3.5})
        one.say(do="look", mode="speed", theme="dark", grid=False)
        for viewer in (one, other):
            viewer.see(lambda last: "speed" in last["scene"]["key"]["words"])
            heard = viewer.see(lambda last: last["settings"]["mode"] == "speed")["settings"]
            assert (heard["shape"], heard["values"]["impactor.velocity"]) == ("flat", 3.5)
            assert (heard["theme"], heard["grid"]) == ("dark", False)
        one.say(do="look", mode="worst-strain", theme="auto", grid=True)


def test_fifty_viewers_get_pictures(served: Served) -> None:
    counts: list[int] = []

    def look() -> None:
        with served.viewer() as viewer:
            viewer.wait_for("picture")
            counts.append(len(viewer.pictures(2.0)))

    threads = [threading.Thread(target=look) for _ in range(50)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    # these fifty share two cores with the server: what matters is that none is left out
    assert len(counts) == 50
    assert min(counts) >= 3
    assert min(counts) > 0.3 * max(counts)


#: A request for a WebSocket, without its end.
_UPGRADE = (
    b"GET /live HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n"
)


def _deaf(served: Served) -> socket.socket:
    """A viewer that asks for everything and never reads: with as little room as may be."""
    line = socket.socket()
    line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    line.connect(("127.0.0.1", served.port))
    line.sendall(_UPGRADE + f"Cookie: {served.cookie['Cookie']}\r\n\r\n".encode())
    watch = b'{"do": "watch", "on": true, "tone": "light"}'
    mask = bytes(4)
    for text in (watch, *[b'{"do": "next"}'] * 50):  # as if it took pictures all the same
        line.sendall(bytes([0x81, 0x80 | len(text)]) + mask + text)
    return line


def _pictures_of_each(*viewers: Viewer) -> list[int]:
    """How many pictures come to each within the same two seconds."""
    with ThreadPoolExecutor(len(viewers)) as pool:
        return [len(found) for found in pool.map(lambda viewer: viewer.pictures(2.0), viewers)]


def test_nobody_is_slowed_by_those_who_never_read_or_never_stop_talking(
    served: Served, tmp_path: Path
) -> None:
    talkers: list[socket.socket] = []

    def talk() -> None:
        with served.viewer(watches=False) as talker, contextlib.suppress(ConnectionClosed):
            talkers.append(talker.socket.socket)
            while True:
                for key in ("impactor.mass", "impactor.velocity", "foam.rate"):
                    talker.say(do="set", shape="wedge", values={key: 5})

    # a second server, left in peace, has the same share of a busy machine
    with (
        Served(tmp_path, *ENDLESS) as peaceful,
        peaceful.viewer() as other,
        served.viewer() as viewer,
    ):
        other.wait_for("numbers", lambda message: message["state"] == "running")
        viewer.wait_for("picture")
        before = len(viewer.pictures(2.0))
        deaf = [_deaf(served) for _ in range(5)]
        beside_deaf = _pictures_of_each(viewer, other)
        for line in deaf:
            line.close()
        talking = threading.Thread(target=talk)
        talking.start()
        viewer.see(lambda last: last["settings"]["values"]["foam.rate"] == 5)
        beside_talking = _pictures_of_each(viewer, other)
        talkers[0].shutdown(socket.SHUT_RDWR)
        talking.join()
    assert before >= 10
    for disturbed, in_peace in (beside_deaf, beside_talking):
        # a server that waits for the deaf, or hears one to the end, would send next to nothing
        assert disturbed > 0.5 * in_peace > 0


@on_linux
def test_memory_is_bounded(served: Served) -> None:
    def abuse(rounds: int) -> None:
        for _ in range(rounds):
            with served.viewer() as viewer:
                viewer.wait_for("picture")
                for _ in range(90):
                    viewer.say(do="set", shape="wedge", values={"impactor.mass": 5})
                    viewer.socket.send("nonsense")
                viewer.wait_for("problem")
            _deaf(served).close()

    abuse(20)  # what is loaded or cached once
    before = served.memory
    abuse(100)
    # eighteen thousand messages and two hundred viewers; a picture kept for each would be 3 MB,
    # a hundred bytes for each message 2 MB
    assert served.memory - before < 8e6


def test_the_run_goes_on_when_a_viewer_is_gone(served: Served) -> None:
    with served.viewer() as viewer:
        before = viewer.wait_for("numbers", lambda m: m.get("time"))["time"]
        viewer.socket.socket.close()  # as if its process had been killed
    time.sleep(0.5)
    with served.viewer() as other:
        assert other.wait_for("numbers", lambda m: m["time"] > before)["state"] == "running"
        assert other.wait_for("picture", lambda m: m["time"] > before)


def _workers_of(parent: int) -> list[int]:
    """Processes that compute for a server."""
    children = Path(f"/proc/{parent}/task").glob("*/children")
    found = [int(pid) for path in children for pid in path.read_text().split()]
    return [
        pid for pid in found if "spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes().decode()
    ]


@on_linux
def test_drops_are_saved_and_a_killed_worker_is_replaced(tmp_path: Path) -> None:
    server = Served(tmp_path, *SMALL, "numerics.end=0.2")
    try:
        with server.viewer() as viewer:
            viewer.wait_for("numbers", lambda m: m["state"] == "running")
            # a drop that the next one cuts short is kept
            viewer.say(do="drop", shape="cylinder", values={"impactor.velocity": 3})
            viewer.see(lambda last: last["scene"]["name"] == "cylinder, 3 m/s")
            early = viewer.wait_for("picture", lambda m: m["drop"] == 2 and m["time"] > 0)
            viewer.say(do="pace", rate=None)
            viewer.see(lambda last: last["numbers"]["state"] == "ended")
            end = viewer.see(lambda last: last["picture"]["time"] > 0.199)["picture"]
            viewer.see(lambda last: sum(bool(d["folder"]) for d in last["drops"]["drops"]) == 2)
            ended = [(drop["number"], drop["ended"]) for drop in viewer.last["drops"]["drops"]]
            assert ended == [(2, "end time"), (1, "cut short")]
        names = ["paper-wedge-2.86-001", "cylinder-3-m-s-001"]
        assert {path.name for path in tmp_path.iterdir()} == set(names)
        result = Result.load(tmp_path / names[1])
        assert result.scene.impactor is not None
        assert (result.scene.impactor.shape, result.scene.impactor.velocity) == ("cylinder", 3.0)
        assert result.history["time_s"][-1] == pytest.approx(0.2, rel=1e-2)
        # what is read out beside a picture is one row of the history
        history = result.history
        for told in (early, end):
            row = int(np.argmin(np.abs(history["time_s"] - told["time"])))
            for name in ("time_s", "displacement_m", "velocity_m_s"):
                shown = told[name.partition("_")[0]]
                assert shown == pytest.approx(history[name][row], rel=1e-5)
            for words, columns in ENERGIES:
                energy = sum(history[name][row] for name in columns)
                assert told["energies"][words] == pytest.approx(energy, rel=1e-5, abs=1e-12)
        smoothed = history["deceleration_smoothed_m_s2"][-1]
        assert end["deceleration"] == pytest.approx(smoothed, rel=1e-5)
        for name in ("history.csv", "scene.toml", "summary.json", "snapshots.npz", "cracks.json"):
            stored = (tmp_path / names[1] / name).read_bytes()
            assert server.get(f"/drops/2/{name}").content == stored
        gif = Image.open(io.BytesIO(server.get("/drops/2/film.gif").content))
        assert gif.size == (320, 180)
        gif.seek(len(result.snapshots) - 1)
        with pytest.raises(EOFError):
            gif.seek(len(result.snapshots))

        with server.viewer() as viewer:
            for pid in _workers_of(server.process.pid):
                os.kill(pid, signal.SIGKILL)
            told = viewer.wait_for("numbers", lambda m: m["state"] == "died")
            assert "by signal 9" in told["message"]
            viewer.say(do="reset")
            viewer.see(lambda last: last["drops"]["drops"][0]["number"] == 3)
            viewer.see(lambda last: last["numbers"]["state"] == "ended")
    finally:
        code, said = server.stop()
    assert (code, said) == (0, "")  # nothing was cut short by Ctrl-C


@pytest.mark.skipif(os.name != "posix", reason="signals a group")
def test_a_closed_terminal_or_the_end_of_a_service_loses_nothing(tmp_path: Path) -> None:
    """Either may come first: the test of the token ends its server by SIGTERM alone."""
    with Served(tmp_path, *ENDLESS) as server:
        with server.viewer() as viewer:
            viewer.wait_for("numbers", lambda m: m["state"] == "running" and m.get("time"))

        def disturb(wait: float) -> None:  # again and again while it saves
            for number in (signal.SIGHUP, signal.SIGTERM):
                os.killpg(server.process.pid, number)
                time.sleep(wait / 2)

        until(lambda: any(tmp_path.iterdir()), "nothing is saved", turn=disturb)
        code, said = server.wait()
        assert (code, said) == (130, f"interrupted: what was computed is in {tmp_path}\n")
        assert Result.load(tmp_path / "paper-wedge-2.86-001").run["interrupted"]


@on_linux
def test_what_could_not_be_saved_is_told_at_the_end(tmp_path: Path) -> None:
    with Served(tmp_path, *ENDLESS) as server:
        with server.viewer() as viewer:
            viewer.wait_for("numbers", lambda m: m["state"] == "running" and m.get("time"))
            for pid in _workers_of(server.process.pid):
                os.kill(pid, signal.SIGKILL)
            viewer.wait_for("numbers", lambda m: m["state"] == "died")
        code, said = server.stop()
        assert code == 2
        assert "not saved: drop 1: the computing process ended by signal 9" in said
        assert list(tmp_path.iterdir()) == []


def test_without_the_token_nothing_is_served(served: Served) -> None:
    assert len(served.token) >= 32
    wrong = f"taichi-foam-{served.port}=wrong"
    for path in ("/", "/assets/page.js", "/drops/1/history.csv", "/?token=", "/?token=é"):
        for headers in ({}, {"Cookie": wrong}):
            answer = served.get_as_stranger(path, headers)
            assert (answer.status_code, "token" in answer.text) == (401, True)
            assert answer.headers["connection"] == "close"
            assert "set-cookie" not in answer.headers
    # a page that is still open has to be told why
    with served.viewer(watches=False, headers={}) as viewer, pytest.raises(ConnectionClosed) as end:
        viewer.hear()
    assert end.value.rcvd is not None
    assert "open the address that it printed" in end.value.rcvd.reason
    first = served.get_as_stranger(f"/?token={served.token}")
    assert first.status_code == 200
    cookie = first.headers["set-cookie"]
    assert cookie.startswith(served.cookie["Cookie"])
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie


def test_elsewhere_any_name_of_the_machine_will_do(tmp_path: Path) -> None:
    with Served(tmp_path, *ENDLESS, options=("--host", "0.0.0.0")) as server:
        server.address = f"http://127.0.0.1:{server.port}/?token={server.token}"
        assert server.get("/", {"Host": "lab-machine:80"}).status_code == 200
        assert server.get_as_stranger("/", {"Host": "lab-machine:80"}).status_code == 401
        code, said = server.stop(signal.SIGTERM)
    assert code in (0, 130)  # whether there was something to cut short yet
    assert "warning: anyone who can reach 0.0.0.0" in said


def test_silent_strangers_do_not_lock_the_owner_out(served: Served) -> None:
    """Neither those who say nothing, nor those who never end what they say."""
    begun = (b"", b"GET / HTTP/1.1\r\nHost: localh", b"POST / HTTP/1.1\r\nHost: localhost\r\n")
    start = time.monotonic()
    with contextlib.ExitStack() as lines, served.viewer() as viewer:
        strangers = []
        for n in range(305):
            line = lines.enter_context(socket.create_connection(("127.0.0.1", served.port)))
            with contextlib.suppress(OSError):  # it may have been closed for the next ones
                line.sendall((*begun, _UPGRADE + b"\r\n")[n % 4])
            strangers.append(line)
        came = time.monotonic()
        assert served.get("/").status_code == 200
        with served.viewer() as other:
            other.wait_for("picture")
        viewer.wait_for("picture")  # who was in stays in
        assert time.monotonic() - came < 5.0
        for line in strangers:
            line.settimeout(PATIENCE)
            with contextlib.suppress(ConnectionError):
                while line.recv(4096):
                    pass
    # none is held longer than it takes to show a token
    assert time.monotonic() - start < MOST_SECONDS + 15.0
    with served.viewer() as viewer:
        viewer.wait_for("picture")


def test_who_has_the_token_is_counted_and_not_the_others(served: Served) -> None:
    with contextlib.ExitStack() as inside:
        for _ in range(MOST_VIEWERS):
            inside.enter_context(served.viewer(watches=False))
        with served.viewer(watches=False) as late, pytest.raises(ConnectionClosed) as end:
            late.hear()
        assert end.value.rcvd is not None
        assert "100 viewers already" in end.value.rcvd.reason
        assert served.get("/").status_code == 200


def test_odd_requests_are_answered_or_closed_without_a_trace(served: Served) -> None:
    """What the server says at its end, the fixture checks: nothing of any of these."""
    known = f"Host: localhost\r\nCookie: {served.cookie['Cookie']}\r\n".encode()
    rng = random.Random(5)
    paths = [
        "/drops/1/" + "x" * 8000, "/drops//history.csv", "/drops/1e3/history.csv", "//", "/%",
        "/assets/%2e%2e%2fapp.py", "/%ff%fe", "/drops/%00/%00", "/?token=%ff", "/live", "/assets/",
        "http://localhost/", "*", "/drops/0x1/scene.toml", "/assets/page.js/", "/;" * 500,
    ]  # fmt: skip
    paths += ["/" + "".join(rng.choices("/.%2e5c\\;:@&=+$,0123drops", k=40)) for _ in range(60)]
    requests = [f"GET {path} HTTP/1.1\r\n".encode() + known + b"\r\n" for path in paths]
    requests += [
        b"POST / HTTP/1.1\r\n" + known + b"Content-Length: 99999999999\r\n\r\n" + b"x" * 200_000,
        b"POST / HTTP/1.1\r\n" + known + b"Transfer-Encoding: chunked\r\n\r\nzz\r\nnonsense",
        b"GET / HTTP/1.1\r\n" + known + b"Content-Length: 3\r\n\r\nabc\x00\x01\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + known + b"\r\n\x16\x03\x01 not HTTP\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + known + b"X: " + b"y" * 100_000 + b"\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + known + b"Range: bytes=9-1,-\r\nIf-None-Match: \xff\r\n\r\n",
        b"GET /live HTTP/1.1\r\n" + known + b"Upgrade: websocket\r\nConnection: Upgrade\r\n\r\n",
        b"GET /live HTTP/1.1\r\n" + known + b"Upgrade: h2c\r\nConnection: Upgrade\r\n\r\n",
        b"HEAD / HTTP/1.0\r\n" + known + b"\r\n",
        b"OPTIONS * HTTP/1.1\r\n" + known + b"\r\n",
        *(rng.randbytes(200) for _ in range(40)),
    ]
    for request in requests:
        with socket.create_connection(("127.0.0.1", served.port)) as line:
            line.settimeout(PATIENCE)
            with contextlib.suppress(ConnectionError):
                line.sendall(request)
                line.shutdown(socket.SHUT_WR)
                status = line.recv(4096).split(b" ")[1:2]
                assert status == [] or 200 <= int(status[0]) < 500, (request[:200], status)
    frames = [bytes([first, 0xFE]) + rng.randbytes(60) for first in (0x81, 0x82, 0x83, 0xF1, 0x09)]
    frames += [b"\x81\x82\0\0\0\0\xff\xfe", b"\x01\x80\0\0\0\0" * 3, rng.randbytes(500)]
    for frame in frames:
        line = _deaf(served)
        with contextlib.suppress(ConnectionError):
            line.sendall(frame)
        line.close()
    with served.viewer() as viewer:
        viewer.wait_for("picture")


def test_the_scene_of_a_drop_is_that_of_the_command_line(served: Served) -> None:
    given = load_scene("paper/wedge-2.86", overrides=list(ENDLESS))
    with served.viewer() as viewer:
        scene = viewer.wait_for("scene")
        assert scene["nodes"] == [given.block.columns, given.block.rows]
        assert scene["measured"]["plateau_deceleration_m_s2"] == 66
