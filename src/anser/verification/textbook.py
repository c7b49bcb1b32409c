"""Verification of the F-16 by Stevens & Lewis: state derivatives, the steady turn, and trims.

The aircraft has the constants of the textbook's program, with which the printed numbers were computed. Each constant
changes the last digits of a printed number. Source: second note of the aircraft's data file.
"""

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.actuators import AbstractActuators, Deflections
from anser.aircraft.air_data import AirData, Wrench
from anser.aircraft.airframe import AbstractAirframe, AircraftState, Controls, MassProperties
from anser.aircraft.engines import AbstractEngine, EnginePower
from anser.aircraft.f16 import F16
from anser.aircraft.motion import air_data_and_forces, flat_earth_derivative, moment_for_acceleration
from anser.aircraft_files.library import load_f16
from anser.compiling.options import compiled_quickly
from anser.environment.atmosphere import AbstractAtmosphere, Air
from anser.environment.earth import FlatEarth
from anser.environment.environment import Environment, SteadyWind
from anser.shapes import Flag, Scalar, ScalarLike, Vector, Vector3
from anser.spatial.rotations import euler_from_quaternion, quaternion_from_euler
from anser.spatial.wind_axes import flow_angles
from anser.steady.trim import TrimPoint, solve_trim, trim_target
from anser.units import DEG_RAD, FOOT_M, FT_LBF_N_M, PSF_PA, RAD_DEG, RANKINE_K, SLUG_FT3_KG_M3, SLUG_KG
from anser.verification.checks import Comparison, half_of_last_digit, half_of_significant, load_published, make_check

TextbookState = Float[Array, "13"]
"""State vector of the textbook, shape (13,).

VT (ft/s), alpha, beta, phi, theta, psi (rad), P, Q, R (rad/s), north, east, altitude (ft), power (percent).
"""
TextbookControls = Float[Array, "4"]
"""Control vector of the textbook, shape (4,): throttle (0..1), elevator, aileron, rudder (deg)."""

_PRINTED_RATIOS = ("-0.770", "0.02755", "1.055e-4", "1.642e-6", "0.9604", "1.759e-2", "1.792e-5", "-0.7336", "1.587e-5")
INERTIA_RATIOS = tuple(map(float, _PRINTED_RATIOS))
"""Inertia ratios c1..c9 of the textbook's program, rounded to three or four digits; for moments in ft lbf."""
ENGINE_MOMENTUM_SLUG_FT2_S = 160.0


class TextbookAtmosphere(AbstractAtmosphere):
    """Atmosphere of the textbook's program ([SL] appendix A, subroutine ADC)."""

    def at(self, altitude: ScalarLike) -> Air:
        """Return the air at an altitude, m."""
        h = altitude / FOOT_M
        factor = 1.0 - 0.703e-5 * h
        temperature = jnp.where(h >= 35000.0, 390.0, 519.0 * factor)
        density = 0.002377 * factor**4.14
        return Air(
            density=density * SLUG_FT3_KG_M3,
            pressure=1715.0 * density * temperature * PSF_PA,
            temperature=temperature * RANKINE_K,
            speed_of_sound=jnp.sqrt(1.4 * 1716.3 * temperature) * FOOT_M,
        )


class TextbookF16(AbstractAirframe):
    """F-16 with the constants of the textbook's program: 57.3 deg/rad in CZ, and rounded ratios of inertia.

    CZ = CZ0 (1 - (beta/57.3)^2), beta in deg. If `rounded_inertia` is True, the moment is changed such that the
    exact inertia gives the angular acceleration of the textbook's rounded ratios c1 to c9.
    """

    f16: F16
    rounded_inertia: bool = eqx.field(static=True)
    mass_properties: MassProperties
    actuators: AbstractActuators
    engine: AbstractEngine
    alpha_range: tuple[Scalar, Scalar]
    beta_range: tuple[Scalar, Scalar]

    def aerodynamics(self, air_data: AirData, rates_b: Vector3, surfaces: Vector) -> Wrench:
        """Compute the aerodynamic force (N) and moment (N m) with the textbook's CZ; surfaces in rad."""
        f16 = self.f16
        CZ0 = f16.tables(air_data.alpha * RAD_DEG, 0.0, 0.0)[0][0]
        change = CZ0 * (air_data.beta**2 - (air_data.beta * RAD_DEG / 57.3) ** 2)
        force = air_data.qbar * f16.wing_area * change
        zero = jnp.zeros_like(force)
        moment = force * f16.mean_chord * (f16.x_cg_reference - f16.x_cg)
        wrench = f16.aerodynamics(air_data, rates_b, surfaces) + Wrench(
            jnp.stack([zero, zero, force]), jnp.stack([zero, moment, zero])
        )
        if not self.rounded_inertia:
            return wrench
        acceleration = _textbook_acceleration(INERTIA_RATIOS, rates_b, wrench.moment_b)
        return Wrench(wrench.force_b, moment_for_acceleration(self.mass_properties, rates_b, acceleration))

    def outside_tables(self, air_data: AirData) -> Flag:
        """Return whether the flight condition is outside the F-16's tables."""
        return self.f16.outside_tables(air_data)


