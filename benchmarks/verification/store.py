"""Figures of runs, kept in one JSON file as they come: what is there is not computed again."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass
class Store:
    """Figures by part and by the run's name; written after every run."""

    path: Path
    kept: dict[str, dict[str, Any]] = field(default_factory=dict)

    @classmethod
    def open(cls, path: Path) -> Store:
        """Read what earlier calls left, if anything."""
        kept = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        return cls(path, kept)

    def part(self, part: str) -> dict[str, Any]:
        """What there is of one part, by the run's name."""
        return self.kept.setdefault(part, {})

    def forget(self, part: str) -> None:
        """Drop one part, so that it is computed afresh."""
        self.kept.pop(part, None)

    def figures(self, part: str, name: str, compute: Callable[[], Any]) -> Any:
        """The figures of a run: kept ones, or computed now and kept."""
        known = self.part(part)
        if name not in known:
            known[name] = compute()
            self.path.parent.mkdir(parents=True, exist_ok=True)
            text = json.dumps(self.kept, indent=None, separators=(",", ":"), sort_keys=True)
            self.path.write_text(text + "\n", encoding="utf-8")
        return known[name]
