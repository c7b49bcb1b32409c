"""Response of one aircraft to a command for one loop of the autopilot, and step-response metrics (theory section 5)."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.aircraft.airframe import AbstractAirframe, AircraftState
from anser.aircraft.motion import air_data_and_forces, angular_acceleration, modelled_air_data_and_forces
from anser.control.autopilot_state import AutopilotState, ModelResidual, initial_autopilot_state
from anser.control.gains import AutopilotGains
from anser.control.inversion_autopilot import InversionAutopilot, Loop, LoopCommand
from anser.control.limits import FlightLimits
from anser.control.onboard_model import PathMotion, path_motion
from anser.environment.environment import Environment
from anser.parts.controllers import AbstractGuidance
from anser.parts.paths import PathCommand
from anser.parts.perception import Belief, Instant
from anser.parts.planners import AircraftPlan
from anser.sensing.estimators import TrackingEstimator
from anser.sensing.ideal_sensors import IdealSensors
from anser.shapes import Scalar, ScalarLike, Vector, Vector3
from anser.simulation.closed_loop import fly_alone, trimmed_vehicle
from anser.simulation.recorders import AbstractRecorder, AircraftSample
from anser.simulation.survey_flight import final_part_start
from anser.simulation.vehicle import Vehicle
from anser.steady.trim import TrimPoint


class LoopCase(eqx.Module):
    """Aircraft, autopilot and trim point, for step responses and linear models of the autopilot's loops."""

    airframe: AbstractAirframe
    environment: Environment
    gains: AutopilotGains
    limits: FlightLimits
    trim: TrimPoint  # steady flight at the start
    step: Scalar = eqx.field(converter=lambda step: jnp.asarray(step, dtype=float))  # sampling period, s
    # onboard model of the airframe in the autopilot; None: the airframe itself
    model: AbstractAirframe | None = None


class ConstantCommand(AbstractGuidance):
    """Guidance that always gives the same command, `value`, of the type that the controller expects."""

    value: Any

    def command(
        self, guidance_state: None, belief: Belief, plan: AircraftPlan | None, instant: Instant
    ) -> tuple[Any, Vector3, None]:
        """Return `value`, the aircraft's own position (NED, m), and None."""
        return self.value, belief.state.position_n, None


class Response(eqx.Module):
    """Time histories of one loop's step response."""

    time: Float[Array, " steps"]  # s
    measured: Float[Array, "steps 3"]  # outputs of the commanded loop, see `loop_outputs`
    surfaces: Float[Array, "steps surfaces"]  # deflections, rad
    throttle: Float[Array, " steps"]  # 0..1
    power: Float[Array, " steps"]  # engine power, percent


def step_response(case: LoopCase, size: Vector3, count: int, loop: Loop) -> Response:
    """Fly from trim with a step command to one loop, for `count` sampling periods, and return the time histories.

    `size` is the step of the loop's three channels at time 0, see `loop_outputs`. The command has no time derivative
    (no feed-forward). The throttle stays at trim if `loop` is "rates" or "attitude".
    """
    trimmed = loop_outputs(exact_belief(case.airframe, case.environment, case.trim.state), loop)
    return loop_flight(case, trimmed + size, count, loop, ResponseRecorder(loop=loop))


def loop_flight(case: LoopCase, value: Vector3, count: int, loop: Loop, recorder: AbstractRecorder) -> Any:
    """Fly from trim with a constant command `value` to one loop, for `count` periods; return the recorder's rows."""
    command = loop_command(loop, value, jnp.zeros(3), case.trim.controls.throttle)
    autopilot, estimator = InversionAutopilot(case.gains, case.limits, loop=loop), TrackingEstimator(model=case.model)
    vehicle = Vehicle(case.airframe, IdealSensors(), estimator, ConstantCommand(command), autopilot)
    instant = Instant(case.environment, jnp.asarray(0, dtype=jnp.int32), case.step)
    start = trimmed_vehicle(vehicle, instant, case.trim)
    if case.model is not None:
        start = eqx.tree_at(lambda s: s.controller.residual, start, loop_start(case).residual)
    return fly_alone(vehicle, case.environment, start, case.step, count, recorder)[2]


