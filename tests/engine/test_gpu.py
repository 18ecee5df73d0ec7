"""A GPU's ways of stepping against the CPU's, by CUDA and Vulkan; Debian's Vulkan is software.

Both compute the same sums in almost the same order, and differ by rounding. So short runs agree
past their first failures, too: it takes longer until the chaos of broken foam shows.
"""

import contextlib
import functools
import os
import subprocess
import sys
import time
from pathlib import Path

import device_states
import numpy as np
import pytest
from device_states import (
    ALONE,
    ENERGIES,
    STEPS_AFTER,
    STEPS_BIG,
    STEPS_ENSEMBLE,
    STEPS_OPTIONS,
    STEPS_PAD,
    States,
)

from taichi_foam.engine.runtime import Device, device_of

HERE = Path(__file__).parent

# A step rounds the forces a few dozen times, and a node's force is the difference of bonds'
# forces that are up to 1e3 times as large. Stable steps let errors add up, no faster than steps.
ROUNDING = 1e3 * 50 * np.finfo(float).eps


# The architectures that have a device here; without any, the tests of Vulkan say what they miss.
ARCHES = [arch for arch in ("cuda", "vulkan") if device_of(arch) is not None] or ["vulkan"]

on_this_cpu = functools.cache(device_states.everything)


@pytest.fixture(scope="module", params=ARCHES)
def device(request: pytest.FixtureRequest) -> tuple[str, Device]:
    found = device_of(request.param)
    if found is None or not found.has_float64:
        pytest.skip("no Vulkan device with 64-bit floats; Debian's mesa-vulkan-drivers has one")
    return request.param, found


@pytest.fixture(scope="module")
def states(
    device: tuple[str, Device], tmp_path_factory: pytest.TempPathFactory
) -> tuple[States, States]:
    """Everything on the CPU, and the same on a GPU by a process of its own, at the same time.

    With pytest-xdist, all workers share the one process.
    """
    arch, _ = device
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    process = None
    with contextlib.suppress(FileExistsError):
        (folder / arch).mkdir()
        process = subprocess.Popen(
            [sys.executable, HERE / "device_states.py", arch, folder / f"{arch}.part.npz"],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=HERE.parents[1],
        )  # fmt: skip
    on_cpu = on_this_cpu()
    if process is not None:
        out, _ = process.communicate(timeout=1200)
        assert process.returncode == 0, out
        (folder / f"{arch}.part.npz").rename(folder / f"{arch}.npz")
    end = time.monotonic() + 600
    while not (folder / f"{arch}.npz").exists():
        assert time.monotonic() < end
        time.sleep(0.1)
    with np.load(folder / f"{arch}.npz") as numbers:
        return on_cpu, dict(numbers)


def assert_close(one: States, other: States, steps: int) -> None:
    """Equal to rounding, on the scale of each quantity."""
    names = ("time", "impactor_y", "position", "velocity", "e_min_a")
    for name in (*names, "impactor_angle", "impactor_shift"):
        scale = np.abs(one[name]).max()
        np.testing.assert_allclose(
            other[name], one[name], rtol=0, atol=steps * ROUNDING * scale, err_msg=name
        )


def test_the_record_names_the_device(
    states: tuple[States, States], device: tuple[str, Device]
) -> None:
    on_cpu, on_gpu = states
    _, found = device
    assert not on_cpu["device"].item()
    assert found.name in on_gpu["device"].item()
    assert found.is_software == on_gpu["device"].item().endswith("(software)")


def test_no_float_lies_where_vulkan_misreads_it(states: tuple[States, States]) -> None:
    assert states[1]["misplaced"].size == 0, states[1]["misplaced"]


def test_a_pad_of_two_foams_agrees_with_the_cpu_to_rounding(states: tuple[States, States]) -> None:
    """Masses, faces and foams by place, on a ribbed support."""
    on_cpu, on_gpu = states
    assert np.abs(part(on_cpu, "pad")["e_min_a"]).max() > 0.0
    assert_close(part(on_cpu, "pad"), part(on_gpu, "pad"), STEPS_PAD)


def test_blocks_agree_with_the_cpu_to_rounding_with_every_option(
    states: tuple[States, States],
) -> None:
    """Rates, scatter, cuts, pieces that rub, off the rails."""
    on_cpu, on_gpu = states
    assert on_cpu["options/e_min_a"].min() < -1e-3
    assert on_cpu["options/broken"].min() > 5  # the cut
    np.testing.assert_array_equal(on_gpu["options/broken"], on_cpu["options/broken"])
    assert_close(part(on_cpu, "options"), part(on_gpu, "options"), STEPS_OPTIONS)


def test_wide_steps_agree_with_the_cpu_to_rounding(states: tuple[States, States]) -> None:
    """Lattices too big for one block: crushed, and barely broken; one with every option."""
    on_cpu, on_gpu = states
    assert on_cpu["big/e_min_a"].min() < -0.08  # well past the yield strain, -0.05
    assert_close(part(on_cpu, "big"), part(on_gpu, "big"), STEPS_BIG)


def test_blocks_agree_with_the_cpu_to_rounding_past_failure(states: tuple[States, States]) -> None:
    """Three shapes in one batch, each more than one turn of a block's threads."""
    on_cpu, on_gpu = states
    assert on_cpu["after/broken"].min() >= 3
    np.testing.assert_array_equal(on_gpu["after/broken"], on_cpu["after/broken"])
    assert_close(part(on_cpu, "after"), part(on_gpu, "after"), STEPS_AFTER)


def test_a_lattice_has_the_same_numbers_alone_and_in_a_batch(states: tuple[States, States]) -> None:
    """To the last bit, on the same device, past the first failures."""
    _, on_gpu = states
    assert on_gpu["after/broken"].min() >= 3
    for name, alone in part(on_gpu, "alone").items():
        np.testing.assert_array_equal(
            on_gpu[f"after/{name}"][ALONE : ALONE + 1], alone, err_msg=name
        )


def test_whole_runs_that_break_agree_with_the_cpu(states: tuple[States, States]) -> None:
    """Depth, broken bonds, and every energy, on the scale of the impact energy."""
    on_cpu, on_gpu = (part(each, "ensemble") for each in states)
    assert on_cpu["broken"].min() > 10
    np.testing.assert_array_equal(on_gpu["broken"], on_cpu["broken"])
    close = STEPS_ENSEMBLE * ROUNDING
    np.testing.assert_allclose(on_gpu["depth"], on_cpu["depth"], rtol=close)
    for name in ENERGIES:
        away = np.abs(on_gpu[name] - on_cpu[name]) / on_cpu["impact"]
        assert away.max() < close, name


def test_the_energy_ledger_closes_as_on_the_cpu(states: tuple[States, States]) -> None:
    on_cpu, on_gpu = (part(each, "ensemble") for each in states)
    worst = (on_cpu["residual"] / on_cpu["impact"]).max()
    assert worst < 1e-3
    assert (on_gpu["residual"] / on_gpu["impact"]).max() < 2 * worst


def part(states: States, name: str) -> States:
    return {key.split("/")[1]: x for key, x in states.items() if key.startswith(name + "/")}
