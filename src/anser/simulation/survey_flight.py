"""Surveyed flights of one aircraft.

The closed loop flown from a trim to commanded values, with running extremes instead of a record.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.motion import FlightCondition, MotionState, flight_condition
from anser.control.autopilot import AutopilotSignals
from anser.control.feedback import wrap_angle
from anser.control.gains import AutopilotGains
from anser.control.inversion_autopilot import InversionAutopilot
from anser.control.limits import FlightLimits
from anser.environment.environment import Environment
from anser.parts.controllers import AbstractGuidance
from anser.parts.paths import PathCommand
from anser.parts.perception import AbstractEstimator, AbstractSensors, Belief, Instant
from anser.parts.planners import AircraftPlan
from anser.sensing.estimators import DirectEstimator
from anser.sensing.ideal_sensors import IdealSensors
from anser.shapes import Flag, Scalar, ScalarLike, Vector, Vector3
from anser.simulation.closed_loop import fly_alone, trimmed_vehicle
from anser.simulation.recorders import AbstractRecorder, AircraftSample
from anser.simulation.vehicle import Vehicle
from anser.spatial.rotations import rotate_back
from anser.spatial.wind_axes import path_angles
from anser.steady.trim import TrimPoint, TrimTarget, surface_share
from anser.units import DEG_RAD

AUTOPILOT_LIMITS = (
    "thrust_max",
    "thrust_idle",
    "alpha",
    "load_factor",
    "unloading",
    "bank",
    "body_rates",
    "surfaces",
    "surface_rates",
)
"""Limits at which a command of the autopilot may stand; `unloading` is the lift withheld while the bank is 60 deg off,
`surfaces` and `surface_rates` are the stops and the rate limits of the actuators."""
TABLE_AXES = ("alpha", "beta", "altitude", "mach")
"""Arguments of the airframe's data."""

BETA_BOUND = 2.0 * DEG_RAD
"""Sideslip (rad) that a flight should not pass."""


class SurveySummary(eqx.Module):
    """What is kept of one flight. Channels are (V, gamma, chi), m/s and rad; surfaces are the airframe's.

    Attributes
    ----------
    final_error, final_error_max
        Command minus output over the last tenth of the flight: mean, and largest amount.
    settling_time
        From the step until the error stays within the tolerance, s; infinite where it does not before the end.
    overshoot
        Beyond the command, part of the step; 0 for channels without a step.
    coupling
        Largest error of the channels without a step; 0 for the others.
    beta_max
        Largest amount of sideslip, rad.
    alpha_min, alpha_max
        rad.
    load_factor_min, load_factor_max
        Minus body z force over weight.
    surface_share
        Largest part of the way from the middle to the stop that each surface went.
    surface_rate_share, body_rate_share
        Largest rate of each surface over the actuator's limit; largest (P, Q, R) over the autopilot's.
    limited_time, limited_late
        Time at each of `AUTOPILOT_LIMITS`, s: in the whole flight, and in its last tenth.
    limited_before_slip
        The same until sideslip first passes `BETA_BOUND`.
    left_time
        First time outside the airframe's data along each of `TABLE_AXES`, s; infinite if never.
    finite
        Whether the state at the end is a number throughout.
    """

    final_error: Vector3
    final_error_max: Vector3
    settling_time: Vector3
    overshoot: Vector3
    coupling: Vector3
    beta_max: Scalar
    alpha_min: Scalar
    alpha_max: Scalar
    load_factor_min: Scalar
    load_factor_max: Scalar
    surface_share: Vector
    surface_rate_share: Vector
    body_rate_share: Vector3
    limited_time: Float[Array, "9"]
    limited_late: Float[Array, "9"]
    limited_before_slip: Float[Array, "9"]
    left_time: Float[Array, "4"]
    finite: Flag


class SurveySample(NamedTuple):
    """What the summary takes of one instant."""

    time: ScalarLike
    error: Vector3
    alpha: ScalarLike
    beta: ScalarLike
    load_factor: ScalarLike
    surface_share: Vector
    surface_rate_share: Vector
    body_rate_share: Vector3
    limited: Bool[Array, "9"]
    outside: Bool[Array, "4"]


