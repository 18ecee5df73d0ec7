"""Cushions: which foam, how thick, how large; curves and designs from formulas and runs."""