class ResponseRecorder(AbstractRecorder):
    """Recorder of one loop's outputs and of the controls at every sample, as a `Response`."""

    loop: Loop = eqx.field(static=True)
    stride: int = eqx.field(static=True, default=1)

    def output(self, sample: AircraftSample, instant: Instant) -> Response:
        """Return the `Response` at one sample."""
        state = sample.truth.state
        measured = loop_outputs(sample.belief, self.loop)
        return Response(instant.time, measured, state.surfaces, sample.controls.throttle, state.power)


def loop_command(loop: Loop, value: Vector3, rate: Vector3, throttle: ScalarLike) -> PathCommand | LoopCommand:
    """Return the command to a loop from values (see `loop_outputs`) and rates of the three channels.

    `throttle` (0..1) has no effect if `loop` is "velocity".
    """
    return PathCommand(*value, *rate) if loop == "velocity" else LoopCommand(value, rate, throttle)


def exact_belief(airframe: AbstractAirframe, environment: Environment, state: AircraftState) -> Belief:
    """Return a belief that equals the truth at time 0, without gusts, for an aircraft that has no goal."""
    condition = air_data_and_forces(airframe, environment, 0.0, state)
    specific_force_b = condition.wrench.force_b / airframe.mass_properties.mass
    return Belief(airframe, state, condition, specific_force_b, sight=None, goal=None)


def modelled_belief(case: LoopCase, state: AircraftState) -> Belief:
    """Return a belief with the true state and specific force, but the forces and moments of the onboard model."""
    belief = exact_belief(case.airframe, case.environment, state)
    if case.model is None:
        return belief
    condition = modelled_air_data_and_forces(case.model, belief.condition, belief.condition.air_data, state)
    return Belief(case.model, state, condition, belief.specific_force_b, sight=None, goal=None)


def settled_residual(belief: Belief) -> ModelResidual:
    """Return measured minus modelled force (N) and angular acceleration (rad/s^2) in steady flight.

    The body rates and the specific force of the steady flight are taken from `belief`.
    """
    mass_properties, condition, rates_b = belief.airframe.mass_properties, belief.condition, belief.state.rates_b
    force_b = mass_properties.mass * belief.specific_force_b - condition.wrench.force_b
    acceleration_b = angular_acceleration(mass_properties, rates_b, condition.wrench.moment_b)
    return ModelResidual(force_b, -acceleration_b, rates_b, acceleration_b)


def trimmed_autopilot_state(trim: TrimPoint) -> AutopilotState:
    """Return the settled state, in the steady flight `trim`, of an autopilot that does not limit the bank rate."""
    attitude = jnp.stack([trim.mu, trim.alpha, trim.beta])
    return initial_autopilot_state(attitude, trim.state.rates_b, trim.state.surfaces)


def loop_start(case: LoopCase) -> AutopilotState:
    """Return the autopilot's settled state at the trim point of a case, with the residual of the onboard model."""
    start = trimmed_autopilot_state(case.trim)
    if case.model is None:
        return start
    return eqx.tree_at(lambda s: s.residual, start, settled_residual(modelled_belief(case, case.trim.state)))


def believed_motion(belief: Belief) -> PathMotion:
    """Return path and attitude angles (rad), airspeed (m/s) and rates from the estimated state in a belief."""
    condition, mass = belief.condition, belief.airframe.mass_properties.mass
    return path_motion(condition, condition.wrench.force_b, belief.state.velocity_b, mass, condition.earth.gravity)


def loop_outputs(belief: Belief, loop: Loop) -> Vector3:
    """Return the three outputs of a loop: (P, Q, R) rad/s, (mu, alpha, beta) rad, or (V, gamma, chi) m/s and rad."""
    if loop == "rates":
        return belief.state.rates_b
    motion = believed_motion(belief)
    if loop == "velocity":
        return jnp.stack([motion.V, motion.gamma, motion.chi])
    return jnp.stack([motion.mu, motion.alpha, motion.beta])


