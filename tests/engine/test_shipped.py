"""Kernels that come with the package: a first run compiles nothing, and nothing else changes."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

import taichi_foam
from taichi_foam import backend
from taichi_foam.engine import kernel_cache

needs_kernels = pytest.mark.skipif(
    kernel_cache.archive() is None, reason="no kernels come with the package on this platform"
)
ZEN_5 = "vendor_id\t: AuthenticAMD\ncpu family\t: 26\nflags\t\t: fpu sse2 {}\n".format(
    " ".join(sorted(kernel_cache.WIDE_NEEDS))
)

PROGRAM = """
import hashlib, sys
import taichi_foam as tf
tf.init(threads=int(sys.argv[1]))
for values in sys.argv[2:]:
    scene = tf.load_scene("paper/wedge-2.86", overrides=values.split())
    result = tf.run(scene.with_values({"numerics.time_limit": 3e-3}))  # the foam crushes
    print(hashlib.sha256(result.snapshots[-1].position.tobytes()).hexdigest())
"""


def computed(cache: Path, *runs: str, threads: int = 2, program: str = PROGRAM) -> list[str]:
    """What a process computes that has its kernels in this folder."""
    settings = {k: v for k, v in os.environ.items() if not k.startswith("TI_")}
    done = subprocess.run(
        [sys.executable, "-c", program, str(threads), *runs],
        env={
            **settings,
            "TI_OFFLINE_CACHE_FILE_PATH": str(cache),
            "PYTHONPATH": str(Path(taichi_foam.__file__).parents[1]),
        },
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.glob("T*.tic")}


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("unpacked") / "kernels"
    kernel_cache.unpack(folder)
    return folder


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """The folder of a first process, and what it computes."""
    cache = tmp_path_factory.mktemp("first") / "cache"
    return cache, computed(cache, "block.columns=40", "block.columns=33", threads=1)


@needs_kernels
def test_a_first_run_compiles_nothing(first: tuple[Path, list[str]], unpacked: Path) -> None:
    """Whatever the size of the block and the number of threads; else the kernels are stale.

    They are made again by `python kernels/make.py`.
    """
    cache = first[0]
    computed(cache, "foam.rate=none")  # crushable foam of one's own
    assert names(cache) == names(unpacked), "kernels/make.py has to be run again"


@needs_kernels
def test_they_have_room_beside_many_others(unpacked: Path) -> None:
    """Taichi empties a full folder from those that were used least, which they may well be."""
    size = sum(path.stat().st_size for path in unpacked.iterdir())
    assert 5 * size < backend.compiling().offline_cache_max_size_of_files


@needs_kernels
def test_nor_do_drops_on_cushions_side_by_side(tmp_path: Path, unpacked: Path) -> None:
    cache = tmp_path / "cache"
    program = """
import taichi_foam as tf
from taichi_foam.cushions.scenes import cushion_scene
tf.run_many([cushion_scene("eps-28.8", 0.05, height, 4e3) for height in (0.02, 0.03)])
"""
    computed(cache, program=program)
    assert names(cache) == names(unpacked), "kernels/make.py has to be run again"


@needs_kernels
def test_a_folder_that_is_used_is_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that Taichi keeps a list in."""
    monkeypatch.setenv("TI_OFFLINE_CACHE_FILE_PATH", str(tmp_path))
    (tmp_path / kernel_cache.INDEX).write_bytes((8).to_bytes(8, "little"))
    kernel_cache.prepared()
    assert names(tmp_path) == set()


@needs_kernels
def test_a_damaged_archive_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The run goes on, and compiles."""
    archive = kernel_cache.archive()
    assert archive is not None
    damaged = tmp_path / "damaged.tar.xz"
    damaged.write_bytes(archive.read_bytes()[:-4000])
    monkeypatch.setattr(kernel_cache, "archive", lambda: damaged)
    cache = tmp_path / "cache"
    monkeypatch.setenv("TI_OFFLINE_CACHE_FILE_PATH", str(cache))
    assert kernel_cache.prepared() == cache
    assert names(cache) == set()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cache", "damaged.tar.xz"]


def test_processors_with_more_than_llvm_knows() -> None:
    assert kernel_cache.is_wider_than_known(ZEN_5)
    assert not kernel_cache.is_wider_than_known(ZEN_5.replace(": 26", ": 25"))
    assert not kernel_cache.is_wider_than_known(ZEN_5.replace("avx2", "avx"))
    assert not kernel_cache.is_wider_than_known(ZEN_5.replace("AuthenticAMD", "GenuineIntel"))
    assert not kernel_cache.is_wider_than_known("")


@needs_kernels
def test_widened_kernels_are_sound_and_compute_the_same(
    tmp_path: Path, unpacked: Path, first: tuple[Path, list[str]]
) -> None:
    """Told that the processor has wide vectors, a kernel gives the same bits."""
    flags = kernel_cache.cpuinfo()
    if not all(flag in flags.split() for flag in kernel_cache.WIDE_NEEDS):
        pytest.skip("this processor does not have them")
    wide = tmp_path / "wide"
    wide.mkdir()
    for path in unpacked.iterdir():
        kernel = path.read_bytes()
        changed = kernel_cache.widened(kernel) if path.suffix == ".tic" else kernel
        assert (changed != kernel) == (path.suffix == ".tic")
        (wide / path.name).write_bytes(changed)
    before = {path: hashlib.sha256(path.read_bytes()).digest() for path in wide.glob("T*.tic")}
    assert computed(wide, "block.columns=40") == first[1][:1]
    assert {path: hashlib.sha256(path.read_bytes()).digest() for path in before} == before
    assert names(wide) == names(unpacked)
