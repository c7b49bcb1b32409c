"""Response of one aircraft to commands given to one loop of its autopilot: the step tests of theory section 5."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.aircraft import AbstractAirframe, AircraftState, condition
from anser.control import (
    AbstractGuidance,
    AutopilotGains,
    AutopilotState,
    FlightLimits,
    InversionAutopilot,
    Loop,
    LoopCommand,
    PathMotion,
    initial_autopilot_state,
    path_motion,
)
from anser.environment import Environment
from anser.planning import AircraftPlan, PathCommand
from anser.sensing import Belief, DirectEstimator, IdealSensors, Instant
from anser.shapes import Scalar, ScalarLike, Vector3
from anser.simulation.closed_loop import fly_alone, trimmed_vehicle
from anser.simulation.recorder import AbstractRecorder, AircraftSample
from anser.simulation.trim import TrimPoint
from anser.simulation.vehicle import Vehicle


class LoopCase(eqx.Module):
    """What flies a trim point, and how.

    Attributes
    ----------
    airframe, environment, gains, limits
        What flies, where and how.
    trim
        Steady flight that is departed from.
    step
        Sampling period, s.
    """

    airframe: AbstractAirframe
    environment: Environment
    gains: AutopilotGains
    limits: FlightLimits
    trim: TrimPoint
    step: Scalar = eqx.field(converter=lambda step: jnp.asarray(step, dtype=float))


class HeldCommand(AbstractGuidance):
    """One command throughout."""

    held: Any

    def init(self, belief: Belief, instant: Instant) -> None:
        """Nothing is kept."""

    def command(
        self, memory: None, belief: Belief, plan: AircraftPlan | None, instant: Instant
    ) -> tuple[Any, Vector3, None]:
        """The command; no place is asked for."""
        return self.held, belief.state.position_n, None


class Response(eqx.Module):
    """Record of one response, one row per step.

    Attributes
    ----------
    time
        s.
    measured
        The loop's own outputs: (P, Q, R), (mu, alpha, beta) or (V, gamma, chi).
    surfaces, throttle, power
        What they took: rad, 0..1, percent.
    """

    time: Float[Array, " steps"]
    measured: Float[Array, "steps 3"]
    surfaces: Float[Array, "steps 3"]
    throttle: Float[Array, " steps"]
    power: Float[Array, " steps"]


def step_response(case: LoopCase, size: Vector3, count: int, loop: Loop) -> Response:
    """Fly a step away from trim, commanded to one loop, for `count` sampling periods.

    Parameters
    ----------
    case
        What flies, and the steady flight that the step leaves.
    size
        Step of the loop's three channels: (P, Q, R) rad/s, (mu, alpha, beta) rad or (V, gamma, chi) m/s and rad. The
        command jumps at time 0 and carries no rate (no feed-forward). The throttle stays at trim unless the velocity
        loop is commanded.
    count
        Number of periods.
    loop
        Which loop is commanded.
    """
    held = measured_by(believed(case.airframe, case.environment, case.trim.state), loop)
    return loop_flight(case, held + size, count, loop, ResponseRecorder(loop=loop))


def loop_flight(case: LoopCase, value: Vector3, count: int, loop: Loop, recorder: AbstractRecorder) -> Any:
    """Rows of a flight from trim with one loop commanded to a value throughout; see `step_response`."""
    command = loop_command(loop, value, jnp.zeros(3), case.trim.controls.throttle)
    autopilot = InversionAutopilot(case.gains, case.limits, loop=loop)
    vehicle = Vehicle(case.airframe, IdealSensors(), DirectEstimator(), HeldCommand(command), autopilot)
    instant = Instant(case.environment, jnp.asarray(0, dtype=jnp.int32), case.step)
    start = trimmed_vehicle(vehicle, instant, case.trim)
    return fly_alone(vehicle, case.environment, start, case.step, count, recorder)[2]


class ResponseRecorder(AbstractRecorder):
    """What one loop does and takes, at each sample."""

    loop: Loop = eqx.field(static=True)
    every: int = eqx.field(static=True, default=1)

    def init(self, aircraft: int) -> None:
        """Nothing is kept."""

    def take(self, memory: None, sample: AircraftSample, instant: Instant) -> None:
        """Nothing is kept."""

    def row(self, sample: AircraftSample, instant: Instant) -> Response:
        """One row."""
        state = sample.truth.state
        measured = measured_by(sample.belief, self.loop)
        return Response(instant.time, measured, state.surfaces, sample.controls.throttle, state.power)


def loop_command(loop: Loop, value: Vector3, rate: Vector3, throttle: ScalarLike) -> PathCommand | LoopCommand:
    """Command for a loop: values of its channels and their rates.

    The throttle (0..1) is held unless the velocity loop is commanded.
    """
    return PathCommand(*value, *rate) if loop == "velocity" else LoopCommand(value, rate, throttle)


def believed(airframe: AbstractAirframe, environment: Environment, state: AircraftState) -> Belief:
    """What an aircraft without a goal believes that knows itself and its state, at time 0."""
    now = condition(airframe, environment, 0.0, state)
    specific_force_b = now.wrench.force_b / airframe.mass_properties.mass
    return Belief(airframe, state, now, specific_force_b, sight=None, goal=None)


def trimmed_memory(trim: TrimPoint) -> AutopilotState:
    """Memory of an autopilot that has been holding a trim point."""
    attitude = jnp.stack([trim.mu, trim.alpha, trim.beta])
    return initial_autopilot_state(attitude, trim.state.rates_b, trim.state.surfaces)


def motion_of(belief: Belief) -> PathMotion:
    """Path and attitude angles that an aircraft believes."""
    now, mass = belief.now, belief.airframe.mass_properties.mass
    return path_motion(now, now.wrench.force_b, belief.state.velocity_b, mass, now.earth.gravity)


def measured_by(belief: Belief, loop: Loop) -> Vector3:
    """Outputs of a loop: (P, Q, R), (mu, alpha, beta) or (V, gamma, chi)."""
    if loop == "rates":
        return belief.state.rates_b
    motion = motion_of(belief)
    if loop == "velocity":
        return jnp.stack([motion.V, motion.gamma, motion.chi])
    return jnp.stack([motion.mu, motion.alpha, motion.beta])
