"""Output of a plan: dataset, summary, figure and table."""

import dataclasses
import functools
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from anser.missions.plan_samples import PlannedPath, sample_plan, sample_times
from anser.missions.refusal import UNPROVEN, unproven_paths
from anser.numerics.arrays import rows_on_host, unstack_rows
from anser.planning.certified.certified_plan import CertifiedPlan
from anser.planning.certified.path_bounds import PathBounds
from anser.planning.certified.task import AircraftTask
from anser.planning.holds.hold_paths import PlannedHolds
from anser.planning.limits import CERTIFIED_LIMITS, LIMIT_MESSAGES, LIMITS, PathLimits, describe_turns
from anser.planning.published.coordination import PLAN_MESSAGES
from anser.report.plan_figures import draw_plan
from anser.results.arrival import closest_approach
from anser.results.flight_rows import CLEARANCE_MIN_M
from anser.results.plan_outputs import plan_summary, write_trajectories
from anser.results.plan_record import PlanDetails, PlanSamples, plan_dataset
from anser.results.summary import write_summary
from anser.scenario.build_aircraft import push_over_limit, resolve_fleet
from anser.scenario.schema import Scenario
from anser.scenario.schema_aircraft import Goal

if TYPE_CHECKING:
    from anser.missions.first_plan import PublishedFirstPlan


@dataclass(frozen=True)
class RecordedPlan:
    """Plan prepared for output: its samples over time (`samples`), and the planner's report (`details`)."""

    samples: PlanSamples
    details: PlanDetails

    @functools.cached_property
    def dataset(self) -> xr.Dataset:
        """Samples and details as a dataset from `anser.results.plan_record`."""
        return plan_dataset(self.samples, self.details)

    @functools.cached_property
    def summary(self) -> dict[str, Any]:
        """Content of `plan.json`."""
        return plan_summary(self.dataset)

    def write_into(self, folder: Path) -> None:
        """Write `plan.json`, `trajectories.csv`, `plan.svg` and `plan.png` into an existing folder.

        Raises FileExistsError if one of the files exists.
        """
        write_summary(self.summary, folder / "plan.json")
        write_trajectories(self.dataset, folder / "trajectories.csv")
        draw_plan(self.dataset, folder)


def record_published(planned: "PublishedFirstPlan") -> RecordedPlan:
    """Return the samples of a plan of the published planner, with the planner's report."""
    scenario, plan = planned.scenario, planned.plan
    details = PlanDetails(
        scenario,
        paths=planned.path_descriptions(),
        messages=tuple(
            PLAN_MESSAGES[int(status)] if int(status) else LIMIT_MESSAGES[int(limit)] if int(limit) else None
            for status, limit in zip(plan.status, planned.limits.status, strict=True)
        ),
        problems=planned.problems(),
        notes=planned.notes(),
        limits=_limits_by_key(scenario),
        lengths_m=np.asarray(plan.lengths),
        nominal_lengths_m=np.asarray(plan.nominal_lengths),
        turn_utilization=np.asarray(planned.limits.turn_utilization_max),
        level_off_m=np.asarray(planned.limits.level_off_altitude),
    )
    return _record(plan.trajectories, planned.arrivals_s, planned.flight.environment.gravity, details)


def record_user_plan(
    scenario: Scenario, paths: PlannedPath, arrivals_s: np.ndarray, gravity: Any, problems: tuple[str, ...]
) -> RecordedPlan:
    """Return the samples and the report of a user-defined planner's plan; no path is compared with the limits.

    `paths` has the leading axis aircraft; `arrivals_s` are arrival times; `gravity` is in m/s^2; `problems` are the
    obstacles to flying the plan.
    """
    count = len(scenario.aircraft)
    details = PlanDetails(
        scenario,
        paths=("user-defined planner",) * count,
        messages=(None,) * count,
        problems=problems,
        limits=_limits_by_key(scenario),
    )
    return _record(paths, arrivals_s, gravity, details)


def record_certified(
    scenario: Scenario,
    plan: CertifiedPlan,
    tasks: AircraftTask,
    gravity: Any,
    holds: PlannedHolds | None = None,
    notes: tuple[str, ...] = (),
) -> RecordedPlan:
    """Return the samples of a plan of the certified planner, and a report with the proven bounds.

    Inactive aircraft of `tasks` are padding and are left out; `gravity` is in m/s^2.
    """
    indices = np.flatnonzero(np.asarray(tasks.active) > 0.0)
    active_plan, limits = rows_on_host((plan, tasks.limits), indices)
    certificate = active_plan.certificate
    is_proven, ratio = (
        np.asarray(plan.feasible)[indices],
        float(np.min(np.asarray(certificate.clearance_ratio)[:, indices])),
    )
    details = PlanDetails(
        scenario,
        paths=tuple(describe_turns(math.degrees(float(total_turn))) for total_turn in active_plan.total_turn),
        lengths_m=np.asarray(active_plan.lengths),
        notes=notes,
        messages=tuple(None if ok else UNPROVEN for ok in is_proven),
        problems=unproven_paths(scenario, is_proven),
        limits=_limits_by_key(scenario, limits),
        bounds=_bounds_by_key(certificate.bounds, limits),
        separation_bound=ratio if math.isfinite(ratio) else None,
        keep_out_bounds_m=np.asarray(certificate.keep_out_clearance)[:, : len(scenario.keep_out)]
        if scenario.keep_out
        else None,
        **_holds_by_key(holds, indices),
    )
    return _record(active_plan.paths, np.asarray(active_plan.arrival_times), gravity, details, limits)


