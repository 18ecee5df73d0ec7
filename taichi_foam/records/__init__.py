"""Data recorded by a run: instants of the lattice, the history, and both together."""
