"""Table [keep] of a study: what is kept of flights beside their rows."""

import difflib
from collections.abc import Iterable

from pydantic import Field

from anser.execution.series import SeriesKept
from anser.scenario import Problem, Scenario, ScenarioError
from anser.scenario.errors import plain, show
from anser.scenario.schema_base import Table, expects, number
from anser.scenario.schema_settings import is_multiple, multiple_words
from anser.variables import CATALOGUE, DERIVED_KEYS, OPTIONAL_KEYS, RECORDED_KEYS

_KEYS = (*RECORDED_KEYS, *(variable.key for variable in CATALOGUE if variable.optional))
_OF_NAME = {variable.name: variable.key for variable in CATALOGUE}
_OF_GUSTS = frozenset({"airspeed_mean_wind", *(key for key in OPTIONAL_KEYS if key.startswith("gust_"))})
_OF_NETWORK = frozenset({"clock_lag", "clock_rate", "heard_from", "path_offered"})
_OF_SENSORS = OPTIONAL_KEYS - _OF_GUSTS - _OF_NETWORK


class Keep(Table):
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

    def own_problems(self) -> list[Problem]:
        """Find names that no recorded variable has, names that stand twice, and a rate of nothing."""
        found = []
        for k, name in enumerate(self.series):
            if name in self.series[:k]:
                found.append(Problem(f"series[{k}]", show(name), "each variable once"))
            elif name in DERIVED_KEYS:
                words = "a variable that is recorded: north and east lead to latitude and longitude"
                found.append(Problem(f"series[{k}]", show(name), words))
            elif name not in _KEYS:
                found.append(Problem(f"series[{k}]", show(name), f"the name of a variable, {_near(name)}"))
        if "series_every_s" in self.model_fields_set and not self.series:
            found.append(Problem("series", "nothing", "names of variables, where keep.series_every_s is given"))
        return found


def series_of(keep: Keep | None, scenario: Scenario) -> SeriesKept | None:
    """What a table asks to be recorded of a scenario's flights; None: nothing."""
    if keep is None or not keep.series:
        return None
    return SeriesKept.of(scenario, keep.series, keep.series_every_s)


def refuse_series(keep: Keep | None, source: str, scenarios: Iterable[Scenario], varied: Iterable[str]) -> None:
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
        words = multiple_words(keep.series_every_s, "timing.step_s of the scenario", step_s)
        found.append(Problem("keep.series_every_s", plain(keep.series_every_s), words))
    words = "none where durations or steps vary: the series of all flights have the same times"
    found += [Problem("keep.series", f"with {show(path)}", words) for path in varied if path.startswith("timing")]
    recorded = set().union(*map(_recorded, scenarios))
    for k, name in enumerate(keep.series):
        if name not in recorded:
            found.append(Problem(f"keep.series[{k}]", show(name), f"a variable that a flight has; {_lacking(name)}"))
    if found:
        raise ScenarioError(source, found)


def _recorded(scenario: Scenario) -> set[str]:
    """Keys that the flights of a scenario have."""
    found = set(RECORDED_KEYS)
    if scenario.turbulence.intensity != "none" or scenario.gust:
        found |= _OF_GUSTS
    if scenario.goal_sensor.preset != "exact":
        found |= _OF_SENSORS
    if scenario.fleet.planner == "decentralised":
        found |= _OF_NETWORK
    return found


def _lacking(name: str) -> str:
    if name in _OF_GUSTS:
        return "this one takes turbulence or a gust"
    if name in _OF_NETWORK:
        return 'this one takes fleet.planner = "decentralised"'
    return "this one takes a goal sensor with errors, such as goal_sensor.preset"


def _near(name: str) -> str:
    """What was perhaps meant, or where the names are."""
    if name in _OF_NAME:
        return f"perhaps {show(_OF_NAME[name])}: here without its unit"
    near = difflib.get_close_matches(name, _KEYS, n=3)
    if near:
        return f"perhaps {' or '.join(map(show, near))}"
    return 'such as "position_error", "airspeed", "bank" (all are in docs/reference/variables.md)'