def _textbook_acceleration(ratios: Iterable[ScalarLike], rates_b: Vector3, moment_b: Vector3) -> Vector3:
    """Compute the angular acceleration, rad/s^2, by [SL] eq. (1.7-5) with the inertia ratios c1 to c9 (`ratios`).

    `rates_b` are in rad/s, `moment_b` is in N m.
    """
    c1, c2, c3, c4, c5, c6, c7, c8, c9 = ratios
    P, Q, R = rates_b
    L, M, N = moment_b / FT_LBF_N_M
    HE = ENGINE_MOMENTUM_SLUG_FT2_S
    return jnp.stack(
        [
            (c2 * P + c1 * R + c4 * HE) * Q + c3 * L + c4 * N,
            (c5 * P - c7 * HE) * R + c6 * (R * R - P * P) + c7 * M,
            (c8 * P - c2 * R + c9 * HE) * Q + c4 * L + c9 * N,
        ]
    )


def textbook_aircraft(x_cg_over_c: float, *, rounded_inertia: bool = True) -> TextbookF16:
    """Build the F-16 of the textbook's printed numbers, with a mass of 1/0.00157 slug.

    `x_cg_over_c` is the centre of gravity, fraction of the mean chord; `rounded_inertia` as in `TextbookF16`.
    """
    f16 = load_f16("textbook", x_cg_over_c)
    mass_properties = eqx.tree_at(lambda m: m.mass, f16.mass_properties, jnp.asarray(SLUG_KG / 1.57e-3))
    return TextbookF16(
        f16=f16,
        rounded_inertia=rounded_inertia,
        mass_properties=mass_properties,
        actuators=f16.actuators,
        engine=f16.engine,
        alpha_range=f16.alpha_range,
        beta_range=f16.beta_range,
    )


def textbook_environment() -> Environment:
    """Build the textbook's environment: its atmosphere without wind, and gravity of 32.17 ft/s^2 over a flat Earth."""
    return Environment(
        atmosphere=TextbookAtmosphere(), wind=SteadyWind(jnp.zeros(3)), earth=FlatEarth(jnp.asarray(32.17 * FOOT_M))
    )


def textbook_state(x: TextbookState, u: TextbookControls) -> AircraftState:
    """Convert the textbook's state vector to an aircraft state; the surfaces have the deflections commanded by `u`."""
    VT, alpha, beta = x[0] * FOOT_M, x[1], x[2]
    direction = [jnp.cos(alpha) * jnp.cos(beta), jnp.sin(beta), jnp.sin(alpha) * jnp.cos(beta)]
    return AircraftState(
        position_n=jnp.stack([x[9], x[10], -x[11]]) * FOOT_M,
        velocity_b=VT * jnp.stack(direction),
        quaternion=quaternion_from_euler(x[3], x[4], x[5]),
        rates_b=x[6:9],
        actuators=Deflections(u[1:] * DEG_RAD),
        engine=EnginePower(x[12]),
    )


def textbook_controls(u: TextbookControls) -> Controls:
    """Convert the textbook's control vector to controls in SI units and radians."""
    return Controls(surfaces=u[1:] * DEG_RAD, throttle=u[0])


