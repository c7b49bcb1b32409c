"""The scenario: all tables that one flight of a fleet needs.

Validated, in the units of its file, with the contents of the aircraft files that it names.
"""

import copy
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
    """Values of a scenario, aircraft files in the places of their paths.

    Parameters
    ----------
    values
        As the TOML file would hold them; not validated.
    source
        Path of the scenario's file, from whose folder paths are seen, or what it is called.

    Raises
    ------
    ScenarioError
        If an aircraft file cannot be read or is no valid aircraft, or stands beside a key of the library's airframes.
    """
    fleet = values.get("aircraft")
    if not isinstance(fleet, list | tuple) or not any(_path_of(one) for one in fleet):
        return values
    read: dict[Path, AirframeFile | DaveMlFile] = {}
    found, problems = [], []
    for k, one in enumerate(fleet):
        path = _path_of(one)
        if path is None:
            found.append(one)
            continue
        beside = [key for key in _EXCLUSIVE_KEYS if one.get(key) is not None]
        if beside:
            words = "either airframe, the path of a file, or type with its variant; not both"
            arrived = f"{describe_value(path)} beside {beside[0]} = {describe_value(one[beside[0]])}"
            problems.append(Problem(f"aircraft[{k}].airframe", arrived, words))
            continue
        place = Path(source).parent / path
        if place not in read:
            read[place] = read_airframe(place)
        found.append({**one, "airframe": read[place]})
    if problems:
        raise ScenarioError(source, problems)
    return {**values, "aircraft": found}


def _path_of(one: object) -> str | None:
    path = one.get("airframe") if isinstance(one, dict) else None
    return path if isinstance(path, str) else None


FORMAT = 2
"""The newest format of scenario files; those before it are read too."""
DEFAULT_PLANNERS = {1: "published", 2: "certified"}
"""The planner that is meant where a file of a format names none."""
_FORMATS = f"{FORMAT} or 1, the formats that this anser reads"
SEED_MAX = 2**32 - 1


