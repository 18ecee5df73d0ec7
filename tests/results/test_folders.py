"""A result appears as a whole or not at all; what is not the program's is never touched.

Trouble is told early and clearly.
"""

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
from processes import without_rights

from taichi_foam.errors import UserError
from taichi_foam.results.files import next_numbered
from taichi_foam.results.folders import (
    UNFINISHED,
    check_output_folder,
    claimed,
    output_folder,
    request_in,
)
from taichi_foam.results.manifest import MANIFEST, Manifest

on_linux = pytest.mark.skipif(sys.platform != "linux", reason="needs Linux's /proc and /dev/full")


def contents(folder: Path) -> dict[str, str]:
    """All files but manifests."""
    files = (p for p in folder.rglob("*") if p.is_file() and p.name != MANIFEST)
    return {str(p.relative_to(folder)): p.read_text() for p in files}


@pytest.fixture
def old(tmp_path: Path) -> Path:
    """A folder with a result."""
    write(tmp_path / "old", "summary.json", "precious")
    return tmp_path / "old"


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
        assert os.listdir(target) == [UNFINISHED]
    assert contents(tmp_path) == {"a/b/run/frames/1.txt": "one"}
    assert sorted(os.listdir(target)) == ["frames", MANIFEST]
    assert Manifest.of(target) == Manifest.read(target)


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
    with (
        pytest.raises(UserError, match=r"already holds a result.*overwrite=True"),
        output_folder(old),
    ):
        pytest.fail("the block must not run")
    assert contents(old) == {"summary.json": "precious"}


def test_overwriting_replaces_it_as_a_whole(old: Path) -> None:
    with output_folder(old, overwrite=True) as folder:
        (folder / "new").write_text("new")
        assert (old / "summary.json").read_text() == "precious"
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


def test_a_second_process_is_refused_before_it_computes(old: Path) -> None:
    with output_folder(old, overwrite=True) as folder:
        (folder / "ours").write_text("ours")
        for refused in (check_output_folder, lambda path, over: write(path, "x", "x", over)):
            with pytest.raises(UserError, match="another process is working"):
                refused(old, True)
    assert contents(old) == {"ours": "ours"}


def test_what_somebody_puts_there_meanwhile_is_not_lost_nor_is_the_result(tmp_path: Path) -> None:
    target = tmp_path / "run"
    ours = output_folder(target)
    (ours.__enter__() / "history.csv").write_text("ours")
    (target / "history.csv").write_text("theirs")
    with pytest.raises(
        UserError, match=r"history\.csv: another program has put this here in the meantime"
    ):
        ours.__exit__(None, None, None)
    assert (target / "history.csv").read_text() == "theirs"
    assert "ours" in contents(target).values()


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
    with pytest.raises(UserError, match=r"file: is a file\. Fix"):
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


