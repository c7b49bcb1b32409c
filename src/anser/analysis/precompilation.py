"""Compilation, ahead of time, of the programs that the commands of the command line use."""

import functools
from collections.abc import Callable, Sequence
from typing import Any

from anser.analysis.linear_models import linearize
from anser.analysis.step_flights import fly_steps
from anser.analysis.step_tests import PUBLISHED_STEPS
from anser.analysis.trim_points import trim
from anser.missions.batches import Progress, no_progress
from anser.missions.plans import plan
from anser.missions.segments import fly_with_replanning, prepare_flight, replan_stopped_flight
from anser.scenario.schema import Scenario


def warm_cache(scenarios: Sequence[Scenario], progress: Progress | None = None) -> None:
    """Compile, or load from disk, the programs of the commands `plan`, `run`, `trim`, `linearize` and `step`.

    The programs of `plan` and `run` depend on planner, Earth, aircraft, number of aircraft, keep-outs and wind layers
    of the `scenarios`, but not on numerical values. The remaining programs are for the F-16. `progress` is called with
    a description of the current work and the completed part, 0 to 1.
    """
    report_progress = progress or no_progress

    def fly(scenario: Scenario) -> None:
        planned = plan(scenario, prepare_next=prepare_flight)
        if not planned.refusals:
            flight, state = planned.flight, planned.initial_state()
            fly_with_replanning(flight, state, 0, 1)
            replan_stopped_flight(flight, state, 0)

    condition: dict[str, Any] = {"speed_m_s": 150.0, "altitude_m": 1000.0}
    tasks: list[tuple[str, Callable[[], Any]]] = [
        *((f"{scenario.name}: plan and flight", functools.partial(fly, scenario)) for scenario in scenarios),
        ("trim", lambda: trim("f16", **condition)),
        ("linear model", lambda: linearize("f16", **condition)),
        ("step", lambda: fly_steps(PUBLISHED_STEPS[:1], **condition)),
    ]
    for k, (description, work) in enumerate(tasks):
        report_progress(description, k / len(tasks))
        work()
    report_progress("ready", 1.0)
