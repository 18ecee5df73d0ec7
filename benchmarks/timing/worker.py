"""A process that measures what it is asked for: JSON lines in, JSON lines out.

A process has one Taichi, hence one number of threads; so each number has a process of its own,
which stays alive and idle while the others measure.

    python -m timing.worker engine 2
    python -m timing.worker engine 1 no-ledger
    python -m timing.worker peers
"""

from __future__ import annotations

import json
import os
import sys
import traceback
from dataclasses import asdict
from typing import Any

from .subjects import Subject
from .workers import AbsentError


def main() -> None:
    """Answer requests until the pipe closes."""
    # what libraries print must not come between the answers
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    try:
        server, failure = _server(sys.argv[1:]), None
    except Exception as error:
        server, failure = None, error
    for line in sys.stdin:
        request = json.loads(line)
        try:
            if failure is not None:
                raise failure
            answer = {"ok": _answer(server, request)}
        except Exception as error:  # one subject's failure must not end the others
            traceback.print_exception(error)
            lines = str(error).strip().splitlines() or [""]
            said = " ... ".join(dict.fromkeys((lines[0], lines[-1])))
            answer = {"error": f"{type(error).__name__}: {said}"}
            if isinstance(error, AbsentError):
                answer = {"absent": said}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


def _server(arguments: list[str]) -> Any:
    if arguments[0] == "peers":
        from .peer import Peers

        return Peers()
    if "no-ledger" in arguments:
        from . import no_ledger

        no_ledger.install()
    from .engine import Engine, start_taichi

    start_taichi(threads=int(arguments[1]))
    return Engine()


def _answer(server: Any, request: dict) -> Any:
    if request["do"] == "whole":
        return asdict(server.whole(request["case"], request["extent"], request["end"]))
    values = request["subject"]
    subject = Subject(**{**values, "counts": tuple(values["counts"])})
    result = getattr(server, request["do"])(subject)
    return asdict(result) if request["do"] == "measure" else result


if __name__ == "__main__":
    main()
