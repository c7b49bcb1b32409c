"""Flights of the NESC check-cases of the F-16 under the published control laws, in anser's closed loop."""

import math
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.airframe import AircraftState, Controls
from anser.aircraft.f16 import F16
from anser.aircraft.motion import EarthFixedState, earth_fixed_state, flight_condition, local_state, require_round_earth
from anser.compiling.options import compiled_quickly
from anser.control.dave_ml_laws import DaveMlLaw, NamedCommands, dave_ml_law, named_signals
from anser.environment.environment import Environment
from anser.numerics.arrays import as_array, stack_rows
from anser.numerics.least_squares import Solution, levenberg_marquardt
from anser.parts.perception import Belief, Instant
from anser.sensing.estimators import DirectEstimator
from anser.sensing.ideal_sensors import IdealSensors
from anser.shapes import Scalar, Vector
from anser.simulation.closed_loop import fly_alone, trimmed_vehicle
from anser.simulation.recorders import AbstractRecorder, AircraftSample
from anser.simulation.vehicle import Vehicle
from anser.steady.trim import TrimPoint
from anser.units import DEG_RAD, FOOT_M, KNOT_M_S, RAD_DEG
from anser.verification.nasa_f16 import prompt_f16, published_model
from anser.verification.nesc_cases import LawFlight
from anser.verification.nesc_flight import LOG_PERIOD_S, Log, log_row, trimmed_starts

LAW_STEPS = 80
"""Steps of 0.00125 s in a log period: the laws close loops of about 50 rad/s, and the files define no sampling."""
_LAW_TRIMS = ("trimmedPilotControl_long", "trimmedPilotControl_throttle")
"""Inputs of the control laws for the feed-forward of stick and throttle."""
_FULL_STICK_DEG = 25.0
"""Elevator of a full longitudinal stick, up for aft. Source: F16_control.dml, elevatorDeflection."""
_COMMAND_UNITS = {
    "altitudeMslCommand": FOOT_M,
    "equivalentAirspeedCommand": KNOT_M_S,
    "trueBaseCourseCommand": DEG_RAD,
    "lateralDeviationError": FOOT_M,
}


def fly_laws(cases: Sequence[LawFlight], steps: int = LAW_STEPS) -> dict[str, Log]:
    """Trim and fly check-cases under one control law in one batch; return logs by case number, every 0.1 s from time 0.

    Parameters
    ----------
    cases
        Check-cases with the same law.
    steps
        Steps and samples of the law in a log period.
    """
    airframe = prompt_f16(LOG_PERIOD_S / steps)
    environments, starts, controls = trimmed_starts(airframe, cases)
    law = dave_ml_law(published_model(cases[0].law))
    keas = _equivalent_airspeeds(airframe, environments, starts)
    commands = stack_rows([_commands(case, float(keas[k]), _row_of(controls, k)) for k, case in enumerate(cases)])
    if cases[0].law == "F16_control":
        commands = _with_trim_feed_forward(airframe, law, environments, starts, controls, commands)
    periods = round(max(case.times_s[-1] for case in cases) / LOG_PERIOD_S)
    logs = _fly_all(airframe, law, environments, commands, starts, controls, periods, steps)
    return {case.number: {key: np.asarray(values[k]) for key, values in logs.items()} for k, case in enumerate(cases)}


def _row_of(controls: Controls, k: int) -> Controls:
    return jax.tree.map(lambda leaf: np.asarray(leaf)[k], controls)


def _commands(case: LawFlight, keas: float, trim: Controls) -> NamedCommands:
    """Return the inputs of the law: autopilot on, stick centred, trim as feed-forward, and the change at its time."""
    north, east, _ = case.velocity_ft_s
    initial_commands: dict[str, float] = {
        **dict.fromkeys((f"pilotControl_{axis}" for axis in ("throttle", "long", "lat", "yaw")), 0.0),
        "stabilityAugmentationOn_disc": 1.0,
        "autopilotOn_disc": 1.0,
        "equivalentAirspeedCommand": keas,
        "altitudeMslCommand": case.altitude_ft * FOOT_M,
        "trimmedPilotControl_throttle": float(trim.throttle),
        "trimmedPilotControl_long": -float(trim.surfaces[0]) * RAD_DEG / _FULL_STICK_DEG,
    }
    if case.law == "F16_gnc":
        initial_commands["selectCircumnavigator_disc"] = float(case.circles_pole)
    else:
        initial_commands |= {"trueBaseCourseCommand": math.atan2(east, north), "lateralDeviationError": 0.0}
    change = {name: 0.0 for name in _COMMAND_UNITS if name in initial_commands}
    name, amount = case.change
    change[name] = amount * _COMMAND_UNITS[name]
    return NamedCommands(
        initial_commands={key: as_array(value) for key, value in initial_commands.items()},
        change={key: as_array(value) for key, value in change.items()},
        change_time=as_array(case.change_time_s),
        follows_line=as_array(float(case.follows_line)),
        with_position=case.law == "F16_gnc",
    )