def textbook_rates(
    airframe: AbstractAirframe, environment: Environment, x: TextbookState, u: TextbookControls
) -> TextbookState:
    """Return the time derivative of the textbook's state vector, in the vector's units per second (subroutine F)."""
    state = textbook_state(x, u)
    rate = flat_earth_derivative(airframe, environment, 0.0, state, textbook_controls(u))
    _, (V_dot, alpha_dot, beta_dot) = jax.jvp(flow_angles, (state.velocity_b,), (rate.velocity_b,))
    _, euler_rates = jax.jvp(euler_from_quaternion, (state.quaternion,), (rate.quaternion,))
    north, east, down = rate.position_n / FOOT_M
    return jnp.stack([V_dot / FOOT_M, alpha_dot, beta_dot, *euler_rates, *rate.rates_b, north, east, -down, rate.power])


SINGLE_PRECISION = 4e-7
"""Relative error of the textbook's program: about three units in the last place of single precision."""
_DIGITS = 7
"""Number of significant digits of the numbers in the turn example."""
_CONDITION_STATES = ("VT", "pN", "pE", "h")
"""States that define the turn example's condition and are not results of its trim."""
_STEADY_STATES = ("VT", "alpha", "beta", "phi", "theta", "psi", "P", "Q", "R", "h", "pow")
"""States whose rates a steady level turn fixes: every state but the horizontal position."""
_TURN_RATE_RAD_S = 0.3


def state_and_controls(figures: dict[str, Any]) -> Float[np.ndarray, "17"]:
    """Return state (13) and controls (4) of a textbook example as one vector, shape (17,), in the textbook's units.

    `figures` is the example's table in the file of published values.
    """
    controls = figures["controls"]
    surfaces = [controls[f"{name}_deg"] for name in ("elevator", "aileron", "rudder")]
    return np.array([*figures["state"], controls["throttle"], *surfaces])


@compiled_quickly
def rates_and_slopes(
    airframe: AbstractAirframe, environment: Environment, x_and_u: Float[Array, "17"]
) -> tuple[Float[Array, "13"], Float[Array, "13 17"]]:
    """Return the rates of the textbook's state vector, (13,), and the derivatives by states and controls, (13, 17)."""

    def rates(z: Float[Array, "17"]) -> Float[Array, "13"]:
        return textbook_rates(airframe, environment, z[:13], z[13:])

    value, directional_derivative = jax.linearize(rates, x_and_u)
    return value, jax.vmap(directional_derivative, out_axes=1)(jnp.eye(17))


def _rates_of(figures: dict[str, Any]) -> tuple[Float[np.ndarray, "13"], Float[np.ndarray, "13 17"]]:
    airframe, x_and_u = textbook_aircraft(figures["xcg"]), jnp.asarray(state_and_controls(figures))
    value, slopes = rates_and_slopes(airframe, textbook_environment(), x_and_u)
    return np.asarray(value), np.asarray(slopes)


def _units() -> list[str]:
    """Return the unit of each rate of the textbook's state vector, in the order of the vector."""
    units = load_published("textbook_checks")["derivative_table_3_5_2"]["rates_units"]
    return [unit.replace("/s/s", "/s^2") for unit in units]


@compiled_quickly
def _own_acceleration(
    airframe: AbstractAirframe, environment: Environment, x_and_u: Float[Array, "17"]
) -> tuple[Vector3, Vector3]:
    """Return the angular acceleration by the aircraft's own inertia, and a bound on the effect of rounded ratios.

    Both are in rad/s^2; the bound is for the printed ratios c1 to c9.
    """
    state, controls = textbook_state(x_and_u[:13], x_and_u[13:]), textbook_controls(x_and_u[13:])
    rate = flat_earth_derivative(airframe, environment, 0.0, state, controls)
    moment_b = air_data_and_forces(airframe, environment, 0.0, state).wrench.moment_b

    def acceleration(ratios: Float[Array, "9"]) -> Vector3:
        return _textbook_acceleration(ratios, state.rates_b, moment_b)

    slopes = jax.jacfwd(acceleration)(jnp.asarray(INERTIA_RATIOS))
    return rate.rates_b, jnp.abs(slopes) @ jnp.asarray([half_of_last_digit(printed) for printed in _PRINTED_RATIOS])


