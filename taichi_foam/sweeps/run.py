"""A whole sweep: check everything, compute what is missing, put the rows into one table.

import taichi_foam as tf
done = tf.sweep("plan.toml", "sweeps/cushion")
done.to_pandas()
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from taichi_foam.engine import runtime
from taichi_foam.errors import RunError, UserError, installed, warn_of_run
from taichi_foam.interrupts import held_interrupts
from taichi_foam.results.folders import resolved
from taichi_foam.results.result import Result
from taichi_foam.simulation import simulate
from taichi_foam.simulation.progress import Bars
from taichi_foam.sweeps import dealing, table
from taichi_foam.sweeps.compute import compute
from taichi_foam.sweeps.dealing import Estimate, Solve
from taichi_foam.sweeps.plan import Plan
from taichi_foam.sweeps.sampling import Design, Member
from taichi_foam.sweeps.store import Store, claimed

MOST_CHECKED = 10_000
"""Drops whose scenes are built before any is computed; of more, as many spread evenly."""


_TELLING = ("energy_residual", "max_displacement_m", "peak_deceleration_m_s2")
"""Measures of which one at least differs as soon as two drops differ in anything."""


@dataclass(frozen=True)
class Standing:
    """How far a sweep is.

    drops    of the whole plan
    done     those with a row
    failed   those among them that failed: diverged, or their values make no scene
    lost     those whose chunk could not be computed; the same command tries them again
    at_work  whether a process computes it now
    """

    drops: int
    done: int
    failed: int
    lost: int
    at_work: bool


@dataclass(frozen=True)
class Sweep:
    """A sweep on disk, whole or not."""

    store: Store

    @classmethod
    def open(cls, folder: str | Path) -> Sweep:
        """The sweep in a folder. Raises UserError: there is none, or it is damaged."""
        return cls(Store.open(folder))

    @property
    def notes(self) -> list[str]:
        """What there is to say of its repeats, in words: seeds that have changed nothing."""
        repeats = self.store.plan.repeats
        if repeats.count == 1 or repeats.vary != "seed":
            return []
        found = table.read(self.store.shards(), [table.MEMBER, *_TELLING])
        same = table.same_in_groups(found, repeats.count)
        if not any(same):
            return []
        where = "of all combinations" if all(same) else f"of {sum(same):,} of {len(same):,}"
        where = where if len(same) > 1 else "of the drop"
        return [
            f"repeats.vary = 'seed': the seeds have changed nothing in the repeats {where}: "
            "scattered strengths matter only where foam breaks or comes near to it. "
            "Fix: vary the velocity"
        ]

    @property
    def folder(self) -> Path:
        return self.store.folder

    @property
    def standing(self) -> Standing:
        """How far it is."""
        store = self.store
        failures = table.read(store.shards(), ["failure"])
        return Standing(
            drops=len(store.design),
            done=len(failures),
            failed=len(failures) - failures["failure"].null_count if len(failures) else 0,
            lost=sum(map(len, store.lost())),
            at_work=store.is_at_work,
        )

    def collect(self) -> int:
        """Write results.parquet and results.csv of what there is; return how many rows they have.

        Raises OSError: they cannot be written.
        """
        store = self.store
        more = [
            table.row_without_scene(store.design, number, f"lost: {reason}")
            for chunk, reason in store.lost().items()
            for number in chunk
        ]
        return table.collect(store.shards(), more, store.folder)

    def to_pandas(self) -> Any:
        """The table as a frame; a row a drop.

        Raises UserError: nothing has been computed yet, or pandas is not installed.
        """
        with installed("a table as a frame", "pandas"):
            import pandas
        path = self.folder / table.PARQUET
        if not path.is_file():
            raise UserError(f"{self.folder}: has no {table.PARQUET} yet")
        return pandas.read_parquet(path)

    def histories(self, number: int) -> Any:
        """The history of a member as a frame, if the plan keeps histories.

        Raises UserError: it does not, or the member's chunk is not complete.
        """
        with installed("a history as a frame", "pandas"):
            import pandas
        self._check_number(number)
        chunk = next((each for each in self.store.finished() if number in each), None)
        path = None if chunk is None else self.store.history_file(chunk)
        if path is None or not path.is_file():
            raise UserError(
                f"{self.folder}: there is no history of member {number}; it is not computed yet, "
                "or the plan does not keep them (keep.histories). Fix: compute it again in full."
            )
        found = pandas.read_parquet(path, filters=[("member", "==", number)])
        return found.drop(columns="member")

    def again(
        self,
        number: int,
        on_progress: simulate.ProgressCallback | None = None,
        *,
        threads: int | None = None,
    ) -> Result:
        """Compute a member again, in full: the numbers are those of its row, to the last bit.

        Raises UserError: no such member, or other versions than those of the sweep; RunError as
        `run`.
        """
        scene = self.member(number).scene
        self.store.check_versions()
        arch = self.store.made_with["arch"]
        return simulate.run(scene, on_progress, arch=arch, threads=threads)

    def member(self, number: int) -> Member:
        """One drop: its values and its scene. Raises UserError: there is none."""
        self._check_number(number)
        return self.store.design.member(number)

    def _check_number(self, number: int) -> None:
        if not 0 <= number < len(self.store.design):
            raise UserError(
                f"member {number}: there is none; they are 0 to {len(self.store.design) - 1}"
            )


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
    """Compute all drops of a plan into a folder; go on where an earlier call has ended.

    Args:
        plan: a TOML file, the same as a mapping, or a `Plan`.
        out: the folder. One that holds this sweep is continued.
        workers: processes on this machine; None: in this one. Like all that starts processes, a
            script that gives it needs its `if __name__ == "__main__"`.
        scheduler: address of a Dask scheduler, instead of `workers`; its workers share the folder.
        arch: what to compute on, as for `init`; default "cpu".
        threads: CPU threads of each worker; default 1, in this process as for `init`.
        bars: where progress shows, and notes; None: nowhere. A `RunWarning` says notes, too.
        solve: what computes scenes, instead of `simulate_many`.

    Raises:
        UserError: anything that cannot be, and a disk that is full.
        RunError: chunks could not be computed, or the scheduler was lost.
        KeyboardInterrupt: Ctrl-C. In all these cases what is complete is kept, and the same call
            goes on.
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
    with claimed(folder, checked, arch) as store:
        found = Sweep(store)
        for chunk in store.drop_damaged():
            bars.say(f"members {chunk[0]} to {chunk[-1]} cannot be read, and are computed again")
        pending = sum(map(len, store.missing()))
        try:
            if pending:
                what = f"{pending:,} of {len(store.design):,} drops"
                with bars.counting("computing", what, pending, "drops") as advance:
                    compute(
                        store, solve, advance,
                        side_by_side=side_by_side, workers=workers, scheduler=scheduler,
                    )  # fmt: skip
        except KeyboardInterrupt:
            with held_interrupts():
                _collect_if_possible(found)
            done, drops = found.standing.done, found.standing.drops
            raise KeyboardInterrupt(
                f"{done:,} of {drops:,} drops are in {folder}; the same command goes on"
            ) from None
        except (RunError, UserError):
            _collect_if_possible(found)
            raise
        store.forget_lost()
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
    """Check what can be without computing or writing; the folder, and the plan resolved.

    Raises UserError.
    """
    if workers is not None and scheduler is not None:
        raise UserError("workers, scheduler: give one of them")
    if workers is not None or scheduler is not None:
        with installed("a sweep in other processes", "taichi-foam[sweep]"):
            import cryptography  # noqa: F401
            import distributed  # noqa: F401
    if workers is not None and not 1 <= workers <= 1000:
        raise UserError(f"workers = {workers}: choose 1 to 1000 processes")
    checked = Plan.load(plan)
    Design(checked).check(MOST_CHECKED)
    resolved(out)  # refuses what is no folder's name
    folder = Path(out).absolute()
    dealing.check_room(folder, checked)
    return folder, checked


def tried(
    plan: Plan, arch: str = "cpu", threads: int | None = None, bars: Bars | None = None
) -> Estimate:
    """What a sweep will take, after a short trial in this process. Raises UserError as `sweep`."""
    runtime.start(arch, threads)
    with (bars or Bars()).counting("trial", "trial", 2, "drops") as advance:
        solve = partial(simulate.simulate_many, arch=arch, threads=threads)
        return dealing.trial(Design(plan), solve, advance)


def _say(bars: Bars, notes: list[str]) -> None:
    for text in notes:
        bars.say(f"note: {text}")
        warn_of_run(text)


def _collect_if_possible(found: Sweep) -> None:
    """Put what there is into the table; the disk may be what has failed."""
    with contextlib.suppress(OSError):
        found.collect()
