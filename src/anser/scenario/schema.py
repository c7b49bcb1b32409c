"""The scenario: all tables that describe one flight of a fleet.

Values are validated, have the units of the scenario file, and include the contents of the aircraft files named there.
"""

from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, ValidationError, model_validator

from anser.aircraft_files.schema import AirframeFile, DaveMlFile
from anser.aircraft_files.sources import entry_point_origin, read_airframe
from anser.config.errors import Problem, ScenarioError, check_file_kind, describe_value
from anser.config.key_paths import replace_values
from anser.config.tables import SLUG_EXPECTED, SLUG_PATTERN, Table, content_hash, expects, table, tables
from anser.config.validation_messages import validation_problems
from anser.scenario.schema_aircraft import Aircraft, Goal
from anser.scenario.schema_airspace import (
    Arrival,
    KeepOut,
    Separation,
    arrival_problems,
    keep_out_problems,
    same_point_problems,
    separation_problems,
)
from anser.scenario.schema_chart import chart_problems
from anser.scenario.schema_checks import (
    goal_problems,
    limits_for,
    name_problems,
    order_problems,
    planner_problems,
    range_problems,
    rendezvous_problems,
    speed_problems,
    start_problems,
)
from anser.scenario.schema_environment import DiscreteGust, Earth, EarthField, Turbulence, Wind, gust_problems
from anser.scenario.schema_event import Event, event_problems
from anser.scenario.schema_network import Network, network_problems
from anser.scenario.schema_reach import arrival_time_problems, reach_problems
from anser.scenario.schema_sensing import Estimator, GoalSensor, Navigation, margin_problems, sensing_problems
from anser.scenario.schema_settings import Fleet, Guidance, Hold, Limits, Requirements, Timing

_EXCLUSIVE_KEYS = ("type", "variant", "x_cg_over_c")


def insert_aircraft_files(values: dict[str, Any], source: str) -> dict[str, Any]:
    """Replace the paths of aircraft files by the contents of the files.

    Parameters
    ----------
    values
        Nested values of the scenario file; not validated.
    source
        Path of the scenario file (relative paths start from its folder), or a name for messages.

    Raises
    ------
    ScenarioError
        If an aircraft file is missing or invalid, or if a table also has a key of the library's airframes.
    """
    fleet = values.get("aircraft")
    if not isinstance(fleet, list | tuple) or not any(_aircraft_file_path(aircraft) for aircraft in fleet):
        return values
    files: dict[Path, AirframeFile | DaveMlFile] = {}
    tables_with_files, problems = [], []
    for k, aircraft in enumerate(fleet):
        path = _aircraft_file_path(aircraft)
        if path is None:
            tables_with_files.append(aircraft)
            continue
        conflicting_keys = [key for key in _EXCLUSIVE_KEYS if aircraft.get(key) is not None]
        if conflicting_keys:
            expected = "either airframe, the path of a file, or type with its variant; not both"
            arrived = (
                f"{describe_value(path)} beside {conflicting_keys[0]} = {describe_value(aircraft[conflicting_keys[0]])}"
            )
            problems.append(Problem(f"aircraft[{k}].airframe", arrived, expected))
            continue
        file_path = Path(source).parent / path
        if file_path not in files:
            files[file_path] = read_airframe(file_path)
        tables_with_files.append({**aircraft, "airframe": files[file_path]})
    if problems:
        raise ScenarioError(source, problems)
    return {**values, "aircraft": tables_with_files}


def _aircraft_file_path(aircraft: object) -> str | None:
    path = aircraft.get("airframe") if isinstance(aircraft, dict) else None
    return path if isinstance(path, str) else None


FORMAT = 2
"""Newest format of scenario files; older formats are read too."""
DEFAULT_PLANNERS = {1: "published", 2: "certified"}
"""Planner of a file without `fleet.planner`, by format."""
_FORMATS = f"{FORMAT} or 1, the formats that this anser reads"
SEED_MAX = 2**32 - 1


_CHECKS = (
    range_problems,
    speed_problems,
    start_problems,
    goal_problems,
    separation_problems,
    chart_problems,
    gust_problems,
    sensing_problems,
    event_problems,
    network_problems,
)
_CHECKS_WITH_GOALS = (
    rendezvous_problems,
    same_point_problems,
    margin_problems,
    arrival_problems,
    keep_out_problems,
)
"""Checks that need unique names and an existing goal of every aircraft."""


