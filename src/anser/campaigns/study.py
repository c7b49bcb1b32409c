"""The study file: tables and keys, consistency checks, and reading."""

import contextlib
import csv
import difflib
import math
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError

from anser.campaigns.distributions import Dispersion
from anser.config.errors import Problem, ScenarioError, check_file_kind, describe_value, format_number, quoted_list
from anser.config.key_paths import repeated_paths
from anser.config.tables import Table, content_hash, expects, number, slug, table, tables, whole_number
from anser.config.toml_text import attach_line_numbers, named_by, number_lines, read_text
from anser.config.validation_messages import validation_problems
from anser.files import MIB
from anser.missions.flight_outputs import FlightOutput
from anser.missions.series import SeriesSelection
from anser.scenario.files import load, parse_scenario
from anser.scenario.schema import Scenario
from anser.scenario.schema_settings import is_multiple, multiple_message
from anser.scenario.schema_tables import SEED_MAX
from anser.simulation.flight import Precision
from anser.variables import ADAPTATION_KEYS, CATALOGUE, DERIVED_KEYS, OPTIONAL_KEYS, RECORDED_KEYS

_KEYS = (*RECORDED_KEYS, *(variable.key for variable in CATALOGUE if variable.optional))
_KEY_BY_NAME = {variable.name: variable.key for variable in CATALOGUE}
_GUST_KEYS = frozenset({"airspeed_mean_wind", *(key for key in OPTIONAL_KEYS if key.startswith("gust_"))})
_NETWORK_KEYS = frozenset({"clock_lag", "clock_rate", "heard_from", "path_offered"})
_SENSOR_KEYS = OPTIONAL_KEYS - _GUST_KEYS - _NETWORK_KEYS - ADAPTATION_KEYS


class OutputSelection(Table):
    """Data of each flight stored in addition to its row of results."""

    worst: int = whole_number(
        "number of the worst flights archived at the end of the campaign, with the outputs of anser run", 0, 1000, 0
    )
    series: tuple[str, ...] = Field(
        (),
        strict=False,
        description="variables stored over time for every flight",
        json_schema_extra=expects('a list of names of variables, such as ["position_error", "airspeed"]'),
    )
    series_every_s: float = number("period of stored values, a whole multiple of the step", 0.001, 60, "s", 1)

    def consistency_problems(self) -> list[Problem]:
        """Return the problems of unknown or repeated variables, and of a period without variables; empty if valid."""
        problems = []
        for k, name in enumerate(self.series):
            if name in self.series[:k]:
                problems.append(Problem(f"series[{k}]", describe_value(name), "each variable once"))
            elif name in DERIVED_KEYS:
                expected = (
                    "a variable that is recorded: north and east lead to latitude and longitude, airspeed and altitude "
                    "to the other airspeeds and altitudes"
                )
                problems.append(Problem(f"series[{k}]", describe_value(name), expected))
            elif name not in _KEYS:
                problems.append(
                    Problem(f"series[{k}]", describe_value(name), f"the name of a variable, {_suggestion(name)}")
                )
        if "series_every_s" in self.model_fields_set and not self.series:
            problems.append(Problem("series", "nothing", "names of variables, where keep.series_every_s is given"))
        return problems


_TIMES = "timing", "timing.duration_s", "timing.step_s"
"""Key paths on which the times of time series depend."""


def select_series(keep: OutputSelection | None, scenario: Scenario) -> SeriesSelection | None:
    """Return the time series to be stored for a scenario's flights; None if the study's table [keep] selects none."""
    if keep is None or not keep.series:
        return None
    return SeriesSelection.from_period(scenario, keep.series, keep.series_every_s)


