"""The one place that starts Taichi.

A second ``ti.init`` frees the memory of every field made before it, and access to such a field then
crashes the process, so the runtime starts once and keeps its settings. `begin_anew` is for a caller
that owns all fields and knows that none is in use.
"""

import contextlib
import ctypes
import io
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from taichi_foam import backend
from taichi_foam.backend import ti
from taichi_foam.engine import kernel_cache
from taichi_foam.errors import UserError

ARCHES = ("cpu", "cuda", "vulkan", "metal")

MOST_THREADS = 64  # most CPU threads that kernels may use


@dataclass(frozen=True)
class Device:
    """A graphics device; `is_software`: emulated by the CPU."""

    name: str
    is_software: bool = False
    has_float64: bool = True


_started: tuple[str, int] | None = None
_device: Device | None = None
_aside: list[Callable[[], None]] = []


def start(arch: str | None = None, threads: int | None = None) -> None:
    """Start Taichi on `arch` with `threads` CPU threads.

    None keeps the settings of a running runtime, or else takes the CPU with all its cores: a GPU is
    never chosen by default.

    Asking again for the same settings does nothing. Floats are 64-bit, and fast math is off: it
    would reorder sums and fuse products, and only without it are the mirror symmetry and the
    independence of batch and thread count exact to the last bit.

    Raises:
        UserError: unknown or absent architecture, a device without 64-bit floats, invalid thread
            count, or settings that differ from those of the running runtime.
    """
    global _started, _device
    cores = os.cpu_count() or 1
    if arch is None:
        arch = _started[0] if _started else "cpu"
    if arch not in ARCHES:
        raise UserError(f"arch = {arch!r}: choose one of {', '.join(ARCHES)}")
    if threads is not None and not 1 <= threads <= 4 * cores:
        raise UserError(f"threads = {threads}: choose 1 to {4 * cores} on {cores} cores")
    wanted = (arch, cores if threads is None else threads)
    if _started is not None:
        if _started[0] != arch or (threads is not None and _started != wanted):
            raise UserError(
                f"Taichi is already running in this process on {_started[0]} with {_started[1]} "
                f"threads; start a new process for {arch} with {wanted[1]} threads"
            )
        return
    ti.set_logging_level(ti.ERROR)
    if arch != "cpu" and not backend.is_present(arch):
        raise UserError(
            f"arch = {arch!r}: this machine offers no {arch} device that Taichi can use; "
            "use arch='cpu', or install the device's driver",
            argument="arch='cpu'",
        )
    _device = device_of(arch)
    if _device is not None and not _device.has_float64:
        raise UserError(
            f"arch = {arch!r}: {_device.name} has no 64-bit floats; use arch='cpu', or a device "
            "that has them",
            argument="arch='cpu'",
        )
    _init(*wanted)
    _started = wanted


def begin_anew() -> None:
    """Free all memory of fields and compiled kernels, and restart with the same settings.

    Every field made so far is lost. Compiled kernels are loaded from the disk again.
    """
    assert _started is not None
    while _aside:
        _aside.pop()()
    ti.reset()
    ti.set_logging_level(ti.ERROR)
    _init(*_started)


def set_aside(shape: tuple[int, int], field: Any, forget: Callable[[], None]) -> None:
    """Allocate a field of the package that belongs to no lattice.

    `forget` is called before the field is lost (`begin_anew`).
    """
    start()
    tree = ti.FieldsBuilder()
    tree.dense(ti.ij, shape).place(field)
    tree.finalize()
    _aside.append(forget)


def has_only(trees: int) -> bool:
    """Whether the device has only this many trees of fields, and no other fields or arrays.

    Fields that were set aside do not count.
    """
    return not backend.has_fields_elsewhere(trees + len(_aside))


def _init(arch: str, threads: int) -> None:
    folder = kernel_cache.prepared()
    with contextlib.redirect_stdout(io.StringIO()):
        ti.init(
            arch=getattr(ti, arch),
            default_fp=ti.f64,
            default_ip=ti.i32,
            cpu_max_num_threads=threads,
            fast_math=False,
            offline_cache=folder is not None,
            # Taichi makes this folder at exit in any case, and the process crashes if it cannot
            offline_cache_file_path=str(folder or os.path.abspath(os.sep)),
            offline_cache_max_size_of_files=kernel_cache.MOST_BYTES,
            # slower than LLVM's own, and makes kernels slower; for the other passes see `passes`
            cfg_optimization=False,
            advanced_optimization=_has_all_passes(arch),
            log_level=ti.ERROR,
            unrolling_limit=0,  # no warnings about loops that are unrolled on purpose
        )
    _share_kernels()


