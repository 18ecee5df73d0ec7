"""One server for all tests of a module that leave it as it is."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from serving import ENDLESS, Served

from taichi_foam.results.result import Result


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    out = tmp_path_factory.mktemp("served")
    with Served(out, *ENDLESS) as server:  # which ends it, should it never come to run
        with server.viewer() as viewer:
            viewer.wait_for("numbers", lambda message: message["state"] == "running")
        yield server
        # whatever has been done to it
        code, said = server.stop()
    assert (code, said) == (130, f"interrupted: what was computed is in {out}\n")
    assert Result.load(out / "paper-wedge-2.86-001").run["interrupted"]
