"""Fields and kernels of the lattice: what `taichi_foam.simulation.batches` drives."""
