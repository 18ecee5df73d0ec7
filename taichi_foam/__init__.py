"""Impact on crushable foam: a breakable particle lattice on Taichi, after Shim, Tu & Lim (2000)."""

import os

# Taichi prints a banner when it is first imported, wherever that happens.
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")

__version__ = "0.1.0"