def empty_summary(surfaces: int) -> SurveySummary:
    """Summary of no sample of an aircraft with so many surfaces."""
    none, least, most = jnp.zeros(3), jnp.asarray(jnp.inf), jnp.asarray(-jnp.inf)
    return SurveySummary(
        final_error=none,
        final_error_max=none,
        settling_time=none,
        overshoot=none,
        coupling=none,
        beta_max=jnp.zeros(()),
        alpha_min=least,
        alpha_max=most,
        load_factor_min=least,
        load_factor_max=most,
        surface_share=jnp.zeros(surfaces),
        surface_rate_share=jnp.zeros(surfaces),
        body_rate_share=none,
        limited_time=jnp.zeros(len(AUTOPILOT_LIMITS)),
        limited_late=jnp.zeros(len(AUTOPILOT_LIMITS)),
        limited_before_slip=jnp.zeros(len(AUTOPILOT_LIMITS)),
        left_time=jnp.full(len(TABLE_AXES), jnp.inf),
        finite=jnp.asarray(True),
    )


def add_sample(
    before: SurveySummary, now: SurveySample, size: Vector3, tolerance: Vector3, step: ScalarLike, late: Flag
) -> SurveySummary:
    """Summary with one more sample; until the end `final_error` is a sum and `settling_time` the last time outside."""
    stepped = size != 0.0
    amount = jnp.abs(now.error)
    beyond = jnp.where(stepped, -now.error / jnp.where(stepped, size, 1.0), 0.0)
    left = jnp.where(now.outside, now.time, jnp.inf)
    return SurveySummary(
        final_error=before.final_error + jnp.where(late, now.error, 0.0),
        final_error_max=jnp.where(late, jnp.maximum(before.final_error_max, amount), before.final_error_max),
        settling_time=jnp.where(amount > tolerance, now.time, before.settling_time),
        overshoot=jnp.maximum(before.overshoot, beyond),
        coupling=jnp.maximum(before.coupling, jnp.where(stepped, 0.0, amount)),
        beta_max=jnp.maximum(before.beta_max, jnp.abs(now.beta)),
        alpha_min=jnp.minimum(before.alpha_min, now.alpha),
        alpha_max=jnp.maximum(before.alpha_max, now.alpha),
        load_factor_min=jnp.minimum(before.load_factor_min, now.load_factor),
        load_factor_max=jnp.maximum(before.load_factor_max, now.load_factor),
        surface_share=jnp.maximum(before.surface_share, now.surface_share),
        surface_rate_share=jnp.maximum(before.surface_rate_share, now.surface_rate_share),
        body_rate_share=jnp.maximum(before.body_rate_share, now.body_rate_share),
        limited_time=before.limited_time + jnp.where(now.limited, step, 0.0),
        limited_late=before.limited_late + jnp.where(now.limited & late, step, 0.0),
        limited_before_slip=before.limited_before_slip
        + jnp.where(now.limited & (before.beta_max <= BETA_BOUND), step, 0.0),
        left_time=jnp.minimum(before.left_time, left),
        finite=before.finite,
    )


_END = 0.1
"""Last part of the flight over which the error at the end is taken."""
_COS_UNLOADING = 0.5


def step_command(target: TrimTarget, size: Vector3, time: ScalarLike) -> PathCommand:
    """Steady flight, its turn included, plus a step of (V, gamma, chi), m/s and rad."""
    zero = jnp.zeros(())
    return PathCommand(
        target.speed + size[0],
        target.path_angle + size[1],
        target.course + target.turn_rate * time + size[2],
        zero,
        zero,
        target.turn_rate,
    )


def final_part_start(count: int) -> int:
    """First of the `count` samples that belong to the end of a flight."""
    return round((1.0 - _END) * count)


