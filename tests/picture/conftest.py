"""What tests of pictures share."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from taichi_foam.picture import annotate, inset, raster


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch) -> Iterator[list]:
    """(picture, words, box) of every text that is written."""
    texts: list[tuple[np.ndarray, str, tuple[float, float, float, float]]] = []
    write = annotate.write

    def record(image, xy, string, face, *, anchor="ls", colour=(0, 0, 0)) -> None:
        left, top, right, bottom = face.getbbox(string, anchor=anchor)
        x, y = round(xy[0]), round(xy[1])
        texts.append((image, string, (x + left, y + top, x + right, y + bottom)))
        write(image, xy, string, face, anchor=anchor, colour=colour)

    monkeypatch.setattr(annotate, "write", record)
    inset._panel.cache_clear()
    raster._page.cache_clear()
    yield texts
    inset._panel.cache_clear()
    raster._page.cache_clear()


@pytest.fixture
def words_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Foam is not drawn: for those who look at the words around it."""
    monkeypatch.setattr(raster, "draw", lambda *arguments, **options: None)