def _measure_derivatives() -> Iterator[Comparison]:
    table = load_published("textbook_checks")["derivative_table_3_5_2"]
    rates, _ = _rates_of(table)
    for (name, printed), unit, rate in zip(table["rates"].items(), _units(), rates, strict=True):
        yield Comparison(name, "table 3.5-2", unit, printed, float(rate), SINGLE_PRECISION * abs(printed))
    airframe = textbook_aircraft(table["xcg"], rounded_inertia=False)
    inputs = jnp.asarray(state_and_controls(table))
    accelerations, roundings = map(np.asarray, _own_acceleration(airframe, textbook_environment(), inputs))
    for name, obtained, rounding in zip(("P_dot", "Q_dot", "R_dot"), accelerations, roundings, strict=True):
        printed = table["rates"][name]
        tolerance = float(rounding) + SINGLE_PRECISION * abs(printed)
        figures, reason = (printed, float(obtained)), "half the last digit of each inertia ratio"
        yield Comparison(f"{name}, own inertia", "table 3.5-2", "rad/s^2", *figures, tolerance, tolerance_reason=reason)


def _measure_turn() -> Iterator[Comparison]:
    example = load_published("textbook_checks")["turn_example_3_6_2"]
    names = [*example["state_names"], *example["controls"]]
    states_and_controls = state_and_controls(example)
    rates, slopes = _rates_of(example)
    printed = [
        0.0 if name in _CONDITION_STATES or value == 0.0 else half_of_significant(value, _DIGITS)
        for name, value in zip(names, states_and_controls, strict=True)
    ]
    tolerances = np.abs(slopes) @ (np.array(printed) + SINGLE_PRECISION * np.abs(states_and_controls))
    for name, unit, rate, tolerance in zip(example["state_names"], _units(), rates, tolerances, strict=True):
        if name in _STEADY_STATES:
            expected = _TURN_RATE_RAD_S if name == "psi" else 0.0
            yield Comparison(f"{name}_dot", "example 3.6-2", unit, expected, float(rate), float(tolerance))


F16_DERIVATIVES = make_check("f16-derivatives", _measure_derivatives)

F16_TURN = make_check("f16-turn", _measure_turn)


_LEVEL_X_CG = 0.35
_NOISE = 1e-6
"""Printed angles below ten times this number (rad, deg) are zeros, up to the noise of the textbook's minimizer."""
_AILERON_DEG = 2e-5
"""Tolerance of the aileron, deg: half the last digit, 0.5e-5, plus 1.5e-5 for single precision.

The textbook's program resolves the sideslip rate to 5.8e-8 rad/s, 4e-7 of its terms. The corresponding sideslip is
balanced by 1.5e-5 deg of aileron in the steady turn and 1.3e-5 deg in the pull-up.
"""
_PULL_UP_RUDDER_DEG = 3e-5
"""Tolerance of the rudder in the pull-up, deg: half the last digit, 0.5e-5, plus 2.5e-5 for single precision.

The 2.5e-5 deg of rudder balance the sideslip that corresponds to the resolution of the sideslip rate.
"""

_SINGLE_PRECISION_REASON = "last digit, single precision"
_NAMES = {
    "nominal": "x_cg 0.35 c",
    "xcg030": "x_cg 0.30 c",
    "coordinated_turn": "turn of 0.3 rad/s",
    "pull_up": "pull-up of 0.3 rad/s",
}


class TextbookFlight(NamedTuple):
    """Steady flight at sea level: x_cg/c, airspeed (ft/s), turn rate, and pitch rate of a pull-up (rad/s)."""

    x_cg: float
    V_ft_s: float
    turn_rate: float
    pitch_rate: float = 0.0


def trim_published(flights: list[TextbookFlight]) -> tuple[TrimPoint, Float[np.ndarray, "flight 3"]]:
    """Trim steady flights with the textbook's constants.

    Returns the trim points, stacked over the flights, and the Euler angles phi, theta, psi (rad), shape (flight, 3).
    Raises RuntimeError if a flight has no trim; the message names the flight.
    """
    points, euler = _trim_all(textbook_aircraft(_LEVEL_X_CG), textbook_environment(), jnp.array(flights))
    for flight, converged, residual in zip(flights, points.converged, points.residual, strict=True):
        if not converged:
            raise RuntimeError(f"no trim found for {flight}: a residual of {float(residual):.1e} remains")
    return points, np.asarray(euler)


