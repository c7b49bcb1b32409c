"""The stand-off with an uncertain goal: how far beyond the least distance a rendezvous has to be."""

import math
from collections.abc import Sequence

from anser.constants import AIRBORNE_STAND_OFF_MIN_M, SURFACE_STAND_OFF_MIN_M
from anser.scenario.errors import Problem, plain
from anser.scenario.schema_aircraft import Aircraft
from anser.scenario.schema_checks import label
from anser.scenario.schema_goal import Goal
from anser.scenario.schema_sensing import Estimator, GoalSensor, Navigation
from anser.scenario.schema_settings import Fleet, Timing

_MEASUREMENTS = 2000  # after which the filter is taken to be settled, at most


def goal_sigma_m(
    sensor: GoalSensor, estimator: Estimator, navigation: Navigation, timing: Timing, fleet: Fleet, distance_m: float
) -> float:
    """Standard deviation with which a goal's place at the arrival is known when the plan comes to stand still, m.

    That of the steadily moving goal in one axis, by the recursion of the Kalman filter from what is known beforehand,
    predicted over the freeze; measurements are as good as on the way through it. A goal's own report is compared with
    the own position, so that the error of satellite navigation adds to it.
    """
    if sensor.preset == "exact":
        return 0.0
    range_m = distance_m + 0.5 * fleet.speed_m_s * timing.freeze_s
    if sensor.number("kind") == "report":
        one_m = math.hypot(sensor.number("position_m"), navigation.position_m if navigation.sensors != "exact" else 0.0)
        floor_m = 0.0 if navigation.sensors == "exact" else navigation.position_m
    else:
        one_m = max(sensor.number("range_m"), 1e-3 * sensor.number("angle_mrad") * range_m)
        floor_m = math.hypot(sensor.range_bias_m, 1e-3 * sensor.angle_bias_mrad * range_m)
    working = (1.0 - sensor.outage_share) * (1.0 - sensor.dropout_probability)
    period_s = sensor.number("period_s") / max(working, 1e-6)
    density = estimator.acceleration_m_s2**2
    place, both, speed = estimator.briefed_position_m**2, 0.0, estimator.briefed_velocity_m_s**2
    count = min(_MEASUREMENTS, int(timing.duration_s / period_s))
    for _ in range(count):
        place, both, speed = _predicted(place, both, speed, density, period_s)
        spread = place + one_m**2
        place, both, speed = place - place**2 / spread, both - place * both / spread, speed - both**2 / spread
    place, _, _ = _predicted(place, both, speed, density, timing.freeze_s)
    return math.hypot(math.sqrt(max(place, 0.0)), floor_m)


def _predicted(place: float, both: float, speed: float, density: float, span_s: float) -> tuple[float, float, float]:
    """Variances of place and speed and their covariance a time later, with white noise of acceleration."""
    return (
        place + 2.0 * span_s * both + span_s**2 * speed + density * span_s**3 / 3.0,
        both + span_s * speed + density * span_s**2 / 2.0,
        speed + density * span_s,
    )


def margin_problems(
    aircraft: Sequence[Aircraft],
    goals: Sequence[Goal],
    sensor: GoalSensor,
    estimator: Estimator,
    navigation: Navigation,
    timing: Timing,
    fleet: Fleet,
) -> list[Problem]:
    """Find rendezvous points that an uncertain goal may come nearer to than is allowed; all goals exist."""
    kinds = {goal.name: goal.kind for goal in goals}
    found = []
    for index, one in enumerate(aircraft):
        least_m = AIRBORNE_STAND_OFF_MIN_M if kinds[one.goal] == "airborne" else SURFACE_STAND_OFF_MIN_M
        distance_m = one.rendezvous.stand_off_distance_m
        sigma_m = goal_sigma_m(sensor, estimator, navigation, timing, fleet, distance_m)
        needed_m = least_m + estimator.margin_sigma * sigma_m
        # nearer than the scope allows is told by itself
        if sigma_m > 0.0 and least_m <= distance_m < needed_m:
            words = (
                f"a stand-off of {math.ceil(needed_m)} m or more: the {plain(least_m)} m of the scope and "
                f"estimator.margin_sigma = {plain(estimator.margin_sigma)} standard deviations of the goal's place at "
                f"the arrival, which the sensor leaves at {sigma_m:.1f} m"
            )
            found.append(Problem(f"aircraft[{index}].rendezvous", f"{distance_m:.1f} m", words, label("aircraft", one)))
    return found
