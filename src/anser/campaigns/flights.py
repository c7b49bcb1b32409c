"""Flights of a campaign.

Values applied to the scenario of each flight, refusals before the first flight, worker processes and the batch size
that the memory allows, and the chunks that are missing.
"""

import concurrent.futures
import contextlib
import itertools
import multiprocessing
import os
import signal
from collections.abc import Generator, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any

import numpy as np

from anser.campaigns.cluster import fly_on_cluster
from anser.campaigns.machine import available_memory, usable_cores
from anser.campaigns.sampling import flight_seeds, sample_study
from anser.campaigns.store import CampaignStore
from anser.campaigns.store_integrity import StoreError
from anser.campaigns.study import Study, refuse_series, select_series
from anser.compiling.options import enable_compilation_cache
from anser.config.errors import Problem, ScenarioError, describe_value
from anser.config.key_paths import value_at
from anser.missions.batches import BATCH, Progress, no_progress
from anser.missions.flight_batches import FlightCase, fly_many
from anser.missions.runs import check_precision, needs_single_flight
from anser.missions.series import SeriesSelection
from anser.results.flight_rows import FlightRow
from anser.scenario.flight_checks import refuse_unused_keys
from anser.scenario.schema import Scenario
from anser.simulation.flight import SEGMENT_STEPS

_PROCESS = 1_350_000_000
"""Of a process that flies: libraries, and the most that compiling takes. Measured: docs/how-to/many-flights.md."""
_AIRCRAFT = 500_000
"""Of each aircraft of a batch: tables of its own, state, plans, and what one segment of the flight takes."""
_COPIES = 3
"""Of the series of a batch: as recorded, as one array of each flight, and as written."""
_MB = 1e6


@dataclass(frozen=True)
class ProcessLimit:
    """How many processes fly.

    Attributes
    ----------
    processes
        How many.
    words
        One line where memory limits something; else empty.
    """

    processes: int
    message: str


