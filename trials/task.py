"""A planning task of the checker as a task of the certified planner, padded to one size to share compiled programs."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.environment import LayeredWind
from anser.parts import Rendezvous
from anser.planning import PathLimits, Separation
from anser.planning.certified.task import AircraftTask, Airspace, ArrivalRequest, KeepOuts
from trials.data import KeepOutCylinders, PlanCase, WindProfile

__all__ = ["LATEST_S", "PlanTask", "planner_task"]

LATEST_S = 1200.0
"""Latest arrival allowed to the planner, s: the random cases' longest lines, 42 km, take 380 s at 110 m/s."""
_FLEET, _LAYERS, _VOLUMES = 8, 4, 4
_ROLL_RATE_MAX = np.deg2rad(30.0)
"""Greatest roll rate of a plan, rad/s; no limit of the cases."""
_AWAY_M = 1e7
_SPEED_ROOM = 0.002
"""Least distance of the preferred airspeed from the edges of the airspeed range, as a fraction."""
_LAYER_M = 1000.0


class PlanTask(NamedTuple):
    """Input of the planner; aircraft beyond those of the case repeat the last one and are inactive."""

    tasks: AircraftTask
    airspace: Airspace
    request: ArrivalRequest


def planner_task(case: PlanCase) -> PlanTask:
    """The planner's task of a case, padded to 8 aircraft, 4 layers of wind and 4 keep-outs without effect.

    The aircraft start at the case's positions and velocities, unaccelerated. The planner's goals start at the positions
    of the case's goals.

    Raises
    ------
    ValueError
        If the case has more aircraft, layers or keep-outs, is accelerated at the start, or its goals change velocity.
    """
    _must_fit(case)
    indices = np.minimum(np.arange(_FLEET), case.size - 1)
    wind = _wind(case.wind)
    starts, goals, limits = case.starts, case.goals, case.limits
    wind_n = case.wind.at(-starts.position_n[:, 2]).T
    goal_positions = (
        np.stack([goals.meeting_n(k, np.array([starts.time]))[0] for k in range(case.size)]) - goals.stand_off_n
    )
    rendezvous = Rendezvous(
        _array(goals.stand_off_n[indices]),
        _array(np.nan_to_num(goals.course[indices])),
        jnp.asarray(np.isfinite(goals.course[indices])),
        _array(np.nan_to_num(goals.path_angle[indices])),
        jnp.asarray(np.isfinite(goals.path_angle[indices])),
    )
    path_limits = PathLimits(
        speed_min=_array(limits.speed_min[indices]),
        speed_max=_array(limits.speed_max[indices]),
        bank_max=_array(limits.bank_max[indices]),
        climb_rate_max=_array(limits.climb_rate_max[indices]),
        altitude_min=_array(limits.altitude_min[indices]),
        altitude_max=_array(limits.altitude_max[indices]),
        load_factor_max=_array(limits.load_factor_max[indices]),
        acceleration_max=_array(limits.acceleration_max[indices]),
        deceleration_max=_array(limits.deceleration_max[indices]),
        load_factor_min=jnp.full(_FLEET, -jnp.inf),
    )
    low, high = (1.0 + _SPEED_ROOM) * limits.speed_min, (1.0 - _SPEED_ROOM) * limits.speed_max
    tasks = AircraftTask(
        position_n=_array(starts.position_n[indices]),
        air_velocity_n=_array((starts.velocity_n - wind_n)[indices]),
        air_acceleration_n=jnp.zeros((_FLEET, 3)),
        goal_position_n=_array(goal_positions[indices]),
        goal_velocity_n=_array(goals.velocity_after_n[indices]),
        rendezvous=rendezvous,
        speed=_array(np.clip(case.speed, low, high)[indices]),
        side=jnp.zeros(_FLEET, dtype=int),
        limits=path_limits,
        roll_rate_max=jnp.full(_FLEET, _ROLL_RATE_MAX),
        active=_array(np.arange(_FLEET) < case.size),
    )
    airspace = Airspace(
        wind,
        _array(case.gravity),
        Separation(_array(case.separation_horizontal), _array(case.separation_vertical)),
        _keep_outs(case.keep_outs, starts.time),
    )
    return PlanTask(tasks, airspace, _request(case, indices))


def _array(values: object) -> Float[Array, "..."]:
    return jnp.asarray(np.asarray(values, dtype=float))


def _must_fit(case: PlanCase) -> None:
    for quantity, count, maximum in (
        ("aircraft", case.size, _FLEET),
        ("layers of wind", case.wind.altitudes.size, _LAYERS),
        ("keep-outs", case.keep_outs.radius.size, _VOLUMES),
    ):
        if count > maximum:
            raise ValueError(f"plan case: arrived {count} {quantity}; expected {maximum} at most")
    if np.any(case.starts.acceleration_n):
        raise ValueError("plan case: arrived aircraft that accelerate at the start; expected none")
    if np.any(case.goals.times != case.starts.time):
        raise ValueError(
            "plan case: arrived goals with timed waypoints; expected goals of steady velocity from the start"
        )


def _wind(profile: WindProfile) -> LayeredWind:
    """The profile, with constant layers added above."""
    altitudes, velocities = profile.altitudes, profile.velocities_n
    missing = _LAYERS - altitudes.size
    above = altitudes[-1] + _LAYER_M * np.arange(1, missing + 1)
    return LayeredWind(
        _array(np.concatenate([altitudes, above])),
        _array(np.concatenate([velocities, np.repeat(velocities[-1:], missing, axis=0)])),
    )


def _keep_outs(cylinders: KeepOutCylinders, start: float) -> KeepOuts:
    """The cylinders, with axes at the planner's start, plus distant cylinders as padding."""
    missing = _VOLUMES - cylinders.radius.size
    start_positions = cylinders.position_n + start * cylinders.velocity_n
    return KeepOuts(
        _array(np.concatenate([start_positions, np.full((missing, 2), _AWAY_M)])),
        _array(np.concatenate([cylinders.velocity_n, np.zeros((missing, 2))])),
        _array(np.concatenate([cylinders.radius, np.ones(missing)])),
        _array(np.concatenate([cylinders.bottom, np.zeros(missing)])),
        _array(np.concatenate([cylinders.top, np.ones(missing)])),
    )


def _request(case: PlanCase, indices: np.ndarray) -> ArrivalRequest:
    """The arrival rule; the planner counts times from the start."""
    rule, start = case.rule, case.starts.time
    times = offsets = windows = None
    if rule.name in ("at", "times"):
        times = rule.times[indices] - start
    if rule.name == "windows":
        windows = rule.windows[indices] - start
    if rule.name == "sequence":
        offsets = rule.ranks()[indices] * rule.spacing
    return ArrivalRequest(rule.name, LATEST_S, times, offsets, windows)
