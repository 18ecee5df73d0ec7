"""A report as a browser sees it."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path

#: Elements that need no end tag.
VOID = {"meta", "link", "img", "source", "br"}


class Page(HTMLParser):
    """Collects texts by tag and what a page refers to, and checks that elements nest."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.links: list[str] = []
        self.sources: list[str] = []
        self.images: list[dict[str, str | None]] = []
        self.ids: set[str | None] = set()
        self.texts: dict[str, list[str]] = {}
        self.badges = 0
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        if tag not in VOID:
            self.open.append(tag)
        self.ids.add(values.get("id"))
        self.links += [values["href"] or ""] if "href" in values else []
        self.sources += [v or "" for k, v in attrs if k in ("src", "srcset")]
        if tag == "img":
            self.images.append(values)
        self.badges += values.get("class") == "badge"

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and data.strip():
            self.texts.setdefault(self.open[-1], []).append(data.strip())

    def check(self, folder: Path) -> None:
        """It is whole, loads nothing from outside, and its links lead somewhere in `folder`."""
        assert self.open == []
        assert all(source.startswith("data:image/") for source in self.sources)
        for link in self.links:
            assert link[1:] in self.ids if link.startswith("#") else (folder / link).exists(), link
