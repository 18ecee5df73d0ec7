"""What a GPU does with this engine: `python benchmarks/gpu.py --arch cuda`.

Node-stages a second in float64, of many lattices of a paper test side by side and of big lattices,
against the CPU's in a process of its own. It prints a table and writes it to `results/`.

With `--peak-gflops` and `--peak-gbps`, the card's limits in float64, it says what share of them is
reached. On software Vulkan: `--arch vulkan --lattices 1,4 --nodes 20000 --seconds 0.5 --steps 20`.
"""

import argparse
import json
import subprocess
import sys
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path

from peers import lattice_of, scene_with
from timing.engine import Loaded, settings, start_taichi
from timing.table import Table, write
from timing.workers import compile_thoroughly

from taichi_foam.errors import UserError
from taichi_foam.scene import Scene

RESULTS = Path(__file__).parent / "results"

# What a node and stage reads and writes on a GPU [bytes], its neighbours' numbers being in a cache:
# the forces' pass reads the motion (32) and both bonds (48) and writes their forces (32); the
# nodes' pass reads motion (32), forces (32), sums (24, as three stages of four do) and the accepted
# state (32), and writes sums (32), motion (32) and, once a step, the state (8).
BYTES = 304
# Floating-point operations of a node and stage, a division or root counting as one: some 25
# differences, twice 45 for a bond, 40 for the node, and 25 for histories and energies.
FLOPS = 180

# The CPU is not asked for more nodes than this: its rate is then the same.
MOST_CPU_NODES = 4_000_000


@dataclass(frozen=True)
class Rate:
    """One measurement."""

    lattices: int
    nodes: int  # of each lattice
    steps: int
    seconds: float

    @property
    def node_stages(self) -> float:
        """Stages of nodes a second."""
        return 4.0 * self.nodes * self.lattices * self.steps / self.seconds


def scene_of(nodes: int | None) -> Scene:
    """The paper's test, or as many nodes of the same cells."""
    scene = scene_with("calibrated", extent="whole")
    if nodes is None:
        return scene
    columns = max(2, round((nodes / 2) ** 0.5))
    return lattice_of(scene, columns, 2 * columns)


def measure(scene: Scene, lattices: int, seconds: float, most_steps: int) -> Rate:
    """Step `lattices` copies of a scene for some `seconds`, after a first call that compiles."""
    with ExitStack() as stack:
        loaded = Loaded(stack, lattices, scene)
        loaded.start([scene] * lattices)
        loaded.run_steps(2)
        taken, spent, call = 0, 0.0, 1
        while spent < seconds and taken < most_steps:
            measured = loaded.run_steps(call)
            wanted = 4.0 * loaded.nodes * lattices * call
            assert measured.node_stages == wanted, "a lattice stopped early"
            taken, spent = taken + call, spent + measured.wall
            call = min(most_steps - taken, 2 * call if measured.wall < 0.1 else call)
        return Rate(lattices, loaded.nodes, taken, spent)


def on_cpu(options: argparse.Namespace) -> dict[tuple[int, int], Rate]:
    """The same measurements by the same command on this machine's CPU."""
    command = [
        sys.executable, __file__, "--arch", "cpu", "--json",
        "--lattices", ",".join(map(str, options.lattices)),
        "--nodes", ",".join(map(str, options.nodes)),
        "--seconds", str(options.seconds), "--steps", str(options.steps),
    ]  # fmt: skip
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    rates = [Rate(**each) for each in json.loads(done.stdout.splitlines()[-1])]
    return {(rate.lattices, rate.nodes): rate for rate in rates}


def table(rates: list[Rate], cpu: dict[tuple[int, int], Rate], options: argparse.Namespace) -> str:
    """The measurements in Markdown."""
    told = settings()
    device = told.get("device", f"CPU with {told['threads']} threads")
    heads = ["lattices", "nodes each", "million node-stages/s", "Gflop/s", "GB/s"]
    heads += ["of peak flops"] * bool(options.peak_gflops)
    heads += ["of peak GB/s"] * bool(options.peak_gbps)
    found = Table([*heads, *["times the CPU"] * bool(cpu)])
    for rate in rates:
        gflops, gbps = rate.node_stages * FLOPS / 1e9, rate.node_stages * BYTES / 1e9
        row = [f"{rate.lattices:,}", f"{rate.nodes:,}", f"{rate.node_stages / 1e6:,.1f}"]
        row += [f"{gflops:,.1f}", f"{gbps:,.1f}"]
        if options.peak_gflops:
            row.append(f"{gflops / options.peak_gflops:.1%}")
        if options.peak_gbps:
            row.append(f"{gbps / options.peak_gbps:.1%}")
        if cpu:
            same = cpu.get((rate.lattices, rate.nodes))
            row.append(f"{rate.node_stages / same.node_stages:.2f}" if same else "")
        found.rows.append(row)
    return (
        f"{device}, Taichi's {told['arch']}, float64; {FLOPS} flops and {BYTES} bytes "
        f"a node-stage by count.\n\n{found.markdown()}\n"
    )


def numbers(text: str) -> list[int]:
    return [int(each) for each in text.split(",") if each]


def main() -> None:
    """Measure, print, and write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--arch", required=True, help="cpu, cuda, vulkan or metal")
    parser.add_argument("--lattices", type=numbers, default=[1, 64, 1024, 16384])
    parser.add_argument("--nodes", type=numbers, default=[2_000_000, 32_000_000])
    parser.add_argument("--seconds", type=float, default=2.0, help="for each measurement")
    parser.add_argument("--steps", type=int, default=5000, help="at most, for each measurement")
    parser.add_argument("--peak-gflops", type=float, help="the device's limit in float64")
    parser.add_argument("--peak-gbps", type=float, help="its memory's limit")
    parser.add_argument("--json", action="store_true", help="print numbers only, write nothing")
    parser.add_argument(
        "--smoke", action="store_true", help="a few steps of two lattices, write nothing"
    )
    options = parser.parse_args()
    if options.smoke:
        options.lattices, options.nodes, options.seconds, options.steps = [2], [], 1e-9, 1
    else:
        compile_thoroughly()
    try:
        start_taichi(options.arch)
    except UserError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    wanted = [(None, lattices) for lattices in options.lattices]
    wanted += [(nodes, 1) for nodes in options.nodes]
    rates = []
    for nodes, lattices in wanted:
        scene = scene_of(nodes)
        total = lattices * scene.block.columns * scene.block.rows
        if options.arch == "cpu" and total > MOST_CPU_NODES:
            continue
        rates.append(measure(scene, lattices, options.seconds, options.steps))
        if not options.json:
            rate = rates[-1]
            print(f"{lattices:,} x {rate.nodes:,}: {rate.node_stages / 1e6:,.1f} M/s", flush=True)
    records = [asdict(rate) for rate in rates]
    if options.json:
        print(json.dumps(records))
        return
    cpu = {} if options.arch == "cpu" else on_cpu(options)
    text = table(rates, cpu, options)
    print("\n" + text)
    if options.smoke:
        return
    record = {
        **settings(),
        "flops_per_node_stage": FLOPS,
        "bytes_per_node_stage": BYTES,
        "rates": records,
        "cpu": [asdict(rate) for rate in cpu.values()],
    }
    write(RESULTS / f"gpu-{options.arch}.json", json.dumps(record, indent=1) + "\n")
    write(RESULTS / f"gpu-{options.arch}.md", text)


if __name__ == "__main__":
    main()
