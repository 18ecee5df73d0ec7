"""Rounds: every subject is measured once in each, so that slow minutes hit all alike."""

from __future__ import annotations

import contextlib
import statistics
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, wait
from dataclasses import dataclass, field
from typing import Any

from .limits import Limits
from .subjects import Subject
from .workers import AbsentError, Workers

ENOUGH = 4  # values for quartiles; of fewer the least and the largest are shown


@dataclass(frozen=True)
class Spread:
    """A median and what lies around it."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread:
        """Median and quartiles, or median, least and largest of a few."""
        if len(values) < ENOUGH:
            return cls(statistics.median(values), min(values), max(values))
        low, median, high = statistics.quantiles(values, n=4, method="inclusive")
        return cls(median, low, high)


def wall_ns(measurement: dict) -> float:
    """Wall time per node and force evaluation [ns]."""
    return 1e9 * measurement["wall"] / measurement["node_stages"]


def cpu_ns(measurement: dict) -> float:
    """Processor time per node and force evaluation [ns], of all threads together."""
    return 1e9 * measurement["cpu"] / measurement["node_stages"]


def wall_per_ms(measurement: dict) -> float:
    """Wall time per simulated millisecond of one lattice [s]."""
    return 1e-3 * measurement["wall"] / measurement["simulated"]


@dataclass
class Record:
    """Everything that a run has found so far: what Ctrl-C leaves is as good as what there is."""

    subjects: list[Subject]
    rounds: list[dict[str, dict]] = field(default_factory=list)  # measurements by subject
    limits: list[dict[int, dict]] = field(default_factory=list)  # of each round, by threads
    skipped: dict[str, str] = field(default_factory=dict)  # what is not installed, by subject
    failed: dict[str, str] = field(default_factory=dict)  # errors, by subject
    found: dict[str, Any] = field(default_factory=dict)  # what is measured outside the rounds

    @contextlib.contextmanager
    def attempt(self, key: str) -> Iterator[None]:
        """Go on when `key` cannot be measured, and keep the reason: not installed, or an error."""
        try:
            yield
        except AbsentError as error:
            self.skipped[key] = str(error)
        except RuntimeError as error:
            self.failed[key] = str(error)

    def values(self, key: str, of: Callable[[dict], float]) -> list[float]:
        """A subject's values, one of each round that has it."""
        return [of(measured[key]) for measured in self.rounds if key in measured]

    def ratio(self, over: str, under: str, of: Callable[[dict], float]) -> Spread | None:
        """How many times `over` takes what `under` takes: formed within rounds, then the median."""
        ratios = [
            of(measured[over]) / of(measured[under])
            for measured in self.rounds
            if over in measured and under in measured
        ]
        return Spread.of(ratios) if ratios else None


def prepare(workers: Workers, record: Record, on_progress: Callable[[int], None]) -> None:
    """Compile everything, and bring every subject where its measurements begin."""
    waiting = workers.prepare(record.subjects)
    while waiting:
        wait(waiting.values(), timeout=0.2, return_when=FIRST_COMPLETED)
        done = {key: future for key, future in waiting.items() if future.done()}
        for key, future in done.items():
            del waiting[key]
            with record.attempt(key):
                future.result()
        on_progress(len(done))


def measure(
    workers: Workers, record: Record, limits: Limits | None, rounds: int,
    on_next: Callable[[str], None],
) -> None:  # fmt: skip
    """Measure all subjects `rounds` times in turn; each round begins with another one."""
    for number in range(rounds):
        measured: dict[str, dict] = {}
        record.rounds.append(measured)
        there = [each for each in record.subjects if each.key not in record.skipped | record.failed]
        begin = number * len(there) // rounds
        for subject in there[begin:] + there[:begin]:
            on_next(subject.name)
            with record.attempt(subject.key):
                measured[subject.key] = workers[subject.worker].ask("measure", subject)
        if limits:
            record.limits.append(limits.measure())
