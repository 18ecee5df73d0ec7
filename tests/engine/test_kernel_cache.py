"""Compiled kernels on disk, in a folder that cannot be written, or that is damaged."""

from __future__ import annotations

import functools
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
import taichi as ti

import taichi_foam
from taichi_foam.engine import kernel_cache, runtime
from taichi_foam.engine.kernel_cache import INDEX, LOCK

PROGRAM = """
import taichi as ti
from taichi_foam.engine import runtime

runtime.start(threads=1)

@ti.kernel
def answer() -> ti.i32:
    total = 0
    for k in range(7):
        total += 6
    return total

print(answer())
"""


def process(tmp_path: Path, **environment: str) -> str:
    """Compile a kernel in a process of its own, which has to end well; returns its stderr."""
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    root = str(Path(taichi_foam.__file__).parents[1])
    kept = {name: value for name, value in os.environ.items() if name != "XDG_CACHE_HOME"}
    kept["PYTHONWARNINGS"] = "ignore"  # of Taichi's own source
    done = subprocess.run(
        [sys.executable, str(program)],
        env={**kept, "PYTHONPATH": root, "TI_SKIP_VERSION_CHECK": "ON", **environment},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (done.returncode, done.stdout) == (0, "42\n"), done.stderr
    return done.stderr


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the kernels of a process that has ended; another one finds them all again."""
    folder = tmp_path_factory.mktemp("filled")
    cache = folder / "cache"
    assert again(folder, cache) == ""
    assert compiled(cache)
    assert kernels(cache).keys() >= packaged()
    before = {file: file.stat().st_mtime_ns for file in cache.glob("T*.tic")}
    assert again(folder, cache) == ""
    assert {file: file.stat().st_mtime_ns for file in cache.glob("T*.tic")} == before
    return cache


@pytest.fixture
def cache(filled: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(filled, tmp_path / "cache"))


def kernels(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.glob("T*.tic")}


@functools.cache
def packaged() -> set[str]:
    """Names of the kernels that come with the package."""
    with tempfile.TemporaryDirectory() as name:
        kernel_cache.unpack(Path(name))
        return {file.name for file in Path(name).glob("T*.tic")}


def compiled(folder: Path) -> set[str]:
    """Names of the kernels that did not come with the package."""
    return kernels(folder).keys() - packaged()


def again(tmp_path: Path, cache: Path) -> str:
    return process(tmp_path, TI_OFFLINE_CACHE_FILE_PATH=str(cache))


def test_a_home_that_cannot_be_written(tmp_path: Path) -> None:
    """It was a segmentation fault when the process ended."""
    (tmp_path / "home").write_text("a file")
    told = process(tmp_path, HOME=str(tmp_path / "home"))
    assert told.count("\n") == 1
    assert re.search(r"home/\.cache/taichi_foam/kernels/\w+: cannot be written", told)
    assert process(tmp_path, HOME=str(tmp_path / "home"), TI_OFFLINE_CACHE="0") == ""


def test_the_users_cache(tmp_path: Path) -> None:
    assert process(tmp_path, HOME=str(tmp_path)) == ""
    assert compiled(tmp_path / ".cache" / "taichi_foam" / "kernels" / kernel_cache.digest())


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """For tests that have folders prepared in this process, whose own stays what it is."""
    monkeypatch.setattr(kernel_cache, "_prepared", None)
    return monkeypatch


def test_kernels_of_versions_that_are_used_no_more(
    tmp_path: Path, here: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    kernels_of = tmp_path / "caches" / "taichi_foam" / "kernels"
    for name, days in (("abandoned", 91), ("in use", 89)):
        (kernels_of / name).mkdir(parents=True)
        (kernels_of / name / "T.tic").touch()
        (kernels_of / name / "checked").touch()
        used = time.time() - 86400 * days
        os.utime(kernels_of / name / "checked", (used, used))
    (kernels_of / "begun").mkdir()
    here.setenv("XDG_CACHE_HOME", str(tmp_path / "caches"))
    here.delenv("TI_OFFLINE_CACHE_FILE_PATH", raising=False)
    assert kernel_cache.prepared() == kernels_of / kernel_cache.digest()
    assert capsys.readouterr().err == ""
    names = {path.name for path in kernels_of.iterdir()}
    assert names == {"begun", "in use", kernel_cache.digest()}


def test_a_lock_that_was_left_behind(tmp_path: Path) -> None:
    """Nothing was ever written while it lay there."""
    cache = tmp_path / "cache"
    cache.mkdir()
    lock = cache / LOCK
    lock.touch()
    os.utime(lock, (time.time() - 120, time.time() - 120))
    assert "ticache.lock: left by a process that was killed; removed" in again(tmp_path, cache)
    assert not lock.exists()
    assert compiled(cache)


def test_a_lock_that_is_held(tmp_path: Path) -> None:
    """Another process may be writing: it is left alone."""
    cache = tmp_path / "cache"
    cache.mkdir()
    (cache / LOCK).touch()
    assert again(tmp_path, cache) == ""
    assert (cache / LOCK).exists()
    assert not compiled(cache)


DAMAGED = "some compiled kernels were damaged; they are discarded and compiled again"


def damaged(cache: Path, damage: str) -> None:
    name, content = max(kernels(cache).items(), key=lambda item: len(item[1]))
    file = cache / (INDEX if damage == "index cut" else name)
    if damage == "missing":
        file.unlink()
    elif damage == "flipped":
        file.write_bytes(content[:200] + bytes([content[200] ^ 1]) + content[201:])
    else:
        file.write_bytes(b"" if damage == "empty" else file.read_bytes()[:-50])


@pytest.mark.parametrize("damage", ["cut", "flipped", "missing", "empty", "index cut"])
def test_damage_is_mended_once(
    damage: str, cache: Path, here: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    here.setenv("TI_OFFLINE_CACHE_FILE_PATH", str(cache))
    damaged(cache, damage)
    assert kernel_cache.prepared() == cache
    assert DAMAGED in capsys.readouterr().err
    assert kernels(cache).keys() == packaged()
    assert kernel_cache.prepared() == cache
    assert capsys.readouterr().err == ""


def test_a_process_compiles_again_what_was_damaged(tmp_path: Path, cache: Path) -> None:
    whole = kernels(cache).keys()
    damaged(cache, "flipped")
    assert DAMAGED in again(tmp_path, cache)
    assert kernels(cache).keys() == whole


def test_a_source_is_read_once_however_often_it_is_inlined() -> None:
    runtime.start()
    from taichi.lang.kernel_impl import getsourcelines

    @ti.func
    def doubled(number):
        return 2.0 * number

    @ti.kernel
    def eightfold():
        _ = doubled(doubled(doubled(5.0)))

    before = getsourcelines.cache_info()
    eightfold()
    after = getsourcelines.cache_info()
    assert (after.misses - before.misses, after.hits - before.hits) == (2, 2)
