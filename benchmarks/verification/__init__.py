"""The lattice against theories that know no lattice: `benchmarks/verify.py` runs all of it."""
