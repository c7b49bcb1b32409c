"""The study file: which scenario is flown how often.

Which of its parameters are dispersed, which estimates are required, which outputs are selected for storage (table
[keep]), and the rare event (table [rare]). Schema, checks and reading.
"""

import csv
import difflib
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError

from anser.campaigns.distributions import Dispersion
from anser.config.errors import Problem, ScenarioError, check_file_kind, describe_value, format_number
from anser.config.tables import SLUG_EXPECTED, SLUG_PATTERN, Table, choice, content_hash, expects, number, table, tables
from anser.config.toml_text import attach_line_numbers, read_text
from anser.config.validation_messages import validation_problems
from anser.files import MIB
from anser.missions.series import SeriesSelection
from anser.scenario.files import load, parse_scenario
from anser.scenario.schema import SEED_MAX, Scenario
from anser.scenario.schema_settings import is_multiple, multiple_message
from anser.simulation.precision import PRECISIONS, Precision
from anser.variables import CATALOGUE, DERIVED_KEYS, OPTIONAL_KEYS, RECORDED_KEYS

_KEYS = (*RECORDED_KEYS, *(variable.key for variable in CATALOGUE if variable.optional))
_KEY_BY_NAME = {variable.name: variable.key for variable in CATALOGUE}
_GUST_KEYS = frozenset({"airspeed_mean_wind", *(key for key in OPTIONAL_KEYS if key.startswith("gust_"))})
_NETWORK_KEYS = frozenset({"clock_lag", "clock_rate", "heard_from", "path_offered"})
_SENSOR_KEYS = OPTIONAL_KEYS - _GUST_KEYS - _NETWORK_KEYS


class OutputSelection(Table):
    """What is kept of flights beside their rows."""

    worst: int = Field(
        0,
        ge=0,
        le=1000,
        description="how many of the worst flights are kept whole when the campaign ends, as anser run leaves them",
        json_schema_extra=expects("a whole number from 0 to 1000"),
    )
    series: tuple[str, ...] = Field(
        (),
        strict=False,
        description="variables that are kept of every flight over time",
        json_schema_extra=expects('a list of names of variables, such as ["position_error", "airspeed"]'),
    )
    series_every_s: float = number("between two values that are kept, a whole multiple of the step", 0.001, 60, "s", 1)

    def consistency_problems(self) -> list[Problem]:
        """Find names that no recorded variable has, names that stand twice, and a rate of nothing."""
        found = []
        for k, name in enumerate(self.series):
            if name in self.series[:k]:
                found.append(Problem(f"series[{k}]", describe_value(name), "each variable once"))
            elif name in DERIVED_KEYS:
                words = "a variable that is recorded: north and east lead to latitude and longitude"
                found.append(Problem(f"series[{k}]", describe_value(name), words))
            elif name not in _KEYS:
                found.append(
                    Problem(f"series[{k}]", describe_value(name), f"the name of a variable, {_suggestion(name)}")
                )
        if "series_every_s" in self.model_fields_set and not self.series:
            found.append(Problem("series", "nothing", "names of variables, where keep.series_every_s is given"))
        return found


def select_series(keep: OutputSelection | None, scenario: Scenario) -> SeriesSelection | None:
    """What a table asks to be recorded of a scenario's flights; None: nothing."""
    if keep is None or not keep.series:
        return None
    return SeriesSelection.from_period(scenario, keep.series, keep.series_every_s)


def refuse_series(
    keep: OutputSelection | None, source: str, scenarios: Iterable[Scenario], varied: Iterable[str]
) -> None:
    """Refuse series that the flights of a study cannot have, before any flies.

    Parameters
    ----------
    keep
        Table of the study; None: nothing is asked for.
    source
        Name of the study.
    scenarios
        Some of those that are to fly, one at least.
    varied
        Paths of what differs between them.

    Raises
    ------
    ScenarioError
        The rate is no multiple of the step, what rules the times varies, or no flight has one of the variables.
    """
    if keep is None or not keep.series:
        return
    scenarios = list(scenarios)
    step_s, found = scenarios[0].timing.step_s, []
    if not is_multiple(keep.series_every_s, step_s):
        words = multiple_message(keep.series_every_s, "timing.step_s of the scenario", step_s)
        found.append(Problem("keep.series_every_s", format_number(keep.series_every_s), words))
    words = "none where durations or steps vary: the series of all flights have the same times"
    found += [
        Problem("keep.series", f"with {describe_value(path)}", words) for path in varied if path.startswith("timing")
    ]
    recorded = set().union(*map(_recorded, scenarios))
    for k, name in enumerate(keep.series):
        if name not in recorded:
            found.append(
                Problem(
                    f"keep.series[{k}]",
                    describe_value(name),
                    f"a variable that a flight has; {_requirement_text(name)}",
                )
            )
    if found:
        raise ScenarioError(source, found)


