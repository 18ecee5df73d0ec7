"""Scenes, results and a live cell in a notebook that a real kernel executes."""

from __future__ import annotations

import base64
import io
import re
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
from PIL import Image

from taichi_foam.catalogue import list_scenes, load_scene
from taichi_foam.live.notebook import result_html, scene_html

nbclient = pytest.importorskip("nbclient", reason="needs nbclient and ipykernel (pip: dev)")
nbformat = pytest.importorskip("nbformat")

SHOW_SCENE = """
import taichi_foam as tf
coarse = ["block.columns=20", "block.rows=10", "numerics.end=0.005"]
scene = tf.load_scene("paper/wedge-2.86", overrides=coarse)
scene
"""
WATCH = """
result = tf.watch(scene, pace=None)
print(len(result.snapshots), tf.summary(result)["steps"])
result
"""
# Somebody presses the kernel's interrupt when the first rows have come.
INTERRUPT = """
import os, signal
from taichi_foam.live.session import Session

poll = Session.poll

def press_once(session, timeout):
    events = poll(session, timeout)
    if len(session.so_far.history["time_s"]) > 3:
        Session.poll = poll
        os.kill(os.getpid(), signal.SIGINT)
    return events

Session.poll = press_once
endless = tf.load_scene(scene, overrides=["numerics.end=10"])
cut = tf.watch(endless)
print(cut.run["interrupted"], len(cut.history["time_s"]) > 3)
"""


@pytest.fixture(scope="module")
def cells() -> list:
    """The outputs of each cell."""
    book = nbformat.v4.new_notebook(
        cells=[nbformat.v4.new_code_cell(text) for text in (SHOW_SCENE, WATCH, INTERRUPT)]
    )
    nbclient.NotebookClient(book, timeout=180).execute()
    return [cell.outputs for cell in book.cells]


def html_of(outputs: list) -> str:
    return next(o["data"]["text/html"] for o in outputs if o.output_type == "execute_result")


def embedded(kind: str, html: str) -> bytes:
    found = re.search(rf"data:{kind};base64,([A-Za-z0-9+/=]+)", html)
    assert found, f"no {kind} in it"
    return base64.b64decode(found.group(1))


def text_of(outputs: list) -> str:
    return "".join(o["text"] for o in outputs if o.output_type == "stream" and o.name == "stdout")


def test_a_scene_shows_how_it_starts_and_what_it_sets(cells: list) -> None:
    html = html_of(cells[0])
    picture = np.asarray(Image.open(io.BytesIO(embedded("image/png", html))).convert("RGB"))
    assert picture.shape == (360, 640, 3)
    assert "impactor.velocity" in html
    assert "2.86" in html
    assert "block.columns" in html
    assert "initial velocity, downwards [m/s]" in html


def test_a_result_shows_instants_figures_and_a_film(cells: list, tmp_path: Path) -> None:
    html = html_of(cells[1])
    montage = np.asarray(Image.open(io.BytesIO(embedded("image/png", html))).convert("RGB"))
    assert montage.shape[1] == 1200
    film = tmp_path / "film.mp4"
    film.write_bytes(embedded("video/mp4", html))
    frames = iio.imread(film)
    snapshots = int(text_of(cells[1]).split()[0])
    assert frames.shape == (snapshots, 360, 640, 3)
    assert "energy per volume" in html or "impact duration" in html
    assert len(html) < 500_000


def test_a_live_cell_shows_the_last_instant_of_what_it_returns(cells: list) -> None:
    shown = [o for o in cells[1] if o.output_type == "display_data"]
    assert len(shown) == 1  # drawn again in place, not once below the other
    picture = base64.b64decode(shown[0]["data"]["image/jpeg"])
    assert Image.open(io.BytesIO(picture)).size == (960, 540)


def test_a_result_has_a_short_text(cells: list) -> None:
    text = next(o for o in cells[1] if o.output_type == "execute_result")["data"]["text/plain"]
    assert text.startswith("<Result of 'paper/wedge-2.86'")
    assert len(text) < 200


def test_the_kernels_interrupt_ends_a_drop_and_keeps_what_there_is(cells: list) -> None:
    assert text_of(cells[2]).split() == ["True", "True"]


def test_nothing_but_results_is_printed(cells: list) -> None:
    streams = [o for outputs in cells for o in outputs if o.output_type == "stream"]
    assert [o["text"] for o in streams if o.name != "stdout"] == []
    # a line may come in several parts
    assert [len(text_of(outputs).splitlines()) for outputs in cells] == [0, 1, 1]


@pytest.mark.parametrize("name", [name for name in list_scenes() if name.startswith("gallery/")])
def test_every_scene_of_the_gallery_shows_itself(name: str) -> None:
    scene = load_scene(name)
    html = scene_html(scene)
    assert Image.open(io.BytesIO(embedded("image/png", html))).size == (640, 360)
    assert ("foam.curve" in html) == (scene.foam.law == "tabulated")
    assert len(html) < 100_000


def test_what_is_assumed_is_a_line_that_opens(make_result) -> None:
    scene = load_scene("gallery/own-foam")
    html = result_html(make_result(scene))
    line, opened = html.split("<summary>")[1].split("</summary>")
    assert scene.assumed is not None
    assert line == f"assumed values of the foam: {len(scene.assumed)}"
    assert all(each.key in opened for each in scene.assumed)
    assert "<summary>" not in result_html(make_result(load_scene("paper/wedge-2.86")))
