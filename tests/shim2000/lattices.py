"""Overrides that make a study small."""

_PICTURES = ("output.width=320", "output.height=180")

# with the calibrated friction the wedge goes through so few cells
COARSE = ("block.columns=20", "block.rows=10", "impactor.friction=0.4", *_PICTURES)
#: So small that an impact takes a second.
TINY = ("block.columns=16", "block.rows=8", *_PICTURES)
