"""Odd but valid scenes: `python validation/odd_scenes.py --count 1000`.

Every value is drawn over many decades of what a scene allows: masses from a microgram to a
thousand tonnes, foams from jelly to steel, cells like needles and like sheets, impacts up to 500
m/s. Each scene has to end with finite figures, and with an energy residual of at most 1 % or a
warning; or with a message that says what went wrong and what to do. Nothing that is lost may come
back, but by the readings of the paper that make energy: shear by faces, contact that jumps.

Each scene's data are also spoiled a few times, by values of other types in any place: what they
say of the foam's origin (`assumed`) among them. They are a scene still, or refused in words.

Kernels are compiled for options and lattice counts: scenes come in groups that share both.
"""

from __future__ import annotations

import math
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import typer

from taichi_foam.analysis.soundness import FALL_LIMIT, RESIDUAL_LIMIT, largest_fall
from taichi_foam.engine import runtime
from taichi_foam.engine.model import FOLLOWED
from taichi_foam.errors import UserError
from taichi_foam.results.result import Result
from taichi_foam.scene import Scene
from taichi_foam.scene.paths import by_key
from taichi_foam.simulation.stepwise import Drop

GROUP = 50
"""Scenes that share options and counts."""

PERIODS = 400.0
"""Most that a scene lasts, in periods of its fastest swing."""

PATIENCE = 20.0
"""Wall time after which a scene is cut short [s]: it still has to have finite figures."""

SPOILED = 10
"""How often each scene's data are spoiled."""

CLEAN, WARNED, FAILED, CUT, BAD = "clean", "warned", "failed, with a message", "cut short", "BAD"


@dataclass(frozen=True)
class Verdict:
    """What became of a scene: one of the words above, and what there is to say."""

    word: str
    text: str = ""


def scenes(count: int, seed: int) -> Iterator[Scene]:
    """`count` valid scenes; what is drawn and refused is drawn again."""
    for first in range(0, count, GROUP):
        rng = np.random.default_rng([seed, first])
        options = _options(rng)
        # drawn apart: the scenes are those of before it was an option
        options["model.shear_yield"] = bool(np.random.default_rng([seed, first, 1]).integers(2))
        found = 0
        while found < min(GROUP, count - first):
            try:
                scene = _scene(rng, options, f"odd {seed}/{first + found}")
            except UserError:
                continue
            found += 1
            yield scene


def judge(scene: Scene) -> Verdict:
    """Run a scene, and say what became of it."""
    try:
        with Drop(scene) as drop:
            begun = time.perf_counter()
            while not drop.ended and time.perf_counter() - begun < PATIENCE:
                drop.advance(0.25)
            if drop.failure is not None:
                return Verdict(FAILED, drop.failure)
            return _judged(drop.result(), was_cut=not drop.ended)
    except Exception:  # whatever it is, it is what this study looks for
        return Verdict(BAD, traceback.format_exc())


def read_spoiled(scene: Scene, rng: np.random.Generator) -> list[Verdict]:
    """What is bad about how spoiled data of a scene are read."""
    bad = []
    for _ in range(SPOILED):
        data = _spoiled(scene.model_dump(exclude_none=True), rng)
        try:
            Scene.checked(data, scene.name).with_values({"foam": "rigid-pu-40"})
        except UserError:
            continue
        except Exception:
            bad.append(Verdict(BAD, f"{data!r}\n{traceback.format_exc()}"))
    return bad


