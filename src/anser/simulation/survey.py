"""One flight of an envelope survey: from a trim point, a step of the path command, summed up while it is flown."""

import equinox as eqx
import jax.numpy as jnp

from anser.aircraft import AbstractAirframe, Condition, condition
from anser.control import AbstractGuidance, AutopilotGains, FlightLimits, InversionAutopilot
from anser.environment import Environment
from anser.planning import AircraftPlan, PathCommand
from anser.sensing import AbstractEstimator, AbstractSensors, Belief, DirectEstimator, IdealSensors, Instant
from anser.shapes import ScalarLike, Vector3
from anser.simulation.closed_loop import fly_alone, trimmed_vehicle
from anser.simulation.flight_summary import FlightSummary, including, nothing_yet
from anser.simulation.recorder import AbstractRecorder, AircraftSample
from anser.simulation.survey_sample import finished, late_from, sample_of, stepped_command
from anser.simulation.trim import TrimPoint, TrimTarget
from anser.simulation.vehicle import Vehicle


class SteppedPath(AbstractGuidance):
    """Steady flight, its turn included, plus a step of (V, gamma, chi), m/s and rad, from time 0 on."""

    target: TrimTarget
    size: Vector3

    def init(self, belief: Belief, instant: Instant) -> None:
        """Nothing is kept."""

    def command(
        self, memory: None, belief: Belief, plan: AircraftPlan | None, instant: Instant
    ) -> tuple[PathCommand, Vector3, None]:
        """The course goes on turning as before the step; no place is asked for."""
        return stepped_command(self.target, self.size, instant.time), belief.state.position_n, None


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
    start: Condition
    size: Vector3
    tolerance: Vector3
    count: int = eqx.field(static=True)
    surfaces: int = eqx.field(static=True)
    every: int = eqx.field(static=True, default=1)

    def init(self, aircraft: int) -> FlightSummary:
        """Summary of no sample."""
        return nothing_yet(self.surfaces)

    def take(self, memory: FlightSummary, sample: AircraftSample, instant: Instant) -> FlightSummary:
        """Summary with one more sample."""
        extremes = sample_of(sample, instant.environment, instant.time, self.limits, self.start)
        late = instant.number >= late_from(self.count)
        return including(memory, extremes, self.size, self.tolerance, instant.step, late)

    def row(self, sample: AircraftSample, instant: Instant) -> None:
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
) -> FlightSummary:
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
    start = condition(airframe, environment, 0.0, trim.state)
    surfaces = len(airframe.actuators.names)
    recorder = SurveyRecorder(limits, start, size, tolerance, count, surfaces)
    state, summary, _ = fly_alone(vehicle, environment, trimmed_vehicle(vehicle, instant, trim), step, count, recorder)
    return finished(summary, state.aircraft, step, count)
