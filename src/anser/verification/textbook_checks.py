"""Verification of the F-16 by Stevens & Lewis: state derivatives, the steady turn, and trims."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.airframe import AbstractAirframe
from anser.compiling.options import compiled_quickly
from anser.environment.environment import Environment
from anser.shapes import Scalar
from anser.spatial.rotations import euler_from_quaternion
from anser.steady.trim import TrimPoint, solve_trim, trim_target
from anser.units import FOOT_M, RAD_DEG
from anser.verification.checks import Check, Comparison, half_of_significant, load_published
from anser.verification.textbook import TextbookF16, textbook_aircraft, textbook_environment, textbook_rates

SINGLE_PRECISION = 4e-7
"""Relative error of the textbook's program: about three units in the last place of single precision."""
_DIGITS = 7
"""Significant digits of the numbers in the turn example."""
_CONDITION_STATES = ("VT", "pN", "pE", "h")
"""States that define the example's condition and are not results of its trim."""
_STEADY_STATES = ("VT", "alpha", "beta", "phi", "theta", "psi", "P", "Q", "R", "h", "pow")
"""States whose rates a steady level turn fixes: every state but the horizontal position."""
_TURN_RATE_RAD_S = 0.3


def state_and_controls(figures: dict[str, Any]) -> Float[np.ndarray, "17"]:
    """Return state and controls of a textbook example as one vector (17,), in the textbook's units."""
    controls = figures["controls"]
    surfaces = [controls[f"{name}_deg"] for name in ("elevator", "aileron", "rudder")]
    return np.array([*figures["state"], controls["throttle"], *surfaces])


@compiled_quickly
def rates_and_slopes(
    airframe: AbstractAirframe, environment: Environment, x_and_u: Float[Array, "17"]
) -> tuple[Float[Array, "13"], Float[Array, "13 17"]]:
    """Return the rates of the textbook's state vector and the derivatives with respect to states and controls."""

    def rates(z: Float[Array, "17"]) -> Float[Array, "13"]:
        return textbook_rates(airframe, environment, z[:13], z[13:])

    value, directional_derivative = jax.linearize(rates, x_and_u)
    return value, jax.vmap(directional_derivative, out_axes=1)(jnp.eye(17))


def _rates_of(figures: dict[str, Any]) -> tuple[Float[np.ndarray, "13"], Float[np.ndarray, "13 17"]]:
    states_and_controls = jnp.asarray(state_and_controls(figures))
    value, slopes = rates_and_slopes(textbook_aircraft(figures["xcg"]), textbook_environment(), states_and_controls)
    return np.asarray(value), np.asarray(slopes)


def _units() -> list[str]:
    """Return the units of the rates of the textbook's state vector."""
    units = load_published("textbook_checks")["derivative_table_3_5_2"]["rates_units"]
    return [unit.replace("/s/s", "/s^2") for unit in units]


def _measure_derivatives() -> tuple[Comparison, ...]:
    table = load_published("textbook_checks")["derivative_table_3_5_2"]
    rates, _ = _rates_of(table)
    return tuple(
        Comparison(name, "table 3.5-2", unit, printed, float(rate), SINGLE_PRECISION * abs(printed))
        for (name, printed), unit, rate in zip(table["rates"].items(), _units(), rates, strict=True)
    )


def _measure_turn() -> tuple[Comparison, ...]:
    example = load_published("textbook_checks")["turn_example_3_6_2"]
    names = [*example["state_names"], *example["controls"]]
    states_and_controls = state_and_controls(example)
    rates, slopes = _rates_of(example)
    printed = [
        0.0 if name in _CONDITION_STATES or value == 0.0 else half_of_significant(value, _DIGITS)
        for name, value in zip(names, states_and_controls, strict=True)
    ]
    tolerances = np.abs(slopes) @ (np.array(printed) + SINGLE_PRECISION * np.abs(states_and_controls))
    units = _units()
    return tuple(
        Comparison(
            group=f"{name}_dot",
            point="example 3.6-2",
            unit=units[k],
            expected=_TURN_RATE_RAD_S if name == "psi" else 0.0,
            obtained=float(rates[k]),
            tolerance=float(tolerances[k]),
        )
        for k, name in enumerate(example["state_names"])
        if name in _STEADY_STATES
    )


