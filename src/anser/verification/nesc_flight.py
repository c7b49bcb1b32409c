"""Flights of the NESC check-cases, logged in the columns and units of the published simulations.

The F-16 flies with fixed controls, or in anser's closed loop under the published control laws.
"""

import functools
import math
from collections.abc import Mapping, Sequence
from importlib import resources
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.actuators import FirstOrderActuators
from anser.aircraft.air_data import AirData, Wrench
from anser.aircraft.airframe import AbstractAirframe, AircraftState, Controls
from anser.aircraft.engines import AbstractEngine, AbstractLaggedEngine
from anser.aircraft.f16 import F16
from anser.aircraft.motion import (
    EarthFixedState,
    air_data_and_forces,
    earth_fixed_derivative,
    earth_fixed_state,
    local_state,
    require_round_earth,
)
from anser.aircraft_files.library import load_body, load_f16
from anser.compiling.options import compiled_quickly
from anser.control.dave_ml_laws import DaveMlLaw, NamedCommands, dave_ml_law, named_signals
from anser.dave_ml.model import Model, read_dave_ml
from anser.environment.atmosphere import StandardAtmosphere
from anser.environment.earth import spherical_earth, wgs84_earth
from anser.environment.environment import Environment, LayeredWind
from anser.numerics.arrays import as_array, stack_rows
from anser.numerics.least_squares import Solution, levenberg_marquardt
from anser.parts.perception import Belief, Instant
from anser.sensing.estimators import TrackingEstimator
from anser.sensing.ideal_sensors import IdealSensors
from anser.shapes import Flag, Scalar, ScalarLike, Vector, Vector3
from anser.simulation.closed_loop import fly_alone, trimmed_vehicle
from anser.simulation.open_loop import start_point
from anser.simulation.recorders import AbstractRecorder, AircraftSample
from anser.simulation.vehicle import Vehicle, advance
from anser.spatial.frames import eci_from_ecef, velocity_eci_from_ecef
from anser.spatial.rotations import (
    euler_from_quaternion,
    quaternion_from_euler,
    rotate,
    rotate_back,
    rotation_from_quaternion,
    safe_norm,
)
from anser.units import (
    DEG_RAD,
    FOOT_M,
    FOOT_PER_MINUTE_M_S,
    FT_LBF_N_M,
    KNOT_M_S,
    LBF_N,
    PSF_PA,
    RAD_DEG,
    RANKINE_K,
    SLUG_FT3_KG_M3,
)
from anser.verification.nesc_cases import (
    SPHERE_RADIUS_M,
    TRIMMED_FLIGHTS,
    EarthName,
    FreeFlight,
    LawFlight,
    TrimmedFlight,
    TrimmedStart,
)

LOG_PERIOD_S = 0.1
_FALL_STEPS = 10
"""Integration steps of 0.01 s in a log period: a hundredth of the tumbling period, error below 1e-9 deg."""
_CRUISE_STEPS = 5

Log = dict[str, np.ndarray]
"""Log of a flight: arrays over the logged times, by published column name."""


def fly_free(cases: Sequence[FreeFlight]) -> dict[int | str, Log]:
    """Fly the check-cases without controls in one batch; return logs by case number, every 0.1 s from time 0."""
    airframes = [load_body(case.body) for case in cases]
    environments = [_environment(case.earth, case.wind_east_ft_s) for case in cases]
    starts = list(map(_start_free, airframes, environments, cases))
    controls = [Controls(surfaces=jnp.zeros(3), throttle=jnp.zeros(()))] * len(cases)
    stacked = Starts(stack_rows(environments), stack_rows(starts), stack_rows(controls))
    return _logs(cases, stack_rows(airframes), stacked, _FALL_STEPS)