class Scenario(Table):
    """A scenario file; build one with :func:`anser.scenario.files`, whose messages are plain."""

    format: Literal[1, 2] = Field(description="version of the file format", json_schema_extra=expects(_FORMATS))
    name: str = Field(
        pattern=SLUG_PATTERN,
        max_length=64,
        description="name of the scenario, also of its output",
        json_schema_extra=expects(SLUG_EXPECTED),
    )
    description: str = Field("", description="what it is for", json_schema_extra=expects("a text in quotes"))
    seed: int = Field(
        0,
        ge=0,
        le=SEED_MAX,
        description="of everything that is random",
        json_schema_extra=expects(f"a whole number from 0 to {SEED_MAX}"),
    )
    timing: Timing = table("time", "a table [timing]")
    earth: EarthField = table("the Earth and its origin", 'a table [earth], or the word "flat" or "wgs84"', Earth())
    wind: Wind = table("wind", "a table [wind]", Wind())
    fleet: Fleet = table("common to all", "a table [fleet]")
    limits: Limits = table("envelope", "a table [limits]", Limits())
    arrival: Arrival = table("when to arrive", "a table [arrival]", Arrival())
    separation: Separation = table("how far apart to stay", "a table [separation]", Separation())
    guidance: Guidance = table("how the plan is followed", "a table [guidance]", Guidance())
    hold: Hold = table("after the arrival", "a table [hold]", Hold())
    requirements: Requirements = table("what to achieve", "a table [requirements]", Requirements())
    aircraft: tuple[Aircraft, ...] = tables(
        "the fleet", "one table [[aircraft]] or more, in double brackets", at_least=1
    )
    goal: tuple[Goal, ...] = tables("places to meet", "one table [[goal]] or more, in double brackets", at_least=1)
    turbulence: Turbulence = table("gusts of the air", "a table [turbulence]", Turbulence())
    gust: tuple[DiscreteGust, ...] = tables(
        "single gusts", "tables [[gust]], in double brackets", at_least=0, default=()
    )
    navigation: Navigation = table("what an aircraft knows of itself", "a table [navigation]", Navigation())
    goal_sensor: GoalSensor = table("what it sees of its goal", "a table [goal_sensor]", GoalSensor())
    estimator: Estimator = table("the filter behind it", "a table [estimator]", Estimator())
    network: Network | None = table("who hears whom in a fleet without a centre", "a table [network]", None)
    event: tuple[Event, ...] = tables(
        "what happens on the way", "tables [[event]], in double brackets", at_least=0, default=()
    )
    keep_out: tuple[KeepOut, ...] = tables(
        "where no aircraft may be", "tables [[keep_out]], in double brackets", at_least=0, default=()
    )

    @model_validator(mode="after")
    def _holds_together(self) -> Self:
        if "planner" not in self.fleet.model_fields_set:
            # Not by validating the name: the file does not hold it, and what is written again must not either.
            meant = copy.copy(self.fleet)
            object.__setattr__(meant, "planner", DEFAULT_PLANNERS[self.format])
            object.__setattr__(self, "fleet", meant)
        if len({one.range for one in self.aircraft}) == 1:
            object.__setattr__(self, "limits", limits_for(self.limits, self.aircraft[0].range))
        found = self.consistency_problems()
        if found:
            raise ScenarioError("", found)
        return self

    def consistency_problems(self) -> list[Problem]:
        """Find what is wrong between tables, from the simple to what rests on it."""
        aircraft, goals, fleet, limits = self.aircraft, self.goal, self.fleet, self.limits
        unread = planner_problems(self)
        if unread:
            return unread  # what the planner does not know is not judged
        unordered = order_problems(limits)
        if unordered:
            return unordered
        names = name_problems(aircraft, goals)
        found = [
            *names,
            *range_problems(aircraft, limits),
            *speed_problems(self),
            *start_problems(self),
            *goal_problems(goals, self.timing),
            *separation_problems(aircraft, self.separation),
            *chart_problems(self),
            *gust_problems(self.gust, aircraft),
            *sensing_problems(self.navigation, self.goal_sensor, self.timing),
            *event_problems(self.event, aircraft, goals, self.timing, fleet.planner),
            *network_problems(
                self.network,
                fleet,
                limits,
                self.timing,
                self.arrival,
                aircraft,
                self.event,
                self.wind.speed_max_m_s,
            ),
        ]
        if not names:
            found.extend(rendezvous_problems(self))
            found.extend(same_point_problems(aircraft, self.arrival))
            found.extend(
                margin_problems(aircraft, goals, self.goal_sensor, self.estimator, self.navigation, self.timing, fleet)
            )
            found.extend(arrival_problems(self.arrival, aircraft, self.timing))
            found.extend(keep_out_problems(self.keep_out, aircraft, goals))
        return found or reach_problems(self) or arrival_time_problems(self)

    @property
    def hash(self) -> str:
        """SHA-256 of the validated values, 64 hexadecimal digits; see :func:`scenario_hash`."""
        return scenario_hash(self)

    @property
    def is_random(self) -> bool:
        """Whether the seed changes anything."""
        known = self.navigation.sensors == "exact" and self.goal_sensor.preset == "exact"
        network = self.network
        heard = network is None or not (network.loss or network.outage_share)
        return self.turbulence.intensity != "none" or not known or not heard

    @property
    def requires_separation(self) -> bool:
        """Whether a flight is judged by how near two aircraft come."""
        return self.separation.required_m is not None or self.requirements.separation_min_m is not None

    @property
    def is_gusty(self) -> bool:
        """Whether there is turbulence, which asks for the span of the wing."""
        return self.turbulence.intensity != "none"

    def limits_for(self, aircraft: Aircraft) -> Limits:
        """Limits of one aircraft: what the scenario leaves out is its airframe's own."""
        return limits_for(self.limits, aircraft.range)

    def speed_for(self, aircraft: Aircraft) -> float:
        """Airspeed that one aircraft prefers, m/s: its own where it has one, or that of the fleet."""
        return self.fleet.speed_m_s if aircraft.speed_m_s is None else aircraft.speed_m_s

    def goal_of(self, aircraft: Aircraft) -> Goal:
        """Look up the goal of an aircraft of this scenario."""
        return next(goal for goal in self.goal if goal.name == aircraft.goal)

    def replace(self, path: str, value: object, /, *more: object) -> "Scenario":
        """Make another scenario with other values, as validated as one from a file; this one stays as it is.

        Parameters
        ----------
        path
            Where, as messages write it: keys with dots between them; an item of a list in brackets, by its number from
            0 or by its name, in quotes where the name is a number: "wind.speed_m_s", "aircraft[1].start.speed_m_s",
            "goal[boat-north].course_deg", "keep_out".
        value
            What the file would hold there: a number, a text, a list, a dictionary (or a table of a scenario) for a
            whole table, which takes the place of all of it. None: left out, where a key may be.
        *more
            Further paths and values in turn. All are put in their places one after the other, and only what comes of
            all is validated.

        Raises
        ------
        ScenarioError
            If a path leads nowhere, or what comes of it is no valid scenario; the message names the place.
        TypeError
            If paths and values do not come in pairs.
        """
        given = (path, value, *more)
        if len(given) % 2:
            raise TypeError(f"replace takes paths and values in turn; the path {given[-1]!r} has no value")
        changes = tuple(zip(given[::2], given[1::2], strict=True))
        source = f"{self.name} with {', '.join(str(one) for one in given[::2])} replaced"
        try:
            return validate(replace_values(self, changes), source)
        except ScenarioError as error:
            raise ScenarioError(source, error.problems) from None


def validate(values: dict[str, Any], source: str = "<values>") -> Scenario:
    """Validate a scenario that is at hand as nested dictionaries and lists.

    Parameters
    ----------
    values
        As the TOML file would hold them.
    source
        What to call it in messages; a path of the scenario's file: paths in it are seen from there.

    Raises
    ------
    ScenarioError
        If it is no valid scenario, or an aircraft file that it names is none.
    """
    check_file_kind("scenario", values, source)
    version = values.get("format")
    if "format" in values and (type(version) is not int or version not in DEFAULT_PLANNERS):
        # in another format all keys may differ, so nothing else is told
        raise ScenarioError(source, [Problem("format", describe_value(version), _FORMATS)])
    values = insert_aircraft_files(values, source)
    try:
        return Scenario.model_validate(values)
    except ValidationError as error:
        raise ScenarioError(source, validation_problems(error, Scenario, values)) from None


def scenario_hash(scenario: Scenario) -> str:
    """Hash the values of a scenario: comments, order of keys and defaults written out do not change it.

    SHA-256 of its canonical JSON (keys sorted, no blanks, ASCII), 64 hexadecimal digits. Of airframes of entry points,
    which are code, it knows the distribution and its version.
    """
    offered = {one.type: entry_point_origin(one.type) for one in scenario.aircraft if one.airframe is None}
    code = {name: origin for name, origin in offered.items() if origin}
    return content_hash(scenario, {"entry_points": code} if code else None)
