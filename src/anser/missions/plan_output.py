"""A plan as people get it: a dataset, a summary, a picture and a table."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from anser.missions.first_plan import UNPROVEN, CertifiedFirstPlan, FirstPlan, unproven_paths
from anser.missions.plan_samples import PlannedPath, sample_plan, sample_times
from anser.missions.plans import PublishedFirstPlan
from anser.numerics.arrays import take_rows, unstack_rows
from anser.planning.certified.certified_plan import CertifiedPlan
from anser.planning.certified.path_bounds import PathBounds
from anser.planning.certified.task import AircraftTask
from anser.planning.holds.hold_paths import PlannedHolds
from anser.planning.limits import CERTIFIED_LIMITS, LIMIT_MESSAGES, LIMITS, PathLimits, describe_turns
from anser.planning.published.coordination import PLAN_MESSAGES
from anser.report.plan_figures import draw_plan
from anser.results.plan_outputs import plan_summary, write_trajectories
from anser.results.plan_record import PlanDetails, plan_dataset
from anser.results.summary import write_summary
from anser.scenario.build_aircraft import resolve_limits
from anser.scenario.schema import Scenario
from anser.scenario.schema_aircraft import Goal


@dataclass(frozen=True)
class RecordedPlan:
    """A plan, sampled and summed up.

    Attributes
    ----------
    dataset
        As `anser.results.plan_record` makes it.
    summary
        The contract of `plan.json`.
    """

    dataset: xr.Dataset
    summary: dict[str, Any]

    def write_into(self, folder: Path) -> None:
        """Write `plan.json`, `trajectories.csv`, `plan.svg` and `plan.png` into a folder that exists.

        Raises
        ------
        FileExistsError
            One of them exists: nothing is overwritten.
        """
        write_summary(self.summary, folder / "plan.json")
        write_trajectories(self.dataset, folder / "trajectories.csv")
        draw_plan(self.dataset, folder)


def record_plan(planned: FirstPlan) -> RecordedPlan:
    """Sample and sum up what `anser.plan` gives: `record(anser.plan(scenario)).summary` is what `plan.json` holds.

    Raises
    ------
    NoPlanError
        If it is a refusal.
    """
    if isinstance(planned, PublishedFirstPlan):
        return record_published(planned)
    if not isinstance(planned, CertifiedFirstPlan):
        raise TypeError(f"planned: arrived a {type(planned).__name__}; expected what anser.plan gives")
    gravity, holds = planned.airspace.gravity, planned.holds
    return record_certified(planned.scenario, planned.plan, planned.tasks, gravity, holds, planned.notes())


def record_published(planned: PublishedFirstPlan) -> RecordedPlan:
    """Sample and sum up a plan of the published planner."""
    scenario, made = planned.scenario, planned.plan
    details = PlanDetails(
        scenario,
        paths=planned.path_descriptions(),
        messages=tuple(
            PLAN_MESSAGES[int(status)] if int(status) else LIMIT_MESSAGES[int(limit)] if int(limit) else None
            for status, limit in zip(made.status, planned.limits.status, strict=True)
        ),
        problems=planned.problems(),
        notes=planned.notes(),
        limits=_limits_by_key(scenario),
        lengths_m=np.asarray(made.lengths),
        nominal_lengths_m=np.asarray(made.nominal_lengths),
        turn_utilization=np.asarray(planned.limits.turn_utilization_max),
        level_off_m=np.asarray(planned.limits.level_off_altitude),
    )
    arrivals = np.full(len(scenario.aircraft), float(made.arrival_time))
    return _record(made.trajectories, arrivals, planned.flight.environment.gravity, details)


def record_certified(
    scenario: Scenario,
    plan: CertifiedPlan,
    tasks: AircraftTask,
    gravity: Any,
    holds: PlannedHolds | None = None,
    notes: tuple[str, ...] = (),
) -> RecordedPlan:
    """Sample and sum up a plan of the certified planner, with what it proves; gravity in m/s^2.

    Rows of stacked tasks that are not active fill the fleet up to a size: they are no aircraft of the scenario.
    """
    rows = np.flatnonzero(np.asarray(tasks.active) > 0.0)
    made, asked = take_rows((plan, tasks.limits), rows)
    found = made.certificate
    good, ratio = np.asarray(plan.feasible)[rows], float(np.min(np.asarray(found.clearance_ratio)[:, rows]))
    details = PlanDetails(
        scenario,
        paths=tuple(describe_turns(math.degrees(float(turned))) for turned in made.total_turn),
        lengths_m=np.asarray(made.lengths),
        notes=notes,
        messages=tuple(None if ok else UNPROVEN for ok in good),
        problems=unproven_paths(scenario, good),
        limits=_limits_by_key(scenario, asked),
        bounds=_bounds_by_key(found.bounds, asked),
        separation_bound=ratio if math.isfinite(ratio) else None,
        keep_out_bounds_m=np.asarray(found.keep_out_clearance)[:, : len(scenario.keep_out)]
        if scenario.keep_out
        else None,
        **_holds_by_key(holds, rows),
    )
    return _record(made.paths, np.asarray(made.arrival_times), gravity, details, asked)


def _bounds_by_key(found: PathBounds, limits: PathLimits) -> dict[str, np.ndarray]:
    """Bounds of paths by key: of the accelerations those that ask as much of each aircraft at its start."""
    values = {limit.key: np.asarray(getattr(found, limit.field)) for limit in CERTIFIED_LIMITS}
    along = np.array([own.along_at_start(held_to) for own, held_to in unstack_rows((found, limits))])
    return values | {"thrust_surplus_max": along[:, 0], "thrust_deficit_max": along[:, 1]}


def _holds_by_key(holds: PlannedHolds | None, rows: np.ndarray) -> dict[str, Any]:
    """What is recorded of the holds of some aircraft."""
    if holds is None:
        return {}
    ratio = float(np.min(np.asarray(holds.clearance_ratio)[:, rows]))
    return {
        "hold_radii_m": np.asarray(holds.circles.radius)[rows],
        "hold_turns": np.asarray(holds.circles.turn)[rows],
        "hold_heights_m": np.asarray(holds.circles.height)[rows],
        "hold_separation_bound": ratio if math.isfinite(ratio) else None,
    }


def _record(
    paths: PlannedPath,
    arrivals: np.ndarray,
    gravity: Any,
    details: PlanDetails,
    limits: PathLimits | None = None,
) -> RecordedPlan:
    scenario = details.scenario
    times = sample_times(0.0, arrivals)
    goals = np.stack([_goal_n(scenario.goal_of(aircraft), times[0]) for aircraft in scenario.aircraft], axis=1)
    samples = sample_plan(
        paths, 0.0, arrivals, gravity, goals, times, scenario.separation.required_m, scenario.keep_out, limits
    )
    dataset = plan_dataset(samples, details)
    return RecordedPlan(dataset, plan_summary(dataset))


def _goal_n(goal: Goal, times_s: np.ndarray) -> np.ndarray:
    """Where a goal of a scenario is, (time, NED axis), m."""
    if goal.waypoints is None:
        north, east, up = goal.velocity_m_s()
        start = goal.position_m(0.0)
        place = [here + rate * times_s for here, rate in zip(start, (north, east, up), strict=True)]
    else:
        at = [point.time_s for point in goal.waypoints]
        corners = zip(*((p.north_m, p.east_m, p.altitude_m) for p in goal.waypoints), strict=True)
        place = [np.interp(times_s, at, corner) for corner in corners]
    return np.stack([place[0], place[1], -place[2]], axis=1)


def _limits_by_key(scenario: Scenario, own: PathLimits | None = None) -> dict[str, float | np.ndarray]:
    """Limits by key; what a scenario leaves out is each aircraft's own at its start, the reserve included.

    The published planner has none of its own, and it alone judges the level-off after the arrival.
    """
    found, each = {}, [resolve_limits(scenario, one) for one in scenario.aircraft]
    for limit in LIMITS if own is None else CERTIFIED_LIMITS:
        given = [getattr(one, limit.scenario_key) for one in each]
        if None not in given:
            found[limit.key] = np.asarray(given) / limit.factor
        elif own is None:
            found[limit.key] = math.nan
        else:
            found[limit.key] = np.asarray(getattr(own, limit.field)) / (1.0 - scenario.fleet.reserve)
    return found
