"""The choices that the paper leaves open, against its tests: `benchmarks/fidelity.py` runs it."""
