"""The choices that the paper leaves open, against its tests: `validation/fidelity.py` runs it."""