def refuse_series(
    keep: OutputSelection | None,  # output selection of the study; None if the study has none
    source: str,  # name of the study, for messages
    scenarios: Iterable[Scenario],  # one or more of the scenarios to be flown
    varied: Iterable[str],  # key paths of the varied parameters
) -> None:
    """Raise ScenarioError if the flights of a study cannot have the time series that the study selects.

    The errors are: the period is not a multiple of the time step; the duration or the step of the flights varies; or no
    flight records a selected variable.
    """
    if keep is None or not keep.series:
        return
    scenarios = list(scenarios)
    step_s, problems = scenarios[0].timing.step_s, []
    if not is_multiple(keep.series_every_s, step_s):
        expected = multiple_message(keep.series_every_s, "timing.step_s of the scenario", step_s)
        problems.append(Problem("keep.series_every_s", format_number(keep.series_every_s), expected))
    expected = "none where durations or steps vary: the series of all flights have the same times"
    problems += [Problem("keep.series", f"with {describe_value(path)}", expected) for path in varied if path in _TIMES]
    recorded = set().union(*map(recorded_keys_of, scenarios))
    for k, name in enumerate(keep.series):
        if name not in recorded:
            expected = f"a variable that a flight has; this one takes {feature_required(name)}"
            problems.append(Problem(f"keep.series[{k}]", describe_value(name), expected))
    if problems:
        raise ScenarioError(source, problems)


def recorded_keys_of(scenario: Scenario) -> set[str]:
    """Return the keys (in `anser.variables.CATALOGUE`) of the variables that the flights of a scenario record."""
    keys = set(RECORDED_KEYS)
    if scenario.turbulence.intensity != "none" or scenario.gust:
        keys |= _GUST_KEYS
    if scenario.goal_sensor.preset != "exact":
        keys |= _SENSOR_KEYS
    if not scenario.fleet.is_central:
        keys |= _NETWORK_KEYS
    if any(aircraft.gains.inversion == "adaptive" for aircraft in scenario.aircraft):
        keys |= ADAPTATION_KEYS
    return keys


def feature_required(name: str) -> str:
    """Return a text that names the scenario feature without which flights do not record the variable `name`."""
    if name in _GUST_KEYS:
        return "turbulence or a gust"
    if name in _NETWORK_KEYS:
        return 'fleet.planner = "decentralised"'
    if name in ADAPTATION_KEYS:
        return 'gains.inversion = "adaptive"'
    return "a goal sensor with errors, such as goal_sensor.preset"


def _suggestion(name: str) -> str:
    """Return advice for an unknown variable name: the key without unit, similar keys, or the page with all keys."""
    if name in _KEY_BY_NAME:
        return f"perhaps {describe_value(_KEY_BY_NAME[name])}: here without its unit"
    matches = difflib.get_close_matches(name, _KEYS, n=3)
    if matches:
        return f"perhaps {' or '.join(map(describe_value, matches))}"
    return 'such as "position_error", "airspeed", "bank" (all are in docs/reference/variables.md)'


RARE_FLIGHTS_MAX = 100_000
"""Maximum number of flights per level of a rare-event analysis: each takes about 1.5 kB of memory."""
_CHAINS = 10
"""Minimum number of Markov chains per level and repetition; for fewer chains the interval's coverage is unknown."""
_WHOLE = 1e-9


class RareEventConfig(Table):
    """Definition of a rare event."""

    statistic: Literal["separation_min_m", "clearance_min_m", "miss_m", "arrival_spread_s"] = Field(
        description="quantity whose breach is the event; the worst aircraft of the fleet counts"
    )
    threshold: float = number("threshold of the event", 0, 1e9, "m or s")
    flights: int = whole_number("number of flights per level, over all repetitions", 1, RARE_FLIGHTS_MAX, 2000)
    level_share: float = number(
        "fraction of the worst flights of a level that start the next level", 0.05, 0.5, "", 0.1
    )
    levels_max: int = whole_number(
        "maximum number of levels; level_share to this power is about the lowest detectable probability", 2, 20, 10
    )
    repetitions: int = whole_number("number of independent repetitions, whose scatter gives the interval", 3, 100, 5)

    @property
    def breached_below(self) -> bool:
        """Whether the event is a value of the statistic below (True) or above (False) the threshold."""
        return self.statistic in ("separation_min_m", "clearance_min_m")

    @property
    def chain_length(self) -> int:
        """Number of points per Markov chain: 1 / `level_share`, rounded."""
        return round(1.0 / self.level_share)

    def consistency_problems(self) -> list[Problem]:
        """Return the problem of `level_share` or, if `level_share` is valid, of `flights`; empty if both are valid.

        1 / level_share must be a whole number; the number of flights must be a multiple of repetitions / level_share,
        and at least ten times this ratio.
        """
        if abs(self.chain_length * self.level_share - 1.0) > _WHOLE:
            return [
                Problem("level_share", format_number(self.level_share), "one over a whole number, such as 0.1 or 0.2")
            ]
        part = self.repetitions * self.chain_length
        if self.flights % part or self.flights < _CHAINS * part:
            expected = f"a multiple of {part} (repetitions over level_share), {_CHAINS * part} at least"
            return [Problem("flights", str(self.flights), expected)]
        return []


