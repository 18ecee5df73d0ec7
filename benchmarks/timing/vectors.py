"""How wide the vectors are that Taichi compiles for on this machine."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

from taichi_foam.engine import kernel_cache

BITS = {"x": 128, "y": 256, "z": 512}

# Eight numbers a pack fill the widest vectors there are. Taichi leaves the assembly in the folder.
_PROGRAM = """
import taichi as ti
ti.init(
    arch=ti.cpu, cpu_max_num_threads=1, print_kernel_asm=True, offline_cache=False,
    log_level=ti.ERROR,
)
one, other = (ti.Vector.field(8, ti.f64, 64) for _ in range(2))
@ti.kernel
def add():
    ti.loop_config(serialize=True)
    for i in range(64):
        one[i] += other[i]
add()
"""


@cache
def vectors() -> str:
    """Width of the vectors in the assembly of a kernel that is compiled here, in words."""
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "add.py"
        program.write_text(_PROGRAM, encoding="utf-8")
        subprocess.run([sys.executable, program.name], cwd=folder, check=True, capture_output=True)
        assembly = "".join(path.read_text("utf-8") for path in Path(folder).glob("*.s"))
    registers = set(re.findall(r"%([xyz])mm", assembly))
    if not registers:
        return "vectors of unknown width"  # not an x86 processor
    width = f"vectors of {BITS[max(registers)]} bits"
    if kernel_cache.is_wider_than_known(kernel_cache.cpuinfo()):
        width += " (256 in the kernels that come with the package)"
    return width
