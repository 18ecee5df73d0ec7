"""Overrides that make a study small."""

_PICTURES = ("output.width=320", "output.height=180")

COARSE = ("block.columns=20", "block.rows=10", *_PICTURES)
#: So small that an impact takes a second.
TINY = ("block.columns=16", "block.rows=8", *_PICTURES)
