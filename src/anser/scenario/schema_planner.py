"""Which planner knows which keys: nothing that a scenario asks for is passed over in silence."""

from typing import TYPE_CHECKING

from anser.scenario.errors import Problem, plain, show
from anser.scenario.schema_base import Table
from anser.scenario.schema_checks import label

if TYPE_CHECKING:
    from anser.scenario.schema import Scenario

_LIMITS = ("altitude_max_m", "roll_rate_max_deg_s", "acceleration_max_m_s2", "deceleration_max_m_s2")
_AIRCRAFT = ("arrive_s", "arrive_from_s", "arrive_to_s")
_TABLES = ("arrival", "separation")


def planner_problems(scenario: "Scenario") -> list[Problem]:
    """Find keys that the planner of the scenario does not know.

    Beside ``planner = "published"`` written out, a key written out with its default asks for nothing and may stand; so
    a scenario that was recorded with all its defaults loads again.
    """
    fleet = scenario.fleet
    if fleet.planner == "certified":
        if fleet.speed_profile == "published":
            words = '"even", or fleet.planner = "published", which alone has such polynomials'
            return [Problem("fleet.speed_profile", '"published" with fleet.planner "certified"', words)]
        return []
    explicit = "planner" in fleet.model_fields_set
    found = [_unknown(f"fleet.{key}", fleet, key) for key in _used(fleet, ("reserve",), explicit)]
    found.extend(_unknown(f"limits.{key}", scenario.limits, key) for key in _used(scenario.limits, _LIMITS, explicit))
    for name in _TABLES:
        table: Table = getattr(scenario, name)
        found.extend(
            _unknown(f"{name}.{key}", table, key) for key in _used(table, tuple(type(table).model_fields), explicit)
        )
    for index, one in enumerate(scenario.aircraft):
        whom = label("aircraft", one)
        found.extend(_unknown(f"aircraft[{index}].{key}", one, key, whom) for key in _used(one, _AIRCRAFT, explicit))
    if scenario.keep_out:
        found.append(_refused("keep_out", f"a list of {len(scenario.keep_out)}"))
    return found


def _used(table: Table, keys: tuple[str, ...], explicit: bool) -> list[str]:
    """List the keys that are written out, less those that ask for nothing."""
    fields = type(table).model_fields
    written = [key for key in keys if key in table.model_fields_set]
    return [key for key in written if not (explicit and getattr(table, key) == fields[key].default)]


def _unknown(path: str, table: Table, key: str, whom: str = "") -> Problem:
    value = getattr(table, key)
    return _refused(path, plain(value) if isinstance(value, float) else show(value), whom)


def _refused(path: str, arrived: str, whom: str = "") -> Problem:
    words = 'fleet.planner = "certified" beside it, which alone knows this key'
    return Problem(path, f'{arrived} with fleet.planner "published"', words, whom)
