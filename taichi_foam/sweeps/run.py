"""Run a whole sweep: check everything, compute missing drops, write all rows to one table.

import taichi_foam as tf
done = tf.sweep("plan.toml", "sweeps/cushion")
done.to_pandas()
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from taichi_foam.engine import runtime
from taichi_foam.errors import RunError, UserError, installed, warn_of_run
from taichi_foam.interrupts import held_interrupts
from taichi_foam.results.folders import resolved
from taichi_foam.simulation import simulate
from taichi_foam.simulation.progress import Bars
from taichi_foam.sweeps import dealing, table
from taichi_foam.sweeps.compute import compute
from taichi_foam.sweeps.dealing import Estimate, Solve
from taichi_foam.sweeps.plan import Plan
from taichi_foam.sweeps.sampling import Design
from taichi_foam.sweeps.store import Sweep, claimed

MOST_CHECKED = 10_000
"""How many scenes are built, as a check, before any is computed; evenly spread over the drops."""


def sweep(
    plan: str | Path | Mapping[str, Any] | Plan,
    out: str | Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    arch: str | None = None,
    threads: int | None = None,
    bars: Bars | None = None,
    solve: Solve | None = None,
) -> Sweep:
    """Compute all drops of a plan into a folder, continuing where an earlier call stopped.

    Args:
        plan: a TOML file, the same as a mapping, or a `Plan`.
        out: the folder. If it holds this sweep already, the sweep is continued.
        workers: number of processes on this machine; None: compute in this process. Because
            processes are started, a script that sets it needs `if __name__ == "__main__"`.
        scheduler: address of a Dask scheduler, instead of `workers`; its workers share the folder.
        arch: what to compute on, as for `init`; default "cpu".
        threads: CPU threads of each worker; default 1, in this process as for `init`.
        bars: where progress and notes are shown; None: nowhere. Notes are also issued as
            `RunWarning`.
        solve: function that computes scenes, instead of `simulate_many`.

    Raises:
        UserError: the request is invalid, or the disk is full.
        RunError: chunks could not be computed, or the scheduler was lost.
        KeyboardInterrupt: Ctrl-C. In all these cases complete chunks are kept, and the same call
            continues the sweep.
    """
    bars = bars or Bars()
    folder, checked = prepare(plan, out, workers, scheduler)
    _say(bars, checked.notes)
    arch, side_by_side = arch or "cpu", 1
    if solve is None:
        if workers is None and scheduler is None:
            runtime.start(arch, threads)
            threads = int(runtime.settings()["threads"])
        threads = threads or 1
        solve = partial(simulate.simulate_many, arch=arch, threads=threads)
        # a GPU has room for more than a chunk holds
        side_by_side = threads if arch == "cpu" else dealing.MOST
    with claimed(folder, checked, arch) as found:
        for chunk in found.drop_damaged():
            bars.say(f"members {chunk[0]} to {chunk[-1]} cannot be read and are computed again")
        pending = sum(map(len, found.missing()))
        try:
            if pending:
                impacts = checked.impacts
                what = f"{impacts * pending:,} of {impacts * len(found.design):,} drops"
                with bars.counting("computing", what, impacts * pending, "drops") as advance:
                    compute(
                        found, solve, advance,
                        side_by_side=side_by_side, workers=workers, scheduler=scheduler,
                    )  # fmt: skip
        except (KeyboardInterrupt, RunError, UserError) as error:
            # the disk itself may have failed
            with held_interrupts(), contextlib.suppress(OSError):
                found.collect()
            if not isinstance(error, KeyboardInterrupt):
                raise
            done, of = checked.impacts * found.standing.done, checked.impacts * len(found.design)
            raise KeyboardInterrupt(
                f"{done:,} of {of:,} drops are in {folder}; the same command continues"
            ) from None
        found.forget_lost()
        if pending or not (folder / table.PARQUET).is_file():
            found.collect()
    _say(bars, found.notes)
    return found


def prepare(
    plan: str | Path | Mapping[str, Any] | Plan,
    out: str | Path,
    workers: int | None = None,
    scheduler: str | None = None,
) -> tuple[Path, Plan]:
    """Check what can be checked without computing or writing. Raises UserError.

    Returns the folder and the resolved plan.
    """
    if workers is not None and scheduler is not None:
        raise UserError("workers, scheduler: give only one of them")
    if workers is not None or scheduler is not None:
        with installed("a sweep in other processes", "taichi-foam[sweep]"):
            import cryptography  # noqa: F401
            import distributed  # noqa: F401
    if workers is not None and not 1 <= workers <= 1000:
        raise UserError(f"workers = {workers}: choose 1 to 1000 processes")
    checked = Plan.load(plan)
    design = Design.of(checked)
    design.check(MOST_CHECKED)
    resolved(out)  # refuses an invalid folder name
    folder = Path(out).absolute()
    dealing.check_room(folder, design)
    return folder, checked


def tried(plan: Plan, arch: str, threads: int | None, bars: Bars) -> Estimate:
    """Estimate the cost of a sweep from a short trial in this process. Raises UserError."""
    runtime.start(arch, threads)
    with bars.counting("trial", "trial", dealing.TRIED, "drops") as advance:
        solve = partial(simulate.simulate_many, arch=arch, threads=threads)
        return dealing.trial(Design.of(plan), solve, advance)


def _say(bars: Bars, notes: list[str]) -> None:
    for text in notes:
        bars.say(f"note: {text}")
        warn_of_run(text)