def _recorded(scenario: Scenario) -> set[str]:
    """Keys that the flights of a scenario have."""
    found = set(RECORDED_KEYS)
    if scenario.turbulence.intensity != "none" or scenario.gust:
        found |= _GUST_KEYS
    if scenario.goal_sensor.preset != "exact":
        found |= _SENSOR_KEYS
    if scenario.fleet.planner == "decentralised":
        found |= _NETWORK_KEYS
    return found


def _requirement_text(name: str) -> str:
    if name in _GUST_KEYS:
        return "this one takes turbulence or a gust"
    if name in _NETWORK_KEYS:
        return 'this one takes fleet.planner = "decentralised"'
    return "this one takes a goal sensor with errors, such as goal_sensor.preset"


def _suggestion(name: str) -> str:
    """What was perhaps meant, or where the names are."""
    if name in _KEY_BY_NAME:
        return f"perhaps {describe_value(_KEY_BY_NAME[name])}: here without its unit"
    near = difflib.get_close_matches(name, _KEYS, n=3)
    if near:
        return f"perhaps {' or '.join(map(describe_value, near))}"
    return 'such as "position_error", "airspeed", "bank" (all are in docs/reference/variables.md)'


RARE_FLIGHTS_MAX = 100_000
"""Of a level: what its walks have come to takes about 1.5 kB of memory for each."""
STATISTICS = ("separation_min_m", "clearance_min_m", "miss_m", "arrival_spread_s")
BREACHED_BELOW = ("separation_min_m", "clearance_min_m")
"""Of the others the event is above the threshold."""
_CHAINS = 10
"""Of each level of one repetition at least; the coverage of the interval was measured down to there."""
_WHOLE = 1e-9


class RareEventConfig(Table):
    """An event that happens in few flights."""

    statistic: Literal["separation_min_m", "clearance_min_m", "miss_m", "arrival_spread_s"] = choice(
        "whose breach is the event; of the aircraft of a fleet the worst counts", STATISTICS
    )
    threshold: float = number("beyond which it is one", 0, 1e9, "m or s")
    flights: int = Field(
        2000,
        ge=1,
        le=RARE_FLIGHTS_MAX,
        description="of each level, in all repetitions together",
        json_schema_extra=expects(f"a whole number from 1 to {RARE_FLIGHTS_MAX}"),
    )
    level_share: float = number("of the flights of a level, the worst, from which the next begins", 0.05, 0.5, "", 0.1)
    levels_max: int = Field(
        10,
        ge=2,
        le=20,
        description="levels at most; the share to the power of them is about the least probability that can be found",
        json_schema_extra=expects("a whole number from 2 to 20"),
    )
    repetitions: int = Field(
        5,
        ge=3,
        le=100,
        description="that are independent of each other; from how they differ comes the interval",
        json_schema_extra=expects("a whole number from 3 to 100"),
    )

    @property
    def breached_below(self) -> bool:
        """Whether the event is a value below the threshold."""
        return self.statistic in BREACHED_BELOW

    @property
    def chain_length(self) -> int:
        """One over the share of a level."""
        return round(1.0 / self.level_share)

    def consistency_problems(self) -> list[Problem]:
        """Find shares and numbers of flights that do not divide."""
        if abs(self.chain_length * self.level_share - 1.0) > _WHOLE:
            return [
                Problem("level_share", format_number(self.level_share), "one over a whole number, such as 0.1 or 0.2")
            ]
        part = self.repetitions * self.chain_length
        if self.flights % part or self.flights < _CHAINS * part:
            words = f"a multiple of {part} (repetitions over level_share), {_CHAINS * part} at least"
            return [Problem("flights", str(self.flights), words)]
        return []


