"""Pages in Markdown name what is there: files, links, headings, modules."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "taichi_foam"
PAGES = sorted(
    page
    for folder in ("", "docs", "renders", "benchmarks", "benchmarks/results", "validation",
                   "validation/results")
    for page in (ROOT / folder).glob("*.md")
)  # fmt: skip

_LINK = re.compile(r"\]\(([^)\s]+)\)")
_FILE = re.compile(r"`((?:[\w.-]+/)+[\w.-]*|[\w-]+\.(?:py|md))`")
# What a run or an installation writes, names of scenes, words for what stands for others.
_NOT_HERE = re.compile(
    r"(runs|paper|figures|frames|comparison|reproduction|unfinished|chunks|histories|lost)/"
    r"|FOLDER|MODE|MACHINE|NAME|gallery|my_scene|utils\.py"
)


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


def anchors(page: Path) -> set[str]:
    """Anchors of a page's headings, as GitHub makes them."""
    heads = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", head.lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_lead_somewhere(page: Path) -> None:
    for link in _LINK.findall(page.read_text(encoding="utf-8")):
        if ":" in link:
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link


@pytest.mark.parametrize("page", [p for p in PAGES if p.name != "CHANGELOG.md"], ids=name_of)
def test_files_that_pages_name_are_there(page: Path) -> None:
    wings = [folder for folder in PACKAGE.rglob("*") if folder.is_dir()]
    places = [ROOT, PACKAGE, page.parent, *wings]
    for name in _FILE.findall(page.read_text(encoding="utf-8")):
        if not _NOT_HERE.search(name):
            # `engine/model.MEMBERS` is a name in a module
            module = re.sub(r"\.[A-Za-z_]+$", ".py", name)
            found = any((place / path).exists() for place in places for path in (name, module))
            assert found or any((place / f"{name}.py").exists() for place in places), name
