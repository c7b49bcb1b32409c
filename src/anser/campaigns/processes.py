"""Worker processes for flights: their number (by cores and memory), start, progress reports, and parallel tasks."""

import concurrent.futures
import contextlib
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from anser.campaigns.machine import available_memory
from anser.campaigns.store_integrity import StoreError
from anser.compiling.measuring import compilation_message, usable_cores
from anser.compiling.options import enable_compilation_cache
from anser.missions.batches import Progress
from anser.missions.series import SeriesSelection
from anser.scenario.schema import Scenario
from anser.simulation.flight import SEGMENT_STEPS

Result = TypeVar("Result")

_PROCESS_BYTES = 1_350_000_000
"""Memory of one process that flies, bytes: libraries and the peak of compilation (docs/how-to/many-flights.md)."""
_AIRCRAFT_BYTES = 500_000
"""Memory per aircraft in a batch, bytes: tables, state, plans, and recordings of one segment."""
_COPIES = 3
"""Number of copies of a batch's time series in memory: as recorded, as arrays per flight, and as written to file."""
_MB = 1e6


class ProcessLimit(NamedTuple):
    """Greatest number of processes that should fly on this machine at a time, with the reason."""

    processes: int  # number of processes, at least one
    message: str  # explanation if memory limits the number; otherwise empty


