"""Warnings about the figures of a run, as plain sentences.

Each states the problem, with a number, and a remedy.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from taichi_foam.analysis.cell_state import bonded, hangs_on, there
from taichi_foam.analysis.impact import LIFTED, fell_beside, passed_through
from taichi_foam.laws.bond import BondFoam
from taichi_foam.records.history import DISSIPATIONS, Column
from taichi_foam.records.record import Record
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Block, Scene
from taichi_foam.scene.filling import thin_parts
from taichi_foam.scene.layers import foams_of_bonds
from taichi_foam.scene.options import STIFFEST_CONTACT

RESIDUAL_LIMIT = 1e-2
"""The share of the impact energy that may be unaccounted for: it is 1e-4 in the paper's tests, and
chance alone changes the figures of broken foam by more than this."""

FALL_LIMIT = 1e-3
"""The share of the impact energy by which a dissipation, which should only grow, may fall, due to
step errors at kinks of a force: 2e-5 in the paper's tests, a hundred times that with shear by
faces."""

STILL = 1e-9
"""A block with no more than this strain, or the equivalent kinetic energy, is at rest."""

OVERLAP_LIMIT = 0.1
"""How deep a mass point may sink into the impactor, in cells: the lattice does not resolve less
than a cell, and a tenth of one changes no figure; the paper's tests reach 0.01."""

UNTESTED_LIMIT = 0.01
"""The share of bonds that may be crushed beyond the tested range of the foam's curve."""

LOOSE_LIMIT = 0.25
"""The share of mass points without a whole bond up to which the lattice represents foam: the
contact of points models the contact of pieces; the paper's tests reach 0.005."""


def energy_residual(record: Record) -> float | None:
    """Unaccounted energy at its worst row, with its sign, over the impact energy.

    None if there is no impact energy, see `impact_energy`.
    """
    energy, h = impact_energy(record), record.history
    if energy == 0:
        return None
    return float(h["residual_J"][np.argmax(np.abs(h["residual_J"]))] / energy)


def largest_fall(record: Record) -> tuple[Column, float] | None:
    """The dissipation that falls most below its earlier maximum, and the fall / impact energy.

    None if there is no impact energy except from rounding.
    """
    energy, block = impact_energy(record), record.scene.block
    volume = block.width * block.height * block.depth
    if energy <= record.scene.foam.youngs_modulus * volume * STILL**2:
        return None
    there = [each for each in DISSIPATIONS if each.name in record.history]
    falls = [
        float((np.maximum.accumulate(lost) - lost).max(initial=0.0))
        for lost in (np.nan_to_num(record.history[each.name]) for each in there)
    ]
    worst = int(np.argmax(falls))
    return there[worst], falls[worst] / energy


def impact_energy(record: Record) -> float:
    """The largest kinetic and strain energy in any row [J].

    It is that of the first row, or at contact if the impactor falls; or the energy supplied by a
    crosshead or a shaken base, if that is larger.
    """
    h = record.history
    parts = ("impactor_kinetic_J", "foam_kinetic_J", "strain_J")
    energy = float(np.sum([np.nan_to_num(h[name]) for name in parts], axis=0).max(initial=0.0))
    if record.scene.is_driven:
        energy = max(energy, float(np.abs(h["base_J"]).max(initial=0.0)))
    return energy


def loose_share(snapshot: Snapshot, block: Block) -> float:
    """The share of mass points without an unbroken bond."""
    return float(np.mean(~hangs_on(snapshot, block)[there(block)]))


def overlap_cells(record: Record) -> float | None:
    """How deep a mass point sank into the impactor, in cells; None without an impactor."""
    block, overlap = record.scene.block, record.run.get("max_overlap_m")
    if record.scene.impactor is None or overlap is None:
        return None
    return overlap / min(block.dx, block.dy)


def warnings_of(record: Record) -> list[str]:
    """Sentences about what makes the run's figures doubtful; empty if nothing does."""
    found = (
        _of_step(record),
        _of_residual(record),
        _of_falls(record),
        _of_overlap(record),
        _of_leaving(record),
        _of_lifting(record),
        _of_loose_points(record),
        _of_thin_foam(record),
    )
    return [*(each for each in found if each is not None), *_of_tested_range(record)]


def _of_step(record: Record) -> str | None:
    given, stable = record.scene.numerics.dt, record.run.get("dt_stable_min_s")
    if given == "auto" or stable is None or given <= stable:
        return None
    return (
        f"numerics.dt = {given:g} s is {given / stable:.2g} times the stable step, which fell to "
        f"{stable:.3g} s during the run: spurious vibrations may have grown; set numerics.dt = "
        "'auto'"
    )


def _of_residual(record: Record) -> str | None:
    residual = energy_residual(record)
    if residual is None or not abs(residual) > RESIDUAL_LIMIT:
        return None
    return (
        f"{abs(residual):.1%} of the impact energy is unaccounted for (at most "
        f"{100 * RESIDUAL_LIMIT:g} % is acceptable); {_cure(record)}"
    )


