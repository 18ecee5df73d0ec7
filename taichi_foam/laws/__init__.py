"""The physics: bond laws, impactor shapes, contact; each is tested alone against a closed form.

A law or a shape consists of the values of a scene's table and the functions that kernels call
(`ti.func`). Lengths in m, stresses in Pa, tension positive.
"""
