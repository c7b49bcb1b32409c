"""Flights of a campaign.

The module computes the scenario of each flight from the sampled values, checks a study before the first flight, and
flies the missing chunks.
"""

import contextlib
import functools
import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from anser.campaigns.cluster import fly_on_cluster
from anser.campaigns.processes import (
    ProcessLimit,
    batch_size_for,
    fly_concurrently,
    process_limit,
    worker_processes,
)
from anser.campaigns.sampling import flight_seeds, sample_study
from anser.campaigns.store import CampaignStore
from anser.campaigns.study import Study, refuse_series, select_series
from anser.config.errors import Problem, ScenarioError, describe_value
from anser.config.key_paths import value_at
from anser.missions.batches import BATCH, Progress, no_progress
from anser.missions.flight_batches import FlightCase, fly_many
from anser.missions.runs import check_precision, needs_single_flight
from anser.results.flight_rows import FlightRow
from anser.scenario.flight_checks import refuse_unused_keys
from anser.scenario.schema import Scenario

_CHUNK_WITHOUT_BATCH = 4
"""Flights per chunk if each is flown individually."""
_BUILT_FLIGHTS = 8
"""Number of flights built before flying; a varied path without effect in every one of them is rejected."""
VALIDATED_FLIGHTS = 64
"""Number of scenarios validated before flying; the study is rejected if every one of them is invalid."""