def _of_falls(record: Record) -> str | None:
    found = largest_fall(record)
    if found is None or not found[1] > FALL_LIMIT:
        return None
    column, fall = found
    cure = _cure(record)
    if record.scene.model.shear == "face":
        cure = "shear by faces creates energy: set model.shear = 'cell'"
    return (
        f"{column.label} ({column.name}) fell by {100 * fall:.2g} % of the impact energy, but "
        f"dissipated energy can only grow (a fall of at most {100 * FALL_LIMIT:g} % is "
        f"acceptable); {cure}"
    )


def _cure(record: Record) -> str:
    """The remedy for a large residual, or for a dissipation that falls."""
    scene, stable = record.scene, record.run.get("dt_stable_min_s")
    numerics = scene.numerics
    if scene.model.broken_contact == "jump":
        return (
            "broken bonds that jump on to the loading curve create energy: set "
            "model.broken_contact = 'reload'"
        )
    if numerics.dt == "auto":
        return f"set numerics.safety = {numerics.safety / 4:.2g}, for a step a quarter as long"
    if stable is not None and numerics.dt > stable:
        return "set numerics.dt = 'auto'"
    return f"set numerics.dt = {numerics.dt / 4:.2g}"


def _of_overlap(record: Record) -> str | None:
    cells = overlap_cells(record)
    if cells is None or cells <= OVERLAP_LIMIT:
        return None
    stiffness = record.scene.numerics.contact_stiffness
    # at a given force the overlap decreases with stiffness; half the limit leaves a margin
    stiffer = float(f"{stiffness * cells / (0.5 * OVERLAP_LIMIT):.1g}")
    if stiffer <= STIFFEST_CONTACT:
        cure = f"set numerics.contact_stiffness = {stiffer:g}"
    else:
        cure = "this impact is too hard for penalty contact; use a slower or lighter impactor"
    return (
        f"mass points penetrated the impactor by up to {cells:.2g} of a cell (at most "
        f"{OVERLAP_LIMIT:g} is acceptable); {cure}"
    )


def _of_leaving(record: Record) -> str | None:
    if not passed_through(record):
        return None
    if fell_beside(record):
        return (
            "the impactor fell past the block to the surface that the block stands on: the "
            "figures describe that fall; bring impactor.x nearer to 0, or end the run earlier "
            "(numerics.end)"
        )
    velocity = record.history["velocity_m_s"]
    return (
        f"the impactor left the foam at {velocity[-1]:.3g} m/s, after {velocity.max():.3g} m/s at "
        "its fastest: max_displacement_m is how far it had moved when the run ended, not a "
        "stopping distance; use a thicker block (block.height), or a milder impact"
    )


def _of_lifting(record: Record) -> str | None:
    if record.scene.impactor is None or record.lifted <= LIFTED * record.scene.block.dy:
        return None
    return (
        f"the impactor starts {record.lifted:.3g} m above the fresh block, over foam that an "
        "earlier drop threw up: displacements are measured from there; let the foam settle first, "
        "in a run without an impactor but with numerics.gravity"
    )


def _of_loose_points(record: Record) -> str | None:
    if not record.snapshots:
        return None
    share = loose_share(record.snapshots[-1], record.scene.block)
    if share <= LOOSE_LIMIT:
        return None
    return (
        f"{share:.0%} of the mass points have no unbroken bond left: the lattice fell apart into "
        "loose points, which do not represent foam; use smaller cells (more block.columns and "
        "block.rows), or end the run earlier (numerics.end)"
    )


def _of_tested_range(record: Record) -> Iterator[str]:
    """Yield a sentence for each foam that was crushed beyond its test."""
    if not record.snapshots:
        return
    last = record.snapshots[-1]
    foams, rows_a, rows_b = foams_of_bonds(record.scene)
    a, b = bonded(record.scene.block)
    for number, foam in enumerate(foams):
        tested = foam.tested_strain
        mine_a, mine_b = a & (rows_a == number), b & (rows_b == number)
        strain = np.concatenate([last.e_min_a[mine_a], last.e_min_b[mine_b]])
        if tested is None or not strain.size or not np.mean(strain < tested) > UNTESTED_LIMIT:
            continue
        whose = "" if len(foams) == 1 else f" of {_called(record.scene, foam)}"
        yield (
            f"{np.mean(strain < tested):.0%} of the bonds{whose} were crushed beyond a strain of "
            f"{-tested:.3g}, where the foam's test curve ends: their stress is extrapolated; test "
            "the foam to a larger strain, or use a thicker block"
        )


def _called(scene: Scene, foam: BondFoam) -> str:
    """The key of the first table that defines a foam."""
    named = {"foam": scene.foam}
    named |= {f"block.layers[{n}].foam": each.foam for n, each in enumerate(scene.block.layers)}
    return next((key for key, each in named.items() if each == foam), "across.foam")


def _of_thin_foam(record: Record) -> str | None:
    block = record.scene.block
    found = thin_parts(block)
    if found is None:
        return None
    x, y = found
    return (
        f"the foam near x = {x:.3g} m, y = {y:.3g} m is thinner than two cells of {block.dx:.3g} x "
        f"{block.dy:.3g} m: the lattice represents it by a single row of mass points, and bends "
        "and breaks it as such; use more block.columns and block.rows"
    )
