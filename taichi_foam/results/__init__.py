"""A run in memory and on disk: results and their folders."""
