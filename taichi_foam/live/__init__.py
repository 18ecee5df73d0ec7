"""Watching a run while it is computed: in a window, a notebook or a browser."""