def finish_summary(summary: SurveySummary, state: MotionState, step: ScalarLike, count: int) -> SurveySummary:
    """Summary of a whole flight, made of the running one: sum of the late errors, last time outside the tolerance."""
    finite = jnp.all(jnp.stack([jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(state)]))
    last = (count - 1) * step
    return eqx.tree_at(
        lambda s: (s.final_error, s.settling_time, s.finite),
        summary,
        (
            summary.final_error / (count - final_part_start(count)),
            jnp.where(summary.settling_time >= last, jnp.inf, summary.settling_time),
            finite,
        ),
    )


def take_sample(
    sample: AircraftSample, environment: Environment, time: ScalarLike, limits: FlightLimits, start: FlightCondition
) -> SurveySample:
    """What an aircraft does, and at which limits its autopilot believes to stand.

    Parameters
    ----------
    sample
        The aircraft, under `InversionAutopilot` with its velocity loop commanded.
    environment, time
        Where and when it flies, s.
    limits
        Of its autopilot.
    start
        Condition at the start, inside the airframe's data.
    """
    truth, state, now, command = sample.truth.airframe, sample.truth.state, sample.truth.condition, sample.command
    actuators = truth.actuators
    gamma, chi = path_angles(rotate_back(now.R_bn, state.velocity_b) - now.wind_n)
    error = jnp.stack([command.V - now.air_data.V, command.gamma - gamma, wrap_angle(command.chi - chi)])
    moving = actuators.rate(state.actuators, sample.controls.surfaces, now.air_data).position
    rate_share = jnp.abs(moving) / actuators.rate_limit
    return SurveySample(
        time=time,
        error=error,
        alpha=now.air_data.alpha,
        beta=now.air_data.beta,
        load_factor=-now.wrench.force_b[2] / (truth.mass_properties.mass * environment.gravity),
        surface_share=surface_share(truth, state.surfaces),
        surface_rate_share=rate_share,
        body_rate_share=jnp.abs(state.rates_b) / limits.rates_max,
        limited=jnp.append(_limited(sample.belief, limits, sample.signals), jnp.any(rate_share >= 1.0)),
        outside=outside_axes(truth, now, start),
    )


def outside_axes(airframe: AbstractAirframe, condition: FlightCondition, inside: FlightCondition) -> Bool[Array, "4"]:
    """Along which of `TABLE_AXES` a condition lies outside the airframe's data; `inside` is one that lies within.

    The airframe says only whether it is outside: altitude and Mach number are told apart by putting one of them back
    inside.
    """
    data, known = condition.air_data, inside.air_data

    def beyond(value: Scalar, ends: tuple[Scalar, Scalar]) -> Flag:
        return (value < ends[0]) | (value > ends[1])

    of_altitude = eqx.tree_at(lambda d: d.altitude, known, data.altitude)
    of_mach = eqx.tree_at(lambda d: d.mach, known, data.mach)
    return jnp.stack(
        [
            beyond(data.alpha, airframe.alpha_range),
            beyond(data.beta, airframe.beta_range),
            airframe.outside_tables(of_altitude),
            airframe.outside_tables(of_mach),
        ]
    )


def _limited(belief: Belief, limits: FlightLimits, signals: AutopilotSignals) -> Bool[Array, "8"]:
    """At which of `AUTOPILOT_LIMITS` the autopilot's commands stand, all but the last."""
    data, thrust, attitude = belief.condition.air_data, signals.thrust, signals.attitude
    most = belief.airframe.engine.propulsion(100.0, data).force_b[0]
    bank, alpha, _ = attitude.angles
    at_alpha = attitude.alpha_saturated & ((alpha <= limits.alpha_min) | (alpha >= limits.alpha_max))
    unloading = attitude.alpha_saturated & ~at_alpha & (jnp.cos(signals.motion.mu - bank) < _COS_UNLOADING)
    return jnp.stack(
        [
            thrust.saturated & (thrust.thrust > most),
            thrust.saturated & (thrust.thrust <= most),
            at_alpha | attitude.lift_short,
            (attitude.alpha_saturated & ~at_alpha & ~unloading) | attitude.load_factor_short,
            unloading,
            jnp.abs(bank) >= (1 - 1e-9) * limits.bank_max,
            signals.rates_limited,
            signals.surfaces_limited,
        ]
    )