METHODS = ("monte-carlo", "latin-hypercube", "sobol", "saltelli", "grid", "table")
FLIGHTS_MAX = 10_000_000
_LEAST_EIGENVALUE = 1e-9
_TABLE_SIZE_MAX = 256 * MIB
"""Size of the largest table of sampled values."""


class Sampling(Table):
    """How often, and how what varies is sampled."""

    method: Literal["monte-carlo", "latin-hypercube", "sobol", "saltelli", "grid", "table"] = choice(
        "of sampling", METHODS, "monte-carlo"
    )
    flights: int | None = Field(
        None,
        ge=1,
        le=FLIGHTS_MAX,
        description="how many; with saltelli how many blocks, each of as many flights as numbers vary and two more; "
        "left out with a grid or a table, which say it themselves",
        json_schema_extra=expects(f"a whole number from 1 to {FLIGHTS_MAX}"),
    )
    levels: int | None = Field(
        None,
        ge=1,
        le=1000,
        description="values of each number on a grid: the middles of so many parts of equal probability",
        json_schema_extra=expects("a whole number from 1 to 1000"),
    )
    file: str | None = Field(
        None,
        description="table of the values (CSV, one column for each path), seen from the study file",
        json_schema_extra=expects("the path of a CSV file in quotes"),
    )

    def consistency_problems(self) -> list[Problem]:
        """Find keys that the method lacks or does not know."""
        needed = {"grid": "levels", "table": "file"}.get(self.method, "flights")
        keys = {"flights": self.flights, "levels": self.levels, "file": self.file}
        found = [
            Problem(key, describe_value(value), f"no such key with the method {self.method}, which has {needed}")
            for key, value in keys.items()
            if value is not None and key != needed
        ]
        if keys[needed] is None:
            found.append(Problem(needed, "nothing", f"a value: the method {self.method} needs it"))
        if self.method in ("sobol", "saltelli") and self.flights is not None and self.flights & (self.flights - 1):
            near = 2 ** round(np.log2(self.flights))
            found.append(Problem("flights", str(self.flights), f"a power of 2 for a Sobol sequence, such as {near}"))
        return found


class CorrelatedGroup(Table):
    """Numbers that do not vary independently: a Gaussian copula."""

    paths: tuple[str, ...] = Field(
        min_length=2,
        strict=False,
        description="of tables [[vary]]",
        json_schema_extra=expects("a list of two paths or more"),
    )
    coefficients: tuple[Annotated[tuple[float, ...], Field(strict=False)], ...] = Field(
        strict=False,
        description="correlation matrix of the normal numbers behind them",
        json_schema_extra=expects("a symmetric matrix with ones on its diagonal, a list of rows"),
    )

    def consistency_problems(self) -> list[Problem]:
        """Find what is no correlation matrix."""
        count, rows = len(self.paths), self.coefficients
        words = f"a symmetric, positive definite matrix of {count} rows with ones on its diagonal"
        if len(rows) != count or any(len(row) != count for row in rows):
            return [Problem("coefficients", f"{len(rows)} rows", words)]
        matrix = np.array(rows)
        if not np.array_equal(matrix, matrix.T) or not np.array_equal(np.diag(matrix), np.ones(count)):
            return [Problem("coefficients", "another matrix", words)]
        least = float(np.linalg.eigvalsh(matrix)[0])
        if least < _LEAST_EIGENVALUE:
            return [Problem("coefficients", f"a matrix with the eigenvalue {format_number(least)}", words)]
        return []


class EstimateSettings(Table):
    """What is asked of the answers."""

    confidence: float = number("of the intervals", 0.5, 0.999999, "", 0.95)
    quantiles: tuple[float, ...] = Field(
        default=(0.5, 0.95, 0.99),
        strict=False,
        description="shares of the flights for which bounds are told",
        json_schema_extra=expects("a list of numbers between 0 and 1"),
    )

    def consistency_problems(self) -> list[Problem]:
        """Find shares that are none."""
        return [
            Problem(f"quantiles[{k}]", format_number(share), "a number between 0 and 1, both excluded")
            for k, share in enumerate(self.quantiles)
            if not 0.0 < share < 1.0
        ]