def process_limit(
    scenario: Scenario,
    batch: int,  # flights per compiled call
    series: SeriesSelection | None = None,  # variables stored over time; None if none are stored
) -> ProcessLimit:
    """Return how many processes may fly at a time: one per core, fewer if the free memory is too small; at least one.

    If the system does not report its free memory, the cores alone count.
    """
    cores, free_bytes = usable_cores(), available_memory()
    if free_bytes is None:
        return ProcessLimit(cores, "")
    process_bytes = _PROCESS_BYTES + batch * _flight_bytes(scenario, series)
    processes = max(1, min(cores, free_bytes // process_bytes))
    has = f"memory: {free_bytes / _MB:,.0f} MB are free, and a process that flies {batch} flights at a time takes"
    has += f" {process_bytes / _MB:,.0f} MB"
    if free_bytes < process_bytes:
        return ProcessLimit(1, f"{has}: one flies, and may be killed for want of memory")
    if processes < cores:
        return ProcessLimit(processes, f"{has}: {processes} fly, not one for each of {cores} cores")
    return ProcessLimit(processes, "")


def batch_size_for(batch_max: int, scenario: Scenario, series: SeriesSelection | None = None) -> int:
    """Return the number of flights per compiled call: `batch_max`, or fewer to fit the free memory; at least one.

    `series` are the variables stored over time (None if none are stored).
    """
    free_bytes = available_memory()
    if free_bytes is None:
        return batch_max
    return int(max(1, min(batch_max, (free_bytes - _PROCESS_BYTES) // _flight_bytes(scenario, series))))


def _flight_bytes(scenario: Scenario, series: SeriesSelection | None) -> int:
    """Return the memory that one flight of a batch takes, bytes, including its stored time series."""
    aircraft = len(scenario.aircraft)
    numbers = 0
    if series is not None:
        time_steps = _COPIES * series.rows(scenario) + 2 * SEGMENT_STEPS // series.recording_stride
        numbers = len(series.keys) * aircraft * time_steps
    return aircraft * _AIRCRAFT_BYTES + 8 * numbers


def require_processes(processes: int | None) -> None:
    """Raise ValueError unless a requested number of processes is None or a whole number, 1 at least."""
    is_number = isinstance(processes, int) and not isinstance(processes, bool) and processes >= 1
    if processes is not None and not is_number:
        raise ValueError(f"processes: arrived {processes!r}; expected a whole number, 1 at least, or None")


def choose_processes(
    processes: int | None,  # requested number; None for the limit
    limit: Callable[[], ProcessLimit],  # computes the machine's limit; called only if `processes` is None
    progress: Progress,  # gets a message if the memory limits the number
) -> int:
    """Return the requested number of processes, or the machine's limit if `processes` is None."""
    if processes is not None:
        return processes
    chosen = limit()
    if chosen.message:
        progress(chosen.message, None)
    return chosen.processes


@contextlib.contextmanager
def worker_processes(processes: int) -> Iterator[Executor | None]:
    """Yield an executor with `processes` worker processes; if `processes` is 1 or less, start none and yield None.

    If the `with` block raises, unfinished tasks are cancelled and the workers are terminated.
    """
    if processes <= 1:
        enable_compilation_cache()
        yield None
        return
    former_children, context = set(multiprocessing.active_children()), multiprocessing.get_context("spawn")
    reports = context.SimpleQueue()
    pool = ProcessPoolExecutor(processes, mp_context=context, initializer=_initialize_worker, initargs=(reports,))
    _reports[:] = [reports]
    try:
        with _block_interrupts():
            pool.submit(os.getpid)  # starts every worker
        yield pool
    except BaseException:
        # unfinished chunks are not marked as complete: only computing time is lost
        pool.shutdown(wait=False, cancel_futures=True)
        for child in set(multiprocessing.active_children()) - former_children:
            child.terminate()
        raise
    pool.shutdown()


@contextlib.contextmanager
def _block_interrupts() -> Iterator[None]:
    """Block Ctrl-C in the `with` block, also for worker processes that start in the block; no effect on Windows."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # a later start of the tracker would unblock signals
    former_mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, former_mask)


class WorkerReport(NamedTuple):
    """Progress of a worker process."""

    share: float  # completed share of the current task, 0..1
    compiling: str | None  # message on the compilation in progress; None if there is none


_reports: list[Any] = []
"""Queue from the worker processes, if any: pairs of process id and `WorkerReport`."""
_share = [0.0]
_observers: list[Callable[[], None]] = []
_REPORT_PERIOD_S = 2.0


def report_share(_message: str, share: float | None) -> None:
    """Store the completed share (0..1; None counts as 0) of this process's task, for its progress reports.

    The function is a `Progress` callback; the message is ignored.
    """
    _share[0] = share or 0.0
    for notify in _observers:
        notify()


def _send_reports(reports: Any) -> None:
    while True:
        time.sleep(_REPORT_PERIOD_S)
        reports.put((os.getpid(), WorkerReport(_share[0], compilation_message())))


def _initialize_worker(reports: Any) -> None:
    """Initialize a worker process: progress reports every two seconds, Ctrl-C ignored, one thread for XLA."""
    threading.Thread(target=_send_reports, args=(reports,), daemon=True).start()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # XLA's threads: one process per core suffices, and further threads would compete for the cores
    os.environ.setdefault("NPROC", "1")
    enable_compilation_cache()


def fly_concurrently(
    executor: Executor | None,  # worker processes; None evaluates in this process
    fly: Callable[..., Result],  # function of a task, importable by the workers
    tasks: Sequence[tuple[Any, ...]],  # arguments of `fly`, one tuple per task
    concurrency: int,  # number of tasks submitted to the executor at a time
    folder: Path,  # folder of the store, for messages
    # called at least every two seconds with the last report of each process, by process id; if `executor` is None,
    # called with the key 0 when the task reports progress
    on_reports: Callable[[Mapping[int, WorkerReport]], None] = lambda reports: None,
) -> Generator[tuple[int, Result], None, None]:
    """Evaluate `fly(*task)` for each task; yield each task's index and result, in order of completion.

    Raises StoreError if a worker process was killed.
    """
    if executor is None:
        _observers[:] = [lambda: on_reports({0: WorkerReport(_share[0], None)})]
        try:
            for index, task in enumerate(tasks):
                yield index, fly(*task)
        finally:
            _observers.clear()
        return
    reports: dict[int, WorkerReport] = {}
    futures: dict[Future[Result], int] = {}
    submitted = 0
    try:
        while submitted < len(tasks) or futures:
            while submitted < len(tasks) and len(futures) < concurrency:
                futures[executor.submit(fly, *tasks[submitted])] = submitted
                submitted += 1
            completed, _ = concurrent.futures.wait(
                futures, _REPORT_PERIOD_S, return_when=concurrent.futures.FIRST_COMPLETED
            )
            while not _reports[0].empty():
                process, report = _reports[0].get()
                reports[process] = report
            on_reports(reports)
            if completed:
                reports.clear()  # these reports belong to a completed task
            for future in completed:
                yield futures.pop(future), future.result()
    except BrokenProcessPool:
        detail = "a process that flew and was killed, perhaps for want of memory"
        raise StoreError(
            f"{folder}: arrived {detail}; expected all to end by themselves; resume flies the rest"
        ) from None
