"""Verification of linear models: the textbook's pull-up and modes, and the poles under dynamic inversion."""

from collections.abc import Iterator
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft_files.library import load_f16
from anser.analysis.linearization import CHANNELS, LinearModel, linearize
from anser.analysis.modes import inversion_poles, modes_of
from anser.compiling.options import compiled_quickly
from anser.control.gains import published_gains
from anser.control.limits import default_limits
from anser.environment.environment import Environment, standard_environment
from anser.simulation.response import LoopCase
from anser.steady.trim import TrimPoint, TrimTarget, solve_trim, trim_target
from anser.units import DEG_RAD, FOOT_M
from anser.verification.checks import (
    Check,
    Comparison,
    compare_as_printed,
    half_of_last_digit,
    load_published,
    make_check,
)
from anser.verification.textbook import textbook_aircraft, textbook_environment

_SPEED_M_S = 502.0 * FOOT_M
_X_CG = 0.30
_NAMES = {"VT": "V", "pow": "power"}
_PER_UNIT = {"VT": FOOT_M, "elevator_deg": DEG_RAD, "aileron_deg": DEG_RAD, "rudder_deg": DEG_RAD}
"""Factor from the textbook's unit to SI units and radians by quantity; 1 for quantities not listed."""
_PRINTED_MODES = (
    ("short period", "-1.2039", "1.4922"),
    ("phugoid", "-0.0087", "0.0739"),
    ("Dutch roll", "-0.4399", "3.220"),
    ("roll", "-3.601", "0"),
    ("spiral", "-0.0128", "0"),
)
"""Modes of example 3.8-1: name, real part (1/s) and imaginary part (rad/s) of the eigenvalue, as printed."""


@compiled_quickly
def linear_flight(
    airframe: AbstractAirframe, environment: Environment, target: TrimTarget
) -> tuple[TrimPoint, LinearModel]:
    """Trim a steady flight, linearize the aircraft there, and return the trim point and the linear model.

    The throttle of the linearization is at most 0.99, because the textbook's gearing has no stop at full throttle.
    """
    point = solve_trim(airframe, environment, target)
    controls = eqx.tree_at(lambda c: c.throttle, point.controls, jnp.minimum(point.controls.throttle, 0.99))
    return point, linearize(airframe, environment, point.state, controls)


def _textbook_model(pitch_rate: float) -> LinearModel:
    target = trim_target(_SPEED_M_S, 0.0, pitch_rate=pitch_rate)
    return linear_flight(textbook_aircraft(_X_CG), textbook_environment(), target)[1]


def printed_block(
    model: LinearModel, matrix: str, row_states: list[str], column_states: list[str]
) -> Float[np.ndarray, "r c"]:
    """Return a block of a linear model's matrix (`matrix`: "A", "B", "C" or "D"), in the textbook's units.

    `row_states` and `column_states` select rows and columns by the textbook's names of states, outputs and inputs.
    """
    row_names = model.outputs if matrix in "CD" else model.states
    column_names = model.inputs if matrix in "BD" else model.states
    values = np.asarray(getattr(model, matrix))

    def index_of(name: str, names: tuple[str, ...]) -> int:
        return names.index(_NAMES.get(name, name.removesuffix("_deg")))

    def entry(row_state: str, column_state: str) -> float:
        value = values[index_of(row_state, row_names), index_of(column_state, column_names)]
        return float(value) * _PER_UNIT.get(column_state, 1.0) / _PER_UNIT.get(row_state, 1.0)

    return np.array([[entry(row_state, column_state) for column_state in column_states] for row_state in row_states])