def applied_values(study: Study, scenario: Scenario, table_columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Sample a study; return the values applied to each flight's scenario, by key path. Raises as `apply_samples`."""
    return apply_samples(study, scenario, sample_study(study, table_columns))


def apply_samples(study: Study, scenario: Scenario, sampled: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the values to write into each flight's scenario, by key path: samples set, added to or multiplied.

    Parameters
    ----------
    sampled
        Sampled values by key path, one per flight.

    Raises
    ------
    ScenarioError
        A path does not exist, or is not a number although the operation is add or multiply.
    """
    operations, applied = {dispersion.path: dispersion.how for dispersion in study.vary}, {}
    for path, values in sampled.items():
        try:
            base = value_at(scenario, path)
        except ScenarioError as error:
            raise ScenarioError(f"{study.name}, what varies of {scenario.name}", error.problems) from None
        if operations.get(path, "set") != "set":
            if isinstance(base, bool) or not isinstance(base, int | float):
                raise ScenarioError(study.name, [_not_a_number_problem(path, base, operations[path])])
            values = base + values if operations[path] == "add" else base * values
        is_integer = isinstance(base, int) and not isinstance(base, bool) and values.dtype.kind == "f"
        applied[path] = values.astype(int) if is_integer and np.all(values == np.rint(values)) else values
    return applied


def create_store(folder: Path, study: Study, scenario: Scenario, table_columns: dict[str, np.ndarray]) -> CampaignStore:
    """Check a study and create the campaign's store in an existing folder; raises ScenarioError and StoreError."""
    check_precision(scenario, study.precision, study.name)
    applied = applied_values(study, scenario, table_columns)
    seeds = campaign_seeds(study, applied)
    count = seeds.size
    refuse_invalid_flights(study, scenario, applied, count)
    refuse_paths_without_effect(study, scenario, applied, count)
    refuse_series(study.keep, study.name, _valid_scenarios(scenario, applied, count), applied)
    chunk_max = (
        _CHUNK_WITHOUT_BATCH
        if needs_single_flight(scenario)
        else batch_size_for(BATCH, scenario, select_series(study.keep, scenario))
    )
    chunk = min(chunk_max, count)
    return CampaignStore.create(folder, study, scenario, applied, seeds, chunk)


def campaign_seeds(study: Study, applied: dict[str, np.ndarray]) -> np.ndarray:
    """Return the seed of each flight of a campaign; shape (flights,)."""
    return flight_seeds(study, next(iter(applied.values())).size if applied else study.sampled.flights or 0)


def fly_campaign(
    store: CampaignStore, processes: int = 1, progress: Progress | None = None, cluster: str | None = None
) -> None:
    """Fly the missing or damaged flights of a campaign.

    Parameters
    ----------
    progress
        Called with a message and the completed fraction of the flights, 0..1.
    cluster
        Address of a running scheduler of dask.distributed, whose workers fly instead; the workers need access to the
        folder.

    Raises
    ------
    StoreError
        A process was killed, the cluster is unreachable or lost, or another process flies the campaign. Completed
        chunks remain complete.
    """
    with store.locked():
        _fly_missing(store, processes, progress or no_progress, cluster)


def _fly_missing(store: CampaignStore, processes: int, tell: Progress, cluster: str | None) -> None:
    """Fly the incomplete chunks of a locked campaign until all are complete or the stopping rule is satisfied."""
    total = store.flights
    missing = [int(chunk) for chunk in np.flatnonzero(~store.chunk_is_complete)]
    flown_count = store.flown.size

    def report() -> None:
        tell(f"{flown_count} of {total} flights", flown_count / total)

    report()
    if store.converged_chunks is not None:
        return
    folder = store.folder.resolve()
    with contextlib.ExitStack() as stack:
        if cluster is not None:
            completed_chunks = fly_on_cluster(cluster, fly_chunk, folder, missing)
        else:
            processes = min(processes, len(missing))
            executor = stack.enter_context(worker_processes(processes))
            fly, tasks = functools.partial(fly_chunk, folder), [(chunk,) for chunk in missing]
            completed_chunks = (chunk for _, chunk in fly_concurrently(executor, fly, tasks, processes, folder))
        for chunk in stack.enter_context(contextlib.closing(completed_chunks)):
            flights = store.chunk_slice(chunk)
            flown_count += flights.stop - flights.start
            report()
            if store.converged_chunks is not None:
                break


def campaign_process_limit(store: CampaignStore) -> ProcessLimit:
    """Return how many processes may fly a campaign, limited by cores and free memory; see `process_limit`."""
    # flights flown individually take as much memory as a batch of one
    batch = 1 if needs_single_flight(store.scenario) else store.chunk
    return process_limit(store.scenario, batch, store.series_selection)


def flight_scenario(store: CampaignStore, number: int) -> Scenario:
    """Return the scenario of one flight.

    Raises
    ------
    ValueError
        `number` is out of range.
    ScenarioError
        The sampled values are not a valid scenario.
    """
    if not 0 <= number < store.flights:
        raise ValueError(f"flight: arrived {number}; expected one from 0 to {store.flights - 1}")
    seeds, applied = store.applied(slice(number, number + 1))
    return dispersed_scenario(store.scenario, int(seeds[0]), {path: values[0] for path, values in applied.items()})


def fly_chunk(folder: Path, chunk: int) -> int:
    """Fly a chunk of a campaign and write the results, unless already complete; return the chunk's number."""
    store = CampaignStore.open(folder, verify_chunks=False)
    store.refuse_other_versions()
    if store.chunk_is_complete[chunk]:  # a cluster may submit it again when the worker dies
        return chunk
    seeds, applied = store.applied(store.chunk_slice(chunk))
    flight_rows: list[FlightRow | None] = [None] * seeds.size
    cases: dict[int, FlightCase] = {}
    for k, seed in enumerate(seeds.tolist()):
        if not applied:
            cases[k] = FlightCase(store.scenario, seed=seed)
            continue
        try:
            cases[k] = FlightCase(
                dispersed_scenario(store.scenario, seed, {path: column[k] for path, column in applied.items()})
            )
        except ScenarioError as error:
            flight_rows[k] = FlightRow.failed_start("; ".join(map(str, error.problems)))
    flown = fly_many(
        list(cases.values()), batch=store.chunk, series=store.series_selection, precision=store.study.precision
    )
    for k, flight_row in zip(cases, flown, strict=True):
        flight_rows[k] = flight_row
    store.write(chunk, [flight_row for flight_row in flight_rows if flight_row is not None])
    return chunk


def dispersed_scenario(base: Scenario, seed: int, applied: dict[str, Any]) -> Scenario:
    """Return a scenario with a seed and values by path; raises ScenarioError if the result is invalid."""
    changes: list[object] = ["seed", seed]
    for path, value in applied.items():
        changes += [path, value.item()]
    return base.replace(*changes)  # pyright: ignore[reportArgumentType]


def refuse_invalid_flights(study: Study, scenario: Scenario, applied: dict[str, np.ndarray], count: int) -> None:
    """Raise ScenarioError if all of the first flights of a study (at most 64) have invalid scenarios."""
    first_error: ScenarioError | None = None
    for k in range(min(count, VALIDATED_FLIGHTS)):
        try:
            dispersed_scenario(scenario, 0, {path: values[k] for path, values in applied.items()})
        except ScenarioError as error:
            first_error = first_error or error
        else:
            return
    if first_error is not None:
        raise ScenarioError(f"{study.name}, every flight", first_error.problems)


def refuse_paths_without_effect(study: Study, scenario: Scenario, applied: dict[str, np.ndarray], count: int) -> None:
    """Raise ScenarioError if a varied path changes nothing in any of the first flights."""
    first_cases = itertools.islice(_valid_cases(scenario, applied, count), _BUILT_FLIGHTS)
    refuse_unused_keys(f"{study.name}, what varies of {scenario.name}", first_cases)


def _valid_scenarios(scenario: Scenario, applied: dict[str, np.ndarray], count: int) -> Iterator[Scenario]:
    """Yield the valid scenarios among the first flights."""
    return (dispersed for dispersed, _ in _valid_cases(scenario, applied, count))


def _valid_cases(
    scenario: Scenario, applied: dict[str, np.ndarray], count: int
) -> Iterator[tuple[Scenario, dict[str, Any]]]:
    """Yield the valid scenarios among the first flights, each with the values applied to it by key path."""
    for k in range(min(count, VALIDATED_FLIGHTS) if applied else 1):
        values = {path: column[k] for path, column in applied.items()}
        with contextlib.suppress(ScenarioError):
            yield dispersed_scenario(scenario, 0, values), values


def _not_a_number_problem(path: str, base: object, operation: str) -> Problem:
    return Problem(
        path, f'{describe_value(base)} in the scenario, with how = "{operation}"', 'a number there, or how = "set"'
    )
