"""Formulas of cushion design, in plain NumPy: no scene, no run, no device."""
