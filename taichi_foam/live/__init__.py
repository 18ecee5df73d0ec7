"""Watching a run while it computes: the run in a process of its own, a viewer at the other end."""