def process_limit(scenario: Scenario, batch: int, series: SeriesSelection | None = None) -> ProcessLimit:
    """One process for each core, or as many as the memory holds that is free; one at least.

    Parameters
    ----------
    scenario
        What is flown.
    batch
        Flights of one compiled call.
    series
        Variables that are kept of each flight over time; None: none are.
    """
    cores, free = usable_cores(), available_memory()
    if free is None:
        return ProcessLimit(cores, "")
    needed = _PROCESS + batch * _flight_bytes(scenario, series)
    processes = max(1, min(cores, free // needed))
    has = f"memory: {free / _MB:,.0f} MB are free, and a process that flies {batch} flights at a time takes"
    has += f" {needed / _MB:,.0f} MB"
    if free < needed:
        return ProcessLimit(1, f"{has}: one flies, and may be killed for want of memory")
    if processes < cores:
        return ProcessLimit(processes, f"{has}: {processes} fly, not one for each of {cores} cores")
    return ProcessLimit(processes, "")


def batch_size_for(most: int, scenario: Scenario, series: SeriesSelection | None = None) -> int:
    """Flights of one compiled call: so many at most, or as many as one process has memory for; one at least."""
    free = available_memory()
    if free is None:
        return most
    return int(max(1, min(most, (free - _PROCESS) // _flight_bytes(scenario, series))))


def _flight_bytes(scenario: Scenario, series: SeriesSelection | None) -> int:
    """What a flight of a batch takes, bytes."""
    aircraft = len(scenario.aircraft)
    numbers = 0
    if series is not None:
        rows = _COPIES * series.rows(scenario) + 2 * SEGMENT_STEPS // series.recording_stride
        numbers = len(series.keys) * aircraft * rows
    return aircraft * _AIRCRAFT + 8 * numbers


_CHUNK_WITHOUT_BATCH = 4
"""Flights of a chunk where each is flown by itself."""
_BUILT_FLIGHTS = 8
"""Flights that are built before any flies: a path without effect in all of them is refused."""
VALIDATED_FLIGHTS = 64
"""Scenarios that are validated before any flies; where all of them are refused, so is the study."""


def applied_values(study: Study, scenario: Scenario, given: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """What is put into the scenario of each flight of a campaign, by path; raises as `put` does."""
    return apply_samples(study, scenario, sample_study(study, given))


def apply_samples(study: Study, scenario: Scenario, sampled: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """What is put into scenarios, by path: the sampled values, added or multiplied where asked.

    Raises
    ------
    ScenarioError
        A path leads nowhere, or to no number where one is to be added or multiplied.
    """
    how, found = {one.path: one.how for one in study.vary}, {}
    for path, values in sampled.items():
        try:
            base = value_at(scenario, path)
        except ScenarioError as error:
            raise ScenarioError(f"{study.name}, what varies of {scenario.name}", error.problems) from None
        if how.get(path, "set") != "set":
            if isinstance(base, bool) or not isinstance(base, int | float):
                raise ScenarioError(study.name, [_no_number(path, base, how[path])])
            values = base + values if how[path] == "add" else base * values
        whole = isinstance(base, int) and not isinstance(base, bool) and values.dtype.kind == "f"
        found[path] = values.astype(int) if whole and np.all(values == np.rint(values)) else values
    return found


def create_store(folder: Path, study: Study, scenario: Scenario, given: dict[str, np.ndarray]) -> CampaignStore:
    """Make the store of a campaign in a folder that exists, without flying; raises ScenarioError and StoreError."""
    check_precision(scenario, study.precision, study.name)
    applied = applied_values(study, scenario, given)
    seeds = campaign_seeds(study, applied)
    count = seeds.size
    refuse_invalid_flights(study, scenario, applied, count)
    refuse_paths_without_effect(study, scenario, applied, count)
    refuse_series(study.keep, study.name, _valid(scenario, applied, count), applied)
    most = (
        _CHUNK_WITHOUT_BATCH
        if needs_single_flight(scenario)
        else batch_size_for(BATCH, scenario, select_series(study.keep, scenario))
    )
    chunk = min(most, count)
    return CampaignStore.create(folder, study, scenario, applied, seeds, chunk)


def campaign_seeds(study: Study, applied: dict[str, np.ndarray]) -> np.ndarray:
    """Seed of each flight of a campaign."""
    return flight_seeds(study, next(iter(applied.values())).size if applied else study.sampled.flights or 0)


def fly_campaign(
    store: CampaignStore, processes: int = 1, progress: Progress | None = None, cluster: str | None = None
) -> None:
    """Fly what is missing or damaged of a campaign.

    Parameters
    ----------
    store
        Of the campaign.
    processes
        How many fly at a time.
    progress
        Called with what is being done and the part of the flights that is behind, 0..1.
    cluster
        Address of a running scheduler of dask.distributed, whose workers fly instead; they must see the folder.

    Raises
    ------
    StoreError
        A process was killed, or the cluster cannot be reached or is lost; what is complete stays complete. Or another
        process flies the campaign.
    """
    with store.locked():
        _fly_missing(store, processes, progress or no_progress, cluster)


def _fly_missing(store: CampaignStore, processes: int, tell: Progress, cluster: str | None) -> None:
    total = store.flights
    missing = [int(chunk) for chunk in np.flatnonzero(~store.chunk_is_complete)]
    behind = store.flown.size

    def say() -> None:
        tell(f"{behind} of {total} flights", behind / total)

    say()
    if store.converged_chunks is not None:
        return
    folder = store.folder.resolve()
    with contextlib.ExitStack() as stack:
        if cluster is not None:
            flown = fly_on_cluster(cluster, fly_chunk, folder, missing)
        else:
            executor, at_a_time = stack.enter_context(worker_processes(min(processes, len(missing))))
            flown = _complete_chunks(executor, folder, missing, at_a_time)
        for chunk in stack.enter_context(contextlib.closing(flown)):
            rows = store.chunk_slice(chunk)
            behind += rows.stop - rows.start
            say()
            if store.converged_chunks is not None:
                break


def campaign_process_limit(store: CampaignStore) -> ProcessLimit:
    """How many processes fly a campaign where nobody says, and what is said of it."""
    # those that are flown one by one take no more than one of a batch
    batch = 1 if needs_single_flight(store.scenario) else store.chunk
    return process_limit(store.scenario, batch, store.series_selection)


def flight_scenario(store: CampaignStore, number: int) -> Scenario:
    """The scenario of one flight: a file like any other.

    Raises
    ------
    ValueError
        There is no such flight.
    ScenarioError
        What was sampled made no valid scenario.
    """
    if not 0 <= number < store.flights:
        raise ValueError(f"flight: arrived {number}; expected one from 0 to {store.flights - 1}")
    seeds, applied = store.applied(slice(number, number + 1))
    return dispersed_scenario(store.scenario, int(seeds[0]), {path: values[0] for path, values in applied.items()})


def fly_chunk(folder: Path, chunk: int) -> int:
    """Fly one chunk of a campaign and write it, unless it is complete; its number."""
    store = CampaignStore.open(folder, verify_chunks=False)
    store.refuse_other_versions()
    if store.chunk_is_complete[chunk]:  # a cluster may give it out again when the worker that flew it dies
        return chunk
    seeds, applied = store.applied(store.chunk_slice(chunk))
    rows: list[FlightRow | None] = [None] * seeds.size
    cases: dict[int, FlightCase] = {}
    for k, seed in enumerate(seeds.tolist()):
        if not applied:
            cases[k] = FlightCase(store.scenario, seed=seed)
            continue
        try:
            cases[k] = FlightCase(
                dispersed_scenario(store.scenario, seed, {path: one[k] for path, one in applied.items()})
            )
        except ScenarioError as error:
            rows[k] = FlightRow.failed_start("; ".join(map(str, error.problems)))
    flown = fly_many(
        list(cases.values()), batch=store.chunk, series=store.series_selection, precision=store.study.precision
    )
    for k, row in zip(cases, flown, strict=True):
        rows[k] = row
    store.write(chunk, [row for row in rows if row is not None])
    return chunk


def dispersed_scenario(base: Scenario, seed: int, applied: dict[str, Any]) -> Scenario:
    """A scenario with a seed and values put into it by their paths; raises ScenarioError where that makes none."""
    changes: list[object] = ["seed", seed]
    for path, value in applied.items():
        changes += [path, value.item()]
    return base.replace(*changes)  # pyright: ignore[reportArgumentType]


def refuse_invalid_flights(study: Study, scenario: Scenario, applied: dict[str, np.ndarray], count: int) -> None:
    """Refuse a study of which none of the first scenarios is valid (ScenarioError)."""
    first: ScenarioError | None = None
    for k in range(min(count, VALIDATED_FLIGHTS)):
        try:
            dispersed_scenario(scenario, 0, {path: values[k] for path, values in applied.items()})
        except ScenarioError as error:
            first = first or error
        else:
            return
    if first is not None:
        raise ScenarioError(f"{study.name}, every flight", first.problems)


def refuse_paths_without_effect(study: Study, scenario: Scenario, applied: dict[str, np.ndarray], count: int) -> None:
    """Refuse a study with a path that changes nothing in any of its first flights as built (ScenarioError)."""
    first = itertools.islice(_cases(scenario, applied, count), _BUILT_FLIGHTS)
    refuse_unused_keys(f"{study.name}, what varies of {scenario.name}", first)


def _valid(scenario: Scenario, applied: dict[str, np.ndarray], count: int) -> Iterator[Scenario]:
    """Those of the first scenarios that are valid."""
    return (one for one, _ in _cases(scenario, applied, count))


def _cases(scenario: Scenario, applied: dict[str, np.ndarray], count: int) -> Iterator[tuple[Scenario, dict[str, Any]]]:
    """Those of the first scenarios that are valid, with the values that were put into each."""
    for k in range(min(count, VALIDATED_FLIGHTS) if applied else 1):
        values = {path: column[k] for path, column in applied.items()}
        with contextlib.suppress(ScenarioError):
            yield dispersed_scenario(scenario, 0, values), values


def _no_number(path: str, base: object, how: str) -> Problem:
    return Problem(
        path, f'{describe_value(base)} in the scenario, with how = "{how}"', 'a number there, or how = "set"'
    )


@contextlib.contextmanager
def worker_processes(processes: int) -> Iterator[tuple[Executor | None, int]]:
    """Processes of their own, or None: this one; and how many."""
    if processes <= 1:
        enable_compilation_cache()
        yield None, 1
        return
    others, context = set(multiprocessing.active_children()), multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(processes, mp_context=context, initializer=_initialize_worker)
    try:
        with _interrupts_blocked():
            pool.submit(os.getpid)  # begins all of them
        yield pool, processes
    except BaseException:
        # what they are at is not marked, so that nothing is lost but its time
        pool.shutdown(wait=False, cancel_futures=True)
        for child in set(multiprocessing.active_children()) - others:
            child.terminate()
        raise
    pool.shutdown()


@contextlib.contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Begin processes that Ctrl-C does not reach, not even during their imports; the first process ends them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # which would unblock them
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _initialize_worker() -> None:
    """A process that flies: Ctrl-C is for the one that gave it the work."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # XLA's threads: one process for each core keeps it busy by itself, and more of them get into each other's way
    os.environ.setdefault("NPROC", "1")
    enable_compilation_cache()


def _complete_chunks(
    workers: Executor | None, folder: Path, chunks: list[int], at_a_time: int
) -> Generator[int, None, None]:
    """Each chunk as it becomes complete; so many are given out in advance, in their order."""
    if workers is None:
        for chunk in chunks:
            yield fly_chunk(folder, chunk)
        return
    given, waiting = 0, set[Future[int]]()
    try:
        while given < len(chunks) or waiting:
            more = chunks[given : given + at_a_time - len(waiting)]
            waiting |= {workers.submit(fly_chunk, folder, chunk) for chunk in more}
            given += len(more)
            ended, waiting = concurrent.futures.wait(waiting, return_when=concurrent.futures.FIRST_COMPLETED)
            for one in ended:
                yield one.result()
    except BrokenProcessPool:
        words = "a process that flew and was killed, perhaps for want of memory"
        raise StoreError(
            f"{folder}: arrived {words}; expected all to end by themselves; resume flies the rest"
        ) from None