def fly_trimmed(cases: Sequence[TrimmedFlight], airframe: AbstractAirframe | None = None) -> dict[int | str, Log]:
    """Trim and fly check-cases of the F-16 in one batch; return logs by case number, every 0.1 s from time 0.

    Controls and power are constant. `airframe` None: the library's F-16 with the table set s119.
    """
    airframe = load_f16("s119") if airframe is None else airframe
    return _logs(cases, stack_rows([airframe] * len(cases)), trimmed_starts(airframe, cases), _CRUISE_STEPS)


@functools.cache
def trimmed_logs() -> dict[int | str, Log]:
    """Return the logs of cases 11 and 12 by case number, flown with the library's s119 F-16; cached."""
    return fly_trimmed(TRIMMED_FLIGHTS)


class Starts(NamedTuple):
    """Environments, initial states and controls of check-cases, with a leading axis over the cases."""

    environments: Environment
    states: EarthFixedState
    controls: Controls


def trimmed_starts(airframe: AbstractAirframe, cases: Sequence[TrimmedStart]) -> Starts:
    """Return environments, trim states and controls of check-cases; raises RuntimeError if a case has no trim."""
    environment = stack_rows(
        [_environment("wgs84", (0.0, 0.0), case.latitude_deg, case.longitude_deg) for case in cases]
    )
    positions_n = jnp.array([[0.0, 0.0, -case.altitude_ft * FOOT_M] for case in cases])
    velocities_n = jnp.array([case.velocity_ft_s for case in cases]) * FOOT_M
    starts, controls, residual = _trim_all(airframe, environment, positions_n, velocities_n)
    if not np.all(np.asarray(residual) < 1e-8):
        raise RuntimeError(f"the check-case's trim was not found: {np.asarray(residual)} x 10 m/s^2 or rad/s^2 remain")
    return Starts(environment, starts, controls)


def _logs(
    cases: Sequence[FreeFlight | TrimmedFlight], airframes: AbstractAirframe, starts: Starts, steps: int
) -> dict[int | str, Log]:
    """Fly all cases with fixed controls and `steps` integration steps per log period; return logs by case number."""
    periods = round(max(case.times_s[-1] for case in cases) / LOG_PERIOD_S)
    return split_logs(cases, _fly_fixed(airframes, *starts, periods, steps))


def split_logs(cases: Sequence[FreeFlight | TrimmedStart], logs: Mapping[str, Array]) -> dict[int | str, Log]:
    """Divide logs, arrays (case, time) by column name, into one log per case, by case number."""
    return {case.number: {key: np.asarray(values[k]) for key, values in logs.items()} for k, case in enumerate(cases)}


def _environment(
    earth: EarthName, wind_east_ft_s: tuple[float, float], latitude_deg: float = 0.0, longitude_deg: float = 0.0
) -> Environment:
    origin = (latitude_deg * DEG_RAD, longitude_deg * DEG_RAD)
    if earth == "wgs84":
        earth_model = wgs84_earth(*origin)
    else:
        rate = wgs84_earth(*origin).rotation_rate if earth == "rotating-sphere" else 0.0
        earth_model = spherical_earth(SPHERE_RADIUS_M, *origin, rate)
    east = jnp.asarray(wind_east_ft_s) * FOOT_M
    zeros = jnp.zeros_like(east)
    wind = LayeredWind(jnp.array([0.0, 30_000.0]) * FOOT_M, jnp.stack([zeros, east, zeros], axis=1))
    return Environment(StandardAtmosphere(), wind, earth_model)


def _start_free(airframe: AbstractAirframe, environment: Environment, case: FreeFlight) -> EarthFixedState:
    quaternion = quaternion_from_euler(jnp.zeros(()), jnp.zeros(()), jnp.asarray(case.yaw_deg * DEG_RAD))
    position_n = jnp.array([0.0, 0.0, -case.altitude_ft * FOOT_M])
    velocity_b = rotate(rotation_from_quaternion(quaternion), jnp.asarray(case.velocity_ft_s) * FOOT_M)
    neutral, idle = airframe.actuators.steady_state(jnp.zeros(3)), airframe.engine.steady_state(jnp.zeros(()))
    local_start = AircraftState(position_n, velocity_b, quaternion, jnp.zeros(3), neutral, idle)
    start = earth_fixed_state(require_round_earth(environment), local_start)
    return eqx.tree_at(lambda state: state.rates_b, start, jnp.asarray(case.rates_deg_s) * DEG_RAD)