FLIGHTS_MAX = 10_000_000
_ANOTHER_PATH = "another path: the study's seed gives each flight its own"
_LEAST_EIGENVALUE = 1e-9
_TABLE_SIZE_MAX = 256 * MIB
"""Maximum size of a table of sampled values, bytes."""


class Sampling(Table):
    """Number of flights and sampling method."""

    method: Literal["monte-carlo", "latin-hypercube", "sobol", "saltelli", "grid", "table"] = Field(
        default="monte-carlo", description="sampling method"
    )
    flights: int | None = whole_number(
        "number of flights; with saltelli the number of blocks, each with one flight per varied parameter "
        "and two more; not with a grid or a table, which determine the number",
        *(1, FLIGHTS_MAX, None),
    )
    levels: int | None = whole_number(
        "number of grid values per parameter: midpoints of intervals of equal probability", 1, 1000, None
    )
    file: str | None = Field(
        None,
        description="table of the values (CSV, one column for each path), relative to the study file",
        json_schema_extra=expects("the path of a CSV file in quotes"),
    )

    def consistency_problems(self) -> list[Problem]:
        """Return the problems of the table, empty if valid.

        The method grid requires `levels` alone, the method table `file` alone, the remaining methods `flights` alone.
        The methods sobol and saltelli require a power of 2 as number of flights.
        """
        required = {"grid": "levels", "table": "file"}.get(self.method, "flights")
        keys = {"flights": self.flights, "levels": self.levels, "file": self.file}
        problems = [
            Problem(key, describe_value(value), f"no such key with the method {self.method}, which has {required}")
            for key, value in keys.items()
            if value is not None and key != required
        ]
        if keys[required] is None:
            problems.append(Problem(required, "nothing", f"a value: the method {self.method} needs it"))
        if self.method in ("sobol", "saltelli") and self.flights is not None and self.flights & (self.flights - 1):
            nearest_power = 2 ** round(np.log2(self.flights))
            problems.append(
                Problem("flights", str(self.flights), f"a power of 2 for a Sobol sequence, such as {nearest_power}")
            )
        return problems


class CorrelatedGroup(Table):
    """Correlated parameters: a Gaussian copula."""

    paths: tuple[str, ...] = Field(
        min_length=2,
        strict=False,
        description="paths of tables [[vary]]",
        json_schema_extra=expects("a list of two paths or more"),
    )
    coefficients: tuple[Annotated[tuple[float, ...], Field(strict=False)], ...] = Field(
        strict=False,
        description="correlation matrix of the underlying normal numbers",
        json_schema_extra=expects("a symmetric matrix with ones on its diagonal, a list of rows"),
    )

    def consistency_problems(self) -> list[Problem]:
        """Return the problem of the correlation matrix, empty if valid.

        The matrix must have one row per path, ones on its diagonal, and be symmetric and positive definite.
        """
        count, matrix_rows = len(self.paths), self.coefficients
        expected = f"a symmetric, positive definite matrix of {count} rows with ones on its diagonal"
        if len(matrix_rows) != count or any(len(matrix_row) != count for matrix_row in matrix_rows):
            return [Problem("coefficients", f"{len(matrix_rows)} rows", expected)]
        matrix = np.array(matrix_rows)
        if not np.array_equal(matrix, matrix.T) or not np.array_equal(np.diag(matrix), np.ones(count)):
            return [Problem("coefficients", "another matrix", expected)]
        smallest_eigenvalue = float(np.linalg.eigvalsh(matrix)[0])
        if smallest_eigenvalue < _LEAST_EIGENVALUE:
            return [
                Problem("coefficients", f"a matrix with the eigenvalue {format_number(smallest_eigenvalue)}", expected)
            ]
        return []


