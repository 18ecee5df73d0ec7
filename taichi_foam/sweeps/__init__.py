"""Sweeps: many drops that differ in a few values, in one folder, resumable after any failure."""