def _share_kernels() -> None:
    """Make kernels on disk independent of the number of threads.

    Taichi writes the number of threads into each kernel that it compiles, as an upper limit; the
    actual threads have been started before, and no loop gets more than these.
    """
    backend.compiling().cpu_max_num_threads = MOST_THREADS


def _has_all_passes(arch: str) -> bool:
    """Whether kernels compile with Taichi's advanced passes.

    They are off on a GPU: with its packs, vectors of one component, Taichi 1.7.4 fails for Vulkan,
    since it cannot infer the type of the sum of such a vector and a scalar.
    """
    return arch == "cpu"


@contextlib.contextmanager
def passes(advanced: bool) -> Iterator[None]:
    """Compile with or without Taichi's advanced passes; on a GPU always without.

    They merge repeated address computations of field accesses, which LLVM cannot, and their time
    grows with the square of a kernel's length.
    """
    assert _started is not None
    how = backend.compiling()
    before = how.advanced_optimization
    how.advanced_optimization = advanced and _has_all_passes(_started[0])
    try:
        yield
    finally:
        how.advanced_optimization = before


def settings() -> dict[str, str | int]:
    """The runtime's settings, for a result's record."""
    assert _started is not None
    told: dict[str, str | int] = {"arch": _started[0], "threads": _started[1]}
    if _device is not None:
        told["device"] = _device.name + (" (software)" if _device.is_software else "")
    return told


# Name and 64-bit support of a graphics device are queried from its driver: Taichi reports neither.
# If a driver's library does not answer, nothing is known about the device.

# Vulkan's numbers for device types, in Taichi's order of preference.
DISCRETE, INTEGRATED, VIRTUAL, SOFTWARE = 2, 1, 3, 4
PREFERENCE = (DISCRETE, INTEGRATED, VIRTUAL, SOFTWARE)

# Offsets in Vulkan's records of the values needed here, in 32-bit words.
DEVICE_TYPE = 4
DEVICE_NAME = 5
SHADER_FLOAT64 = 39
RECORD_WORDS = 512  # more than either record has


def device_of(arch: str) -> Device | None:
    """The device that Taichi uses for `arch`, if its driver's library answers."""
    try:
        if arch == "cuda":
            return _cuda_device()
        if arch == "vulkan":
            return _vulkan_device()
    except (OSError, AttributeError):
        return None
    # Metal's language has no 64-bit floats
    return Device("Metal", has_float64=False) if arch == "metal" else None


def _cuda_device() -> Device | None:
    driver = ctypes.CDLL("nvcuda.dll" if os.name == "nt" else "libcuda.so.1")
    name = ctypes.create_string_buffer(256)
    if driver.cuInit(0) or driver.cuDeviceGetName(name, len(name), 0):
        return None
    return Device(name.value.decode(errors="replace"))


def _vulkan_device() -> Device | None:
    driver = ctypes.CDLL("vulkan-1.dll" if os.name == "nt" else "libvulkan.so.1")
    # VkInstanceCreateInfo without layers or extensions: its structure type is 1
    wanted = (ctypes.c_uint64 * 8)(1)
    instance = ctypes.c_void_p()
    if driver.vkCreateInstance(wanted, None, ctypes.byref(instance)):
        return None
    try:
        count = ctypes.c_uint32(16)
        handles = (ctypes.c_void_p * count.value)()
        driver.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), handles)
        found = [_ask(driver, handle) for handle in handles[: count.value]]
    finally:
        driver.vkDestroyInstance(instance, None)
    known = [each for each in found if each[0] in PREFERENCE]
    return min(known, key=lambda each: PREFERENCE.index(each[0]))[1] if known else None


def _ask(driver: ctypes.CDLL, handle: int) -> tuple[int, Device]:
    """Type and description of one physical device."""
    properties = (ctypes.c_uint32 * RECORD_WORDS)()
    features = (ctypes.c_uint32 * RECORD_WORDS)()
    driver.vkGetPhysicalDeviceProperties(ctypes.c_void_p(handle), properties)
    driver.vkGetPhysicalDeviceFeatures(ctypes.c_void_p(handle), features)
    kind = properties[DEVICE_TYPE]
    name = ctypes.string_at(ctypes.addressof(properties) + 4 * DEVICE_NAME)
    return kind, Device(
        name.decode(errors="replace"), kind == SOFTWARE, bool(features[SHADER_FLOAT64])
    )
