"""The scenario: all tables that describe one flight of a fleet.

Values are validated, have the units of the scenario file, and include the contents of aircraft files and soundings.
"""

from pathlib import Path
from typing import Any, Self

from pydantic import PrivateAttr, ValidationError, ValidationInfo, model_validator

from anser.aircraft_files.schema import AirframeFile, DaveMlFile
from anser.aircraft_files.sources import entry_point_origin, read_airframe
from anser.config.errors import Problem, ScenarioError, check_file_kind, describe_value
from anser.config.key_paths import replace_values
from anser.config.tables import content_hash
from anser.config.toml_text import named_by
from anser.config.validation_messages import validation_problems
from anser.environment.air import STANDARD_LAYERS
from anser.scenario import schema_airspace_checks as airspace
from anser.scenario import schema_checks as checks
from anser.scenario.schema_chart import chart_problems
from anser.scenario.schema_environment import Wind
from anser.scenario.schema_reach import arrival_time_problems, reach_problems
from anser.scenario.schema_tables import DEFAULT_PLANNERS, FORMATS_EXPECTED, ScenarioTables
from anser.scenario.sounding_file import read_sounding

_EXCLUSIVE_KEYS = ("type", "variant", "x_cg_over_c")


def insert_aircraft_files(values: dict[str, Any], source: str) -> dict[str, Any]:
    """Return a scenario's unvalidated values with each path of an aircraft file replaced by the file's contents.

    `source` is the path of the scenario file (relative paths start from its folder), or a name for messages. Raises
    ScenarioError if an aircraft file is missing or invalid, or if its aircraft also has a type, variant or x_cg_over_c.
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
            with named_by(source, f"aircraft[{k}].airframe", path):
                files[file_path] = read_airframe(file_path)
        tables_with_files.append({**aircraft, "airframe": files[file_path]})
    if problems:
        raise ScenarioError(source, problems)
    return {**values, "aircraft": tables_with_files}


def insert_wind_field(values: dict[str, Any], source: str) -> dict[str, Any]:
    """Return a scenario's unvalidated values with a wind field's path joined to the folder of the file `source`."""
    wind = values.get("wind")
    if not isinstance(wind, dict) or not isinstance(wind.get("field"), str):
        return values
    return {**values, "wind": {**wind, "field": str(Path(source).parent / wind["field"])}}


def _aircraft_file_path(aircraft: object) -> str | None:
    path = aircraft.get("airframe") if isinstance(aircraft, dict) else None
    return path if isinstance(path, str) else None


def insert_sounding(values: dict[str, Any], source: str) -> dict[str, Any]:
    """Return a scenario's unvalidated values with the contents of a sounding in place of the sounding's path.

    Measured winds, if any, become the table [wind]. `source` is the path of the scenario file (relative paths start
    from its folder), or a name for messages. Raises ScenarioError if the sounding is missing or invalid, or if the
    scenario has a wind beside a sounding with winds.
    """
    atmosphere = values.get("atmosphere")
    if not isinstance(atmosphere, dict) or not isinstance(atmosphere.get("sounding"), str):
        return values
    path = atmosphere["sounding"]
    with named_by(source, "atmosphere.sounding", path):
        measured = read_sounding(Path(source).parent / path)
    values = {**values, "atmosphere": {**atmosphere, "sounding": {"level": measured.levels}}}
    if not measured.winds:
        return values
    if not _is_calm(values.get("wind")):
        expected = "either a wind, or a sounding with winds; not both"
        raise ScenarioError(source, [Problem("wind", f"a wind beside the winds of {describe_value(path)}", expected)])
    return {**values, "wind": {"layers": measured.winds}}


def _is_calm(wind: object) -> bool:
    """Whether an unvalidated table [wind] is absent, or valid and without any wind or wind field."""
    if isinstance(wind, dict):
        try:
            wind = Wind.model_validate(wind)
        except ValidationError:
            return False
    return wind is None or (isinstance(wind, Wind) and wind.speed_max_m_s == 0.0 and wind.field is None)


_CHECKS = (
    checks.range_problems,
    checks.speed_problems,
    checks.start_problems,
    airspace.same_start_problems,
    checks.goal_problems,
    airspace.separation_problems,
    chart_problems,
    checks.gust_problems,
    checks.sounding_problems,
    checks.sensing_problems,
    checks.event_problems,
    checks.excitation_problems,
    checks.network_problems,
)
_CHECKS_WITH_GOALS = (
    checks.rendezvous_problems,
    airspace.same_point_problems,
    checks.margin_problems,
    airspace.arrival_problems,
    airspace.keep_out_problems,
)
"""Checks that are made only if names are unique and the goal of every aircraft exists."""
_CHECKS_OF_AIRCRAFT = (
    checks.range_problems,
    checks.start_problems,
    checks.gust_problems,
    checks.sounding_problems,
    checks.sensing_problems,
    checks.event_problems,
    checks.excitation_problems,
)
"""Checks of aircraft without a mission: nothing is required of goals, holds, and the speed of the wind."""


class Scenario(ScenarioTables):
    """A validated scenario file; :func:`anser.load` reads one and reports errors in plain sentences.

    The attributes are the tables of the file.
    """

    _attached_parts: Any = PrivateAttr(None)  # objects of `anser.scenario.user_parts.attach_parts`

    @model_validator(mode="after")
    def _holds_together(self, info: ValidationInfo) -> Self:
        limits, ranges = self.limits, {aircraft.range for aircraft in self.aircraft}
        if len(ranges) == 1:
            limits = limits.within(ranges.pop())
        fleet = self.fleet.with_defaults(planner=DEFAULT_PLANNERS[self.format])
        scenario = self._with_values(fleet=fleet, limits=limits)._with_true_airspeeds()
        scenario._refuse_contradictions(info)
        return scenario

    def _with_true_airspeeds(self) -> Self:
        """Return the scenario with calibrated and equivalent airspeeds and Mach numbers converted to true airspeeds."""
        altitudes_m = [aircraft.start.altitude_m for aircraft in self.aircraft]
        layers = STANDARD_LAYERS if self.atmosphere is None else self.atmosphere.layers
        members = tuple(
            aircraft._with_values(start=aircraft.start.with_airspeed(layers, altitude_m)).with_airspeed(
                layers, altitude_m
            )
            for aircraft, altitude_m in zip(self.aircraft, altitudes_m, strict=True)
        )
        fleet = self.fleet.with_airspeed(layers, sum(altitudes_m) / len(altitudes_m))
        return self._with_values(aircraft=members, fleet=fleet)

    def consistency_problems(self) -> list[Problem]:
        """List the contradictions between tables; a check is skipped if earlier problems make it meaningless."""
        # unsupported keys and crossed limits make further checks meaningless
        if problems := checks.planner_problems(self) or checks.order_problems(self):
            return problems
        naming_problems = checks.name_problems(self)
        applicable = _CHECKS if naming_problems else (*_CHECKS, *_CHECKS_WITH_GOALS)
        problems = [*naming_problems, *(problem for check in applicable for problem in check(self))]
        if problems or self.wind.field is not None:  # the wind of a field is not known here: the planner refuses
            return problems
        return reach_problems(self) or [*arrival_time_problems(self)]

    def __eq__(self, other: object) -> bool:
        """Whether another scenario has the same values, and omits the same limits and gains.

        A file that writes a default limit or gain is different, because omitted ones follow from the aircraft.
        """
        if not isinstance(other, Scenario):
            return NotImplemented
        return super().__eq__(other) and _written_in_place_of_derived(self) == _written_in_place_of_derived(other)

    @property
    def hash(self) -> str:
        """SHA-256 of the validated values, 64 hexadecimal digits; see :func:`scenario_hash`."""
        return scenario_hash(self)

    def replace(self, path: str, value: object, /, *further_changes: object) -> "Scenario":
        """Return a validated scenario with changed values; this scenario is unchanged.

        Unlike in a file, keys without effect are accepted.

        Parameters
        ----------
        path
            Key path as in messages: keys joined by dots, list items in brackets by number from 0 or by name. Examples:
            "wind.speed_m_s", "aircraft[1].start.speed_m_s", "goal[boat-north].course_deg", "keep_out". A name that is a
            number must be in quotes.
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
            replaced = validate(replace_values(self, changes), source)
        except ScenarioError as error:
            raise ScenarioError(source, error.problems) from None
        replaced._attached_parts = self._attached_parts
        return replaced


