"""Reports in one file: what is in them, and that nothing outside is needed."""

import matplotlib as mpl
import pytest
from html_page import Page

from taichi_foam.errors import UserError
from taichi_foam.picture.document import Section, Table, write
from taichi_foam.picture.style import STYLE, blank


def test_a_report_stands_by_itself(tmp_path):
    with mpl.rc_context(STYLE):
        figure = blank(4, 3)
        figure.subplots().plot([0, 1], [0, 2])
    table = Table(["drop", "peak (g)"], [["first", "30 < 40"], ["second", "41"]], note="CFC 180")
    path = write(
        tmp_path / "report.html",
        "Cushion <of> foam",
        ["It holds."],
        [
            Section("Curve", ["A & B"], figure, "a rising line", "Peaks."),
            Section("Drops", table=table),
        ],
    )
    page = Page(path.read_text(encoding="utf-8"))
    assert page.open == []
    assert page.texts["h1"] == ["Cushion <of> foam"]
    assert page.texts["td"] == ["30 < 40", "41"]
    assert "A & B" in page.texts["p"]
    assert page.links == []
    assert len(page.sources) == 1
    assert page.sources[0].startswith("data:image/svg+xml;base64,")
    assert [each.name for each in tmp_path.iterdir()] == ["report.html"]


def test_a_figure_needs_words_for_those_who_cannot_see_it(tmp_path):
    with pytest.raises(ValueError, match="alt text"):
        write(tmp_path / "report.html", "T", [], [Section("Curve", figure=blank(1, 1))])


def test_a_report_that_cannot_be_written_says_so(tmp_path):
    with pytest.raises(UserError, match="could not be written"):
        write(tmp_path / "missing" / "report.html", "T", [], [])
