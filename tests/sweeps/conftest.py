"""What compares two sweeps on disk is in benchmarks/, which is no package of the project."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[2] / "benchmarks"))
