"""The command line: `taichi-foam run`, `scenes`, `reproduce`, and `python scenes/wedge.py`.

Exit codes: 0 done; 1 a run failed (what was computed is saved); 2 the request cannot be (nothing
was computed or written); 130 Ctrl-C (what there is has been saved).
"""

from taichi_foam.cli.app import main, run_script

__all__ = ["main", "run_script"]
