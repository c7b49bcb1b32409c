"""Changes of an aircraft (faults, ice, shifted load) during its flight, with the keys of a scenario's event."""

from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import ValidationError

from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.changes import AirframeChanges
from anser.aircraft_files.build import build_changes
from anser.aircraft_files.deviations import CoefficientFactors, Deviation
from anser.config.errors import Problem, ScenarioError, format_number
from anser.config.tables import Table, number, tables
from anser.config.validation_messages import validation_problems
from anser.scenario.schema_settings import DURATION_MAX_S


class Change(Deviation):
    """Deviation of an aircraft from its model that begins during the flight, such as a fault or ice."""

    time_s: float = number("time of the change", 0, DURATION_MAX_S, "s")

    def consistency_problems(self) -> list[Problem]:
        """Return a problem if the change has factors on coefficients, which cannot change in flight."""
        if self.coefficients == CoefficientFactors():
            return []
        return [Problem("coefficients", "a table", "none: coefficients do not change during the flight")]


class _Changes(Table):
    change: tuple[Change, ...] = tables("changes of the aircraft", "a list of tables", at_least=0, default=())


def read_changes(
    airframe: AbstractAirframe, change: Mapping[str, Any] | Sequence[Mapping[str, Any]], duration_s: float
) -> AirframeChanges | None:
    """Return the changes of an aircraft over a flight of `duration_s` from one or several tables; None if no change.

    Raises ScenarioError if a change is not valid or not before the end of the flight.
    """
    values = {"change": (change,) if isinstance(change, Mapping) else tuple(change)}
    try:
        changes = _Changes.model_validate(values).change
    except ValidationError as error:
        raise ScenarioError("change of the aircraft", validation_problems(error, _Changes, values)) from None
    expected = f"a time before the end of the flight, duration_s = {format_number(duration_s)} s"
    late = [
        Problem(f"change[{k}].time_s", format_number(item.time_s), expected)
        for k, item in enumerate(changes)
        if item.time_s >= duration_s
    ]
    if late:
        raise ScenarioError("change of the aircraft", late)
    if not changes:
        return None
    return build_changes(airframe, [(item.time_s, item) for item in changes], "change of the aircraft")