class Scenario(Table):
    """A validated scenario file; :func:`anser.load` reads one and reports errors in plain sentences."""

    format: Literal[1, 2] = Field(description="version of the file format", json_schema_extra=expects(_FORMATS))
    name: str = Field(
        pattern=SLUG_PATTERN,
        max_length=64,
        description="name of the scenario, also of its output",
        json_schema_extra=expects(SLUG_EXPECTED),
    )
    description: str = Field("", description="purpose of the scenario", json_schema_extra=expects("a text in quotes"))
    seed: int = Field(
        0,
        ge=0,
        le=SEED_MAX,
        description="seed of all random numbers",
        json_schema_extra=expects(f"a whole number from 0 to {SEED_MAX}"),
    )
    timing: Timing = table("time", "a table [timing]")
    earth: EarthField = table("the Earth and its origin", 'a table [earth], or the word "flat" or "wgs84"', Earth())
    wind: Wind = table("wind", "a table [wind]", Wind())
    fleet: Fleet = table("settings of the whole fleet", "a table [fleet]")
    limits: Limits = table("flight envelope", "a table [limits]", Limits())
    arrival: Arrival = table("arrival times", "a table [arrival]", Arrival())
    separation: Separation = table("minimum separation", "a table [separation]", Separation())
    guidance: Guidance = table("path following", "a table [guidance]", Guidance())
    hold: Hold = table("circle after the arrival", "a table [hold]", Hold())
    requirements: Requirements = table("requirements for a pass", "a table [requirements]", Requirements())
    aircraft: tuple[Aircraft, ...] = tables(
        "the fleet", "one table [[aircraft]] or more, in double brackets", at_least=1
    )
    goal: tuple[Goal, ...] = tables(
        "goals of the aircraft", "one table [[goal]] or more, in double brackets", at_least=1
    )
    turbulence: Turbulence = table("gusts of the air", "a table [turbulence]", Turbulence())
    gust: tuple[DiscreteGust, ...] = tables(
        "single gusts", "tables [[gust]], in double brackets", at_least=0, default=()
    )
    navigation: Navigation = table("navigation of the aircraft", "a table [navigation]", Navigation())
    goal_sensor: GoalSensor = table("sensor of the goal", "a table [goal_sensor]", GoalSensor())
    estimator: Estimator = table("filter that tracks the goal", "a table [estimator]", Estimator())
    network: Network | None = table("communication in a fleet without a centre", "a table [network]", None)
    event: tuple[Event, ...] = tables(
        "events during the flight", "tables [[event]], in double brackets", at_least=0, default=()
    )
    keep_out: tuple[KeepOut, ...] = tables(
        "volumes closed to all aircraft", "tables [[keep_out]], in double brackets", at_least=0, default=()
    )

    @model_validator(mode="after")
    def _holds_together(self) -> Self:
        fleet = self.fleet.with_defaults(planner=DEFAULT_PLANNERS[self.format])
        scenario = self._with_values(fleet=fleet, limits=self._common_limits())
        problems = scenario.consistency_problems()
        if problems:
            raise ScenarioError("", problems)
        return scenario

    def _common_limits(self) -> Limits:
        """Return the limits, completed by the range of the aircraft's data if the fleet has one common range."""
        ranges = {aircraft.range for aircraft in self.aircraft}
        return limits_for(self.limits, self.aircraft[0].range) if len(ranges) == 1 else self.limits

    def consistency_problems(self) -> list[Problem]:
        """List the contradictions between tables; checks that depend on failed checks are skipped."""
        # unsupported keys and crossed limits make further checks meaningless
        for check in (planner_problems, order_problems):
            if problems := check(self):
                return problems
        naming_problems = name_problems(self)
        checks = _CHECKS if naming_problems else (*_CHECKS, *_CHECKS_WITH_GOALS)
        problems = [*naming_problems, *(problem for check in checks for problem in check(self))]
        return problems or reach_problems(self) or arrival_time_problems(self)

    @property
    def hash(self) -> str:
        """Return the SHA-256 of the validated values, 64 hexadecimal digits; see :func:`scenario_hash`."""
        return scenario_hash(self)

    @property
    def is_random(self) -> bool:
        """Whether the flight depends on the seed."""
        has_exact_sensors = self.navigation.sensors == "exact" and self.goal_sensor.preset == "exact"
        network = self.network
        has_perfect_network = network is None or not (network.loss or network.outage_share)
        return self.turbulence.intensity != "none" or not has_exact_sensors or not has_perfect_network

    @property
    def requires_separation(self) -> bool:
        """Whether a flight must keep its aircraft separated to meet the requirements."""
        return self.separation.required_m is not None or self.requirements.separation_min_m is not None

    @property
    def is_gusty(self) -> bool:
        """Whether the air is turbulent."""
        return self.turbulence.intensity != "none"

    def limits_for(self, aircraft: Aircraft) -> Limits:
        """Return one aircraft's limits; keys left out of the scenario follow from the range of its data."""
        return limits_for(self.limits, aircraft.range)

    def speed_for(self, aircraft: Aircraft) -> float:
        """Return the preferred airspeed of one aircraft, m/s: from its table, or else from the fleet."""
        return self.fleet.speed_m_s if aircraft.speed_m_s is None else aircraft.speed_m_s

    def goal_of(self, aircraft: Aircraft) -> Goal:
        """Return the goal of an aircraft of this scenario."""
        return next(goal for goal in self.goal if goal.name == aircraft.goal)

    def replace(self, path: str, value: object, /, *further_changes: object) -> "Scenario":
        """Return a scenario with changed values, validated like one from a file; this scenario is unchanged.

        Parameters
        ----------
        path
            Key path as in messages: keys joined by dots, list items in brackets by number from 0 or by name (a name
            that is a number in quotes): "wind.speed_m_s", "aircraft[1].start.speed_m_s", "goal[boat-north].course_deg",
            "keep_out".
        value
            New value as a file would give it: a number, text, list, or a dictionary (or table of a scenario), which
            replaces the whole table. None leaves out an optional key.
        *further_changes
            Further paths and values, alternately. All changes are made in order; only the result is validated.

        Raises
        ------
        ScenarioError
            If a path does not exist or the result is not a valid scenario; the message names the key path.
        TypeError
            If a path has no value.
        """
        arguments = (path, value, *further_changes)
        if len(arguments) % 2:
            raise TypeError(f"replace takes paths and values in turn; the path {arguments[-1]!r} has no value")
        changes = tuple(zip(arguments[::2], arguments[1::2], strict=True))
        source = f"{self.name} with {', '.join(str(key_path) for key_path in arguments[::2])} replaced"
        try:
            return validate(replace_values(self, changes), source)
        except ScenarioError as error:
            raise ScenarioError(source, error.problems) from None


