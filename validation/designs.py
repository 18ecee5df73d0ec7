"""Do the pads of `design` hold? `python validation/designs.py`: ten products, by runs.

Products of 100 g to 60 kg that bear 15 to 150 g fall from the heights of ISTA 1A. Every run on the
pad that `design` gives should stay below the fragility, and half its thickness should not do.

The foams are expanded polystyrene, whose measured curves have no rate, so that raw peaks should be
those of the formula. The library's rigid foams have the dashpots of the paper's: these add their
viscosity times the strain rate, tau K v/T, which is 11 % of the plateau in a pad of 12 mm.
"""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Annotated, Any

import typer
from pages import RESULTS, table
from rich.console import Console
from store import Smoke

import taichi_foam as tf
from taichi_foam.analysis.bands import band
from taichi_foam.cushions import verify
from taichi_foam.results.files import write_json
from taichi_foam.simulation.progress import Bars

PRODUCTS = [
    (0.1, 150), (0.2, 120), (0.5, 100), (1.0, 80), (2.0, 60),
    (5.0, 40), (10.0, 35), (18.0, 40), (30.0, 25), (60.0, 15),
]  # fmt: skip
"""Masses [kg] and fragilities [g] of ten products of very different size that EPS can hold."""

FOAMS = ("eps-14.4", "eps-18.4", "eps-21.6", "eps-28.8", "eps-38.4")


def main(
    runs: Annotated[int, typer.Option(help="Runs of a pad.")] = 16,
    threads: Annotated[int | None, typer.Option(help="CPU threads.")] = None,
    smoke_test: Smoke = False,
) -> None:
    """Print what came out, and keep it in results/."""
    if smoke_test:
        smoke()
        return
    bars = Bars(Console(stderr=True))
    rows = []
    for mass, fragility in PRODUCTS:
        rows.append(product(mass, fragility, runs, threads, bars))
        bars.say(json.dumps(rows[-1]))
    write_json(RESULTS / "designs.json", {"runs": runs, "products": rows})
    print(products_table(rows, runs))


def smoke() -> None:
    """One product and two runs, with kernels that come with the package."""
    products_table([product(*PRODUCTS[5], runs=2, threads=None, bars=Bars())], 2)


def product(
    mass: float, fragility: float, runs: int, threads: int | None, bars: Bars
) -> dict[str, Any]:
    """The pad of a product, what its runs give, and what those on half its thickness give."""
    found = tf.design(mass, fragility, foams=FOAMS, runs=runs, threads=threads, bars=bars)
    whole = found.chosen
    assert whole is not None, found.answer
    pad = whole.pad
    thin = replace(pad, thickness=0.5 * pad.thickness)
    with bars.computing(f"half the thickness, {runs} runs") as on_progress:
        half = verify.runs(thin, found.shape, runs, on_progress, threads=threads)
    return {
        "mass_kg": mass,
        "fragility_g": fragility,
        "drop_m": found.wish.drop,
        "foam": pad.foam.name,
        "thickness_m": pad.thickness,
        "area_m2": pad.area,
        "pads_tried": len(found.tried),
        "below": whole.below,
        "largest_cfc180_g": max(whole.g),
        "formula_g": pad.g,
        # of all runs the mean velocity is that of the drop height, which the formula has
        "median_raw_g": band(whole.raw).median,
        "half_below": half.below,
        "half_median_cfc180_g": half.band.median,
    }


def products_table(rows: list[dict[str, Any]], runs: int) -> str:
    """A row for each product, in Markdown."""
    head = ("product", "drop", "pad", "runs below", "largest, CFC 180", "raw / formula",
            "half the thickness: runs below", "median")  # fmt: skip
    cells = [
        (
            f"{row['mass_kg']:g} kg, {row['fragility_g']:g} g",
            f"{row['drop_m']:g} m",
            f"{row['foam']}, {1e3 * row['thickness_m']:g} mm, {1e4 * row['area_m2']:g} cm2",
            f"{row['below']} of {runs}",
            f"{row['largest_cfc180_g']:.1f} g",
            f"{row['median_raw_g'] / row['formula_g']:.3f}",
            f"{row['half_below']} of {runs}",
            f"{row['half_median_cfc180_g']:.0f} g",
        )
        for row in rows
    ]
    return table(head, cells)


if __name__ == "__main__":
    typer.run(main)
