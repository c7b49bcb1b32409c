"""Survey flights: metrics of the response of one aircraft in trim to a step command."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.motion import AirDataAndForces, MotionState, air_data_and_forces
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
from anser.sensing.estimators import TrackingEstimator
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
"""Limits that an autopilot's command may reach, in the order of `SurveySummary.limited_time`.

`unloading` is the reduction of lift while the bank error exceeds 60 deg; `surfaces` and `surface_rates` are the stops
and the rate limits of the actuators.
"""
TABLE_AXES = ("alpha", "beta", "altitude", "mach")
"""Axes of the airframe's data, in the order of `SurveySummary.left_time`."""

BETA_BOUND = 2.0 * DEG_RAD
"""Acceptable sideslip, rad."""


class SurveySummary(eqx.Module):
    """Metrics of one survey flight, the response of one aircraft to a step of the velocity command.

    Channels are (V, gamma, chi) in m/s and rad; errors are command minus output.
    """

    final_error: Vector3  # mean error in the last tenth of the flight
    final_error_max: Vector3  # greatest magnitude of the error in the last tenth of the flight
    settling_time: Vector3  # time of the last error beyond the tolerance, s; infinite: not settled at the end
    overshoot: Vector3  # overshoot over the command, fraction of the step; 0 for channels without a step
    coupling: Vector3  # largest error of the channels without a step; 0 for the stepped channels
    beta_max: Scalar  # largest magnitude of the sideslip, rad
    alpha_min: Scalar  # least angle of attack, rad
    alpha_max: Scalar  # greatest angle of attack, rad
    load_factor_min: Scalar  # least load factor: minus body z force over weight
    load_factor_max: Scalar  # greatest load factor
    surface_share: Vector  # greatest deflection of each surface, divided by the travel from the middle to the stop
    surface_rate_share: Vector  # greatest rate of each surface, divided by the rate limit
    body_rate_share: Vector3  # greatest body rates, divided by the limits
    limited_time: Float[Array, "9"]  # time for which each of `AUTOPILOT_LIMITS` is active, s
    limited_late: Float[Array, "9"]  # time at each limit in the last tenth of the flight, s
    limited_before_slip: Float[Array, "9"]  # time at each limit before the sideslip first exceeds `BETA_BOUND`, s
    left_time: Float[Array, "4"]  # first time outside the data along each of `TABLE_AXES`, s; infinite: never
    finite: Flag  # whether the final state is finite


def empty_summary(surface_count: int) -> SurveySummary:
    """Return the summary before the first sample, for an aircraft with `surface_count` surfaces."""
    zero, minimum, maximum = jnp.zeros(3), jnp.asarray(jnp.inf), jnp.asarray(-jnp.inf)
    return SurveySummary(
        final_error=zero,
        final_error_max=zero,
        settling_time=zero,
        overshoot=zero,
        coupling=zero,
        beta_max=jnp.zeros(()),
        alpha_min=minimum,
        alpha_max=maximum,
        load_factor_min=minimum,
        load_factor_max=maximum,
        surface_share=jnp.zeros(surface_count),
        surface_rate_share=jnp.zeros(surface_count),
        body_rate_share=zero,
        limited_time=jnp.zeros(len(AUTOPILOT_LIMITS)),
        limited_late=jnp.zeros(len(AUTOPILOT_LIMITS)),
        limited_before_slip=jnp.zeros(len(AUTOPILOT_LIMITS)),
        left_time=jnp.full(len(TABLE_AXES), jnp.inf),
        finite=jnp.asarray(True),
    )


_FINAL_FRACTION = 0.1
"""Last part of the flight, over which the final error is averaged."""
_COS_UNLOADING = 0.5


def step_command(target: TrimTarget, size: Vector3, time: ScalarLike) -> PathCommand:
    """Return the command at `time` (s): (V, gamma, chi) of steady flight or turn `target`, plus `size` (m/s, rad)."""
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
    """Return the index of the first sample in the last tenth of a flight of `count` samples."""
    return min(round((1.0 - _FINAL_FRACTION) * count), count - 1)


def finish_summary(summary: SurveySummary, state: MotionState, step: ScalarLike, count: int) -> SurveySummary:
    """Return the final summary of a flight of `count` samples from the running summary and the final `state`."""
    finite = jnp.all(jnp.stack([jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(state)]))
    end_time = (count - 1) * step
    return dataclasses.replace(
        summary,
        final_error=summary.final_error / (count - final_part_start(count)),
        settling_time=jnp.where(summary.settling_time >= end_time, jnp.inf, summary.settling_time),
        finite=finite,
    )