@compiled_quickly
def _trim_all(
    airframe: AbstractAirframe,
    environments: Environment,
    positions_n: Float[Array, "case 3"],
    velocities_n: Float[Array, "case 3"],
) -> tuple[EarthFixedState, Controls, Float[Array, " case"]]:
    """Trim each case with wings level and no sideslip; return the states, the controls and the residuals.

    A residual is the largest absolute value of the remaining accelerations: along body x and z in units of 10 m/s^2,
    in pitch in rad/s^2.
    """
    trim = functools.partial(_trim_level, airframe)
    return jax.vmap(trim)(environments, positions_n, velocities_n)


def _trim_level(
    airframe: AbstractAirframe, environment: Environment, position_n: Vector3, velocity_n: Vector3
) -> tuple[EarthFixedState, Controls, Scalar]:
    earth = require_round_earth(environment)
    heading, speed = jnp.arctan2(velocity_n[1], velocity_n[0]), safe_norm(velocity_n)

    def state_of(x: Vector3) -> tuple[EarthFixedState, Controls]:
        alpha, elevator, power = x[0], x[1], 100.0 * x[2]
        surfaces = jnp.stack([elevator, jnp.zeros(()), jnp.zeros(())])
        local_trim = AircraftState(
            position_n=position_n,
            velocity_b=speed * jnp.stack([jnp.cos(alpha), jnp.zeros(()), jnp.sin(alpha)]),
            quaternion=quaternion_from_euler(jnp.zeros(()), alpha, heading),
            rates_b=jnp.zeros(3),
            actuators=airframe.actuators.steady_state(surfaces),
            engine=airframe.engine.steady_state(power),
        )
        return earth_fixed_state(earth, local_trim), Controls(surfaces, airframe.engine.throttle_for_power(power))

    def residual(x: Vector3, _: None) -> Vector3:
        state, controls = state_of(x)
        rate = earth_fixed_derivative(airframe, environment, 0.0, state, controls)
        return jnp.stack([rate.velocity_b[0], rate.velocity_b[2], 10.0 * rate.rates_b[1]]) / 10.0

    trim = levenberg_marquardt(residual, None, jnp.array([0.05, 0.0, 0.2]))
    return *state_of(trim.x), trim.residual


@compiled_quickly
def _fly_fixed(
    airframes: AbstractAirframe,
    environments: Environment,
    starts: EarthFixedState,
    controls: Controls,
    periods: int,
    steps: int,
) -> dict[str, Array]:
    """Fly from `starts` with fixed controls; return the log columns, shape (case, time), from time 0.

    `periods` is the number of log periods, `steps` the number of integration steps in each.
    """

    def fly(
        airframe: AbstractAirframe, environment: Environment, start: EarthFixedState, fixed_controls: Controls
    ) -> dict:
        step = LOG_PERIOD_S / steps

        def log_period(state: EarthFixedState, index: Array) -> tuple[EarthFixedState, dict[str, Scalar]]:
            time = index * LOG_PERIOD_S
            logged = log_row(airframe, environment, time, state)

            def advance_step(k: Array, y: EarthFixedState) -> EarthFixedState:
                return advance(airframe, environment, time + k * step, y, fixed_controls, step)

            return jax.lax.fori_loop(0, steps, advance_step, state), logged

        return jax.lax.scan(log_period, start, jnp.arange(periods + 1))[1]

    return jax.vmap(fly)(airframes, environments, starts, controls)


