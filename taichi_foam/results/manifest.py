"""Names and checksums of the files that this program has written into a folder.

`manifest.json` is written last, so a folder that has one is complete. It also tells the program's
own files from all others: only files that a manifest lists, and that are unchanged, are ever
replaced or removed.

    {"program": "taichi_foam", "version": "0.2.0",
     "files": {"history.csv": {"bytes": 8123, "sha256": "..."}, ...},
     "folders": ["frames"]}      folders with manifests of their own
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Collection, Iterable
from pathlib import Path, PurePosixPath
from typing import Literal, TypeVar

from pydantic import BaseModel, field_validator

from taichi_foam.results.files import whole_file, write_json
from taichi_foam.version import version

MANIFEST = "manifest.json"

_Names = TypeVar("_Names", bound=Collection[str])


class Entry(BaseModel, frozen=True):
    """One file as it was written: its size (bytes) and SHA-256."""

    bytes: int
    sha256: str

    @classmethod
    def of(cls, path: Path) -> Entry:
        """Raises OSError."""
        digest = hashlib.sha256()
        with path.open("rb") as file:
            while block := file.read(1 << 20):
                digest.update(block)
            return cls(bytes=file.tell(), sha256=digest.hexdigest())

    def fits(self, path: Path) -> bool:
        """Whether the file exists and is unchanged."""
        try:
            if path.is_symlink() or path.stat().st_size != self.bytes:
                return False
            return Entry.of(path) == self
        except OSError:
            return False


class Manifest(BaseModel, frozen=True):
    """The files of a folder, by relative path, and its subfolders that have their own manifests."""

    program: Literal["taichi_foam"] = "taichi_foam"
    files: dict[str, Entry] = {}
    folders: frozenset[str] = frozenset()

    @field_validator("files", "folders")
    @classmethod
    def _are_inside(cls, names: _Names) -> _Names:
        """Listed paths lie within the folder: a manifest must not reach elsewhere."""
        for path in map(PurePosixPath, names):
            if not path.parts or path.is_absolute() or ".." in path.parts:
                raise ValueError("outside of the folder")
        return names

    @classmethod
    def read(cls, folder: Path, name: str = MANIFEST) -> Manifest | None:
        """The manifest of `folder`; None if it is missing, damaged, or of another program."""
        try:
            return cls.model_validate_json((folder / name).read_bytes())
        except (OSError, ValueError):
            return None

    @classmethod
    def of(cls, folder: Path) -> Manifest:
        """A manifest of what is in `folder` now. Raises OSError."""
        files, folders = _contents(folder)
        entries = {name: Entry.of(folder / name) for name in files}
        return cls(files=entries, folders=frozenset(folders))

    def __or__(self, other: Manifest) -> Manifest:
        return Manifest(files=self.files | other.files, folders=self.folders | other.folders)

    def write(self, folder: Path, name: str = MANIFEST) -> None:
        """Write it into `folder`. Raises OSError."""
        entries = {name: entry.model_dump() for name, entry in sorted(self.files.items())}
        content = {
            "program": self.program, "version": version(), "files": entries,
            "folders": sorted(self.folders),
        }  # fmt: skip
        with whole_file(folder / name) as partial:
            write_json(partial, content)

    def changed(self, folder: Path) -> list[str]:
        """Its files, including those in its subfolders, that are missing or changed."""
        found = [name for name, entry in self.files.items() if not entry.fits(folder / name)]
        for name in sorted(self.folders):
            inner = Manifest.read(folder / name) or Manifest()
            found += [f"{name}/{each}" for each in inner.changed(folder / name)]
        return found

    def edited(self, folder: Path) -> list[str]:
        """Its files, including those in its subfolders, that exist but are changed."""
        return [name for name in self.changed(folder) if os.path.lexists(folder / name)]

    def remove(self, folder: Path) -> None:
        """Delete the listed files that are unchanged, and folders that become empty.

        Links are not followed. Raises OSError.
        """
        emptied = {folder / name for name in self.folders if not (folder / name).is_symlink()}
        for inner in emptied:
            if (manifest := Manifest.read(inner)) is not None:
                manifest.remove(inner)
                (inner / MANIFEST).unlink()
        for name, entry in self.files.items():
            path = folder / name
            if entry.fits(path) and path.resolve() == folder.resolve() / name:
                path.unlink()
                emptied |= {folder / parent for parent in PurePosixPath(name).parents[:-1]}
        for inner in sorted(emptied, key=lambda path: -len(path.parts)):
            with contextlib.suppress(OSError):  # it holds other files
                inner.rmdir()


def add(folder: Path, names: Iterable[str]) -> None:
    """Add files or subfolders to a folder's manifest; do nothing if it has none.

    Raises OSError.
    """
    if (manifest := Manifest.read(folder)) is None:
        return
    for name in names:
        path = folder / name
        if not path.is_dir():
            manifest |= Manifest(files={name: Entry.of(path)})
        elif (path / MANIFEST).is_file():
            manifest |= Manifest(folders=frozenset([name]))
    manifest.write(folder)


def _contents(folder: Path) -> tuple[list[str], list[str]]:
    """Paths of files in `folder`, and of subfolders that are empty or have their own manifests."""
    files, folders = [], []
    for path in sorted(folder.iterdir()):
        if path.name == MANIFEST:
            continue
        if not path.is_dir() or path.is_symlink():
            files.append(path.name)
            continue
        inner = ([], []) if (path / MANIFEST).is_file() else _contents(path)
        files += [f"{path.name}/{name}" for name in inner[0]]
        folders += [f"{path.name}/{name}" for name in inner[1]] or ([] if inner[0] else [path.name])
    return files, folders