class StoppingRule(Table):
    """When fewer flights are enough."""

    statistic: Literal["met", "miss_m", "arrival_spread_s"] = choice(
        "whose interval is looked at: the probability that all requirements are met, or a quantile over the flights",
        ("met", "miss_m", "arrival_spread_s"),
        "met",
    )
    share: float = number("which quantile of miss or spread", 0, 1, "", 0.95, exclusive_minimum=True)
    width: float = number("of the interval, in its unit", 0, 1e9, "", exclusive_minimum=True)
    at_least: int = Field(
        100,
        ge=1,
        le=FLIGHTS_MAX,
        description="flights that are flown in any case",
        json_schema_extra=expects(f"a whole number from 1 to {FLIGHTS_MAX}"),
    )

    def consistency_problems(self) -> list[Problem]:
        """Find a quantile that no number of flights bounds."""
        if self.share == 1.0:
            return [Problem("share", "1", "a number below 1")]
        return []


class Study(Table):
    """A study file; read one with :func:`anser.campaigns.load_study`, whose messages are plain."""

    format: Literal[1] = Field(description="version of the file format", json_schema_extra=expects("1"))
    name: str = Field(
        pattern=SLUG_PATTERN,
        max_length=64,
        description="name of the study, also of its output",
        json_schema_extra=expects(SLUG_EXPECTED),
    )
    description: str = Field("", description="what it is for", json_schema_extra=expects("a text in quotes"))
    scenario: str = Field(
        min_length=1,
        description="scenario file, seen from the study file",
        json_schema_extra=expects("the path of a scenario file in quotes"),
    )
    seed: int = Field(
        0,
        ge=0,
        le=SEED_MAX,
        description="of all that is random: of the sampling and of each flight",
        json_schema_extra=expects(f"a whole number from 0 to {SEED_MAX}"),
    )
    precision: Precision = choice("in which flights are flown; they are planned in float64", PRECISIONS, "float64")
    sampling: Sampling | None = table("of a campaign: how often and how", "a table [sampling]", None)
    vary: tuple[Dispersion, ...] = tables("what varies", "tables [[vary]], in double brackets", at_least=0, default=())
    correlated: tuple[CorrelatedGroup, ...] = tables(
        "what varies together", "tables [[correlated]], in double brackets", at_least=0, default=()
    )
    rare: RareEventConfig | None = table("which event's probability is looked for", "a table [rare]", None)
    until: StoppingRule | None = table("when fewer flights are enough", "a table [until]", None)
    answers: EstimateSettings = table("what is asked", "a table [answers]", EstimateSettings())
    keep: OutputSelection | None = table("what is kept beside the rows", "a table [keep]", None)

    def consistency_problems(self) -> list[Problem]:
        """Find what is wrong between tables."""
        paths = [one.path for one in self.vary]
        found = [
            Problem(f"vary[{k}].path", describe_value(path), "each path once")
            for k, path in enumerate(paths)
            if path in paths[:k]
        ]
        found += [
            Problem(f"vary[{k}].path", '"seed"', "another path: the study's seed gives each flight its own")
            for k, path in enumerate(paths)
            if path == "seed"
        ]
        taken: list[str] = []
        for k, group in enumerate(self.correlated):
            for path in group.paths:
                if path not in paths:
                    found.append(Problem(f"correlated[{k}].paths", describe_value(path), "paths of tables [[vary]]"))
                elif path in taken:
                    found.append(
                        Problem(f"correlated[{k}].paths", describe_value(path), "each path in one group, once")
                    )
                taken.append(path)
        return [
            *found,
            *(
                self._sampling_problems(self.sampling)
                if self.sampling is not None
                else self._problems_without_sampling()
            ),
        ]

    def _sampling_problems(self, sampling: Sampling) -> list[Problem]:
        found = []
        if sampling.method in ("grid", "table", "saltelli") and self.correlated:
            found.append(Problem("correlated", "a table", f"none with the method {sampling.method}"))
        if self.block * (sampling.flights or 0) > FLIGHTS_MAX:
            words = f"{FLIGHTS_MAX // self.block} blocks of {self.block} flights at most"
            found.append(Problem("sampling.flights", str(sampling.flights), words))
        if self.until is not None and sampling.method != "monte-carlo":
            words = "none: only of plain Monte Carlo are the first flights a sample of their own"
            found.append(Problem("until", "a table", words))
        if sampling.method == "table" and self.rare is not None:
            found.append(Problem("rare", "a table", "none: the values of a table are no distributions"))
        if sampling.method == "table" and self.vary:
            found.append(Problem("vary", "a table", "none: the columns of sampling.file say what varies"))
        if sampling.method != "monte-carlo" and not self.vary and sampling.method != "table":
            words = f"one table [[vary]] at least with the method {sampling.method}"
            found.append(Problem("vary", "nothing", words))
        return found

    def _problems_without_sampling(self) -> list[Problem]:
        """Problems of a study without a table [sampling]."""
        found = []
        if self.rare is None:
            found.append(Problem("sampling", "nothing", "a table [sampling], or a table [rare]"))
        if self.until is not None:
            found.append(Problem("until", "a table", "none without a table [sampling]"))
        return found

    @property
    def sampled(self) -> Sampling:
        """How often and how a campaign samples; ScenarioError where the study is for none."""
        if self.sampling is None:
            raise ScenarioError(self.name, [Problem("sampling", "nothing", "a table [sampling], to fly a campaign")])
        return self.sampling

    @property
    def block(self) -> int:
        """Flights that belong together: with saltelli as many as numbers vary and two more, else each by itself."""
        return len(self.vary) + 2 if self.sampling is not None and self.sampling.method == "saltelli" else 1

    @property
    def hash(self) -> str:
        """SHA-256 of the validated values, 64 hexadecimal digits."""
        return content_hash(self)