_RISE_FROM, _RISE_TO = 0.1, 0.9


class StepMetrics(eqx.Module):
    """Metrics of a step response for each of the loop's three channels; metrics that do not apply are 0."""

    stepped: Bool[Array, "3"]  # whether the channel has a step
    rise_time: Vector3  # time from 10 to 90 percent of the step, s; infinite: not reached
    settling_time: Vector3  # s; infinite: not settled at the end
    overshoot: Vector3  # fraction of the step
    final_error: Vector3  # command minus output, mean of the last tenth, as a fraction of the step
    coupling: Vector3  # largest deviation of a channel without a step, in the channel's unit
    surface_utilization: Vector  # largest deflection of each surface from trim, divided by the travel to the stop


def step_metrics(
    time: Float[Array, " steps"],  # times of the samples, s
    measured: Float[Array, "steps 3"],  # outputs of the loop's channels; angles without jumps of 2 pi
    size: Vector3,  # step of each channel, 0 for channels without a step
    surfaces: Float[Array, "steps n"],  # deflections, rad
    surface_limits: tuple[Vector, Vector],  # lower and upper stops, rad
    band: ScalarLike = 0.05,  # half width of the settling band, fraction of the step
) -> StepMetrics:
    """Return the metrics of a response to a step at the first sample."""
    stepped = size != 0.0
    deviation = measured - measured[:1]
    progress = deviation / jnp.where(stepped, size, 1.0)[None, :]
    tail = jnp.arange(time.shape[0]) >= final_part_start(time.shape[0])
    outside = jnp.abs(progress - 1.0) > band
    settled = jnp.max(jnp.where(outside, time[:, None], -jnp.inf), axis=0)
    lower, upper = surface_limits
    deflection = surfaces - surfaces[:1]
    travel = jnp.where(deflection > 0.0, upper - surfaces[0], surfaces[0] - lower)

    def only_stepped(metric: Vector3) -> Vector3:
        return jnp.where(stepped, metric, 0.0)

    rise_start, rise_end = (_crossing_time(time, progress, level) for level in (_RISE_FROM, _RISE_TO))
    return StepMetrics(
        stepped=stepped,
        rise_time=only_stepped(jnp.where(jnp.isinf(rise_end), jnp.inf, rise_end - rise_start)),
        settling_time=only_stepped(jnp.where(outside[-1], jnp.inf, jnp.maximum(settled - time[0], 0.0))),
        overshoot=only_stepped(jnp.maximum(jnp.max(progress, axis=0) - 1.0, 0.0)),
        final_error=only_stepped(1.0 - jnp.sum(jnp.where(tail[:, None], progress, 0.0), axis=0) / jnp.sum(tail)),
        coupling=jnp.where(stepped, 0.0, jnp.max(jnp.abs(deviation), axis=0)),
        surface_utilization=jnp.max(jnp.abs(deflection) / jnp.maximum(travel, 1e-9), axis=0),
    )


def _crossing_time(time: Float[Array, " steps"], progress: Float[Array, "steps 3"], level: float) -> Vector3:
    """Return the first time (s) at which each channel of `progress` reaches `level`; infinite if never."""

    def channel_crossing(channel: Float[Array, " steps"]) -> Scalar:
        is_reached = channel >= level
        k = jnp.argmax(is_reached)
        previous = jnp.maximum(k - 1, 0)
        rise = channel[k] - channel[previous]
        fraction = jnp.where(rise > 0.0, (level - channel[previous]) / jnp.where(rise > 0.0, rise, 1.0), 1.0)
        crossing = time[previous] + jnp.clip(fraction, 0.0, 1.0) * (time[k] - time[previous])
        return jnp.where(jnp.any(is_reached), crossing, jnp.inf)

    return jnp.stack([channel_crossing(progress[:, k]) for k in range(3)])
