"""The whole page and its picture, from what is kept."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from store import Store

from fidelity_study import changes_page, grid_page
from fidelity_study.changes import outcomes
from fidelity_study.changes_picture import draw
from taichi_foam.simulation.provenance import machine, versions


def write(store: Store, velocities: Mapping[str, int], out: Path, figures: Path) -> str:
    """Write page and picture of what there is of both parts; returns the page's sections."""
    here, known = machine(), versions()
    found = outcomes(velocities["choices"], store.part("choices"))
    if found:
        draw(found, figures / "fidelity-choices.png")
    sections = "\n".join(
        [
            *grid_page.section(velocities["select"], store.part("select")),
            *changes_page.section(velocities["choices"], store.part("choices")),
        ]
    )
    bond = os.path.relpath(figures / "fidelity-choices.png", out.parent)
    caption = "Errors of the nine tests for each change, a panel for each figure"
    head = (
        "# The choices that the paper leaves open\n\n"
        f"taichi_foam {known['taichi_foam']}, Taichi {known['taichi']}, {here['processor']}. "
        "Written by `python validation/fidelity.py`.\n\n"
    )
    out.parent.mkdir(parents=True, exist_ok=True)
    text = head + sections.replace("![fidelity-choices]", f"![{caption}]({bond})")
    out.write_text(text, encoding="utf-8")
    return sections
