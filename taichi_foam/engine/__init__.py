"""Fields and kernels of the lattice: what `taichi_foam.run.batches` drives."""