class EstimateSettings(Table):
    """Confidence level and quantiles of the estimates."""

    confidence: float = number("confidence level of the intervals", 0.5, 0.999999, "", 0.95)
    quantiles: tuple[float, ...] = Field(
        default=(0.5, 0.95, 0.99),
        strict=False,
        description="fractions of the flights for which bounds are estimated",
        json_schema_extra=expects("a list of numbers between 0 and 1"),
    )

    def consistency_problems(self) -> list[Problem]:
        """Return the problem of each quantile whose fraction is not between 0 and 1, both excluded; empty if valid."""
        return [
            Problem(f"quantiles[{k}]", format_number(share), "a number between 0 and 1, both excluded")
            for k, share in enumerate(self.quantiles)
            if not 0.0 < share < 1.0
        ]


_STATISTICS = ("met", "miss_m", "arrival_spread_s")
_STATISTICS_EXPECTED = f"{quoted_list(_STATISTICS, ' or ')}, or the name of an [[output]]"


class StoppingRule(Table):
    """Rule for ending a campaign before its planned number of flights."""

    statistic: str = Field(
        default="met",
        description="statistic of the rule: the probability that all requirements are met, or a quantile over the "
        "flights",
        json_schema_extra=expects(_STATISTICS_EXPECTED),
    )
    share: float = number("quantile of miss, spread or output", 0, 1, "", 0.95, exclusive_minimum=True)
    width: float = number(
        "greatest width of the interval, in the unit of the statistic", 0, 1e9, "", exclusive_minimum=True
    )
    at_least: int = whole_number("minimum number of flights", 1, FLIGHTS_MAX, 100)

    def consistency_problems(self) -> list[Problem]:
        """Return the problem of `share` = 1, whose quantile has no finite upper bound; empty if `share` is below 1."""
        if self.share == 1.0:
            return [Problem("share", "1", "a number below 1")]
        return []


_RESERVED_NAMES = ("flight", "aircraft", "seed", "flown", "series", "met", "unmet", "status", "reason")
"""Names of the store's arrays that an output must not have."""