def _spoiled(data: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """Data of a scene with odd values in one to three places, half of them in `assumed`."""
    keys, entries = list(by_key(data)), data.get("assumed", ())

    def odd(depth: int = 0) -> Any:
        plain = [3, -1e300, True, "", "foam", "foam.curve", "block", str(rng.choice(keys))]
        kind = rng.integers(4 if depth < 3 else 1)
        if kind == 1:
            return [odd(depth + 1) for _ in range(rng.integers(3))]
        if kind == 2:
            return {str(rng.choice(keys)): odd(depth + 1)}
        if kind == 3:
            return {"key": odd(depth + 1), "why": odd(depth + 1)}
        return plain[rng.integers(len(plain))]

    for _ in range(rng.integers(1, 4)):
        part, _, last = str(rng.choice(keys)).rpartition(".")
        if rng.random() < 0.5:
            more = [{"key": odd(), "why": "spoiled"}, *entries]
            data["assumed"] = more if rng.random() < 0.8 else odd()
        elif not isinstance(data.get(part), dict):
            data[part or last] = odd()
        else:
            data[part][last] = odd()
    return data


def _judged(result: Result, was_cut: bool) -> Verdict:
    figures = result.summary
    odd = [
        key
        for key, value in figures.items()
        if isinstance(value, float) and not math.isfinite(value)
    ]
    odd += [name for name, column in result.history.items() if not np.isfinite(column).all()]
    residual = figures["energy_residual"]
    if odd:
        return Verdict(BAD, f"not finite: {', '.join(odd)}")
    if residual is not None and abs(residual) > RESIDUAL_LIMIT and not figures["warnings"]:
        return Verdict(BAD, f"{residual:.1%} unaccounted for, without a warning")
    if (back := _given_back(result)) is not None:
        return Verdict(BAD, back)
    if figures["came_to_rest"] is not None and figures["max_displacement_m"] is None:
        return Verdict(BAD, "touched, and has no displacement")
    if was_cut:
        return Verdict(
            CUT, f"after {figures['steps']:,} steps, at {result.history.time_s[-1]:.3g} s"
        )
    return (
        Verdict(WARNED, "\n".join(figures["warnings"])) if figures["warnings"] else Verdict(CLEAN)
    )


def _given_back(result: Result) -> str | None:
    """What a mechanism has given back of its dissipation, where the step can be trusted."""
    model, residual = result.scene.model, result.summary["energy_residual"]
    makes_energy = model.shear == "face" or model.broken_contact == "jump"
    fall = largest_fall(result)
    if makes_energy or fall is None or residual is None or abs(residual) > RESIDUAL_LIMIT:
        return None
    column, share = fall
    return f"{column.name} fell by {share:.2%} of the energy" if share > FALL_LIMIT else None


def _options(rng: np.random.Generator) -> dict[str, Any]:
    """What kernels are compiled for."""

    def one(*words: Any) -> Any:
        return words[rng.integers(len(words))]

    return {
        "block.columns": int(rng.integers(2, 17)),
        "block.rows": int(rng.integers(2, 13)),
        "model.damping": one("stiffness", "stiffness", "absolute"),
        "model.shear": one("cell", "cell", "face"),
        "model.shear_failure": one("tension-only", "always", "pressure-dependent", "angle"),
        "model.broken_contact": one("reload", "reload", "reload", "jump"),
        "model.self_contact": one(True, True, False),
        "model.crushed_room": one(True, True, False),
        "impactor.shape": one("flat", "cylinder", "wedge"),
        "heeds_rate": one(True, False),
        "exponent": one(1.0, 1.0, 4.0),
        "b": one(1.0, 1.0, 2.0),
        "scatters": one(True, False),
    }


def _scene(rng: np.random.Generator, options: dict[str, Any], name: str) -> Scene:
    """One scene with these options. Raises UserError: what was drawn cannot be."""

    def decades(low: float, high: float) -> float:
        return float(10.0 ** rng.uniform(math.log10(low), math.log10(high)))

    def maybe(value: float, other: float = 0.0) -> float:
        return value if rng.random() < 0.5 else other

    fixed = dict(options)
    shape, heeds_rate = fixed.pop("impactor.shape"), fixed.pop("heeds_rate")
    exponent, b = fixed.pop("exponent"), fixed.pop("b")
    scatters = fixed.pop("scatters")
    width = decades(1e-3, 5.0)
    height = width * decades(0.05, 20.0)
    thickness, density = decades(1e-4, 1.0), decades(1.0, 5000.0)
    stiffness = decades(1e3, 1e11)
    contact = decades(0.1, 1e4)
    crush_start = -decades(1e-3, 0.4)
    crush_end = crush_start - rng.uniform(0.05, 0.98 + crush_start)
    cells = width / fixed["block.columns"], height / fixed["block.rows"]
    mass, impactor_mass = density * cells[0] * cells[1] * thickness, decades(1e-9, 1e6)
    aspect = max(cells[0] / cells[1], cells[1] / cells[0])
    spring = (contact + 40.0 * aspect) * stiffness * thickness
    swing = FOLLOWED**2 * fixed["block.columns"] * contact * stiffness * thickness / impactor_mass
    end = PERIODS * decades(0.02, 1.0) * math.tau / math.sqrt(spring / mass + swing)
    end = min(end, 10.0)
    velocity = decades(1e-2, 500.0)
    impactor: dict[str, Any] = {
        "shape": shape,
        "mass": impactor_mass,
        "velocity": velocity,
        "friction": maybe(rng.uniform(0.0, 5.0)),
        "x": maybe(width * rng.uniform(-0.6, 0.6)),
        "gap": maybe(velocity * end * rng.uniform(0.0, 0.8)),
    }
    size = min(max(width * decades(0.1, 10.0), 1e-4), 5.0)
    if shape == "cylinder":
        impactor["radius"] = min(0.5 * size, 2.0)
    elif shape == "wedge":
        impactor |= {"shank_width": size, "angle_deg": rng.uniform(20.0, 170.0), "height": 5.0}
    else:
        impactor |= {"width": size, "height": size, "rotation_deg": maybe(rng.uniform(-180, 180))}
    stretch = maybe(rng.uniform(-0.5 * min(1.0, -crush_end), 0.02))
    tilt = maybe(rng.uniform(-0.05, 0.05))
    values: dict[str, Any] = {
        "name": name,
        "block": {
            "width": width, "height": height, "depth": thickness, "density": density,
            "columns": fixed.pop("block.columns"), "rows": fixed.pop("block.rows"),
            "mass_points": "cells",
        },
        "foam": {
            "youngs_modulus": stiffness,
            "shear_modulus": max(stiffness * decades(0.01, 10.0), 1e3),
            "yield_strain": crush_start,
            "densification_strain": crush_end,
            "locking_strain": crush_end - rng.uniform(0.1, 0.99) * (0.999 + crush_end),
            "densification_a": decades(1e-2, 10.0),
            "densification_b": b,
            "tensile_strain": decades(1e-3, 2.0),
            "shear_strain": decades(1e-3, 2.0),
            "crushed_tensile_fraction": rng.uniform(0.05, 1.0),
            "softening": bool(rng.integers(2)),
            "strength_scatter": rng.uniform(0.01, 0.5) if scatters else 0.0,
            "rate": decades(1.0, 1e9) if heeds_rate else None,
            "rate_exponent": exponent,
        },
        "impactor": impactor,
        "base": {
            "kind": str(rng.choice(["held", "gripped", "floor"])),
            "friction": rng.uniform(0.0, 5.0),
            "stops_impactor": bool(rng.random() < 0.5),
        },
        "model": {
            **{key.removeprefix("model."): value for key, value in fixed.items()},
            "piece_size": rng.uniform(0.1, 1.1),
            "piece_friction": maybe(rng.uniform(0.0, 5.0)),
        },
        "numerics": {
            "contact_stiffness": contact,
            "damping_time": maybe(min(0.3 * math.sqrt(mass / spring) * decades(1e-3, 3.0), 1e-2)),
            "gravity": maybe(decades(0.1, 1000.0)),
            "end": end,
        },
        "start": {
            "deformation_gradient": ((1.0, tilt), (0.0, 1.0 + stretch)),
            "velocity_gradient": ((0.0, 0.0), (0.0, maybe(rng.uniform(-1.0, 1.0) / end * 0.1))),
        },
        "output": {
            "history_interval": max(end / 50.0, 1e-7), "snapshot_interval": max(end / 4.0, 1e-7),
        },
    }  # fmt: skip
    foam = {key: value for key, value in values["foam"].items() if value is not None}
    return Scene.checked(values | {"foam": foam}, name)


def study(count: int, seed: int) -> Counter[str]:
    """Judge `count` scenes; what is bad is printed with its scene. How many of each word."""
    found: Counter[str] = Counter()
    warned: Counter[str] = Counter()
    begun = time.perf_counter()
    for number, scene in enumerate(scenes(count, seed), 1):
        for verdict in read_spoiled(scene, np.random.default_rng([seed, number])):
            found[BAD] += 1
            print(f"{scene.name}, spoiled: {verdict.text}", flush=True)
        verdict = judge(scene)
        found[verdict.word] += 1
        if verdict.word == BAD:
            print(f"{scene.name}: {verdict.text}\n{scene!r}", flush=True)
        elif verdict.word in (FAILED, CUT):
            print(f"{scene.name}: {verdict.text}", flush=True)
        for text in verdict.text.splitlines() if verdict.word == WARNED else []:
            warned[_kind(text)] += 1
        if number % GROUP == 0:
            took = time.perf_counter() - begun
            print(f"{number} scenes in {took:.0f} s: {dict(found)}", flush=True)
    for kind, times in warned.most_common():
        print(f"warned {times} times: {kind}")
    return found


def _kind(text: str) -> str:
    """A warning without its figures."""
    return " ".join(word for word in text.split(";")[0].split() if not any(map(str.isdigit, word)))


def smoke() -> None:
    """A short form for the tests: raises if anything is bad."""
    found = study(20, 0)
    assert not found[BAD], found


def main(
    count: Annotated[int, typer.Option(help="How many scenes.")] = 1000,
    seed: Annotated[int, typer.Option(help="Which scenes.")] = 0,
    threads: Annotated[int | None, typer.Option(help="CPU threads.")] = None,
) -> None:
    """Run odd but valid scenes, and count how they end."""
    runtime.start(threads=threads)
    found = study(count, seed)
    print(", ".join(f"{words}: {times}" for words, times in found.most_common()))
    raise typer.Exit(1 if found[BAD] else 0)


if __name__ == "__main__":
    typer.run(main)
