"""Flights of a campaign: scenarios with the sampled values, checks before the first flight, and flights in chunks.

A chunk is a number of consecutive flights that one process flies and stores together.
"""

import contextlib
import itertools
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from anser.campaigns.cluster import fly_on_cluster
from anser.campaigns.processes import (
    ProcessLimit,
    WorkerReport,
    batch_size_for,
    fly_concurrently,
    process_limit,
    report_share,
    worker_processes,
)
from anser.campaigns.sampling import flight_seeds, sample_study
from anser.campaigns.store import CampaignStore
from anser.campaigns.study import Study, feature_required, recorded_keys_of, refuse_series, select_series
from anser.config.errors import Problem, ScenarioError, describe_value, format_number, quoted_list
from anser.config.expressions import parse_expression, suggest_variable
from anser.config.key_paths import value_at
from anser.missions.batches import BATCH, Progress, no_progress
from anser.missions.flight_batches import FlightCase, fly_many
from anser.missions.flight_outputs import FlightOutput
from anser.missions.runs import check_precision, needs_single_flight
from anser.results.flight_rows import FlightRow
from anser.scenario.build import build_flight
from anser.scenario.build_wind_field import check_wind_field
from anser.scenario.flight_checks import refuse_unused_keys
from anser.scenario.schema import Scenario
from anser.variables import DERIVED_KEYS, OPTIONAL_KEYS, all_surface_names, catalogue

_CHUNK_WITHOUT_BATCH = 4
"""Number of flights per chunk for scenarios whose flights cannot be computed as a batch."""
_BUILT_FLIGHTS = 8
"""Number of flights built before flying; a varied key path that has no effect in any of them is refused."""
VALIDATED_FLIGHTS = 64
"""Number of scenarios validated before flying; the study is rejected if every one of them is invalid."""