class Study(Table):
    """Content of a study file: a scenario with dispersed parameters, for a campaign or a rare-event analysis.

    Read with :func:`anser.campaigns.load_study`, which gives clear messages.
    """

    format: Literal[1] = Field(description="version of the file format", json_schema_extra=expects("1"))
    name: str = slug("name of the study, also of its output")
    description: str = Field("", description="purpose of the study", json_schema_extra=expects("a text in quotes"))
    scenario: str = Field(
        min_length=1,
        description="scenario file, relative to the study file",
        json_schema_extra=expects("the path of a scenario file in quotes"),
    )
    seed: int = whole_number("seed of the sampling and of the flights", 0, SEED_MAX, 0)
    precision: Precision = Field(default="float64", description="precision of the flights; plans are always in float64")
    sampling: Sampling | None = table("sampling of a campaign", "a table [sampling]", None)
    vary: tuple[Dispersion, ...] = tables(
        "dispersed parameters", "tables [[vary]], in double brackets", at_least=0, default=()
    )
    correlated: tuple[CorrelatedGroup, ...] = tables(
        "correlated parameters", "tables [[correlated]], in double brackets", at_least=0, default=()
    )
    rare: RareEventConfig | None = table("rare event", "a table [rare]", None)
    until: StoppingRule | None = table("stopping rule", "a table [until]", None)
    answers: EstimateSettings = table("settings of the estimates", "a table [answers]", EstimateSettings())
    keep: OutputSelection | None = table("stored outputs in addition to the rows", "a table [keep]", None)
    # left out of the values where empty, so that the hash of a study without outputs does not depend on the key
    output: Annotated[tuple[FlightOutput, ...], Field(exclude_if=lambda outputs: not outputs)] = tables(
        "further outputs of each flight", "tables [[output]], in double brackets", at_least=0, default=()
    )

    def consistency_problems(self) -> list[Problem]:
        """Return the contradictions between the tables of the study, empty if valid."""
        paths = [dispersion.path for dispersion in self.vary]
        problems = [
            Problem(f"vary[{k}].path", describe_value(path), _ANOTHER_PATH if path == "seed" else "each path once")
            for k, path in enumerate(paths)
            if path == "seed" or path in paths[:k]
        ]
        grouped_paths: list[str] = []
        for k, group in enumerate(self.correlated):
            for path in group.paths:
                if path not in paths:
                    problems.append(Problem(f"correlated[{k}].paths", describe_value(path), "paths of tables [[vary]]"))
                elif path in grouped_paths:
                    problems.append(
                        Problem(f"correlated[{k}].paths", describe_value(path), "each path in one group, once")
                    )
                grouped_paths.append(path)
        return problems + self._output_problems() + self._sampling_problems(self.sampling)

    def _output_problems(self) -> list[Problem]:
        reserved = {*_RESERVED_NAMES, *(dispersion.path for dispersion in self.vary)}
        names = [output.name for output in self.output]
        problems = [
            Problem(f"output[{k}].name", describe_value(name), "a name that no other output or result has")
            for k, name in enumerate(names)
            if name in reserved or name in names[:k]
        ]
        if self.until is not None and self.until.statistic not in (*_STATISTICS, *names):
            arrived = describe_value(self.until.statistic)
            problems.append(Problem("until.statistic", arrived, _STATISTICS_EXPECTED))
        if self.output and self.sampling is None and self.rare is not None:
            problems.append(Problem("output", "a table", "none without a table [sampling]"))
        return problems

    def _sampling_problems(self, sampling: Sampling | None) -> list[Problem]:
        problems = []
        if sampling is None:
            if self.rare is None:
                problems.append(Problem("sampling", "nothing", "a table [sampling], or a table [rare]"))
            if self.until is not None:
                problems.append(Problem("until", "a table", "none without a table [sampling]"))
            if self.keep is not None:
                problems.append(Problem("keep", "a table", "none without a table [sampling]"))
            return problems
        if sampling.method in ("grid", "table", "saltelli") and self.correlated:
            problems.append(Problem("correlated", "a table", f"none with the method {sampling.method}"))
        if self.block * (sampling.flights or 0) > FLIGHTS_MAX:
            expected = f"{FLIGHTS_MAX // self.block} blocks of {self.block} flights at most"
            problems.append(Problem("sampling.flights", str(sampling.flights), expected))
        count = math.prod(len(v.values) if v.values is not None else sampling.levels or 1 for v in self.vary)
        if sampling.method == "grid" and count > FLIGHTS_MAX:
            arrived = f"a grid of {count} flights"
            problems.append(Problem("sampling.levels", arrived, f"a grid of {FLIGHTS_MAX} flights at most"))
        if sampling.method == "grid":
            expected = "none with the method grid, which flies each value equally often"
            problems += [
                Problem(f"vary[{k}].weights", f"a list of {len(dispersion.weights)}", expected)
                for k, dispersion in enumerate(self.vary)
                if dispersion.weights is not None
            ]
        if self.until is not None and sampling.method != "monte-carlo":
            expected = "none: only of plain Monte Carlo are the first flights a sample of their own"
            problems.append(Problem("until", "a table", expected))
        if sampling.method == "table" and self.rare is not None:
            problems.append(Problem("rare", "a table", "none: the values of a table are no distributions"))
        if sampling.method == "table" and self.vary:
            problems.append(Problem("vary", "a table", "none: the columns of sampling.file say what varies"))
        if sampling.method not in ("monte-carlo", "table") and not self.vary:
            expected = f"one table [[vary]] at least with the method {sampling.method}"
            problems.append(Problem("vary", "nothing", expected))
        return problems

    @property
    def sampled(self) -> Sampling:
        """The study's table [sampling]; raises ScenarioError if missing."""
        if self.sampling is None:
            raise ScenarioError(self.name, [Problem("sampling", "nothing", "a table [sampling], to fly a campaign")])
        return self.sampling

    @property
    def block(self) -> int:
        """Number of flights in a block of dependent flights: varied parameters + 2 in Saltelli sampling, 1 if not."""
        return len(self.vary) + 2 if self.sampling is not None and self.sampling.method == "saltelli" else 1

    @property
    def hash(self) -> str:
        """SHA-256 of the study's validated values, 64 hexadecimal digits."""
        return content_hash(self)