def printed_tolerances(printed: Float[np.ndarray, "r c"]) -> Float[np.ndarray, "r c"]:
    """Return the tolerance of each printed number: half a unit of its last digit.

    Numbers of 1000 or more are printed with four significant digits, numbers below 0.001 with one, other numbers with
    three. A printed 0 has the least tolerance of the other numbers in its row.
    """
    size = np.abs(printed)
    digits = np.where(size < 1e-3, 1, np.where(size >= 1000, 4, 3))
    unit = 10.0 ** (np.floor(np.log10(np.where(size > 0, size, 1.0))) - digits + 1)
    smallest = np.min(np.where(size > 0, unit, np.inf), axis=1, keepdims=True)
    return 0.5 * np.where(size > 0, unit, np.where(np.isfinite(smallest), smallest, 1e-12))


def _pull_up() -> Iterator[Comparison]:
    published: dict[str, Any] = load_published("textbook_checks")["pull_up_linearization"]
    model = _textbook_model(0.3)
    longitudinal, lateral = published["state_order"][:5], published["state_order"][5:]
    blocks = (
        ("A", longitudinal, longitudinal, "A_lon"),
        ("A", lateral, lateral, "A_lat"),
        ("B", longitudinal + lateral, published["input_order"], "B"),
    )
    for matrix, row_states, column_states, key in blocks:
        printed = np.array(published[key], dtype=float)
        figures = np.stack(
            [printed, printed_block(model, matrix, row_states, column_states), printed_tolerances(printed)], axis=-1
        )
        for i, row_state in enumerate(row_states):
            for j, column_state in enumerate(column_states):
                point = f"d({row_state}_dot)/d({column_state})"
                yield Comparison(key, point, "ft, rad, s, %", *figures[i, j].tolist())


def _modes() -> Iterator[Comparison]:
    model = _textbook_model(0.0)
    order = load_published("textbook_checks")["pull_up_linearization"]["state_order"]
    mode_names = {mode.name for mode in modes_of(model)}
    for name, real, imaginary in _PRINTED_MODES:
        states = order[:5] if name in ("short period", "phugoid") else order[5:]
        values = np.linalg.eigvals(printed_block(model, "A", states, states))
        printed = complex(float(real), float(imaginary))
        nearest = values[np.argmin(np.abs(values - printed))]
        yield compare_as_printed(name, "real part", "1/s", real, nearest.real)
        is_cut_off = name == "phugoid"
        tolerance = half_of_last_digit(imaginary) * (2 if is_cut_off else 1) if printed.imag else 1e-12
        obtained = float(abs(nearest.imag) if printed.imag else nearest.imag)
        reason = "last digit cut, not rounded" if is_cut_off else ""
        figures = printed.imag, obtained, tolerance
        yield Comparison(name, "imaginary part", "rad/s", *figures, tolerance_reason=reason)
        yield Comparison(
            "found by name", name, "", 1.0, float(name in mode_names), 0.0, tolerance_reason="a name or none"
        )


def _poles() -> Iterator[Comparison]:
    airframe, environment = load_f16(), standard_environment()
    point = compiled_quickly(solve_trim)(airframe, environment, trim_target(150.0, 2000.0))
    gains, limits = published_gains(), default_limits()
    for loop, channels in CHANNELS.items():
        poles = inversion_poles(LoopCase(airframe, environment, gains, limits, point, 0.01), loop)
        per_channel = len(poles) // len(channels)
        for k, pole in enumerate(poles):
            channel_and_pole = f"{channels[k // per_channel]}, {pole.ideal.real:.4g} 1/s"
            limit, tolerance = pole.limit_pole, pole.tolerance
            yield Comparison(f"{loop} loop", channel_and_pole, "1/s", pole.ideal.real, limit.real, tolerance)
            yield Comparison(f"{loop} loop, imaginary", channel_and_pole, "1/s", 0.0, limit.imag, tolerance)
            yield Comparison(f"{loop} loop, as flown", channel_and_pole, "1/s", None, pole.sampled_pole.real, None)


LINEAR_CHECKS: tuple[Check, ...] = (
    make_check("f16-pull-up", _pull_up),
    make_check("f16-modes", _modes),
    make_check("inversion-poles", _poles),
)