def applied_values(study: Study, scenario: Scenario, table_columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Sample a study; return by key path the values to write into the flights' scenarios, shape (flights,).

    `table_columns` has the columns of the study's CSV file by key path; empty if the study has no such file.
    """
    return apply_samples(study, scenario, sample_study(study, table_columns))


def apply_samples(study: Study, scenario: Scenario, sampled: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the values to write into the flights' scenarios, shape (flights,), by key path.

    The samples replace the scenario's values or are combined with them, as each table [[vary]] says in `how`. Raises
    ScenarioError if a path does not exist, or if `how` is add or multiply and the scenario's value is not a number.
    """
    operations, applied = {dispersion.path: dispersion.how for dispersion in study.vary}, {}
    for path, values in sampled.items():
        try:
            base = value_at(scenario, path)
        except ScenarioError as error:
            raise ScenarioError(f"{study.name}, what varies of {scenario.name}", error.problems) from None
        if operations.get(path, "set") != "set":
            if isinstance(base, bool) or not isinstance(base, int | float):
                arrived = f'{describe_value(base)} in the scenario, with how = "{operations[path]}"'
                raise ScenarioError(study.name, [Problem(path, arrived, 'a number there, or how = "set"')])
            values = base + values if operations[path] == "add" else base * values
        is_integer = isinstance(base, int) and not isinstance(base, bool) and values.dtype.kind == "f"
        applied[path] = values.astype(int) if is_integer and np.all(values == np.rint(values)) else values
    return applied


def find_bound_cautions(study: Study, scenario: Scenario) -> list[str]:
    """Return a caution for each bound (`low`, `high`) of a varied parameter with which the scenario is invalid.

    In each test, only one parameter takes a bound; all other parameters have the scenario's values.
    """
    cautions = []
    for k, dispersion in enumerate(study.vary):
        for key in ("low", "high"):
            bound = getattr(dispersion, key)
            if bound is None:
                continue
            applied = apply_samples(study, scenario, {dispersion.path: np.array([bound])})
            try:
                dispersed_scenario(scenario, scenario.seed, applied, 0)
            except ScenarioError as error:
                place = f"vary[{k}].{key} = {format_number(bound)}"
                cautions.append(f"{place}: {error.problems[0]}; such flights fail where all else is as in the scenario")
    return cautions


def create_store(folder: Path, study: Study, scenario: Scenario, table_columns: dict[str, np.ndarray]) -> CampaignStore:
    """Check a study and create the campaign's store in an existing folder.

    `table_columns`: see `applied_values`. Raises ScenarioError if the flights cannot be flown as requested. Raises
    StoreError if the disk space is insufficient.
    """
    applied = applied_values(study, scenario, table_columns)
    seeds = campaign_seeds(study, applied)
    refuse_early(study, scenario, applied, seeds.size)
    valid_scenarios = [dispersed for dispersed, _ in _valid_cases(scenario, applied, seeds.size)]
    refuse_series(study.keep, study.name, valid_scenarios, applied)
    refuse_outputs(study, valid_scenarios)
    chunk = (
        _CHUNK_WITHOUT_BATCH
        if needs_single_flight(scenario)
        else batch_size_for(BATCH, scenario, select_series(study.keep, scenario))
    )
    return CampaignStore.create(folder, study, scenario, applied, seeds, min(chunk, seeds.size))


def campaign_seeds(study: Study, applied: dict[str, np.ndarray]) -> np.ndarray:
    """Return the seed of each flight of a campaign; shape (flights,).

    `applied` has the sampled values of all flights by key path; if it is empty, the study gives the number of flights.
    """
    return flight_seeds(study, next(iter(applied.values())).size if applied else study.sampled.flights or 0)


def fly_campaign(
    store: CampaignStore,
    processes: int = 1,
    progress: Progress = no_progress,  # called with a message and the completed fraction of the flights, 0..1
    # address of a running dask.distributed scheduler: its workers fly the campaign and need access to the folder
    cluster: str | None = None,
) -> None:
    """Fly the missing flights of a campaign until all are complete or the study's stopping rule is satisfied.

    Damaged results are removed, and their flights are flown again. Raises StoreError if a process was killed, the
    cluster is unreachable or lost, or another process flies the campaign; completed chunks then remain stored.
    """
    with contextlib.ExitStack() as stack:
        stack.enter_context(store.locked())
        missing, flown_count = np.flatnonzero(~store.chunk_is_complete).tolist(), store.flown.size
        progress(f"{flown_count} of {store.flights} flights", flown_count / store.flights)
        if store.converged_chunks is not None:
            return
        folder, shown_count = store.folder.resolve(), flown_count

        def show(reports: Mapping[int, WorkerReport]) -> None:
            nonlocal shown_count
            shares = sum(report.share for report in reports.values())
            shown_count = min(max(shown_count, flown_count + int(shares * store.chunk)), store.flights)
            compiling = next((report.compiling for report in reports.values() if report.compiling), None)
            text = f"{shown_count} of {store.flights} flights"
            progress(f"{text}: {compiling}" if compiling else text, shown_count / store.flights)

        if cluster is not None:
            completed_chunks = fly_on_cluster(cluster, fly_chunk, folder, missing)
        else:
            processes = min(processes, len(missing))
            executor = stack.enter_context(worker_processes(processes))
            tasks = [(folder, chunk) for chunk in missing]
            completed = fly_concurrently(executor, fly_chunk, tasks, processes, folder, show)
            completed_chunks = (chunk for _, chunk in completed)
        for chunk in stack.enter_context(contextlib.closing(completed_chunks)):
            flights = store.chunk_slice(chunk)
            flown_count += flights.stop - flights.start
            show({})
            if store.converged_chunks is not None:
                break


def campaign_process_limit(store: CampaignStore) -> ProcessLimit:
    """Return how many processes may fly a campaign at a time, limited by cores and free memory; see `process_limit`."""
    # flights flown individually take as much memory as a batch of one
    batch = 1 if needs_single_flight(store.scenario) else store.chunk
    return process_limit(store.scenario, batch, store.series_selection)


def flight_scenario(store: CampaignStore, number: int) -> Scenario:
    """Return the scenario of flight `number` (from 0) of a campaign, with its sampled values and seed.

    Raises ValueError if `number` is out of range, ScenarioError if the sampled values make an invalid scenario.
    """
    if not 0 <= number < store.flights:
        raise ValueError(f"flight: arrived {number}; expected one from 0 to {store.flights - 1}")
    seeds, applied = store.applied(slice(number, number + 1))
    return dispersed_scenario(store.scenario, int(seeds[0]), applied, 0)


def fly_chunk(folder: Path, chunk: int) -> int:
    """Fly a chunk of the campaign in `folder` and store the results; return the chunk's number.

    A chunk that is already complete is not flown again. Flights with an invalid scenario are stored as failed starts.
    Raises StoreError if software versions differ from the store's.
    """
    store = CampaignStore.open(folder, verify_chunks=False)
    store.refuse_other_versions()
    if store.chunk_is_complete[chunk]:  # a cluster may submit it again when the worker dies
        return chunk
    seeds, applied = store.applied(store.chunk_slice(chunk))
    cases: dict[int, FlightCase] = {}
    flight_rows: dict[int, FlightRow] = {}
    for k, seed in enumerate(seeds.tolist()):
        if not applied:
            cases[k] = FlightCase(store.scenario, seed=seed)
            continue
        try:
            cases[k] = FlightCase(dispersed_scenario(store.scenario, seed, applied, k))
        except ScenarioError as error:
            flight_rows[k] = FlightRow.failed_start("; ".join(map(str, error.problems)))
    flown = fly_many(
        list(cases.values()),
        progress=report_share,
        batch=store.chunk,
        series=store.series_selection,
        precision=store.study.precision,
        outputs=store.output_recording,
    )
    flight_rows.update(zip(cases, flown, strict=True))
    store.write(chunk, [flight_rows[k] for k in range(seeds.size)])
    report_share("", 0.0)  # the process waits for a task
    return chunk


def dispersed_scenario(base: Scenario, seed: int, applied: Mapping[str, np.ndarray], number: int) -> Scenario:
    """Return the scenario `base` with the seed `seed` and the sampled values of flight `number` (from 0).

    `applied` has an array over the flights for each key path. Raises ScenarioError if the result is invalid.
    """
    changes = {"seed": seed, **{path: values[number].item() for path, values in applied.items()}}
    scenario = base.replace(*itertools.chain.from_iterable(changes.items()))
    check_wind_field(scenario)
    return scenario


def refuse_early(study: Study, scenario: Scenario, applied: dict[str, np.ndarray], count: int) -> None:
    """Raise ScenarioError before flying if the flights of a study cannot be flown as requested.

    `applied` has the values of all `count` flights by key path. The errors are: the precision does not suit the
    scenario; all of the first 64 flights have invalid scenarios; or a varied key path has no effect in the first eight
    valid flights.
    """
    check_precision(scenario, study.precision, study.name)
    if study.until is not None and study.until.statistic == "arrival_spread_s" and len(scenario.aircraft) == 1:
        expected = '"met", "miss_m" or the name of an [[output]]'
        raise ScenarioError(study.name, [Problem("until.statistic", '"arrival_spread_s" of one aircraft', expected)])
    cases = list(itertools.islice(_valid_cases(scenario, applied, count), _BUILT_FLIGHTS))
    if not cases:
        try:
            dispersed_scenario(scenario, 0, applied, 0)
        except ScenarioError as error:
            raise ScenarioError(f"{study.name}, every flight", error.problems) from None
    refuse_unused_keys(f"{study.name}, what varies of {scenario.name}", cases)


def _valid_cases(
    scenario: Scenario, applied: dict[str, np.ndarray], count: int
) -> Iterator[tuple[Scenario, dict[str, Any]]]:
    """Yield the valid scenarios among the first 64 flights, each with its applied values by key path.

    If `applied` is empty, only the scenario itself is tried.
    """
    for k in range(min(count, VALIDATED_FLIGHTS) if applied else 1):
        with contextlib.suppress(ScenarioError):
            dispersed = dispersed_scenario(scenario, 0, applied, k)
            yield dispersed, {path: values[k] for path, values in applied.items()}


def refuse_outputs(study: Study, scenarios: list[Scenario]) -> None:
    """Raise ScenarioError if the flights cannot have the outputs that the study defines in tables [[output]].

    The errors are: an expression names an unknown variable, or a variable that no flight of `scenarios` records; an
    aircraft is unknown; or an output over several aircraft is neither a greatest nor a least value.
    """
    if not study.output:
        return
    variables = {v.name: v.key for v in catalogue(all_surface_names(build_flight(scenarios[0]).surfaces))}
    recorded = set().union(*map(recorded_keys_of, scenarios))
    absent = {name: key for name, key in variables.items() if key in OPTIONAL_KEYS - recorded}
    usable = [name for name, key in variables.items() if name not in absent and key not in DERIVED_KEYS]
    problems = []
    for k, output in enumerate(study.output):
        for name in parse_expression(output.expression).names:
            if name not in usable:
                expected = (
                    f"a variable that a flight has; this one takes {feature_required(absent[name])}"
                    if name in absent
                    else suggest_variable(name, usable)
                )
                problems.append(Problem(f"output[{k}].expression", describe_value(name), expected))
        problems += _fleet_problems(f"output[{k}]", output, [aircraft.name for aircraft in scenarios[0].aircraft])
    if problems:
        raise ScenarioError(study.name, problems)


def _fleet_problems(key_path: str, output: FlightOutput, names: list[str]) -> list[Problem]:
    if output.aircraft is not None and output.aircraft not in names:
        expected = f"the name of an aircraft of the scenario: {quoted_list(names)}"
        return [Problem(f"{key_path}.aircraft", describe_value(output.aircraft), expected)]
    if output.aircraft is None and len(names) > 1 and output.reduction not in ("greatest", "least"):
        expected = f'{quoted_list(names, " or ")}, for the reduction "{output.reduction}" is that of one aircraft'
        return [Problem(f"{key_path}.aircraft", "nothing", expected)]
    return []
