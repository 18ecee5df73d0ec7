"""The way to step a lattice: which depends on its size, and on what it is on."""

from collections.abc import Callable

from taichi_foam.engine import cpu, gpu
from taichi_foam.engine.lattice import Lattice
from taichi_foam.engine.layout import BLOCK_NODES

# From this many nodes on, a stage is worth spreading over a CPU's threads.
STAGED_NODES = 50_000


def advance_of(lattice: Lattice) -> Callable[[Lattice, int], None]:
    """The faster way to take up to so many steps of every lattice of a batch that goes on."""
    if lattice.on_gpu:
        return gpu.advance_blocks if lattice.size.nodes <= BLOCK_NODES else gpu.advance_wide
    return cpu.advance_staged if lattice.size.nodes >= STAGED_NODES else cpu.advance_fused


def prepare(lattice: Lattice, b: int, knows_stiffest: bool) -> None:
    """Of a state that has been put: what its cells carry, and its stiffest bond if unknown.

    Apart, since the second is the whole law of bonds to compile, and few states ask for it.
    """
    kernels = gpu if lattice.on_gpu else cpu
    if lattice.features.cells:
        kernels.look(lattice, b)
    if not knows_stiffest:
        kernels.find_stiffest(lattice, b)