F16_DERIVATIVES = Check(
    key="f16-derivatives",
    title="F-16: the thirteen state derivatives of the check case",
    source="[SL] tab. 3.5-2",
    tolerance_reason="single precision, 4e-7",
    explanation=(
        "Centre of gravity at 0.4 c, in a steep roll and pull with large deflections: every table and every coupling "
        "term counts. Computed with the constants of the textbook's program instead of the aircraft's own: mass "
        "1/0.00157 slug, g = 32.17 ft/s^2, its simplified atmosphere, 57.3 deg per radian in CZ, and inertia ratios "
        "rounded to four digits, which move the roll acceleration by 2.0e-4 of itself. The program ran in single "
        "precision: seven digits are printed, of which the last carries its rounding (the rate of the power, -58.69 "
        "exactly, is printed as -58.68999)."
    ),
    measure=_measure_derivatives,
)

F16_TURN = Check(
    key="f16-turn",
    title="F-16: the steady turn of 0.3 rad/s at 502 ft/s is an equilibrium",
    source="[SL] ex. 3.6-2",
    tolerance_reason="last digit, single precision",
    explanation=(
        "State and controls are taken as printed, with seven digits; all their rates must vanish but that of the "
        "heading, 0.3 rad/s. Each tolerance is half a unit of the last printed digit of every state and control, and "
        "4e-7 of it for the single precision of the textbook's program (as in table 3.5-2), through the Jacobian of "
        "the rates. The digits alone do not suffice: they allow 1.3e-8 rad/s of sideslip rate and 4.2e-8 and 1.1e-8 "
        "rad/s^2 of roll and yaw acceleration, and 2.6e-8, 2.0e-7 and 5.0e-8 are left, where the textbook's minimizer "
        "could see no further."
    ),
    measure=_measure_turn,
)


_LEVEL_X_CG = 0.35
_NOISE = 1e-6
"""Printed angles of this size (rad, deg) are zeros, up to the noise of the textbook's minimizer."""
_AILERON_DEG = 2e-5
"""Half the last digit, 0.5e-5, plus 1.5e-5 for single precision.

The textbook's program resolves the sideslip rate to 5.8e-8 rad/s, 4e-7 of its terms. The corresponding sideslip is
balanced by 1.5e-5 deg of aileron in the steady turn and 1.3e-5 deg in the pull-up."""
_PULL_UP_RUDDER_DEG = 3e-5
"""Half the last digit, 0.5e-5, plus the 2.5e-5 deg of rudder that balance the corresponding sideslip in the pull-up."""

_SINGLE_PRECISION_REASON = "last digit, single precision"
_NAMES = {
    "nominal": "x_cg 0.35 c",
    "xcg030": "x_cg 0.30 c",
    "coordinated_turn": "turn of 0.3 rad/s",
    "pull_up": "pull-up of 0.3 rad/s",
}


class TextbookFlight(NamedTuple):
    """Steady flight of the textbook at sea level.

    Centre of gravity x_cg/c, airspeed (ft/s), turn rate (rad/s), and pitch rate of a pull-up (rad/s).
    """

    x_cg: float
    V_ft_s: float
    turn_rate: float
    pitch_rate: float = 0.0