def log_row(
    airframe: AbstractAirframe, environment: Environment, time: ScalarLike, state: EarthFixedState
) -> dict[str, Scalar]:
    """Return the log entries at one time by published column name, in the published units."""
    earth = require_round_earth(environment)
    local = local_state(earth, state)
    condition = air_data_and_forces(airframe, environment, time, local)
    lat, lon, _ = earth.geodetic(local.position_n)
    R_be = rotation_from_quaternion(state.quaternion)
    velocity_n = rotate_back(condition.R_bn, local.velocity_b)
    rate, zero = earth.rotation_rate, jnp.zeros(())
    position_i = eci_from_ecef(state.position_e, time, zero, rate)
    velocity_i = velocity_eci_from_ecef(state.position_e, rotate_back(R_be, state.velocity_b), time, zero, rate)
    roll, pitch, yaw = euler_from_quaternion(local.quaternion)
    air, sea_level = environment.atmosphere.at(-local.position_n[2]), environment.atmosphere.at(jnp.zeros(()))
    return {
        **_axes("gePosition_ft", state.position_e / FOOT_M),
        **_axes("eiPosition_ft", position_i / FOOT_M),
        **_axes("eiVelocity_ft_s", velocity_i / FOOT_M),
        **_axes("feVelocity_ft_s", velocity_n / FOOT_M),
        "altitudeMsl_ft": -local.position_n[2] / FOOT_M,
        "longitude_deg": lon * RAD_DEG,
        "latitude_deg": lat * RAD_DEG,
        "localGravity_ft_s2": safe_norm(earth.gravitation_e(state.position_e)) / FOOT_M,
        "eulerAngle_deg_Yaw": yaw * RAD_DEG,
        "eulerAngle_deg_Pitch": pitch * RAD_DEG,
        "eulerAngle_deg_Roll": roll * RAD_DEG,
        **_axes("bodyAngularRateWrtEi_deg_s", state.rates_b * RAD_DEG, ("Roll", "Pitch", "Yaw")),
        "altitudeRateWrtMsl_ft_min": -velocity_n[2] / FOOT_PER_MINUTE_M_S,
        "speedOfSound_ft_s": air.speed_of_sound / FOOT_M,
        "airDensity_slug_ft3": air.density / SLUG_FT3_KG_M3,
        "ambientPressure_lbf_ft2": air.pressure / PSF_PA,
        "ambientTemperature_dgR": air.temperature / RANKINE_K,
        **_axes("aero_bodyForce_lbf", condition.aerodynamic.force_b / LBF_N),
        **_axes("aero_bodyMoment_ftlbf", condition.aerodynamic.moment_b / FT_LBF_N_M, "LMN"),
        "mach": condition.air_data.mach,
        "dynamicPressure_lbf_ft2": condition.air_data.qbar / PSF_PA,
        "trueAirspeed_nmi_h": condition.air_data.V / KNOT_M_S,
        "equivalentAirspeed_nmi_h": jnp.sqrt(2.0 * condition.air_data.qbar / sea_level.density) / KNOT_M_S,
    }


def _axes(name: str, vector: Vector3, axes: Sequence[str] = "XYZ") -> dict[str, Scalar]:
    return {f"{name}_{axis}": vector[k] for k, axis in enumerate(axes)}


LAW_STEPS = 80
"""Steps of 0.00125 s in a log period: the laws close loops of about 50 rad/s, and the files define no sampling."""
_LAW_TRIMS = ("trimmedPilotControl_long", "trimmedPilotControl_throttle")
"""Inputs of the control laws for the feed-forward of longitudinal stick and throttle."""
_FULL_STICK_DEG = 25.0
"""Elevator deflection, deg, of a full longitudinal stick (aft: up). Source: F16_control.dml, elevatorDeflection."""
_COMMAND_UNITS = {
    "altitudeMslCommand": FOOT_M,
    "equivalentAirspeedCommand": KNOT_M_S,
    "trueBaseCourseCommand": DEG_RAD,
    "lateralDeviationError": FOOT_M,
}