def validate(values: dict[str, Any], source: str = "<values>") -> Scenario:
    """Validate a scenario given as nested dictionaries and lists.

    Parameters
    ----------
    values
        Nested values as in a scenario file.
    source
        Name of the scenario in messages; a file path makes relative paths of aircraft files relative to the file's
        folder.

    Raises
    ------
    ScenarioError
        If the scenario or an aircraft file named in the scenario is invalid.
    """
    check_file_kind("scenario", values, source)
    version = values.get("format")
    if "format" in values and (type(version) is not int or version not in DEFAULT_PLANNERS):
        # in another format all keys may differ, so this is the only problem reported
        raise ScenarioError(source, [Problem("format", describe_value(version), _FORMATS)])
    values = insert_aircraft_files(values, source)
    try:
        return Scenario.model_validate(values)
    except ValidationError as error:
        raise ScenarioError(source, validation_problems(error, Scenario, values)) from None


def scenario_hash(scenario: Scenario) -> str:
    """Compute a scenario's hash, which comments, the order of keys and written-out defaults do not change.

    SHA-256 of the canonical JSON (keys sorted, no blanks, ASCII), 64 hexadecimal digits. Airframes from entry points,
    which are code, enter with the name and version of their distribution.
    """
    offered = {
        aircraft.type: entry_point_origin(aircraft.type) for aircraft in scenario.aircraft if aircraft.airframe is None
    }
    code = {name: origin for name, origin in offered.items() if origin}
    return content_hash(scenario, {"entry_points": code} if code else None)