@compiled_quickly
def _trim_all(
    airframe: TextbookF16, environment: Environment, flights: Float[Array, "flight 4"]
) -> tuple[TrimPoint, Float[Array, "flight 3"]]:
    def trim_flight(
        x_cg: Scalar, V_ft_s: Scalar, turn_rate: Scalar, pitch_rate: Scalar
    ) -> tuple[TrimPoint, Float[Array, "3"]]:
        loaded = eqx.tree_at(lambda a: a.f16.x_cg, airframe, x_cg)
        target = trim_target(V_ft_s * FOOT_M, 0.0, turn_rate=turn_rate, pitch_rate=pitch_rate)
        point = solve_trim(loaded, environment, target)
        return point, jnp.stack(euler_from_quaternion(point.state.quaternion))

    return jax.vmap(trim_flight)(*flights.T)


def _measure_trims() -> Iterator[Comparison]:
    checks = load_published("textbook_checks")
    published_rows, cases = checks["trim_table_3_6_2"]["rows"], checks["trim_table_3_6_3"]["cases"]
    flights = [TextbookFlight(_LEVEL_X_CG, float(published_row["V_ft_s"]), 0.0) for published_row in published_rows]
    flights += [
        TextbookFlight(case["xcg"], case["VT_ft_s"], float(case["turn_rate_rad_s"]), float(case["pitch_rate_rad_s"]))
        for case in cases
    ]
    points, euler = trim_published(flights)
    figures = [_figures(jax.tree.map(lambda leaf, k=k: leaf[k], points), euler[k]) for k in range(len(flights))]
    split = len(published_rows)
    yield from _compare_level(published_rows, figures[:split])
    yield from _compare_cases(cases, figures[split:])


def _figures(point: TrimPoint, euler: Float[np.ndarray, "3"]) -> dict[str, float]:
    """Return the results of a trim by published name and in published units; `euler` is phi, theta, psi (rad)."""
    elevator, aileron, rudder = (float(angle) * RAD_DEG for angle in point.state.surfaces)
    power = float(point.power)
    return {
        "alpha_deg": float(point.alpha) * RAD_DEG,
        "alpha_rad": float(point.alpha),
        "beta_rad": float(point.beta),
        "phi_rad": float(euler[0]),
        "theta_rad": float(euler[1]),
        **dict(zip("PQR", map(float, point.state.rates_b), strict=True)),
        # beyond full power, the throttle of the textbook's gearing ([SL] TGEAR), which has no stop
        "throttle": (power + 117.38) / 217.38 if power > 100.0 else float(point.controls.throttle),
        "elevator_deg": elevator,
        "aileron_deg": aileron,
        "rudder_deg": rudder,
    }


def _compare_level(
    published_rows: list[dict[str, float]], trim_figures: list[dict[str, float]]
) -> Iterator[Comparison]:
    """Compare trims in level flight with the printed table: throttle to three decimals, angles to three digits."""
    for published_row, figures in zip(published_rows, trim_figures, strict=True):
        for name in ("throttle", "alpha_deg", "elevator_deg"):
            tolerance = 0.5e-3 if name == "throttle" else half_of_significant(published_row[name], 3)
            point = f"table 3.6-2, V {published_row['V_ft_s']} ft/s"
            yield Comparison(name, point, _unit(name), published_row[name], figures[name], tolerance)


def _compare_cases(cases: list[dict[str, Any]], trim_figures: list[dict[str, float]]) -> Iterator[Comparison]:
    """Compare trims in level flight, turn and pull-up with the printed cases, to four significant digits."""
    for case, figures in zip(cases, trim_figures, strict=True):
        for name, printed in case["published"].items():
            if abs(printed) < 10 * _NOISE:
                tolerance, tolerance_reason = _NOISE, "noise of their minimizer"
            elif name == "aileron_deg":
                tolerance, tolerance_reason = _AILERON_DEG, _SINGLE_PRECISION_REASON
            elif name == "rudder_deg" and case["name"] == "pull_up":
                tolerance, tolerance_reason = _PULL_UP_RUDDER_DEG, _SINGLE_PRECISION_REASON
            else:
                # the sideslip is printed with two digits: 4.8E-4 and 4.1E-5
                tolerance, tolerance_reason = half_of_significant(printed, 2 if name == "beta_rad" else 4), ""
            point, pair = f"table 3.6-3, {_NAMES[case['name']]}", (float(printed), figures[name])
            yield Comparison(name, point, _unit(name), *pair, tolerance, tolerance_reason=tolerance_reason)


def _unit(name: str) -> str:
    if name == "throttle":
        return ""
    return name.rpartition("_")[2] if "_" in name else "rad/s"


F16_TRIM = make_check("f16-trim", _measure_trims)
