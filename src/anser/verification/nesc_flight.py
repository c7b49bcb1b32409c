"""Flights of the NESC check-cases, logged in the columns and units of the published participants."""

import functools
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.airframe import AbstractAirframe, AircraftState, Controls
from anser.aircraft.motion import (
    EarthFixedState,
    earth_fixed_derivative,
    earth_fixed_state,
    flight_condition,
    local_state,
    require_round_earth,
)
from anser.aircraft_files.library import load_body, load_f16
from anser.compiling.options import compiled_quickly
from anser.environment.atmosphere import StandardAtmosphere
from anser.environment.earth import spherical_earth, wgs84_earth
from anser.environment.environment import Environment, LayeredWind
from anser.numerics.arrays import stack_rows
from anser.numerics.least_squares import levenberg_marquardt
from anser.shapes import Scalar, ScalarLike, Vector3
from anser.simulation.vehicle import advance
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
)

LOG_PERIOD_S = 0.1
_FALL_STEPS = 10
"""Integration steps of 0.01 s in a log period: a hundredth of the tumbling period, error below 1e-9 deg."""
_CRUISE_STEPS = 5

Log = dict[str, np.ndarray]
"""Log of a flight: by published column name, the values at each logged time."""


def fly_free(cases: Sequence[FreeFlight]) -> dict[int, Log]:
    """Fly the check-cases without controls in one batch; return logs by case number, every 0.1 s from time 0."""
    airframes = [load_body(case.body) for case in cases]
    environments = [_environment(case.earth, case.wind_east_ft_s) for case in cases]
    starts = [_start_free(*start_arguments) for start_arguments in zip(airframes, environments, cases, strict=True)]
    controls = [Controls(surfaces=jnp.zeros(3), throttle=jnp.zeros(()))] * len(cases)
    return _logs(
        cases, stack_rows(airframes), stack_rows(environments), stack_rows(starts), stack_rows(controls), _FALL_STEPS
    )


def fly_trimmed(cases: Sequence[TrimmedFlight], airframe: AbstractAirframe | None = None) -> dict[int, Log]:
    """Trim and fly check-cases of the F-16 in one batch; return logs by case number, every 0.1 s from time 0.

    The published vehicle has neither lags nor engine momentum: controls and power are constant. `airframe` None: the
    library's s119 variant.
    """
    airframe = load_f16("s119") if airframe is None else airframe
    environments, starts, controls = trimmed_starts(airframe, cases)
    return _logs(cases, stack_rows([airframe] * len(cases)), environments, starts, controls, _CRUISE_STEPS)


@functools.cache
def trimmed_logs() -> dict[int, Log]:
    """Return the logs of cases 11 and 12, flown with the library's s119 variant once per process."""
    return fly_trimmed(TRIMMED_FLIGHTS)


def trimmed_starts(
    airframe: AbstractAirframe, cases: Sequence[TrimmedFlight | LawFlight]
) -> tuple[Environment, EarthFixedState, Controls]:
    """Return the environments, initial states and controls of check-cases that start in trim, stacked over the cases.

    Raises
    ------
    RuntimeError
        A case has no trim.
    """
    environments = [_environment("wgs84", (0.0, 0.0), case.latitude_deg, case.longitude_deg) for case in cases]
    positions_n = jnp.array([[0.0, 0.0, -case.altitude_ft * FOOT_M] for case in cases])
    velocities_n = jnp.array([case.velocity_ft_s for case in cases]) * FOOT_M
    environment = stack_rows(environments)
    starts, controls, residual = _trim_all(airframe, environment, positions_n, velocities_n)
    if not np.all(np.asarray(residual) < 1e-8):
        raise RuntimeError(f"the check-case's trim was not found: accelerations of {np.asarray(residual)} g remain")
    return environment, starts, controls


def _logs(
    cases: Sequence[FreeFlight | TrimmedFlight],
    airframes: AbstractAirframe,
    environments: Environment,
    starts: EarthFixedState,
    controls: Controls,
    steps: int,
) -> dict[int, Log]:
    """Fly stacked cases, each for the longest duration, and return the logs by case number."""
    periods = round(max(case.times_s[-1] for case in cases) / LOG_PERIOD_S)
    logs = _fly_all(airframes, environments, starts, controls, periods, steps)
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
    neutral_actuators, idle_engine = (
        airframe.actuators.steady_state(jnp.zeros(3)),
        airframe.engine.steady_state(jnp.zeros(())),
    )
    local_start = AircraftState(position_n, velocity_b, quaternion, jnp.zeros(3), neutral_actuators, idle_engine)
    start = earth_fixed_state(require_round_earth(environment), local_start)
    return eqx.tree_at(lambda state: state.rates_b, start, jnp.asarray(case.rates_deg_s) * DEG_RAD)


@compiled_quickly
def _trim_all(
    airframe: AbstractAirframe,
    environments: Environment,
    positions_n: Float[Array, "case 3"],
    velocities_n: Float[Array, "case 3"],
) -> tuple[EarthFixedState, Controls, Float[Array, " case"]]:
    """Trim each case: wings level, no sideslip, constant body velocity and pitch rate.

    Returns states, controls, and a residual for each case.
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
def _fly_all(
    airframes: AbstractAirframe,
    environments: Environment,
    starts: EarthFixedState,
    controls: Controls,
    periods: int,
    steps: int,
) -> dict[str, Array]:
    """Return the log of each case, shape (case, time), every `LOG_PERIOD_S` from time 0."""

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
    """Return a row of a participant's log by column name, in the published units, with the KEAS.

    KEAS is the equivalent airspeed in knots.
    """
    earth = require_round_earth(environment)
    local = local_state(earth, state)
    condition = flight_condition(airframe, environment, time, local)
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
