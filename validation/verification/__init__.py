"""The lattice against theories that know no lattice: `validation/verify.py` runs all of it."""
