"""The parent's side of the worker processes."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import tempfile
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any

from .subjects import Subject

BENCHMARKS = Path(__file__).resolve().parent.parent
PATIENCE = 10.0  # s
EFFORT = "TI_ADVANCED_OPTIMIZATION"  # how thoroughly kernels are compiled


def compile_thoroughly() -> None:
    """Have this process and those that it starts compile as after long use.

    See `taichi_foam.engine.effort`.
    """
    os.environ.setdefault(EFFORT, "1")


class WorkerError(RuntimeError):
    """A worker could not do what it was asked for; says why in one line."""


class AbsentError(WorkerError):
    """Because a package or a compiler is not installed."""


class Worker:
    """One process, by its name: `peers`, `engine-2`, `engine-1-no-ledger`."""

    def __init__(self, name: str) -> None:
        kind, *options = name.split("-", 2)
        self._errors = tempfile.TemporaryFile("w+", encoding="utf-8")  # noqa: SIM115
        self._process = subprocess.Popen(
            [sys.executable, "-m", "timing.worker", kind, *options],
            cwd=BENCHMARKS, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=self._errors, start_new_session=True,  # Ctrl-C is for the parent alone
        )  # fmt: skip

    def ask(self, do: str, subject: Subject | None = None, **more: Any) -> Any:
        """Have it done, and wait for the answer.

        Raises:
            WorkerError: it cannot be done, or the process has ended; AbsentError if what it needs
                is not installed.
        """
        request = {"do": do, "subject": subject and asdict(subject), **more}
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
            line = self._process.stdout.readline()
        except OSError:
            line = ""
        if not line:
            raise WorkerError(f"the process has ended: {self._last_error()}")
        answer = json.loads(line)
        if "absent" in answer:
            raise AbsentError(answer["absent"])
        if "error" in answer:
            raise WorkerError(answer["error"])
        return answer["ok"]

    def close(self, at_once: bool) -> None:
        """End the process: in good order, so that Taichi keeps compiled kernels, or at once."""
        assert self._process.stdin is not None
        with contextlib.suppress(OSError, subprocess.TimeoutExpired):
            self._process.stdin.close()
            self._process.wait(0 if at_once else PATIENCE)
        self._process.kill()
        self._process.wait()
        self._errors.close()

    def _last_error(self) -> str:
        self._errors.seek(0)
        lines = self._errors.read().strip().split("\n")
        return lines[-1] or f"status {self._process.wait()}"


class Workers:
    """All processes of a run, each started when it is first asked for something."""

    def __init__(self) -> None:
        self._workers: dict[str, Worker] = {}
        self._pool = ThreadPoolExecutor()

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, failure: type | None, *_: object) -> None:
        for worker in self._workers.values():
            worker.close(at_once=failure is not None)
        self._pool.shutdown(wait=False, cancel_futures=True)

    def __getitem__(self, name: str) -> Worker:
        if name not in self._workers:
            self._workers[name] = Worker(name)
        return self._workers[name]

    def prepare(self, subjects: list[Subject]) -> dict[str, Future]:
        """Have the subjects prepared, those of different workers side by side."""
        futures: dict[str, Future] = {}
        for name in dict.fromkeys(subject.worker for subject in subjects):
            mine = [subject for subject in subjects if subject.worker == name]
            waiting = {subject.key: Future() for subject in mine}
            futures |= waiting
            self._pool.submit(self._prepare, self[name], mine, waiting)
        return futures

    @staticmethod
    def _prepare(worker: Worker, subjects: list[Subject], futures: dict[str, Future]) -> None:
        for subject in subjects:
            try:
                futures[subject.key].set_result(worker.ask("prepare", subject))
            except Exception as error:
                futures[subject.key].set_exception(error)
