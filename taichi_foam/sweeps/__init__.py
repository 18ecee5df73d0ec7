"""Sweeps: many drops that differ in a few values, in one folder, which survive what comes."""
