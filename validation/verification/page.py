"""The whole page, from what is kept."""

from __future__ import annotations

import os
from pathlib import Path

from store import Store

from taichi_foam.simulation.provenance import machine, versions
from verification import cantilever_page, convergence_page, findings, shock_page, waves_page
from verification.convergence import CASES

PICTURES = {
    "verification-shock": "Stress behind a compaction front against velocity, and both theories",
    "verification-front": "Profiles of a compaction front in several cells, and its thickness",
    "verification-cells": "Displacement, crushed width and broken faces against cell size",
    "verification-histories": "Displacement against time in cells of 10 to 1.25 mm",
    "verification-cantilever": "Energy of a double cantilever, and a growing crack",
    "verification-waves": "Place and width of an elastic front against cell size",
}


def write(store: Store, out: Path, figures: Path) -> None:
    """Write the page and the pictures of all parts that have anything."""
    draw(store, figures)
    here, known = machine(), versions()
    parts = [
        "# The lattice against theory\n",
        f"taichi_foam {known['taichi_foam']}, Taichi {known['taichi']}, {here['processor']}. "
        "Written by `python validation/verify.py`.\n",
        *_shock(store),
        *_convergence(store),
        *_cantilever(store),
        *_waves(store),
    ]
    text = "\n".join(parts)
    for name, caption in PICTURES.items():
        bond = os.path.relpath(figures / f"{name}.png", out.parent)
        text = text.replace(f"![{name}]", f"![{caption}]({bond})")
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(text, encoding="utf-8")


def draw(store: Store, figures: Path) -> None:
    """Write the pictures of all parts that have anything."""
    shock, cells = store.part("shock"), store.part("convergence")
    cantilever, waves = store.part("cantilever"), store.part("waves")
    if shock:
        shock_page.draw_velocities(shock, figures / "verification-shock.png")
        shock_page.draw_lattices(shock, figures / "verification-front.png")
    if cells:
        convergence_page.draw_figures(cells, figures / "verification-cells.png")
        convergence_page.draw_histories(cells, figures / "verification-histories.png")
    if cantilever:
        cantilever_page.draw(cantilever, figures / "verification-cantilever.png")
    if waves:
        waves_page.draw(waves, figures / "verification-waves.png")


def _shock(store: Store) -> list[str]:
    part = store.part("shock")
    if not part:
        return []
    return [
        "## Compaction fronts\n",
        shock_page.METHOD,
        shock_page.velocities_table(part),
        "In brackets: theory 2; or theory 1 where it does not apply.\n",
        "![verification-shock]\n",
        findings.SHOCK,
        "### Cells and dashpots\n",
        "The paper's foam at 100 m/s, a bar of 0.75 m. *Rows swing by* is the standard deviation "
        "of the contact force; thickness is from 10 to 90 % of the front's strain, and that *of "
        "the dashpots* an integral over the law, without cells.\n",
        shock_page.lattices_table(part),
        "![verification-front]\n",
        findings.LATTICES,
    ]


def _convergence(store: Store) -> list[str]:
    part, smooth = store.part("convergence"), store.part("smooth")
    parts = []
    if part:
        parts += ["## Impacts in smaller cells\n", convergence_page.METHOD]
        for case in CASES:
            parts += [f"### {case}\n", convergence_page.impacts_table(part, case)]
        parts += [
            "*Apart* is the largest difference of the displacement from that in cells half as "
            "large, at any time, single runs.\n",
            "![verification-cells]\n",
            "![verification-histories]\n",
            findings.CONVERGENCE,
        ]
    if smooth:
        parts += [
            "### Foam that does not break\n",
            convergence_page.smooth_table(smooth),
            "Step, flat face in cells of 5 mm, against 53 ns:\n",
            convergence_page.steps_table(smooth),
            findings.SMOOTH,
        ]
    return parts


def _cantilever(store: Store) -> list[str]:
    part = store.part("cantilever")
    if not part:
        return []
    return [
        "## Energy release of a crack\n",
        cantilever_page.METHOD,
        cantilever_page.standing_table(part),
        "Errors of energy are against bending; and shear; and root; that of force against all.\n",
        cantilever_page.growing_table(part),
        "![verification-cantilever]\n",
        findings.CANTILEVER,
    ]


def _waves(store: Store) -> list[str]:
    part = store.part("waves")
    if not part:
        return []
    return [
        "## Waves\n",
        waves_page.METHOD,
        waves_page.fronts_table(part),
        "![verification-waves]\n",
        findings.WAVES,
    ]
