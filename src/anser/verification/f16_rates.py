"""The F-16's state derivative and steady turn against what Stevens & Lewis print."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft import AbstractAirframe
from anser.compiling import compiled_quickly
from anser.environment import Environment
from anser.verification.check import Check, Comparison
from anser.verification.published import half_of_significant, published
from anser.verification.textbook import textbook_aircraft, textbook_environment, textbook_rates

SINGLE_PRECISION = 4e-7
"""Relative error of the textbook's program: some three units in the last place of single precision."""
_DIGITS = 7
"""Significant digits of the turn example's figures."""
_EXACT = ("VT", "pN", "pE", "h")
"""States that are the condition of the example, not results of its trim."""
_STEADY = ("VT", "alpha", "beta", "phi", "theta", "psi", "P", "Q", "R", "h", "pow")
"""States whose rates a steady level turn fixes: all but the horizontal position."""
_TURN_RATE_RAD_S = 0.3


def state_and_controls(figures: dict[str, Any]) -> Float[np.ndarray, "17"]:
    """State and controls of one of the textbook's figures, as its program has them: one vector, its units."""
    controls = figures["controls"]
    surfaces = [controls[f"{name}_deg"] for name in ("elevator", "aileron", "rudder")]
    return np.array([*figures["state"], controls["throttle"], *surfaces])


@compiled_quickly
def rates_and_slopes(
    airframe: AbstractAirframe, environment: Environment, x_and_u: Float[Array, "17"]
) -> tuple[Float[Array, "13"], Float[Array, "13 17"]]:
    """Rates of the textbook's state vector and their derivatives by all states and controls."""

    def rates(z: Float[Array, "17"]) -> Float[Array, "13"]:
        return textbook_rates(airframe, environment, z[:13], z[13:])

    value, push = jax.linearize(rates, x_and_u)
    return value, jax.vmap(push, out_axes=1)(jnp.eye(17))


def _rates_of(figures: dict[str, Any]) -> tuple[Float[np.ndarray, "13"], Float[np.ndarray, "13 17"]]:
    given = jnp.asarray(state_and_controls(figures))
    value, slopes = rates_and_slopes(textbook_aircraft(figures["xcg"]), textbook_environment(), given)
    return np.asarray(value), np.asarray(slopes)


def _units() -> list[str]:
    """Units of the rates."""
    units = published("textbook_checks")["derivative_table_3_5_2"]["rates_units"]
    return [unit.replace("/s/s", "/s^2") for unit in units]


def _measure_derivatives() -> tuple[Comparison, ...]:
    table = published("textbook_checks")["derivative_table_3_5_2"]
    rates, _ = _rates_of(table)
    return tuple(
        Comparison(name, "table 3.5-2", unit, printed, float(rate), SINGLE_PRECISION * abs(printed))
        for (name, printed), unit, rate in zip(table["rates"].items(), _units(), rates, strict=True)
    )


def _measure_turn() -> tuple[Comparison, ...]:
    example = published("textbook_checks")["turn_example_3_6_2"]
    names = [*example["state_names"], *example["controls"]]
    given = state_and_controls(example)
    rates, slopes = _rates_of(example)
    printed = [
        0.0 if name in _EXACT or value == 0.0 else half_of_significant(value, _DIGITS)
        for name, value in zip(names, given, strict=True)
    ]
    tolerances = np.abs(slopes) @ (np.array(printed) + SINGLE_PRECISION * np.abs(given))
    units = _units()
    return tuple(
        Comparison(
            group=f"{name}_dot",
            where="example 3.6-2",
            unit=units[k],
            expected=_TURN_RATE_RAD_S if name == "psi" else 0.0,
            obtained=float(rates[k]),
            tolerance=float(tolerances[k]),
        )
        for k, name in enumerate(example["state_names"])
        if name in _STEADY
    )


F16_DERIVATIVES = Check(
    key="f16-derivatives",
    title="F-16: the thirteen state derivatives of the check case",
    source="[SL] tab. 3.5-2",
    why="single precision, 4e-7",
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
    why="last digit, single precision",
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
