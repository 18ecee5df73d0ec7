"""The lattice on the device: model, state and scratch, and the kernels that step them.

`taichi_foam.simulation.batches` calls it; nothing here depends on results, files or pictures.
"""