class UnplannedScenario(Scenario):
    """A scenario whose aircraft have no mission: nothing is required of goals, holds, and the speed of the wind."""

    def consistency_problems(self) -> list[Problem]:
        """List the contradictions between tables that concern the aircraft, its air and its sensors."""
        if problems := checks.order_problems(self):
            return problems
        own_airspeed = [problem for problem in checks.speed_problems(self) if problem.path.startswith("aircraft")]
        return own_airspeed + [problem for check in _CHECKS_OF_AIRCRAFT for problem in check(self)]


def validate(
    values: dict[str, Any], source: str = "<values>", kind: type[Scenario] = Scenario, *, is_stored: bool = False
) -> Scenario:
    """Validate a scenario given as nested dictionaries and lists.

    `source` names the scenario in messages; if it is a file's path, relative paths of other files start from the file's
    folder. `kind` is the class of the result. If `is_stored` is True (stored results), contradictions between keys are
    accepted. Raises ScenarioError if the scenario or a file named in it is invalid.
    """
    check_file_kind("scenario", values, source)
    version = values.get("format")
    if "format" in values and (type(version) is not int or version not in DEFAULT_PLANNERS):
        # in another format all keys may differ, so this is the only problem reported
        raise ScenarioError(source, [Problem("format", describe_value(version), FORMATS_EXPECTED)])
    values = insert_wind_field(insert_sounding(insert_aircraft_files(values, source), source), source)
    try:
        return kind.model_validate(values, context={"is_stored": is_stored})
    except ValidationError as error:
        raise ScenarioError(source, validation_problems(error, kind, values)) from None


