"""The engine with the energy ledger left out, to tell what the ledger costs.

The engine has no such switch: it would be one more thing to test, for nobody's use. So this edits
the engine's source before a worker imports it. What the edits leave unused (powers, their sums) the
compiler drops. Rows of the history, whose energies are part of the ledger, are written a hundred
times more rarely.
"""

from __future__ import annotations

import importlib.util
import re
import shutil
import sys
import tempfile
from pathlib import Path

# Statements to drop, wherever the engine has them. Each must be found, or there is nothing to
# measure.
DROPPED = (
    r"lattice\.state\.work\[b, strip\]\[member\] = .+",
    r"(lattice\.scratch\.)?tally\[b, strip\]\.by_bonds = .+",
    r"(?<!\.)tally\[b, strip\]\.(sheared|damped|pressed) = .+",
    r"work\[WORK\.\w+\] [-+]= .+",
    r"lattice\.state\.work\[b, strip\] = work",
)


class OutdatedError(Exception):
    """The engine's source no longer has what is to be dropped."""


def install() -> None:
    """From now on, imports of the engine give the edited one."""
    package = importlib.util.find_spec("taichi_foam.engine")
    assert package is not None
    assert package.submodule_search_locations
    edited = Path(tempfile.mkdtemp(prefix="taichi_foam_no_ledger_"), "engine")
    shutil.copytree(package.submodule_search_locations[0], edited)
    found = dict.fromkeys(DROPPED, 0)
    for path in edited.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        for statement in DROPPED:
            text, count = re.subn(statement, "pass", text)
            found[statement] += count
        path.write_text(text, encoding="utf-8")
    missing = [statement for statement, count in found.items() if not count]
    if missing:
        raise OutdatedError(f"timing/no_ledger.py: the engine no longer has {missing}")
    import taichi_foam.engine

    assert "taichi_foam.engine.nodes" not in sys.modules, "the engine is already imported"
    taichi_foam.engine.__path__[:] = [str(edited)]