class SteppedPath(AbstractGuidance):
    """Steady flight, its turn included, plus a step of (V, gamma, chi), m/s and rad, from time 0 on."""

    target: TrimTarget
    size: Vector3

    def init(self, belief: Belief, instant: Instant) -> None:
        """Nothing is kept."""

    def command(
        self, guidance_state: None, belief: Belief, plan: AircraftPlan | None, instant: Instant
    ) -> tuple[PathCommand, Vector3, None]:
        """The course goes on turning as before the step; no place is asked for."""
        return step_command(self.target, self.size, instant.time), belief.state.position_n, None


class SurveyRecorder(AbstractRecorder):
    """The running summary of one flight; no rows.

    Attributes
    ----------
    limits
        Of the autopilot.
    start
        Condition at the start, inside the airframe's data.
    size, tolerance
        Step of (V, gamma, chi), and the error that counts as settled, m/s and rad.
    count
        Number of samples of the flight.
    surfaces
        Number of control surfaces.
    """

    limits: FlightLimits
    start: FlightCondition
    size: Vector3
    tolerance: Vector3
    count: int = eqx.field(static=True)
    surfaces: int = eqx.field(static=True)
    stride: int = eqx.field(static=True, default=1)

    def init(self, aircraft: int) -> SurveySummary:
        """Summary of no sample."""
        return empty_summary(self.surfaces)

    def update(self, recorder_state: SurveySummary, sample: AircraftSample, instant: Instant) -> SurveySummary:
        """Summary with one more sample."""
        extremes = take_sample(sample, instant.environment, instant.time, self.limits, self.start)
        late = instant.number >= final_part_start(self.count)
        return add_sample(recorder_state, extremes, self.size, self.tolerance, instant.step, late)

    def output(self, sample: AircraftSample, instant: Instant) -> None:
        """None."""


def survey_flight(
    airframe: AbstractAirframe,
    environment: Environment,
    gains: AutopilotGains,
    limits: FlightLimits,
    trim: TrimPoint,
    target: TrimTarget,
    size: Vector3,
    tolerance: Vector3,
    step: ScalarLike,
    count: int,
    sensors: AbstractSensors | None = None,
    estimator: AbstractEstimator | None = None,
) -> SurveySummary:
    """Fly a step of the path command away from steady flight under the velocity loop, and sum it up.

    The command is the steady flight itself, its turn included, plus the step: (V, gamma, chi) jump at time 0 and the
    course goes on turning as before. The memory needed does not grow with the length of the flight.

    Parameters
    ----------
    airframe, environment, gains, limits
        What flies, where and how.
    trim, target
        Steady flight that the step leaves, and what it is a solution of.
    size
        Step of (V, gamma, chi), m/s and rad.
    tolerance
        Error that counts as settled, m/s and rad.
    step
        Sampling period, s.
    count
        Number of periods.
    sensors, estimator
        Ideal ones where None. An estimator with a model of its own makes the autopilot believe another airframe than
        the one that flies; the summary is of what that does.
    """
    vehicle = Vehicle(
        airframe=airframe,
        sensors=IdealSensors() if sensors is None else sensors,
        estimator=DirectEstimator() if estimator is None else estimator,
        guidance=SteppedPath(target, size),
        controller=InversionAutopilot(gains, limits),
    )
    step = jnp.asarray(step, dtype=float)
    instant = Instant(environment, jnp.asarray(0, dtype=jnp.int32), step)
    start = flight_condition(airframe, environment, 0.0, trim.state)
    surfaces = len(airframe.actuators.names)
    recorder = SurveyRecorder(
        limits=limits, start=start, size=size, tolerance=tolerance, count=count, surfaces=surfaces
    )
    state, summary, _ = fly_alone(vehicle, environment, trimmed_vehicle(vehicle, instant, trim), step, count, recorder)
    return finish_summary(summary, state.aircraft, step, count)