_LAGS_IN_STEP = 1.6
"""Ratio of integration step to lag at which a Runge-Kutta step reduces a difference most: to 27 %."""


@functools.cache
def published_model(name: str) -> Model:
    """Read the DAVE-ML file `name` (without suffix) of NASA's F-16, such as F16_aero; cached.

    Sources: README beside the files.
    """
    content = resources.files("anser.dave_ml").joinpath(f"nasa/{name}.dml").read_bytes()
    return read_dave_ml(content, f"{name}.dml")


class PromptEngine(AbstractLaggedEngine):
    """Engine with the thrust of `base`; its power, percent, follows 100 times the throttle with a short `lag`, s."""

    base: AbstractEngine
    lag: Scalar

    def propulsion(self, power: ScalarLike, air_data: AirData) -> Wrench:
        """Return force and moment of the base engine at a power, percent."""
        return self.base.propulsion(power, air_data)

    def power_for_thrust(self, thrust: ScalarLike, air_data: AirData) -> Scalar:
        """Return the base engine's power, percent, for a thrust, N."""
        return self.base.power_for_thrust(thrust, air_data)

    def outside_tables(self, air_data: AirData) -> Flag:
        """Return whether the flight condition is outside the base engine's data."""
        return self.base.outside_tables(air_data)


def prompt_f16(step_s: float) -> F16:
    """Build the s119 F-16 with the shortest lags that a step (s) can integrate, and without rate limits."""
    published = load_f16("s119")
    lag = as_array(step_s / _LAGS_IN_STEP)
    actuators = published.actuators
    prompt = FirstOrderActuators(
        time_constant=jnp.full_like(actuators.lower, lag),
        lower=actuators.lower,
        upper=actuators.upper,
        rate_limit=jnp.full_like(actuators.lower, jnp.inf),
    )
    engine = PromptEngine(base=published.engine, lag=lag)
    return eqx.tree_at(lambda f16: (f16.actuators, f16.engine), published, (prompt, engine))


def fly_laws(cases: Sequence[LawFlight], steps: int = LAW_STEPS) -> dict[int | str, Log]:
    """Trim and fly check-cases under one control law in one batch; return logs by case number, every 0.1 s from time 0.

    All cases must have the same law. `steps` is the number of integration steps, and of evaluations of the law, in 0.1
    s.
    """
    airframe = prompt_f16(LOG_PERIOD_S / steps)
    starts = trimmed_starts(airframe, cases)
    law = dave_ml_law(published_model(cases[0].law))
    keas = _equivalent_airspeeds(airframe, starts.environments, starts.states)
    trims = [jax.tree.map(lambda leaf, k=k: np.asarray(leaf)[k], starts.controls) for k in range(len(cases))]
    commands = stack_rows([_commands(case, float(keas[k]), trims[k]) for k, case in enumerate(cases)])
    if cases[0].law == "F16_control":
        commands = _with_trim_feed_forward(airframe, law, starts, commands)
    periods = round(max(case.times_s[-1] for case in cases) / LOG_PERIOD_S)
    return split_logs(cases, _fly_law(airframe, law, starts, commands, periods, steps))


def _commands(case: LawFlight, keas: float, trim: Controls) -> NamedCommands:
    """Return the inputs of the law: autopilot on, stick centred, trim as feed-forward, and one step (`case.change`).

    `keas` is the commanded equivalent airspeed at the start, m/s.
    """
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
    """Recorder of the columns that the published simulations log."""

    stride: int = eqx.field(static=True)

    def output(self, sample: AircraftSample, instant: Instant) -> dict[str, Array]:
        """Return the log entries of a sample by published column name."""
        truth, environment = sample.truth, instant.environment
        state = earth_fixed_state(require_round_earth(environment), truth.state)
        return log_row(truth.airframe, environment, instant.time, state)


