"""A GPU's ways of stepping against the CPU's, on any Vulkan device; Debian's is software.

Before failure both compute the same sums in almost the same order, and differ by rounding. After
it, broken foam is chaotic: what has to agree are the statistics of an ensemble.
"""

import contextlib
import os
import subprocess
import sys
import time
from pathlib import Path

import device_states
import numpy as np
import pytest
from device_states import ENERGIES, STEPS_BEFORE, STEPS_BIG, STEPS_OPTIONS, States

from taichi_foam.engine.runtime import device_of

HERE = Path(__file__).parent

# A step rounds the forces a few dozen times, and a node's force is the difference of bonds'
# forces that are up to 1e3 times as large. Stable steps let errors add up, no faster than steps.
ROUNDING = 1e3 * 50 * np.finfo(float).eps


@pytest.fixture(scope="module")
def states(tmp_path_factory: pytest.TempPathFactory) -> tuple[States, States]:
    """Everything on the CPU, and the same on Vulkan by a process of its own, at the same time.

    With pytest-xdist, all workers share the one process.
    """
    device = device_of("vulkan")
    if device is None or not device.has_float64:
        pytest.skip("no Vulkan device with 64-bit floats; Debian's mesa-vulkan-drivers has one")
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    process = None
    with contextlib.suppress(FileExistsError):
        (folder / "vulkan").mkdir()
        process = subprocess.Popen(
            [sys.executable, HERE / "device_states.py", "vulkan", folder / "vulkan.part.npz"],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=HERE.parents[1],
        )  # fmt: skip
    on_cpu = device_states.everything()
    if process is not None:
        out, _ = process.communicate(timeout=1200)
        assert process.returncode == 0, out
        (folder / "vulkan.part.npz").rename(folder / "vulkan.npz")
    end = time.monotonic() + 600
    while not (folder / "vulkan.npz").exists():
        assert time.monotonic() < end
        time.sleep(0.1)
    with np.load(folder / "vulkan.npz") as numbers:
        return on_cpu, dict(numbers)


def assert_close(one: States, other: States, steps: int) -> None:
    """Equal to rounding, on the scale of each quantity."""
    names = ("time", "impactor_y", "position", "velocity", "e_min_a")
    for name in (*names, "impactor_angle", "impactor_shift"):
        scale = np.abs(one[name]).max()
        np.testing.assert_allclose(
            other[name], one[name], rtol=0, atol=steps * ROUNDING * scale, err_msg=name
        )


def test_the_record_names_the_device(states: tuple[States, States]) -> None:
    on_cpu, on_vulkan = states
    device = device_of("vulkan")
    assert device is not None
    assert not on_cpu["device"].item()
    assert device.name in on_vulkan["device"].item()
    assert device.is_software == on_vulkan["device"].item().endswith("(software)")


def test_no_float_lies_where_vulkan_misreads_it(states: tuple[States, States]) -> None:
    assert states[1]["misplaced"].size == 0, states[1]["misplaced"]


def test_a_pad_of_two_foams_agrees_with_the_cpu_to_rounding(states: tuple[States, States]) -> None:
    """Masses, faces and foams by place, on a ribbed support."""
    on_cpu, on_vulkan = states
    assert np.abs(part(on_cpu, "pad")["e_min_a"]).max() > 0.0
    assert_close(part(on_cpu, "pad"), part(on_vulkan, "pad"), STEPS_BEFORE)


def test_blocks_agree_with_the_cpu_to_rounding_before_failure(
    states: tuple[States, States],
) -> None:
    """Three of the paper's tests in one batch, each more than one turn of a block's threads."""
    on_cpu, on_vulkan = states
    assert not on_cpu["before/broken"].any()
    assert_close(part(on_cpu, "before"), part(on_vulkan, "before"), STEPS_BEFORE)


def test_blocks_agree_with_the_cpu_to_rounding_with_every_option(
    states: tuple[States, States],
) -> None:
    """Rates, scatter, cuts, pieces that rub, off the rails."""
    on_cpu, on_vulkan = states
    assert on_cpu["options/e_min_a"].min() < -1e-3
    assert on_cpu["options/broken"].min() > 5  # the cut
    np.testing.assert_array_equal(on_vulkan["options/broken"], on_cpu["options/broken"])
    assert_close(part(on_cpu, "options"), part(on_vulkan, "options"), STEPS_OPTIONS)


def test_wide_steps_agree_with_the_cpu_to_rounding(states: tuple[States, States]) -> None:
    """Lattices too big for one block: crushed, and barely broken; one with every option."""
    on_cpu, on_vulkan = states
    assert on_cpu["big/e_min_a"].min() < -0.08  # well past the yield strain, -0.05
    assert_close(part(on_cpu, "big"), part(on_vulkan, "big"), STEPS_BIG)


def test_a_lattice_has_the_same_numbers_alone_and_in_a_batch(states: tuple[States, States]) -> None:
    """To the last bit, on the same device, past the first failures."""
    _, on_vulkan = states
    assert on_vulkan["after/broken"].min() >= 3
    for name, alone in part(on_vulkan, "alone").items():
        np.testing.assert_array_equal(on_vulkan[f"after/{name}"][5:6], alone, err_msg=name)


def test_after_failure_the_statistics_agree(states: tuple[States, States]) -> None:
    on_cpu, on_vulkan = (part(each, "ensemble") for each in states)
    assert on_cpu["broken"].min() > 10
    for name in ("depth", "broken", *ENERGIES):
        assert on_cpu[name].min() <= np.median(on_vulkan[name]) <= on_cpu[name].max(), name


def test_the_energy_ledger_closes_as_on_the_cpu(states: tuple[States, States]) -> None:
    on_cpu, on_vulkan = (part(each, "ensemble") for each in states)
    worst = (on_cpu["residual"] / on_cpu["impact"]).max()
    assert worst < 1e-3
    assert (on_vulkan["residual"] / on_vulkan["impact"]).max() < 2 * worst


def part(states: States, name: str) -> States:
    return {key.split("/")[1]: x for key, x in states.items() if key.startswith(name + "/")}