def load_study(path: str | os.PathLike[str]) -> tuple[Study, Scenario, dict[str, np.ndarray]]:
    """Read and validate a study file, its scenario, and its table of values where it has one.

    Parameters
    ----------
    path
        A TOML file, UTF-8.

    Returns
    -------
    The study, the scenario, and the columns of the table by path (empty without a table).

    Raises
    ------
    ScenarioError
        A file cannot be read or is no valid study or scenario; the message says where and what would be right.
    """
    source = os.fspath(path)
    text = read_text(path, "study")
    with attach_line_numbers(text, source):
        study = validate_study(parse_scenario(text, source), source)
    scenario = load(Path(path).parent / study.scenario)
    file = None if study.sampling is None else study.sampling.file
    given = {} if file is None else _columns(Path(path).parent / file)
    return study, scenario, given


def validate_study(values: dict[str, Any], source: str = "<values>") -> Study:
    """Validate a study that is at hand as nested dictionaries and lists; raises `ScenarioError`."""
    check_file_kind("study", values, source)
    try:
        return Study.model_validate(values)
    except ValidationError as error:
        raise ScenarioError(source, validation_problems(error, Study, values)) from None


def _columns(path: Path) -> dict[str, np.ndarray]:
    """Values by the headings of a CSV file: numbers, truth values where all are `true` or `false`, else texts."""
    try:
        rows = list(csv.reader(read_text(path, "table", _TABLE_SIZE_MAX).splitlines()))
    except csv.Error as error:
        raise ScenarioError(os.fspath(path), [Problem("", f"a table that is no CSV ({error})", "a CSV file")]) from None
    rows = [row for row in rows if row]
    if len(rows) < 2:
        arrived = f"{len(rows)} rows"
        raise ScenarioError(os.fspath(path), [Problem("", arrived, "a row of paths and one row of values at least")])
    heads, width = [head.strip() for head in rows[0]], len(rows[0])
    if len(set(heads)) < width:
        raise ScenarioError(os.fspath(path), [Problem("row 1", "a path twice", "each path once")])
    if "seed" in heads:
        words = "another path: the study's seed gives each flight its own"
        raise ScenarioError(os.fspath(path), [Problem("row 1", '"seed"', words)])
    for k, row in enumerate(rows):
        if len(row) != width:
            raise ScenarioError(os.fspath(path), [Problem(f"row {k + 1}", f"{len(row)} values", f"{width}")])
    return {head: _read([row[k].strip() for row in rows[1:]]) for k, head in enumerate(heads)}


def _read(texts: list[str]) -> np.ndarray:
    if set(texts) <= {"true", "false"}:
        return np.array([text == "true" for text in texts])
    try:
        return np.array([float(text) for text in texts])
    except ValueError:
        return np.array(texts)
