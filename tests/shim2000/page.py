"""A report as a browser sees it."""

from __future__ import annotations

from html.parser import HTMLParser

#: Elements that need no end tag.
VOID = {"meta", "link", "img", "source", "br"}


class Page(HTMLParser):
    """Collects what a page refers to, and checks that elements nest."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.links: list[str] = []
        self.sources: list[str] = []
        self.images: list[dict[str, str | None]] = []
        self.ids: set[str | None] = set()
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