def outside_axes(airframe: AbstractAirframe, condition: AirDataAndForces, inside: AirDataAndForces) -> Bool[Array, "4"]:
    """Return flags of the `TABLE_AXES` along which `condition` is outside the airframe's data.

    `inside` must be a flight condition within the airframe's data.
    """
    data, inside_data = condition.air_data, inside.air_data

    def is_outside(value: Scalar, bounds: tuple[Scalar, Scalar]) -> Flag:
        return (value < bounds[0]) | (value > bounds[1])

    # An airframe has no ranges of altitude and Mach number: test each quantity alone, in air data within the tables.
    altitude_data = eqx.tree_at(lambda d: d.altitude, inside_data, data.altitude)
    mach_data = eqx.tree_at(lambda d: d.mach, inside_data, data.mach)
    return jnp.stack(
        [
            is_outside(data.alpha, airframe.alpha_range),
            is_outside(data.beta, airframe.beta_range),
            airframe.outside_tables(altitude_data),
            airframe.outside_tables(mach_data),
        ]
    )


def _active_limits(belief: Belief, limits: FlightLimits, signals: AutopilotSignals) -> Bool[Array, "8"]:
    """Return flags of the active limits, in the order of `AUTOPILOT_LIMITS`, except the surface rates."""
    data, thrust, attitude = belief.condition.air_data, signals.thrust, signals.attitude
    thrust_max = belief.airframe.engine.propulsion(100.0, data).force_b[0]
    bank, alpha, _ = attitude.angles
    at_alpha = attitude.alpha_saturated & ((alpha <= limits.alpha_min) | (alpha >= limits.alpha_max))
    unloading = attitude.alpha_saturated & ~at_alpha & (jnp.cos(signals.motion.mu - bank) < _COS_UNLOADING)
    return jnp.stack(
        [
            thrust.saturated & (thrust.thrust > thrust_max),
            thrust.saturated & (thrust.thrust <= thrust_max),
            at_alpha | attitude.lift_short,
            (attitude.alpha_saturated & ~at_alpha & ~unloading) | attitude.load_factor_short,
            unloading,
            jnp.abs(bank) >= (1 - 1e-9) * limits.bank_max,
            signals.rates_limited,
            signals.surfaces_limited,
        ]
    )


class SteppedPath(AbstractGuidance):
    """Guidance of a survey flight: at time 0, a step of (V, gamma, chi) from the steady flight `target`."""

    target: TrimTarget
    size: Vector3  # step of (V, gamma, chi), m/s and rad

    def command(
        self, guidance_state: None, belief: Belief, plan: AircraftPlan | None, instant: Instant
    ) -> tuple[PathCommand, Vector3, None]:
        """Return the path command, the own position in place of a position to follow (NED, m), and no state (None)."""
        return step_command(self.target, self.size, instant.time), belief.state.position_n, None


