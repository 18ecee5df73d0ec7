"""The bars and strips are those of validation/verify.py, which is no package of the project."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[2] / "validation"))
