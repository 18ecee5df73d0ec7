"""Computing the chunks of a sweep, in this process or on workers.

Chunks are computed one by one in this process, or as Dask tasks in others. Dask assigns tasks to
workers, and computes a task again if its worker dies. No more chunks are submitted at a time than
workers can compute, so that neither the scheduler nor this process grows with the sweep.
`compute_chunk` writes files on the worker; no data is sent back.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import itertools
import logging
import os
import queue
import secrets
import shutil
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from multiprocessing import resource_tracker
from typing import TYPE_CHECKING, Any

from taichi_foam.errors import RunError, UserError
from taichi_foam.interrupts import held_interrupts
from taichi_foam.records.ending import Ending
from taichi_foam.records.record import Record
from taichi_foam.results.files import drop_name
from taichi_foam.results.folders import UNFINISHED, is_disk_error
from taichi_foam.results.manifest import MANIFEST
from taichi_foam.results.result import Result
from taichi_foam.scene import Scene
from taichi_foam.simulation.after import After
from taichi_foam.sweeps import table
from taichi_foam.sweeps.dealing import Dealer, Solve
from taichi_foam.sweeps.sampling import Member
from taichi_foam.sweeps.store import LOST, SCRATCH, Sweep

if TYPE_CHECKING:
    from distributed import Client

# A chunk whose worker has died this many times is not tried again in this call ...
_MOST_DEATHS = 4
# ... and after this many such chunks in a row the call gives up.
_MOST_LOST = 3

# The option of Linux's prctl by which a process requests a signal when its parent dies.
_PR_SET_PDEATHSIG = 1

# How long to wait for an answer of the scheduler [s].
_PATIENCE = 15


def compute_chunk(folder: str, plan_hash: str, chunk: range, solve: Solve) -> None:
    """Compute some members of the sweep in a folder and write them, complete or not at all.

    A drop that fails, or whose values make an invalid scene, gets a row with the reason.

    Raises:
        UserError: the folder is not visible from here, or the versions differ.
        OSError: it cannot be written.
    """
    sweep = _opened(folder, plan_hash)
    members: list[Member] = []
    rows: dict[int, dict[str, Any]] = {}
    for number in chunk:
        try:
            members.append(sweep.design.member(number))
        except UserError as error:
            rows[number] = table.row_without_scene(sweep.design, number, str(error))
    kept = sweep.plan.keep
    histories: dict[int, list[Record]] = {}
    seconds = 0.0
    for place, drop, result in _drops(solve, members, sweep.plan.impacts, rows):
        begun = time.perf_counter()
        member = members[place]
        if drop == 1:
            rows[member.number] = table.row(member)
        table.add_impact(rows[member.number], drop, result, kept.measures)
        if kept.has_histories:
            histories.setdefault(member.number, []).append(result)
        if kept.full == "all" or member.number in kept.full:
            _save(sweep, member.number, result)
        # without the time to compile its kernels
        seconds += result.run.get("wall_s", 0.0) / result.run.get("batch", 1)
        seconds += time.perf_counter() - begun
    if len(rows) < len(chunk):
        raise RuntimeError("the solver did not return a result for every scene")
    if kept.has_histories:
        table.write_histories(sweep.history_file(chunk), histories, kept.histories)
    table.write_rows(sweep.chunk_file(chunk), [rows[number] for number in sorted(rows)], seconds)
    sweep.lost_file(chunk).unlink(missing_ok=True)


def _drops(
    solve: Solve, members: Sequence[Member], impacts: int, rows: Mapping[int, dict[str, Any]]
) -> Iterator[tuple[int, int, Result]]:
    """Compute impact after impact on the blocks of members, each time all of them side by side.

    Yields the place of the member, the number of the impact from 1, and its result. A member ends
    early if an impact leaves no block for the next one; its row then says why.
    """
    going: dict[int, After | None] = dict.fromkeys(range(len(members)))
    for drop in range(1, impacts + 1):
        places, afters = list(going), list(going.values())
        going = {}
        more: dict[str, Any] = {} if drop == 1 else {"after": afters}
        for n, result in solve([members[place].scene for place in places], **more):
            if result.ending is Ending.INTERRUPTED:
                raise KeyboardInterrupt
            member = members[places[n]]
            yield places[n], drop, result
            if drop == impacts:
                continue
            try:
                going[places[n]] = After.of(member.scene, result)
            except UserError as error:
                row = rows[member.number]
                row["failure"] = row["failure"] or f"drop {drop + 1}: {error}"


@functools.lru_cache(maxsize=1)
def _opened(folder: str, plan_hash: str) -> Sweep:
    """The sweep, read from its folder once in each process."""
    sweep = Sweep.open(folder)
    if sweep.plan.hash != plan_hash:
        raise UserError(f"{folder}: on {socket.gethostname()} this folder holds another sweep")
    sweep.check_versions()
    return sweep


def _save(sweep: Sweep, number: int, result: Result) -> None:
    """Save a whole result, unless a killed chunk has already saved the same one."""
    folder = sweep.run_folder(number)
    if sweep.plan.impacts > 1:
        folder /= drop_name(result.drop)
    if not (folder / MANIFEST).is_file() or (folder / UNFINISHED).exists():
        result.save(folder, overwrite=True)


def compute(
    sweep: Sweep,
    solve: Solve,
    on_drops: Callable[[int], None],
    *,
    side_by_side: int = 1,
    workers: int | None = None,
    scheduler: str | None = None,
) -> None:
    """Compute all missing drops of a sweep, and write them into its folder.

    Arguments as for `run.sweep`, which holds the claim on the folder, and for `Dealer`. `on_drops`
    is called in this thread with the number of drops computed since the last call.

    Raises:
        UserError: there is no scheduler at the address, or the disk is full.
        RunError: chunks could not be computed, or the scheduler was lost. Complete chunks stay.
        KeyboardInterrupt: Ctrl-C; likewise.
    """
    if workers is None and scheduler is None:
        _compute_here(sweep, solve, on_drops, side_by_side)
        return
    with _client(sweep, workers, scheduler) as client:
        driver = None if workers is None else os.getpid()
        task = partial(_in_one_thread, driver, str(sweep.folder), sweep.plan.hash, solve=solve)
        _Computing(sweep, side_by_side, task, on_drops, client).run()


def _compute_here(
    sweep: Sweep, solve: Solve, on_drops: Callable[[int], None], side_by_side: int
) -> None:
    """Compute chunk after chunk in this thread."""

    def told(scenes: Sequence[Scene], **more: Any) -> Iterator[tuple[int, Result]]:
        for place, result in solve(scenes, **more):
            yield place, result
            on_drops(1)

    course = _Course(sweep, side_by_side)
    for chunk in course.chunks:
        try:
            compute_chunk(str(sweep.folder), sweep.plan.hash, chunk, told)
        except Exception as error:
            course.lose(chunk, error)
        else:
            course.take(chunk)
    course.end()


class _Course:
    """The chunks of a sweep, and their outcomes, wherever they are computed.

    chunks  chunks that have not been assigned yet
    """

    def __init__(self, sweep: Sweep, side_by_side: int, workers: int = 1) -> None:
        self._sweep = sweep
        self._dealer = Dealer(sweep.design, sweep.missing(), side_by_side, workers)
        self.chunks: Iterator[range] = iter(self._dealer.next, None)
        self._count = self._on_end = 0

    def take(self, chunk: range) -> None:
        """Record that a chunk has been computed."""
        self._on_end = 0
        with contextlib.suppress(OSError):  # the file may become visible late
            self._dealer.learn(chunk, table.seconds_of(self._sweep.chunk_file(chunk)))

    def lose(self, chunk: range, error: BaseException, reason: str = "") -> None:
        """Record that a chunk could not be computed; `reason` defaults to the error's message.

        Raises:
            UserError: nothing can be computed, or the disk is full.
            RunError: too many chunks failed in a row.
        """
        if isinstance(error, UserError):
            raise error
        if is_disk_error(error):
            raise UserError(
                f"{self._sweep.folder}: cannot be written, {getattr(error, 'strerror', error)}. "
                f"Fix: free some space; {_again(self._sweep)}"
            )
        reason = reason or f"{type(error).__name__}: {error}".strip()
        self._sweep.lose(chunk, reason)
        self._count += 1
        self._on_end += 1
        if self._on_end >= _MOST_LOST:
            self.end(f"\ngiven up: {reason}")

    def end(self, why: str = "") -> None:
        """Raise RunError if any chunk could not be computed."""
        if self._count:
            chunks = "1 chunk" if self._count == 1 else f"{self._count} chunks"
            lost = self._sweep.folder / LOST
            raise RunError(
                f"{chunks} could not be computed, see {lost}; {_again(self._sweep)}{why}"
            )


class _Computing:
    """Chunks submitted to Dask."""

    def __init__(
        self,
        sweep: Sweep,
        side_by_side: int,
        task: Callable[..., None],
        on_drops: Callable[[int], None],
        client: Client,
    ) -> None:
        self._sweep, self._task = sweep, task
        self._on_drops, self._client = on_drops, client
        self._inbox: queue.SimpleQueue[tuple[range, Any]] = queue.SimpleQueue()
        self._flying: dict[range, Any] = {}
        self._group = f"chunk-{secrets.token_hex(4)}"
        self._course = _Course(sweep, side_by_side, self._workers())

    def run(self) -> None:
        from distributed.comm.core import CommClosedError

        try:
            self._hand_over()
            while self._flying:
                try:
                    self._take(*self._inbox.get(timeout=1.0))
                except queue.Empty:
                    self._check_scheduler()
        except CommClosedError:
            raise self._gone() from None
        finally:
            with contextlib.suppress(Exception):  # the scheduler may be gone
                self._client.cancel(list(self._flying.values()), force=True)
        self._course.end()

    def _hand_over(self) -> None:
        """Submit a chunk for each free worker; one chunk even if there is no worker yet.

        No worker gets a second chunk in advance: communication is fast compared with a chunk, and a
        chunk waiting at a worker that dies would be suspected of having killed it.
        """
        room = self._workers() - len(self._flying)
        for chunk in itertools.islice(self._course.chunks, max(0, room)):
            future = self._client.submit(
                self._task, chunk, key=(self._group, chunk.start), priority=-chunk.start
            )
            self._flying[chunk] = future
            self._await(chunk, future)

    def _await(self, chunk: range, future: Any) -> None:
        future.add_done_callback(lambda done: self._inbox.put((chunk, done)))

    def _take(self, chunk: range, future: Any) -> None:
        """Process the outcome of a chunk, and submit the next."""
        there = future.status == "finished" or self._sweep.chunk_file(chunk).exists()
        if not there and future.status in ("lost", "pending"):
            # its worker died after reporting it as done: it is computed again
            self._await(chunk, future)
            return
        if there:
            self._on_drops(len(chunk) * self._sweep.plan.impacts)
            self._course.take(chunk)
        else:
            self._check_scheduler()
            self._lose(chunk, future)
        del self._flying[chunk]
        self._hand_over()

    def _lose(self, chunk: range, future: Any) -> None:
        from distributed.scheduler import KilledWorker

        if future.status != "error":
            raise RunError(
                f"the scheduler gave up on members {chunk[0]} to {chunk[-1]}; {_again(self._sweep)}"
            )
        error, reason = future.exception(), ""
        if isinstance(error, KilledWorker):
            reason = (
                f"its worker died {_MOST_DEATHS} times, most recently at "
                f"{error.last_worker.address}"
            )
        self._course.lose(chunk, error, reason)

    def _check_scheduler(self) -> None:
        if self._client.status != "running":
            raise self._gone()

    def _workers(self) -> int:
        """Number of chunks that can be computed at a time now, at least 1.

        Raises RunError: the scheduler is gone.
        """
        try:
            workers: Any = self._client.nthreads()
        except OSError:  # in any case there is no answer
            raise self._gone() from None
        return max(1, sum(workers.values()))

    def _gone(self) -> RunError:
        return RunError(f"the scheduler no longer answers; {_again(self._sweep)}")


def _again(sweep: Sweep) -> str:
    return f"what is complete is in {sweep.folder}; the same command continues"


_alone: ThreadPoolExecutor | None = None
_making = threading.Lock()


def _in_one_thread(driver: int | None, *args: Any, solve: Solve) -> None:
    """Compute a chunk in the one thread of this process that calls Taichi.

    A worker may have several threads, but Taichi accepts calls from one only. If `driver`, a
    process id, is given, this process ends when that one does.
    """
    global _alone
    with _making:
        if _alone is None:
            _alone = ThreadPoolExecutor(1, initializer=_end_with, initargs=(driver,))
    _alone.submit(compute_chunk, *args, solve=solve).result()


def _end_with(driver: int | None) -> None:
    """Have the system kill this process when its parent dies; Linux only.

    On other systems only a thread of Dask's does this. That thread cannot run while a kernel
    compiles, which may take a minute on a busy machine.
    """
    if driver is None or not sys.platform.startswith("linux"):
        return
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != driver:  # the parent had died before
        os.kill(os.getpid(), signal.SIGKILL)


@contextlib.contextmanager
def _client(sweep: Sweep, workers: int | None, scheduler: str | None) -> Iterator[Client]:
    """A client of the requested scheduler, or of a local cluster."""
    import dask.config
    from distributed import Client, LocalCluster

    scratch = sweep.folder / SCRATCH
    settings = {
        "distributed.scheduler.allowed-failures": _MOST_DEATHS - 1,
        # no web pages about the cluster
        "distributed.scheduler.http.routes": [],
        "distributed.worker.http.routes": [],
        # a worker's parent must be this process, not a fork server
        "distributed.worker.multiprocessing-method": "spawn",
    }
    stack = contextlib.ExitStack()
    try:
        stack.enter_context(_quiet())
        if scheduler is not None:
            try:
                client = Client(scheduler, timeout=_PATIENCE, set_as_default=False)
            except (OSError, ValueError) as error:
                raise UserError(
                    f"scheduler {scheduler}: does not answer ({error}). Fix: give the address that "
                    "`dask scheduler` printed."
                ) from None
            yield stack.enter_context(client)
            return
        stack.enter_context(dask.config.set(settings))
        stack.callback(shutil.rmtree, scratch, ignore_errors=True)
        with _interrupts_for_this_thread_only():
            # over TLS, with a new key: no other user of this machine may join
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                security=True,
                dashboard_address="127.0.0.1:0",
                worker_dashboard_address="127.0.0.1:0",
                local_directory=str(scratch),
                memory_limit=0,
                silence_logs=logging.CRITICAL + 1,
            )
        stack.enter_context(cluster)
        yield stack.enter_context(Client(cluster, set_as_default=False))
    finally:
        with held_interrupts():  # workers take a moment to exit
            stack.close()


@contextlib.contextmanager
def _interrupts_for_this_thread_only() -> Iterator[None]:
    """Block Ctrl-C and the signal of a closed terminal in threads and processes started inside.

    These signals go to the whole process group; workers would die of them with tracebacks. Instead
    they end with this process.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # else starting a process unblocks the signals
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Silence Dask's logs: what matters is raised as an error."""
    # Dask sets the levels of several loggers separately
    loggers = [
        logging.getLogger(name)
        for name in list(logging.root.manager.loggerDict)
        if name.partition(".")[0] in ("asyncio", "distributed", "tornado")
    ]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)
