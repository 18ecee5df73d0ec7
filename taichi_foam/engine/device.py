"""What a graphics device is called and whether it computes in 64 bits, asked of its driver.

Taichi tells neither. Where a driver's library does not answer, nothing is known of the device.
"""

import ctypes
import os
from dataclasses import dataclass

# Vulkan's numbers for kinds of devices, in the order in which Taichi prefers them.
DISCRETE, INTEGRATED, VIRTUAL, SOFTWARE = 2, 1, 3, 4
PREFERENCE = (DISCRETE, INTEGRATED, VIRTUAL, SOFTWARE)

# Where Vulkan's records hold what is asked for here, in 32-bit words.
DEVICE_TYPE = 4
DEVICE_NAME = 5
SHADER_FLOAT64 = 39
RECORD_WORDS = 512  # more than either record has


@dataclass(frozen=True)
class Device:
    """One graphics device; `is_software` if the processor plays its part."""

    name: str
    is_software: bool = False
    has_float64: bool = True


def device_of(arch: str) -> Device | None:
    """The device that Taichi uses for `arch`, if its driver's library answers."""
    try:
        if arch == "cuda":
            return _cuda_device()
        if arch == "vulkan":
            return _vulkan_device()
    except (OSError, AttributeError):
        return None
    # Metal's language has no 64-bit numbers
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
    """Kind and description of one physical device."""
    properties = (ctypes.c_uint32 * RECORD_WORDS)()
    features = (ctypes.c_uint32 * RECORD_WORDS)()
    driver.vkGetPhysicalDeviceProperties(ctypes.c_void_p(handle), properties)
    driver.vkGetPhysicalDeviceFeatures(ctypes.c_void_p(handle), features)
    kind = properties[DEVICE_TYPE]
    name = ctypes.string_at(ctypes.addressof(properties) + 4 * DEVICE_NAME)
    return kind, Device(
        name.decode(errors="replace"), kind == SOFTWARE, bool(features[SHADER_FLOAT64])
    )