def load_study(path: str | os.PathLike[str]) -> tuple[Study, Scenario, dict[str, np.ndarray]]:
    """Read a study file (TOML), its scenario file and its table of values.

    Returns the study, the scenario, and the columns of the table by key path (empty without a table). Raises
    ScenarioError if a file cannot be read or is not valid; the message states the position and the expected content.
    """
    source = os.fspath(path)
    text = read_text(path, "study")
    with attach_line_numbers(text, source):
        study = validate_study(parse_scenario(text, source), source)
        with named_by(source, "scenario", study.scenario):
            scenario = load(Path(path).parent / study.scenario)
        table_columns: dict[str, np.ndarray] = {}
        if study.sampling is not None and study.sampling.file is not None:
            with named_by(source, "sampling.file", study.sampling.file):
                table_columns = _read_columns(Path(path).parent / study.sampling.file)
    repeated = repeated_paths(scenario, [*(dispersion.path for dispersion in study.vary), *table_columns])
    if repeated is not None:
        raise ScenarioError(source, [Problem(repeated[1], f"the key of {repeated[0]} again", "each key once")])
    return study, scenario, table_columns


@contextlib.contextmanager
def located_in(path: str | os.PathLike[str], study: Study) -> Iterator[None]:
    """Add the file and line numbers to a ScenarioError about the study that is raised in the `with` block.

    Errors about another source pass unchanged.
    """
    try:
        yield
    except ScenarioError as error:
        name, comma, rest = error.source.partition(", ")
        if name != study.name:
            raise
        places = {dispersion.path: f"vary[{k}].path" for k, dispersion in enumerate(study.vary)}
        problems = number_lines(error.problems, read_text(path, "study"), places)
        raise ScenarioError(f"{os.fspath(path)}{comma}{rest}", problems) from None


def validate_study(values: dict[str, Any], source: str = "<values>", *, is_stored: bool = False) -> Study:
    """Convert nested dictionaries, with the keys and values of a study file, to a study.

    Contradictions between keys are accepted in the study of stored results (`is_stored`). Raises ScenarioError if keys
    or values are not valid; `source` names their origin in the message.
    """
    check_file_kind("study", values, source)
    try:
        return Study.model_validate(values, context={"is_stored": is_stored})
    except ValidationError as error:
        raise ScenarioError(source, validation_problems(error, Study, values)) from None


def _read_columns(path: Path) -> dict[str, np.ndarray]:
    """Read a CSV file with a heading row of key paths; return numbers, truth values or texts by key path.

    Raises ScenarioError if the file is not a valid table; the message names the line of the file.
    """
    reader = csv.reader(read_text(path, "table", _TABLE_SIZE_MAX).splitlines(keepends=True), strict=True)
    try:
        numbered = [(reader.line_num, [text.strip() for text in row]) for row in reader if row]
    except csv.Error as error:
        raise ScenarioError(os.fspath(path), [Problem("", f"a table that is no CSV ({error})", "a CSV file")]) from None
    if len(numbered) < 2:
        arrived = f"{len(numbered)} rows"
        raise ScenarioError(os.fspath(path), [Problem("", arrived, "a row of paths and one row of values at least")])
    (lines, rows), problems = zip(*numbered, strict=True), []
    heads = rows[0]
    if len(set(heads)) < len(heads):
        problems.append(Problem(f"row {lines[0]}", "a path twice", "each path once"))
    if "seed" in heads:
        problems.append(Problem(f"row {lines[0]}", '"seed"', _ANOTHER_PATH))
    problems += [
        Problem(f"row {line}", f"{len(row)} values", f"{len(heads)}")
        for line, row in numbered
        if len(row) != len(heads)
    ]
    if problems:
        raise ScenarioError(os.fspath(path), problems[:1])
    columns = {head: _parse_column(list(texts)) for head, *texts in zip(*rows, strict=True)}
    problems = [
        Problem(f"row {line}, column {head}", describe_value(text), "a number, as in other rows of the column")
        for head, values in columns.items()
        if values.dtype.kind == "U" and any(map(_is_number, values.tolist()))
        for line, text in zip(lines[1:], values.tolist(), strict=True)
        if not _is_number(text)
    ]
    problems += [
        Problem(f"row {line}, column {head}", describe_value(float(number)), "a finite number")
        for head, values in columns.items()
        if values.dtype.kind == "f"
        for line, number in zip(lines[1:], values, strict=True)
        if not np.isfinite(number)
    ]
    if problems:
        raise ScenarioError(os.fspath(path), problems[:1])
    return columns


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _parse_column(texts: list[str]) -> np.ndarray:
    words = [text.lower() for text in texts]  # spreadsheets write TRUE and FALSE
    if set(words) <= {"true", "false"}:
        return np.array([word == "true" for word in words])
    return np.array([float(text) for text in texts] if all(map(_is_number, texts)) else texts)
