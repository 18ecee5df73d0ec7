"""What the measurements come to: each figure that there is a goal for, and the roofline."""

from __future__ import annotations

from dataclasses import dataclass

from .rounds import Record, Spread, cpu_ns, wall_ns

BUSY = 0.9  # of the gain by threads that an idle machine has in pure arithmetic

COMPILING = 28.0  # a third of what it was before kernels were made for the room of a lattice

NO_GOAL: dict[str, float] = {}
PARTS = {
    "room and softening": ("peers", "room", {"at_most": 15.0}, {"at_most": 20.0}),
    "overshoot, mass points on faces": ("room", "apart", NO_GOAL, NO_GOAL),
    "contact of pieces": ("apart", "whole", {"at_most": 15.0}, {"at_most": 20.0}),
}
"""Parts of the model whose cost is measured, by the extents without and with each, and the goals of
their costs: of all tests, and of the worst."""


@dataclass(frozen=True)
class Figure:
    """One figure, its goal if it has one, and how it was formed."""

    name: str
    unit: str
    value: Spread
    at_most: float | None = None
    at_least: float | None = None

    @property
    def goal(self) -> str:
        """In words."""
        if self.at_most is not None:
            return f"≤ {self.at_most:g}{self.unit}"
        return "" if self.at_least is None else f"≥ {self.at_least:g}{self.unit}"

    @property
    def verdict(self) -> str:
        """Whether the median meets the goal; of a figure without one, nothing."""
        if self.at_most is not None:
            return "met" if self.value.median <= self.at_most else "missed"
        if self.at_least is not None:
            return "met" if self.value.median >= self.at_least else "missed"
        return ""


def figures(record: Record, threads: int) -> list[Figure]:
    """All that can be formed from what was measured.

    Ratios on one thread are of processor time: others' work on the machine stretches the wall time
    of whichever subject it meets. Ratios across numbers of threads, and with LAMMPS, which times
    its own loop, are of wall time: they need an idle machine.
    """
    found: list[Figure] = []

    def add(name: str, unit: str, value: Spread | None, **goal: float) -> None:
        if value is not None:
            found.append(Figure(name, unit, value, **goal))

    small, plain = "800 nodes: ", record.ratio("fused", "plain", cpu_ns)
    add(f"{small}fused / plain C++", "", plain, at_most=0.6)
    vectors = record.ratio("fused", "vectors", cpu_ns)
    add(f"{small}fused / C++ vectors", "", vectors, at_most=1.3)
    room = record.ratio("fused room", "vectors room", cpu_ns)
    add(f"{small}fused / C++ vectors, room and softening", "", room, at_most=1.15)
    add(f"{small}Numba / fused", "", record.ratio("numba", "fused", cpu_ns))
    rotational = record.ratio("lammps", "fused", wall_ns)
    add(f"{small}LAMMPS bpm/rotational / fused", "", rotational, at_least=10.0)
    plastic = record.ratio("lammps plastic", "fused", wall_ns)
    add(f"{small}LAMMPS bpm/spring/plastic / fused", "", plastic)
    if threads > 1:
        for batch in (8, 64):
            many, one = f"batch {batch} on {threads}", f"batch {batch} on 1"
            add(
                f"batch of {batch}: throughput of {threads} threads / 1", "",
                record.ratio(one, many, wall_ns), at_least=0.95 * threads,
            )  # fmt: skip
        for key, nodes in (("middle", "80,000"), ("large", "2,000,000")):
            speedup = record.ratio(f"{key} on 1", f"{key} on {threads}", wall_ns)
            add(f"{nodes} nodes: speed of {threads} threads / 1", "", speedup)
    for what in ("large", "large whole"):
        values = record.values(f"{what} on {threads}", wall_ns)
        name = f"2,000,000 nodes, {threads} threads{what.removeprefix('large').replace(' ', ', ')}"
        add(name, " ns", Spread.of(values) if values else None, at_most=12.0)
    _add_costs(record, add)
    return found