def _bounds_by_key(bounds: PathBounds, limits: PathLimits) -> dict[str, np.ndarray]:
    """Return the proven bounds of the flight quantities, (aircraft,), by key of the limit; SI units, rad.

    Accelerations along the path are converted to level flight at the start airspeed, see `PathBounds.along_at_start`.
    """
    values = {limit.key: np.asarray(getattr(bounds, limit.field)) for limit in CERTIFIED_LIMITS}
    along = np.array(
        [path_bounds.along_at_start(path_limits) for path_bounds, path_limits in unstack_rows((bounds, limits))]
    )
    return values | {"thrust_surplus_max": along[:, 0], "thrust_deficit_max": along[:, 1]}


def _holds_by_key(holds: PlannedHolds | None, indices: np.ndarray) -> dict[str, Any]:
    """Return the entries of `PlanDetails` on the holds of the aircraft at `indices`; empty if `holds` is None."""
    if holds is None:
        return {}
    ratio = float(np.min(np.asarray(holds.clearance_ratio)[:, indices]))
    return {
        "hold_radii_m": np.asarray(holds.circles.radius)[indices],
        "hold_turns": np.asarray(holds.circles.turn)[indices],
        "hold_heights_m": np.asarray(holds.circles.height)[indices],
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
    goals = np.stack([goal_positions_n(scenario.goal_of(aircraft), times[0]) for aircraft in scenario.aircraft], axis=1)
    samples = sample_plan(
        paths, 0.0, arrivals, gravity, goals, times, scenario.separation.required_m, scenario.keep_out, limits
    )
    problems = (*details.problems, *_goal_passes(samples, scenario))
    return RecordedPlan(samples, dataclasses.replace(details, problems=problems))


def _goal_passes(samples: PlanSamples, scenario: Scenario) -> tuple[str, ...]:
    """Return a sentence for each aircraft that comes nearer to its goal, on the way, than a rendezvous may be.

    No planner keeps a distance from the goals before the arrival; in flight such an aircraft breaks off.
    """
    axes = ("north", "east", "altitude")
    positions = np.stack([samples.history[key] for key in axes], axis=-1) * (1.0, 1.0, -1.0)
    sentences = []
    for k, aircraft in enumerate(scenario.aircraft):
        is_before = samples.time_s <= samples.arrival_times_s[k]
        offset, required_m = (
            samples.goal_positions_n[:, k] - positions[:, k],
            CLEARANCE_MIN_M[scenario.goal_of(aircraft).kind],
        )
        if np.count_nonzero(is_before) < 2:
            continue
        time_s, distance_m = closest_approach(samples.time_s[is_before], offset[is_before], None)
        # lengths on the chart of a round Earth may be wrong by 5 %: such a difference is no finding
        allowed_m = required_m if scenario.earth.model == "flat" else 0.95 * required_m
        if distance_m < allowed_m - _SAMPLING_ERROR_M:
            sentences.append(
                f'aircraft "{aircraft.name}" passes its goal "{aircraft.goal}" at {distance_m:.0f} m, at {time_s:.1f} '
                f"s; nearer than {required_m:g} m it breaks off in flight. Another rendezvous.course_deg, or a "
                "stand-off on the side from which it comes, may help"
            )
    return tuple(sentences)


_SAMPLING_ERROR_M = 0.5  # of a distance between samples, with linear motion


def goal_positions_n(goal: Goal, times_s: np.ndarray) -> np.ndarray:
    """Return a goal's positions at times (s), NED, m; shape (time, 3).

    A goal with waypoints moves straight from waypoint to waypoint, and rests before the first and after the last.
    """
    if goal.waypoints is None:
        north, east, up = goal.velocity_m_s()
        start = goal.position_m(0.0)
        coordinates = [origin + rate * times_s for origin, rate in zip(start, (north, east, up), strict=True)]
    else:
        corner_times_s = [point.time_s for point in goal.waypoints]
        corners = zip(*((p.north_m, p.east_m, p.altitude_m) for p in goal.waypoints), strict=True)
        coordinates = [np.interp(times_s, corner_times_s, corner) for corner in corners]
    return np.stack([coordinates[0], coordinates[1], -coordinates[2]], axis=1)


def _limits_by_key(scenario: Scenario, derived: PathLimits | None = None) -> dict[str, float | np.ndarray]:
    """Return the limits of the scenario, (aircraft,), by key of `anser.planning.limits.LIMITS`; SI units, rad.

    A limit that is missing in the scenario is computed from `derived`, the limits of the certified planner, without the
    planner's reserve for the autopilot. If `derived` is None, a missing limit is NaN.
    """
    values_by_key, resolved = {}, [aircraft.limits for aircraft in resolve_fleet(scenario)]
    for limit in LIMITS if derived is None else CERTIFIED_LIMITS:
        scenario_values = [getattr(limits, limit.scenario_key) for limits in resolved]
        if limit.key == "load_factor_min":
            values_by_key[limit.key] = np.asarray([push_over_limit(limits) for limits in resolved])
        elif None not in scenario_values:
            values_by_key[limit.key] = np.asarray(scenario_values) / limit.factor
        elif derived is None:
            values_by_key[limit.key] = math.nan
        else:
            values_by_key[limit.key] = np.asarray(getattr(derived, limit.field)) / (1.0 - scenario.fleet.reserve)
    return values_by_key
