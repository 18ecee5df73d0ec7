"""What every test may share: one Taichi runtime for the whole session."""

import signal

import pytest

from taichi_foam.engine import runtime

# A shell that starts a job in the background has it ignore Ctrl-C, and so all that it starts; the
# tests of Ctrl-C need it.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def taichi_runtime() -> None:
    """Start Taichi as a run would.

    Once in each process: with pytest-xdist every worker has its own runtime and its own fields.
    """
    runtime.start()
