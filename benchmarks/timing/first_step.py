"""`taichi-foam` up to the first step: `python -m timing.first_step STAMP ARGUMENTS...`.

Prints how long after STAMP (of `time.time()`, taken by whoever started this process) the first
steps were done, and ends there.
"""

import sys
import time

stamp, sys.argv[1:] = float(sys.argv[1]), sys.argv[2:]

from taichi_foam import cli  # noqa: E402 - what a user waits for begins here
from taichi_foam.simulation import simulate  # noqa: E402

original = simulate.run


def run(scene, on_progress=None, **more):
    """Stop at the first news."""

    def stop(_):
        print(f"{time.time() - stamp:.4f}", flush=True)
        sys.exit()  # in good order: Taichi keeps compiled kernels when the process ends

    return original(scene, stop, **more)


simulate.run = run
cli.main()
