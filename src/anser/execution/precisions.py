"""Which scenarios can be flown in another precision than float64."""

from collections.abc import Sequence

from anser.scenario import Problem, Scenario, ScenarioError
from anser.simulation import Precision


def flown_one_by_one(scenario: Scenario) -> bool:
    """Whether a scenario's flight stops for a search on the host, or has plans of several sizes."""
    return bool(scenario.event) or scenario.fleet.planner == "decentralised"


def refuse_precision(scenario: Scenario, precision: Precision, source: str | None = None) -> None:
    """Refuse to fly a scenario in a precision that does not fit it (ScenarioError), of the file `source`.

    Over a round Earth places are integrated as distances from its centre, of which float32 tells no two apart that are
    nearer than half a metre. Fleets that plan while they fly do so from their state between two steps.
    """
    if precision == "float64":
        return
    arrived = None
    if scenario.earth.model != "flat":
        arrived = "a round Earth, whose distances float32 rounds to half a metre"
    elif flown_one_by_one(scenario):
        arrived = "one with events, or without a centre"
    if arrived is not None:
        words = 'precision = "float64" for it'
        raise ScenarioError(source or scenario.name, [Problem("precision", f'"{precision}" of {arrived}', words)])


def refused_in(scenarios: Sequence[Scenario], precision: Precision) -> dict[int, str]:
    """Places of scenarios that a precision does not fit, and why."""
    found: dict[int, str] = {}
    for k, scenario in enumerate(scenarios):
        try:
            refuse_precision(scenario, precision)
        except ScenarioError as error:
            found[k] = "; ".join(map(str, error.problems))
    return found