def _exact_belief(airframe: F16, environment: Environment, start: EarthFixedState) -> Belief:
    local_start = local_state(require_round_earth(environment), start)
    return Belief(
        airframe, local_start, air_data_and_forces(airframe, environment, 0.0, local_start), jnp.zeros(3), None, None
    )


@compiled_quickly
def _equivalent_airspeeds(airframe: F16, environments: Environment, starts: EarthFixedState) -> Array:
    """Return the equivalent airspeed, m/s, at each start; shape (case,)."""

    def airspeed(environment: Environment, start: EarthFixedState) -> Scalar:
        return named_signals(_exact_belief(airframe, environment, start))["equivalentAirspeed"]

    return jax.vmap(airspeed)(environments, starts)


def _with_trim_feed_forward(airframe: F16, law: DaveMlLaw, starts: Starts, commands: NamedCommands) -> NamedCommands:
    """Replace the feed-forward of stick and throttle in `commands` so that the law outputs the controls of the trim.

    Raises RuntimeError if no such values exist.
    """
    # with the trim controls as feed-forward, the law would settle 0.31 ft too high: it feeds back pitch and angle of
    # attack relative to its design values, 0.015 deg from the start's
    trims, residual = _solve_law_trims(airframe, law, starts, commands)
    if not np.all(np.asarray(residual) < 1e-10):
        raise RuntimeError(f"the law's trim was not found: {np.asarray(residual)} rad or of full power remain")
    initial_commands = {**commands.initial_commands, **{name: trims[:, k] for k, name in enumerate(_LAW_TRIMS)}}
    return eqx.tree_at(lambda guidance: guidance.initial_commands, commands, initial_commands)


@compiled_quickly
def _solve_law_trims(
    airframe: F16, law: DaveMlLaw, starts: Starts, commands: NamedCommands
) -> tuple[Float[Array, "case 2"], Float[Array, " case"]]:
    """Return the inputs `_LAW_TRIMS` with which the law outputs the trim controls, and the greatest remaining error.

    The error is of the elevator, rad, or of the throttle, 0..1.
    """

    def solve(environment: Environment, start: EarthFixedState, trim: Controls, guidance: NamedCommands) -> Solution:
        belief = _exact_belief(airframe, environment, start)

        def excess(trims: Vector, _: None) -> Vector:
            command = {**guidance.initial_commands, **{name: trims[k] for k, name in enumerate(_LAW_TRIMS)}}
            outputs, _, _ = law.control(None, belief, command, 0.0)
            return jnp.stack([outputs.surfaces[0] - trim.surfaces[0], outputs.throttle - trim.throttle])

        return levenberg_marquardt(excess, None, jnp.stack([guidance.initial_commands[name] for name in _LAW_TRIMS]))

    solution = jax.vmap(solve)(*starts, commands)
    return solution.x, solution.residual


@compiled_quickly
def _fly_law(
    airframe: F16, law: DaveMlLaw, starts: Starts, commands: NamedCommands, periods: int, steps: int
) -> dict[str, Array]:
    """Fly from `starts` under the law with `commands`; return the log columns, shape (case, time), from time 0.

    `periods` is the number of log periods, `steps` the number of integration steps in each.
    """
    step = jnp.asarray(LOG_PERIOD_S / steps)

    def fly(environment: Environment, start: EarthFixedState, trim_controls: Controls, guidance: NamedCommands) -> dict:
        vehicle = Vehicle(airframe, IdealSensors(), TrackingEstimator(), guidance, law)
        local_start = local_state(require_round_earth(environment), start)
        instant = Instant(environment, jnp.asarray(0, dtype=jnp.int32), step)
        trimmed = trimmed_vehicle(vehicle, instant, start_point(airframe, environment, local_start, trim_controls))
        return fly_alone(vehicle, environment, trimmed, step, (periods + 1) * steps, _LogRecorder(stride=steps))[2]

    return jax.vmap(fly)(*starts, commands)