_DERIVED_LIMITS = {
    "bank_max_deg",
    "speed_min_m_s",
    "speed_max_m_s",
    "climb_rate_max_m_s",
    "alpha_min_deg",
    "alpha_max_deg",
}
_DERIVED_GAINS = {"rates", "attitude", "velocity"}


def _written_in_place_of_derived(scenario: Scenario) -> list[str]:
    """Return the sorted key paths of limits and gains in the file that would follow from the aircraft if omitted."""
    derived = {k: aircraft for k, aircraft in enumerate(scenario.aircraft) if not aircraft.is_library_f16}
    limits = scenario.limits.model_fields_set & _DERIVED_LIMITS if derived else ()
    gains = [
        f"aircraft[{k}].gains.{loop}"
        for k, aircraft in derived.items()
        for loop in aircraft.gains.model_fields_set & _DERIVED_GAINS
    ]
    return sorted([*(f"limits.{key}" for key in limits), *gains])


def scenario_hash(scenario: Scenario) -> str:
    """Compute a scenario's hash, which comments, the order of keys and written-out defaults do not change.

    The hash is the SHA-256 of the canonical JSON (keys sorted, no blanks, ASCII), 64 hexadecimal digits. For aircraft
    other than the library's F-16, the hash also depends on which limits and gains the file writes, because omitted ones
    follow from the aircraft. For an airframe from an entry point, the hash includes the name and version of the package
    that offers the airframe; for a wind field, the checksum of the file.
    """
    offered = {
        aircraft.type: entry_point_origin(aircraft.type) for aircraft in scenario.aircraft if aircraft.airframe is None
    }
    code = {name: origin for name, origin in offered.items() if origin}
    extra: dict[str, Any] = {"entry_points": code} if code else {}
    written = _written_in_place_of_derived(scenario)
    if written:
        extra["written"] = written
    if scenario.wind.field is not None:
        extra["wind"] = {**scenario.wind.model_dump(mode="json"), "field": scenario.wind.field.sha256}
    return content_hash(scenario, extra)