class SurveyRecorder(AbstractRecorder):
    """Recorder of a survey flight that keeps the running summary and stores no rows."""

    limits: FlightLimits  # limits of the autopilot
    start: AirDataAndForces  # flight condition before the step; must be within the airframe's data
    size: Vector3  # step of (V, gamma, chi), m/s and rad
    tolerance: Vector3  # tolerance of the settled error, m/s and rad
    count: int = eqx.field(static=True)  # number of samples
    surfaces: int = eqx.field(static=True)  # number of control surfaces
    stride: int = eqx.field(static=True, default=1)

    def init(self, aircraft: int) -> SurveySummary:
        """Return the summary before the first sample."""
        return empty_summary(self.surfaces)

    def update(self, recorder_state: SurveySummary, sample: AircraftSample, instant: Instant) -> SurveySummary:
        """Return the running summary after one more sample.

        In a running summary, `final_error` is a sum, and `settling_time` is finite; `finish_summary` converts both.
        """
        summary, truth, command, step = recorder_state, sample.truth, sample.command, instant.step
        airframe, state, condition = truth.airframe, truth.state, truth.condition
        actuators, data = airframe.actuators, condition.air_data
        gamma, chi = path_angles(rotate_back(condition.R_bn, state.velocity_b) - condition.wind_n)
        error = jnp.stack([command.V - data.V, command.gamma - gamma, wrap_angle(command.chi - chi)])
        magnitude, stepped = jnp.abs(error), self.size != 0.0
        overshoot = jnp.where(stepped, -error / jnp.where(stepped, self.size, 1.0), 0.0)
        surface_rates = actuators.rate(state.actuators, sample.controls.surfaces, data).position
        rate_share = jnp.abs(surface_rates) / actuators.rate_limit
        load_factor = -condition.wrench.force_b[2] / (airframe.mass_properties.mass * condition.earth.gravity)
        limited = jnp.append(_active_limits(sample.belief, self.limits, sample.signals), jnp.any(rate_share >= 1.0))
        left_time = jnp.where(outside_axes(airframe, condition, self.start), instant.time, jnp.inf)
        is_late, before_slip = instant.number >= final_part_start(self.count), summary.beta_max <= BETA_BOUND
        return SurveySummary(
            final_error=summary.final_error + jnp.where(is_late, error, 0.0),
            final_error_max=jnp.where(
                is_late, jnp.maximum(summary.final_error_max, magnitude), summary.final_error_max
            ),
            settling_time=jnp.where(magnitude > self.tolerance, instant.time, summary.settling_time),
            overshoot=jnp.maximum(summary.overshoot, overshoot),
            coupling=jnp.maximum(summary.coupling, jnp.where(stepped, 0.0, magnitude)),
            beta_max=jnp.maximum(summary.beta_max, jnp.abs(data.beta)),
            alpha_min=jnp.minimum(summary.alpha_min, data.alpha),
            alpha_max=jnp.maximum(summary.alpha_max, data.alpha),
            load_factor_min=jnp.minimum(summary.load_factor_min, load_factor),
            load_factor_max=jnp.maximum(summary.load_factor_max, load_factor),
            surface_share=jnp.maximum(summary.surface_share, surface_share(airframe, state.surfaces)),
            surface_rate_share=jnp.maximum(summary.surface_rate_share, rate_share),
            body_rate_share=jnp.maximum(summary.body_rate_share, jnp.abs(state.rates_b) / self.limits.rates_max),
            limited_time=summary.limited_time + jnp.where(limited, step, 0.0),
            limited_late=summary.limited_late + jnp.where(limited & is_late, step, 0.0),
            limited_before_slip=summary.limited_before_slip + jnp.where(limited & before_slip, step, 0.0),
            left_time=jnp.minimum(summary.left_time, left_time),
            finite=summary.finite,
        )

    def output(self, sample: AircraftSample, instant: Instant) -> None:
        """Return None: the recorder stores no rows."""


def survey_flight(
    airframe: AbstractAirframe,
    environment: Environment,
    gains: AutopilotGains,
    limits: FlightLimits,
    trim: TrimPoint,  # steady flight at the start
    target: TrimTarget,  # trim target of the same flight
    size: Vector3,  # step of (V, gamma, chi), m/s and rad
    tolerance: Vector3,  # tolerance of the settled error, m/s and rad
    step: ScalarLike,  # sampling period, s
    count: int,  # number of periods
    sensors: AbstractSensors | None = None,  # None: ideal sensors
    estimator: AbstractEstimator | None = None,  # None: an estimator that knows the airframe
) -> SurveySummary:
    """Simulate the response of the velocity loop to a step command in steady flight, and return metrics of the flight.

    At time 0 the command (V, gamma, chi) jumps by `size` from the steady flight or turn `target`. The metrics describe
    the true motion.
    """
    vehicle = Vehicle(
        airframe=airframe,
        sensors=IdealSensors() if sensors is None else sensors,
        estimator=TrackingEstimator() if estimator is None else estimator,
        guidance=SteppedPath(target, size),
        controller=InversionAutopilot(gains, limits),
    )
    step = jnp.asarray(step, dtype=float)
    instant = Instant(environment, jnp.asarray(0, dtype=jnp.int32), step)
    start = air_data_and_forces(airframe, environment, 0.0, trim.state)
    surfaces = len(airframe.actuators.names)
    recorder = SurveyRecorder(
        limits=limits, start=start, size=size, tolerance=tolerance, count=count, surfaces=surfaces
    )
    state, summary, _ = fly_alone(vehicle, environment, trimmed_vehicle(vehicle, instant, trim), step, count, recorder)
    return finish_summary(summary, state.aircraft, step, count)
