"""What a run records: instants of the lattice, the history, and both together."""
