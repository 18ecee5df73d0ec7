"""The engine with the energy ledger left out, to tell what the ledger costs.

The engine has no such switch: it would be one more thing to test, for nobody's use. So this edits
the engine's source before a worker imports it. What the edits leave unused (powers, their sums) the
compiler drops. Rows of the history, whose energies are part of the ledger, are written a hundred
times more rarely.
"""

from __future__ import annotations

import importlib.util
import re
import sys
import tempfile
from pathlib import Path

# Module, and a statement to drop. Each must be found, or there is nothing to measure.
EDITS = (
    ("nodes", r"lattice\.strip_work\[b, strip\]\[member\] = .+"),
    ("nodes", r"lattice\.tally\[b, strip\]\.by_faces = .+"),
    ("faces", r"(lattice\.)?tally\[b, strip\]\.(sheared|damped) = .+"),
    ("contact", r"work\[\w+\] -= .+"),
    ("contact", r"lattice\.strip_work\[b, strip\] = work"),
)


class OutdatedError(Exception):
    """The engine's source no longer says what is to be edited."""


def install() -> None:
    """From now on, imports of the engine give the edited one."""
    package = importlib.util.find_spec("taichi_foam.engine")
    assert package is not None
    assert package.submodule_search_locations
    source = Path(package.submodule_search_locations[0])
    edited = Path(tempfile.mkdtemp(prefix="taichi_foam_no_ledger_"))
    for path in source.glob("*.py"):
        text = path.read_text(encoding="utf-8")
        for module, statement in EDITS:
            if module == path.stem:
                text, count = re.subn(statement, "pass", text)
                if not count:
                    raise OutdatedError(
                        f"no ledger: engine/{path.name} no longer has {statement!r}"
                    )
        (edited / path.name).write_text(text, encoding="utf-8")
    import taichi_foam.engine

    assert "taichi_foam.engine.nodes" not in sys.modules, "the engine is already imported"
    taichi_foam.engine.__path__[:] = [str(edited)]
