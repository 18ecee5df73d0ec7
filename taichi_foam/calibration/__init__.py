"""Parameters of a scene from measured traces, with their uncertainty."""
