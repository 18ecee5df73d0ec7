"""Running scenes: one, many, or a little at a time."""
