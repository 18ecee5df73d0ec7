"""Whether the words of a picture are whole and clear of one another."""

from __future__ import annotations

import itertools


def check_words(written: list) -> None:
    """No text that the fixture `written` has seen lies over another or beyond its picture."""
    assert len(written) > 10
    for (first, a, box_a), (second, b, box_b) in itertools.combinations(written, 2):
        assert first is not second or not meet(box_a, box_b), f"{a!r} over {b!r}"
    for picture, text, (left, top, right, bottom) in written:
        height, width = picture.shape[:2]
        assert left >= 0, text
        assert top >= 0, text
        assert right <= width, text
        assert bottom <= height, text


def meet(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    """Whether two boxes (left, top, right, bottom) share a point."""
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