def test_only_a_result_is_replaced_and_of_it_only_what_was_written(
    old: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Documents, projects, a parent of home: whatever holds no result is refused whole."""
    work = old.parent / "work"
    project = work / "projects" / "mine"
    (project / ".git").mkdir(parents=True)
    (work / "thesis.txt").write_text("three years")
    (work / UNFINISHED).mkdir()
    (work / UNFINISHED / "novel.txt").write_text("chapter one")
    monkeypatch.setenv("HOME", str(work / "projects"))
    monkeypatch.chdir(project)
    before = contents(work)
    for folder in (work, work / "projects", project, Path(".."), work / UNFINISHED):
        with pytest.raises(UserError, match="not empty, but holds no result"):
            write(folder, "new", "new", overwrite=True)
    assert contents(work) == before
    # what lies beside a result stays when the result is replaced
    (old / "notes.txt").write_text("mine")
    (old / "photographs").mkdir()
    (old / "photographs" / "1.png").write_text("sea")
    write(old, "history.csv", "new", overwrite=True)
    kept = {"notes.txt": "mine", "photographs/1.png": "sea"}
    assert contents(old) == {"history.csv": "new", **kept}


def test_an_edited_file_of_a_result_is_not_replaced(old: Path) -> None:
    (old / "summary.json").write_text("precious, and annotated")
    with pytest.raises(UserError, match=r"changed since .*: summary\.json"):
        write(old, "new", "new", overwrite=True)
    assert contents(old) == {"summary.json": "precious, and annotated"}


def test_a_manifest_reaches_nowhere_else(old: Path) -> None:
    """Paths that lead out of the folder, and links put in place of folders, delete nothing."""
    outside = old.parent / "outside"
    outside.mkdir()
    (outside / "file").write_text("precious")
    entry = (old / MANIFEST).read_text()
    for name in ("../outside/file", str(outside / "file")):
        (old / MANIFEST).write_text(entry.replace("summary.json", name))
        with pytest.raises(UserError, match="holds no result"):
            write(old, "new", "new", overwrite=True)
    (old / "link").symlink_to(outside)
    (old / MANIFEST).write_text(entry.replace("summary.json", "link/file"))
    write(old, "new", "new", overwrite=True)
    assert contents(outside) == {"file": "precious"}


def test_too_little_room_is_told_before_the_run(tmp_path: Path) -> None:
    free = shutil.disk_usage(tmp_path).free
    with pytest.raises(UserError, match=r"needs about .* GB.*free some space"):
        check_output_folder(tmp_path / "run", needed_bytes=free + 10**12)


@on_linux
def test_proc_and_devices_are_refused() -> None:
    with pytest.raises(UserError, match="cannot be written"):
        check_output_folder("/proc/taichi-foam-run")
    with pytest.raises(UserError, match=r"full: is a file\. Fix"):
        check_output_folder("/dev/full")
    with pytest.raises(UserError, match="a file, not a folder"):
        check_output_folder("/dev/full/run")
    with pytest.raises(UserError, match="holds no result"):
        check_output_folder("/", overwrite=True)


def test_a_folder_without_permission_is_refused() -> None:
    base = Path(tempfile.mkdtemp(prefix="taichi-foam-test-"))
    inside = base / "mine"
    write(inside, "note", "note")
    base.chmod(0o555)
    with without_rights():
        with pytest.raises(UserError, match=r"permission denied.*may write"):
            check_output_folder(base / "run")
        with pytest.raises(UserError, match="permission denied"), output_folder(base / "run"):
            pytest.fail("the block must not run")
        with pytest.raises(UserError, match="permission denied"):
            check_output_folder(inside, overwrite=True)
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


# --- work that goes on ------------------------------------------------------------------------


REQUEST = {"command": "test", "mass": 1.0}


def begin(target: Path, overwrite: bool = False) -> None:
    """Claim a folder, leave something to be continued, and be killed."""
    claim = claimed(target, REQUEST, overwrite)
    (claim.__enter__().work / "checkpoint").write_text("half")
    claim.__exit__(SystemExit, SystemExit(), None)


def complete(target: Path, overwrite: bool = False, request: dict = REQUEST) -> bool:
    """Claim it again and write a result; whether there was something to go on from."""
    with claimed(target, request, overwrite) as claim:
        found = (claim.work / "checkpoint").exists()
        with claim.publishing() as staging:
            (staging / "history.csv").write_text("whole")
        claim.finish()
    return found


def test_the_same_request_goes_on_and_another_is_refused(old: Path) -> None:
    target = old.parent / "new"
    begin(target)
    assert request_in(target)["mass"] == 1.0
    with pytest.raises(UserError, match=r"mass = 1\.0 instead of 2\.0"):
        complete(target, request={**REQUEST, "mass": 2.0})
    assert complete(target)
    assert contents(target) == {"history.csv": "whole"}
    assert sorted(os.listdir(target)) == ["history.csv", MANIFEST]


def test_unfinished_work_of_another_request_can_be_given_up(tmp_path: Path) -> None:
    begin(tmp_path / "run")
    assert not complete(tmp_path / "run", overwrite=True, request={**REQUEST, "mass": 2.0})
    assert sorted(os.listdir(tmp_path / "run")) == ["history.csv", MANIFEST]


def test_the_older_result_stays_until_the_new_one_is_complete(old: Path) -> None:
    begin(old, overwrite=True)
    assert (old / "summary.json").read_text() == "precious"
    assert complete(old)  # what has been begun needs no other leave
    assert contents(old) == {"history.csv": "whole"}


def test_a_claim_that_comes_to_nothing_leaves_nothing(old: Path) -> None:
    for target in (old.parent / "a" / "b", old):
        with pytest.raises(SystemExit), claimed(target, REQUEST, overwrite=True):
            raise SystemExit
    assert contents(old.parent) == {"old/summary.json": "precious"}
    assert os.listdir(old.parent) == ["old"]


@pytest.mark.parametrize("last", range(1, 12))
def test_killed_while_files_move_into_place(old: Path, last: int) -> None:
    """In a process of its own, killed at each call that renames or removes something."""
    program = f"""
import os, signal, sys
from pathlib import Path
from taichi_foam.results.folders import claimed
calls = 0
def counted(call):
    def wrapped(*arguments, **options):
        global calls
        calls += 1
        if calls == {last}:
            os.kill(os.getpid(), signal.SIGKILL)
        return call(*arguments, **options)
    return wrapped
with claimed({str(old)!r}, {REQUEST!r}, True) as claim:
    (claim.work / "checkpoint").write_text("ended")
    with claim.publishing() as staging:
        (staging / "deeper").mkdir()
        (staging / "deeper" / "1.txt").write_text("one")
        (staging / "history.csv").write_text("whole")
        for name in ("replace", "unlink", "rmdir", "rename"):
            setattr(os, name, counted(getattr(os, name)))
    claim.finish()
"""
    done = subprocess.run([sys.executable, "-c", program], check=False)
    assert done.returncode in (0, -9)
    kept = contents(old)
    if (old / UNFINISHED).exists():
        assert complete(old)
        assert contents(old) == {"history.csv": "whole"}
    else:
        assert kept.items() >= {"history.csv": "whole", "deeper/1.txt": "one"}.items()
        with pytest.raises(UserError, match="holds a result"):
            complete(old)
    assert sorted(os.listdir(old)) in (
        ["history.csv", MANIFEST],
        ["deeper", "history.csv", MANIFEST],
    )


def test_killed_as_its_first_act(tmp_path: Path) -> None:
    """While it wrote what was asked for."""
    work = tmp_path / UNFINISHED
    work.mkdir()
    for name in ("lock", ".request.0a1b2c3d.partial.json"):
        (work / name).touch()
    assert not complete(tmp_path)
    assert contents(tmp_path) == {"history.csv": "whole"}


def test_what_a_killed_process_was_writing_goes_with_the_next(tmp_path: Path) -> None:
    begin(tmp_path)
    for name in (".film.0a1b2c3d.partial.mp4", f"{UNFINISHED}/.checkpoint.0a1b2c3d.partial.npz"):
        (tmp_path / name).write_text("torn")
    (tmp_path / ".mine.partial").write_text("mine")
    assert complete(tmp_path)
    assert contents(tmp_path) == {"history.csv": "whole", ".mine.partial": "mine"}


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
