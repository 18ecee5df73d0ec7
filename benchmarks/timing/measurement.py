"""What one measurement of a subject is, whatever it is of."""

from __future__ import annotations

from dataclasses import dataclass

LEAST_STEPS = 3


@dataclass
class Measurement:
    """What one measurement gave; two add up."""

    wall: float  # s
    cpu: float | None  # s, of all threads of the process
    node_stages: float
    simulated: float  # s, of one lattice; lattices of a batch add up

    def __add__(self, other: Measurement) -> Measurement:
        cpu = None if self.cpu is None or other.cpu is None else self.cpu + other.cpu
        return Measurement(
            self.wall + other.wall, cpu, self.node_stages + other.node_stages,
            self.simulated + other.simulated,
        )  # fmt: skip


def better_steps(steps: int, took: float, seconds: float) -> int:
    """Steps of the next measurement, that it takes about `seconds`."""
    return max(LEAST_STEPS, round(steps * seconds / took))