class _LogRecorder(AbstractRecorder):
    """Recorder of the columns that the published participants log."""

    stride: int = eqx.field(static=True)

    def init(self, aircraft: int) -> None:
        """Return None: the recorder has no state."""

    def update(self, recorder_state: None, sample: AircraftSample, instant: Instant) -> None:
        """Return None: there is no state to update."""

    def output(self, sample: AircraftSample, instant: Instant) -> dict[str, Array]:
        """Return a row by the published column names."""
        truth, environment = sample.truth, instant.environment
        state = earth_fixed_state(require_round_earth(environment), truth.state)
        return log_row(truth.airframe, environment, instant.time, state)


def _exact_belief(airframe: F16, environment: Environment, start: EarthFixedState) -> Belief:
    local_start = local_state(require_round_earth(environment), start)
    return Belief(
        airframe, local_start, flight_condition(airframe, environment, 0.0, local_start), jnp.zeros(3), None, None
    )


@compiled_quickly
def _equivalent_airspeeds(airframe: F16, environments: Environment, starts: EarthFixedState) -> Array:
    """Return the equivalent airspeed (m/s) at each start."""

    def airspeed(environment: Environment, start: EarthFixedState) -> Scalar:
        return named_signals(_exact_belief(airframe, environment, start))["equivalentAirspeed"]

    return jax.vmap(airspeed)(environments, starts)


def _with_trim_feed_forward(
    airframe: F16,
    law: DaveMlLaw,
    environments: Environment,
    starts: EarthFixedState,
    controls: Controls,
    commands: NamedCommands,
) -> NamedCommands:
    """Replace the feed-forward of stick and throttle by values with which the law holds each start.

    With the bare trim, the law does not hold the start: it feeds back pitch and angle of attack relative to its design
    values, 0.015 deg from the start's, and settles 0.31 ft too high.

    Raises
    ------
    RuntimeError
        No feed-forward makes the law output the controls of the trim.
    """
    trims, residual = _solve_law_trims(airframe, law, environments, starts, controls, commands)
    if not np.all(np.asarray(residual) < 1e-10):
        raise RuntimeError(f"the law's trim was not found: {np.asarray(residual)} rad or of full power remain")
    initial_commands = {**commands.initial_commands, **{name: trims[:, k] for k, name in enumerate(_LAW_TRIMS)}}
    return eqx.tree_at(lambda guidance: guidance.initial_commands, commands, initial_commands)


@compiled_quickly
def _solve_law_trims(
    airframe: F16,
    law: DaveMlLaw,
    environments: Environment,
    starts: EarthFixedState,
    controls: Controls,
    commands: NamedCommands,
) -> tuple[Float[Array, "case 2"], Float[Array, " case"]]:
    """Solve for the `_LAW_TRIMS` with which the law outputs the trim controls; residual in rad or full power."""

    def solve(environment: Environment, start: EarthFixedState, trim: Controls, guidance: NamedCommands) -> Solution:
        belief = _exact_belief(airframe, environment, start)

        def excess(trims: Vector, _: None) -> Vector:
            command = {**guidance.initial_commands, **{name: trims[k] for k, name in enumerate(_LAW_TRIMS)}}
            outputs, _, _ = law.control(None, belief, command, 0.0)
            return jnp.stack([outputs.surfaces[0] - trim.surfaces[0], outputs.throttle - trim.throttle])

        return levenberg_marquardt(excess, None, jnp.stack([guidance.initial_commands[name] for name in _LAW_TRIMS]))

    solution = jax.vmap(solve)(environments, starts, controls, commands)
    return solution.x, solution.residual


@compiled_quickly
def _fly_all(
    airframe: F16,
    law: DaveMlLaw,
    environments: Environment,
    commands: NamedCommands,
    starts: EarthFixedState,
    controls: Controls,
    periods: int,
    steps: int,
) -> dict[str, Array]:
    """Return the log of each case, shape (case, time), every `LOG_PERIOD_S` from time 0."""
    step = jnp.asarray(LOG_PERIOD_S / steps)

    def fly(environment: Environment, guidance: NamedCommands, start: EarthFixedState, trim_controls: Controls) -> dict:
        vehicle = Vehicle(airframe, IdealSensors(), DirectEstimator(), guidance, law)
        local_start = local_state(require_round_earth(environment), start)
        instant = Instant(environment, jnp.asarray(0, dtype=jnp.int32), step)
        trimmed = trimmed_vehicle(vehicle, instant, _trim_point(airframe, environment, local_start, trim_controls))
        return fly_alone(vehicle, environment, trimmed, step, (periods + 1) * steps, _LogRecorder(stride=steps))[2]

    return jax.vmap(fly)(environments, commands, starts, controls)


def _trim_point(
    airframe: F16, environment: Environment, local_start: AircraftState, trim_controls: Controls
) -> TrimPoint:
    data = flight_condition(airframe, environment, 0.0, local_start).air_data
    zero = jnp.zeros(())
    return TrimPoint(
        local_start, trim_controls, zero, data.alpha, data.beta, local_start.power, jnp.asarray(True), zero, zero
    )