def _add_costs(record: Record, add) -> None:
    ledger = record.ratio("fused", "fused no ledger", cpu_ns)
    add("energy ledger, fused run", " %", _percent(ledger), at_most=10.0)
    for what, costs in costs_of_tests(record).items():
        each = list(costs.values())
        *_, usual, worst = PARTS[what]
        add(f"{what}, the paper's tests", " %", Spread.of(each), **usual)
        add(f"{what}, the worst test", " %", _exact(max(each)), **worst)
    found = record.found
    for counts, share in found.get("snapshots", {}).items():
        add(f"snapshots at the default interval, {counts}", " %", _exact(100 * share), at_most=5.0)
    if "memory" in found:
        add("memory per node at 2,000,000 nodes", " bytes", _exact(found["memory"]), at_most=250.0)
    waits = found.get("starts", {})
    goals = {"import": 0.3, "cold": 8.0, "warm": 3.0}
    if "compiling" in waits:
        ratio = _exact(waits["compiling"])
        add("compiling the nine tests' kernels / a loop in Python", "", ratio, at_most=COMPILING)
    for name, seconds in waits.items():
        if name == "compiling":
            continue
        what = "import taichi_foam" if name == "import" else f"first step of a run, {name}"
        goal = {"at_most": goals[name]} if name in goals else {}
        add(what, " s", _exact(seconds), **goal)


def costs_of_tests(record: Record) -> dict[str, dict[str, float]]:
    """What parts of the model add to the processor time of each paper test's whole run [%].

    Per simulated time, since runs end at the rebound, which each part brings forward or puts off.
    """
    costs: dict[str, dict[str, float]] = {}
    for case, rounds in record.found.get("tests", {}).items():
        for what, (without, with_it, *_) in PARTS.items():
            ratios = [_pace(runs[with_it]) / _pace(runs[without]) for runs in rounds]
            costs.setdefault(what, {})[case] = 100 * (Spread.of(ratios).median - 1)
    return costs


def _pace(run: dict[str, float]) -> float:
    """Processor time over simulated time."""
    return run["cpu"] / run["simulated"]


def _percent(ratio: Spread | None) -> Spread | None:
    if ratio is None:
        return None
    return Spread(*(100 * (value - 1) for value in (ratio.median, ratio.low, ratio.high)))


def _exact(value: float) -> Spread:
    return Spread(value, value, value)


def roofline(record: Record, threads: int) -> list[str]:
    """Sentences: what the machine can do, what a node-stage asks of it, how near the engine is."""
    limits = [measured for measured in record.limits if measured]
    if not limits:
        return []
    lines = []
    best: dict[int, dict[str, float]] = {}
    for count in limits[0]:
        best[count] = {
            name: Spread.of([measured[count][name] for measured in limits]).median
            for name in limits[0][count]
        }
        text = f"{count} thread{'s' * (count > 1)}: {best[count]['bandwidth'] / 1e9:.1f} GB/s"
        if "arithmetic" in best[count]:
            text += f", {best[count]['arithmetic'] / 1e9:.1f} Gflop/s in fused multiply-adds"
        lines.append(text)
    many = max(best)
    if many > 1:
        gains = [
            found[many].get("arithmetic", 0) / found[1].get("arithmetic", 1) for found in limits
        ]
        gain = Spread.of(gains).median
        if 0.0 < gain < BUSY * many:
            lines.append(
                f"THE MACHINE WAS BUSY, or its cores are no whole ones: pure arithmetic on {many} "
                f"threads was {gain:.2f} times as fast as on one, and no figure of many threads "
                "means much"
            )
    flops, traffic = record.found.get("flops"), record.found.get("traffic")
    if flops:
        lines.append(
            f"a node-stage is {flops:.0f} operations, counted in the plain C++"
            + (f", and moves {traffic:.0f} bytes beyond the caches" if traffic else "")
        )
    stands = (
        ("fused", "800 nodes, fused", 1, False),
        (f"large on {threads}", f"2,000,000 nodes, {threads} threads", threads, True),
    )
    for key, name, count, beyond in stands:
        values = record.values(key, wall_ns)
        if not values or not flops or "arithmetic" not in best[count]:
            continue
        ns = Spread.of(values).median
        roof = flops / best[count]["arithmetic"]
        text = f"{name}: {flops / ns:.1f} Gflop/s, {100 * roof / (1e-9 * ns):.0f} % of the peak"
        if beyond and traffic:
            bound = max(roof, traffic / best[count]["bandwidth"])
            text += (
                f"; {traffic / ns:.1f} GB/s, {100e9 * traffic / best[count]['bandwidth'] / ns:.0f}"
                f" % of the bandwidth; the roofline allows {1e9 * bound:.1f} ns"
            )
        lines.append(text)
    return lines
