"""An output folder appears as a whole or not at all, and trouble is told early and clearly."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from taichi_foam.errors import UserError
from taichi_foam.results.folders import check_output_folder, next_numbered, output_folder

on_linux = pytest.mark.skipif(sys.platform != "linux", reason="needs Linux's /proc and /dev/full")


def contents(folder: Path) -> dict[str, str]:
    return {str(p.relative_to(folder)): p.read_text() for p in folder.rglob("*") if p.is_file()}


@pytest.fixture
def old(tmp_path: Path) -> Path:
    folder = tmp_path / "old"
    folder.mkdir()
    (folder / "summary.json").write_text("precious")
    return folder


def write(target: Path, name: str, content: str, overwrite: bool = False) -> None:
    """One transaction that writes one file."""
    with output_folder(target, overwrite) as folder:
        (folder / name).write_text(content)


def write_half(target: Path, trouble: type[BaseException], overwrite: bool = False) -> None:
    """A transaction that fails after its first file."""
    with output_folder(target, overwrite) as folder:
        (folder / "half").write_text("half")
        raise trouble


def write_to_full_device(target: Path) -> None:
    with output_folder(target, overwrite=True) as folder:
        (folder / "history.csv").symlink_to("/dev/full")
        (folder / "history.csv").write_text("time_s")


@contextlib.contextmanager
def mounted(options: str) -> Iterator[Path]:
    """A small file system in memory; the test is skipped where mounting is not allowed."""
    point = Path(tempfile.mkdtemp(prefix="taichi-foam-test-"))
    command = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(point)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        point.rmdir()
        pytest.skip("mount is not installed")
    if done.returncode:
        point.rmdir()
        pytest.skip(f"mounting is not permitted here: {done.stderr.strip()}")
    try:
        yield point
    finally:
        subprocess.run(["umount", str(point)], check=True)
        point.rmdir()


# --- the transaction --------------------------------------------------------------------------


def test_a_new_folder_appears_at_the_end_with_its_parents(tmp_path: Path) -> None:
    target = tmp_path / "a" / "b" / "run"
    with output_folder(target) as folder:
        (folder / "frames").mkdir()
        (folder / "frames" / "1.txt").write_text("one")
        assert not target.exists()
    assert contents(tmp_path) == {"a/b/run/frames/1.txt": "one"}
    assert os.listdir(target.parent) == ["run"]


def test_it_gets_the_permissions_of_any_new_folder(tmp_path: Path) -> None:
    (tmp_path / "plain").mkdir()
    with output_folder(tmp_path / "run"):
        pass
    assert (tmp_path / "run").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_an_empty_folder_may_be_filled(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    write(tmp_path / "run", "new", "new")
    assert contents(tmp_path) == {"run/new": "new"}


def test_a_folder_with_content_is_refused(old: Path) -> None:
    with pytest.raises(UserError, match=r"not empty.*overwrite=True"), output_folder(old):
        pytest.fail("the block must not run")
    assert contents(old) == {"summary.json": "precious"}


def test_overwriting_replaces_it_as_a_whole(old: Path) -> None:
    with output_folder(old, overwrite=True) as folder:
        (folder / "new").write_text("new")
        assert contents(old) == {"summary.json": "precious"}
    assert contents(old) == {"new": "new"}
    assert os.listdir(old.parent) == ["old"]


@pytest.mark.parametrize("trouble", [RuntimeError, KeyboardInterrupt, SystemExit])
def test_a_failure_leaves_everything_as_it_was(old: Path, trouble: type[BaseException]) -> None:
    with pytest.raises(trouble):
        write_half(old, trouble, overwrite=True)
    with pytest.raises(trouble):
        write_half(old.parent / "x" / "y", trouble)
    assert contents(old.parent) == {"old/summary.json": "precious"}
    assert os.listdir(old.parent) == ["old"]


def test_a_failed_rename_puts_the_old_folder_back(
    old: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rename = Path.rename

    def failing(self: Path, target: Path) -> Path:
        if self.suffix == ".partial":
            raise OSError(5, "Input/output error")
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", failing)
    with pytest.raises(UserError, match="Input/output error"):
        write(old, "new", "new", overwrite=True)
    assert contents(old.parent) == {"old/summary.json": "precious"}


def test_a_folder_filled_meanwhile_is_not_lost(tmp_path: Path) -> None:
    target = tmp_path / "run"
    ours = output_folder(target)
    ours.__enter__()
    write(target, "theirs", "theirs")
    with pytest.raises(UserError, match="not empty"):
        ours.__exit__(None, None, None)
    assert contents(tmp_path) == {"run/theirs": "theirs"}


def test_a_link_is_followed_and_stays(old: Path) -> None:
    link = old.parent / "link"
    link.symlink_to(old)
    write(link, "new", "new", overwrite=True)
    assert link.is_symlink()
    assert contents(old) == {"new": "new"}


def test_errors_of_the_block_that_are_not_the_folders_pass_through(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError), output_folder(tmp_path / "run"):
        (tmp_path / "no such input").read_text()
    assert os.listdir(tmp_path) == []


# --- what is refused before the run -----------------------------------------------------------


def test_a_good_folder_passes_and_nothing_is_made(tmp_path: Path) -> None:
    check_output_folder(tmp_path / "a" / "b", needed_bytes=1000)
    assert os.listdir(tmp_path) == []


def test_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="that is a file"):
        check_output_folder(tmp_path / "file", overwrite=True)
    with pytest.raises(UserError, match="a file, not a folder"):
        check_output_folder(tmp_path / "file" / "run")
    with pytest.raises(UserError, match="a file, not a folder"):
        check_output_folder(tmp_path / "file" / "deeper" / "run")


@pytest.mark.parametrize("text", ["", "  ", "a\0b"])
def test_what_is_no_path_is_refused(text: str) -> None:
    with pytest.raises(UserError, match="not a path"):
        check_output_folder(text)


def test_too_long_a_name_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="too long"):
        check_output_folder(tmp_path / ("x" * 300))


def test_overwriting_never_deletes_where_one_works(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    work = tmp_path / "work"
    (work / "deeper").mkdir(parents=True)
    home = tmp_path / "home"
    (home / "letters").mkdir(parents=True)
    project = tmp_path / "project"
    (project / ".git").mkdir(parents=True)
    monkeypatch.chdir(work / "deeper")
    monkeypatch.setenv("HOME", str(home))
    for folder in (tmp_path, work, home, project):
        with pytest.raises(UserError, match="would delete everything"):
            check_output_folder(folder, overwrite=True)
    (work / "deeper" / "note").write_text("")
    with pytest.raises(UserError, match="would delete everything"):
        check_output_folder(".", overwrite=True)


def test_too_little_room_is_told_before_the_run(tmp_path: Path) -> None:
    free = shutil.disk_usage(tmp_path).free
    with pytest.raises(UserError, match=r"needs about .* GB.*free some space"):
        check_output_folder(tmp_path / "run", needed_bytes=free + 10**12)


@on_linux
def test_proc_and_devices_are_refused() -> None:
    with pytest.raises(UserError, match="cannot be written"):
        check_output_folder("/proc/taichi-foam-run")
    with pytest.raises(UserError, match="that is a file"):
        check_output_folder("/dev/full")
    with pytest.raises(UserError, match="a file, not a folder"):
        check_output_folder("/dev/full/run")
    with pytest.raises(UserError, match="mount point"):
        check_output_folder("/", overwrite=True)


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="needs Unix permissions")
def test_a_folder_without_permission_is_refused() -> None:
    base = Path(tempfile.mkdtemp(prefix="taichi-foam-test-"))
    inside = base / "mine"
    inside.mkdir()
    (inside / "note").write_text("note")
    base.chmod(0o555)
    root = os.geteuid() == 0
    try:
        if root:  # root may write anywhere, so be nobody for a moment
            os.seteuid(65534)
        with pytest.raises(UserError, match=r"permission denied.*may write"):
            check_output_folder(base / "run")
        with pytest.raises(UserError, match="permission denied"), output_folder(base / "run"):
            pytest.fail("the block must not run")
        with pytest.raises(UserError, match="permission denied"):
            check_output_folder(inside, overwrite=True)
    finally:
        if root:
            os.seteuid(0)
        base.chmod(0o755)
    assert contents(base) == {"mine/note": "note"}
    shutil.rmtree(base)


# --- a disk that fills up or refuses ----------------------------------------------------------


@on_linux
def test_a_full_device_is_told_and_nothing_is_left(old: Path) -> None:
    with pytest.raises(UserError, match=r"the disk is full.*free some space"):
        write_to_full_device(old)
    assert contents(old.parent) == {"old/summary.json": "precious"}
    assert os.listdir(old.parent) == ["old"]


def test_a_disk_that_fills_up_keeps_the_old_folder() -> None:
    with mounted("size=1m") as disk:
        target = disk / "run"
        write(target, "summary.json", "precious")
        with pytest.raises(UserError, match="free some space"):
            check_output_folder(target, overwrite=True, needed_bytes=2_000_000)
        with pytest.raises(UserError, match="the disk is full"):
            write(target, "big", 2_000_000 * " ", overwrite=True)
        assert contents(disk) == {"run/summary.json": "precious"}
        assert os.listdir(disk) == ["run"]
        with pytest.raises(UserError, match=r"mount point.*inside it"):
            check_output_folder(disk)


def test_a_read_only_disk_is_refused() -> None:
    with mounted("ro") as disk, pytest.raises(UserError, match="read-only"):
        check_output_folder(disk / "run")


def test_numbers_go_on_after_the_highest_that_is_there(tmp_path: Path) -> None:
    stem = tmp_path / "a[1]"  # no pattern
    assert next_numbered(stem) == tmp_path / "a[1]-001"
    assert next_numbered(tmp_path / "none" / "a").name == "a-001"
    for name in ("a[1]-007", "a[1]-x", "a[1]-009.png", "a[1]b-020", "a[1]-shots"):
        (tmp_path / name).touch()
    assert next_numbered(stem).name == "a[1]-008"
    assert next_numbered(stem, ".png").name == "a[1]-010.png"
    assert next_numbered(tmp_path / "run", digits=1, first=2).name == "run-2"