def trim_published(flights: list[TextbookFlight]) -> tuple[TrimPoint, Float[np.ndarray, "flight 3"]]:
    """Trim steady flights with the textbook's constants; return stacked trim points, and Euler angles (rad).

    Raises
    ------
    RuntimeError
        A flight has no trim; the message names the flight.
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


def _measure() -> tuple[Comparison, ...]:
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
    return (*_compare_level(published_rows, figures[:split]), *_compare_cases(cases, figures[split:]))


def _figures(point: TrimPoint, euler: Float[np.ndarray, "3"]) -> dict[str, float]:
    """Return the results of a trim by their published names, in the published units."""
    elevator, aileron, rudder = (float(angle) * RAD_DEG for angle in point.state.surfaces)
    P, Q, R = (float(rate) for rate in point.state.rates_b)
    power = float(point.power)
    return {
        "alpha_deg": float(point.alpha) * RAD_DEG,
        "alpha_rad": float(point.alpha),
        "beta_rad": float(point.beta),
        "phi_rad": float(euler[0]),
        "theta_rad": float(euler[1]),
        "P": P,
        "Q": Q,
        "R": R,
        # beyond full power, the throttle of the textbook's gearing ([SL] TGEAR), which has no stop
        "throttle": (power + 117.38) / 217.38 if power > 100.0 else float(point.controls.throttle),
        "elevator_deg": elevator,
        "aileron_deg": aileron,
        "rudder_deg": rudder,
    }


def _compare_level(
    published_rows: list[dict[str, float]], trim_figures: list[dict[str, float]]
) -> Iterator[Comparison]:
    """Compare trims in level flight with the printed table.

    Tolerances: three decimals of the throttle, three significant digits of the angles (final zeros are not printed).
    """
    for published_row, figures in zip(published_rows, trim_figures, strict=True):
        for name in ("throttle", "alpha_deg", "elevator_deg"):
            tolerance = 0.5e-3 if name == "throttle" else half_of_significant(published_row[name], 3)
            point = f"table 3.6-2, V {published_row['V_ft_s']} ft/s"
            yield Comparison(name, point, _unit(name), published_row[name], figures[name], tolerance)


def _compare_cases(cases: list[dict[str, Any]], trim_figures: list[dict[str, float]]) -> Iterator[Comparison]:
    """Compare trims with the printed cases, to four significant digits.

    The sideslip has two, printed as 4.8E-4 and 4.1E-5.
    """
    for case, figures in zip(cases, trim_figures, strict=True):
        for name, printed in case["published"].items():
            if abs(printed) < 10 * _NOISE:
                tolerance, tolerance_reason = _NOISE, "noise of their minimizer"
            elif name == "aileron_deg":
                tolerance, tolerance_reason = _AILERON_DEG, _SINGLE_PRECISION_REASON
            elif name == "rudder_deg" and case["name"] == "pull_up":
                tolerance, tolerance_reason = _PULL_UP_RUDDER_DEG, _SINGLE_PRECISION_REASON
            else:
                tolerance, tolerance_reason = half_of_significant(printed, 2 if name == "beta_rad" else 4), ""
            point = f"table 3.6-3, {_NAMES[case['name']]}"
            yield Comparison(
                name, point, _unit(name), float(printed), figures[name], tolerance, tolerance_reason=tolerance_reason
            )


def _unit(name: str) -> str:
    if name == "throttle":
        return ""
    return name.rpartition("_")[2] if "_" in name else "rad/s"


F16_TRIM = Check(
    key="f16-trim",
    title="F-16: trim at sea level from 130 to 700 ft/s, in a turn and in a pull-up of 0.3 rad/s",
    source="[SL] tab. 3.6-2, 3.6-3",
    tolerance_reason="half the last digit",
    explanation=(
        "Computed with the constants of the textbook's program (see f16-derivatives). Table 3.6-2 has three digits, "
        "table 3.6-3 four; entries of 1e-6 and below are what the textbook's minimizer left of a zero and count to "
        "1e-6. The turn's aileron counts to 2e-5 deg, not to 0.5e-5: the program resolves the sideslip rate to 5.8e-8 "
        "rad/s (single precision, 4e-7 of its terms), and the sideslip that takes that up is balanced by 1.5e-5 deg "
        "of aileron; anser finds 1.7e-5 deg less than is printed. The pull-up holds P = R = 0 and the wings level, as "
        "the textbook does. There the same sideslip rate takes 1.8e-7 rad of sideslip, which 1.3e-5 deg of aileron and "
        "2.5e-5 deg of rudder balance: they count to 2e-5 and 3e-5 deg. (Turning the velocity about the level line to "
        "its right instead gives -0.000556 and 0.016606 deg.) Its throttle, beyond 1, is that of the power needed "
        "through the textbook's gearing, which has no stop."
    ),
    measure=_measure,
)
