"""What tests of pictures share."""

from __future__ import annotations

import pytest

from taichi_foam.picture import raster


@pytest.fixture
def words_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Foam is not drawn: for those who look at the words around it."""
    monkeypatch.setattr(raster, "draw", lambda *arguments, **options: None)
