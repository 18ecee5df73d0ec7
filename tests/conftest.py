"""What every test may share: one Taichi runtime for the whole session."""

import pytest

from taichi_foam.engine import runtime


@pytest.fixture(scope="session")
def taichi_runtime() -> None:
    """Start Taichi as a run would.

    Once in each process: with pytest-xdist every worker has its own runtime and its own fields.
    """
    runtime.start()
