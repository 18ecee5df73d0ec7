"""Make the kernels that come with the package: `python kernels/make.py`.

This takes twenty minutes on two cores. It computes what most users compute first, starting from an
empty cache, and packs the kernels that Taichi has compiled beside the engine (see
`taichi_foam/engine/kernel_cache.py`). Run it again after changing a kernel, under Linux on any
x86-64 processor with 256-bit vectors: kernels are those for one processor (`processor.py`).
"""

import json
import subprocess
import sys
import tarfile
import tempfile
from concurrent.futures import ThreadPoolExecutor
from os import cpu_count, environ, pathsep
from pathlib import Path

from processor import copy_for_one_processor

from taichi_foam.catalogue import list_scenes
from taichi_foam.cushions.scenes import SHAPES
from taichi_foam.engine.kernel_cache import INDEX, MARK, archive_name

ENGINE = Path(__file__).parents[1] / "taichi_foam" / "engine"
WIDE = b"<4 x double>"  # occurs in the code of a kernel compiled for such vectors

# All nine tests of the paper have the same kernels.
PAPER = "paper/rectangular-3.03"
# Crushable foam of one's own has no rate, unless it is given.
NO_RATE = "foam.rate=none"
# Blocks that need other room than the paper's: wider, higher, and smaller.
OTHER_ROOMS = ("block.columns=80", "block.rows=40", "block.columns=20")
SIDE_BY_SIDE = "1,2"  # batches of one run, and of the next larger room
ALONE = "1"

# Cushions: foams of all laws, and the other shapes. Their drops are computed as batches from the
# first lattice on, for which kernels are others than for the second (`Lattice.place`).
CURVE = {"strain": [0.0, 0.05, 0.5, 0.7, 0.9], "stress": [0.0, 1e5, 1.5e5, 3e5, 2e6]}
CUSHIONS = [
    ("shim2000-pu", "flat"),
    ("rigid-pu-50", "flat"),
    *(("eps-28.8", shape) for shape in SHAPES),
    *(
        ({"law": "recovering", "curve": CURVE, **gas}, "flat")
        for gas in ({}, {"gas_pressure": 1e5})
    ),
]

MOST_NODES = 5_000  # of the lattices that are computed

COMPUTED = """
import sys
import taichi_foam as tf
name, counts, most, *values = sys.argv[1:]
scene = tf.load_scene(name, overrides=values)
if scene.block.columns * scene.block.rows <= int(most):
    for count in counts.split(","):
        tf.run_many([scene] * int(count))
"""

CUSHIONED = """
import json, sys
import taichi_foam as tf
from taichi_foam.cushions.scenes import cushion_scene
foam, shape = json.loads(sys.argv[1])
scenes = [cushion_scene(foam, 0.05, 0.1, 4e3, shape=shape)] * 2
first = tf.run_many(scenes)
list(tf.simulate_many(scenes, after=first))
"""


def commands(folder: Path) -> list[list[str]]:
    """Command lines, one per process."""
    gallery = [name for name in list_scenes() if name.startswith("gallery/")]
    usual = (PAPER, "gallery/own-foam")
    computed = [[name, SIDE_BY_SIDE] for name in usual]
    computed += [[name, SIDE_BY_SIDE, room] for name in usual for room in OTHER_ROOMS]
    computed += [[PAPER, SIDE_BY_SIDE, NO_RATE]]
    computed += [[name, ALONE] for name in gallery if name not in usual]
    program = [sys.executable, "-m", "taichi_foam"]
    return [
        [*program, "reproduce", "--out", str(folder / "reproduced")],
        *(
            [sys.executable, "-c", COMPUTED, name, counts, str(MOST_NODES), *values]
            for name, counts, *values in computed
        ),
        *([sys.executable, "-c", CUSHIONED, json.dumps(each)] for each in CUSHIONS),
        [*program, "run", PAPER, "--out", str(folder / "drawn")],
    ]


def main() -> int:
    """Return the exit code: 1 if anything has failed; nothing is then written."""
    target = ENGINE / archive_name()
    target.unlink(missing_ok=True)  # so that none of its kernels are used
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        cache = folder / "cache"
        copy_for_one_processor(folder)
        settings = {
            **environ,
            "PYTHONPATH": pathsep.join(filter(None, (name, environ.get("PYTHONPATH")))),
            "TI_OFFLINE_CACHE_FILE_PATH": str(cache),
            "TI_ADVANCED_OPTIMIZATION": "1",  # see `engine/effort.py`; its marks are packed too
        }

        used = [sys.executable, "-c", "import taichi; print(taichi.__file__)"]
        found = subprocess.run(used, env=settings, capture_output=True, text=True, check=True)
        if name not in found.stdout:
            print(f"Taichi's copy is not used, but {found.stdout}", file=sys.stderr)
            return 1

        def run(command: list[str]) -> subprocess.CompletedProcess[str]:
            done = subprocess.run(
                command, env=settings, capture_output=True, text=True, check=False
            )
            told = " ".join(part for part in command[-3:] if "\n" not in part)
            print(f"{'done' if done.returncode == 0 else 'FAILED'}: {told}")
            return done

        with ThreadPoolExecutor(max(1, (cpu_count() or 1))) as pool:
            results = list(pool.map(run, commands(folder)))
        for failed in (each for each in results if each.returncode != 0):
            print(failed.stderr, file=sys.stderr)
            return 1
        kernels = sorted(cache.glob("T*.tic"))
        largest = max(kernels, key=lambda path: path.stat().st_size)
        if largest.read_bytes().count(WIDE) < 100:
            print("this processor's kernels have no vectors of 256 bits", file=sys.stderr)
            return 1
        written = target.with_suffix(".new")
        with tarfile.open(written, "w:xz", preset=9) as packed:
            for path in (*kernels, *sorted(cache.glob(f"{MARK}*")), cache / INDEX):
                packed.add(path, path.name)
        written.replace(target)
        print(f"{target}: {len(kernels)} kernels, {target.stat().st_size / 1e3:.0f} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
