"""Model structures of identification: short period, lateral motion, and derivatives of the aerodynamic coefficients.

Each model is a set of equations with one response each, linear in the parameters.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.signal import bilinear, lfilter

from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.corrected_airframe import reference_lengths
from anser.identification.coefficients import (
    airframe_derivatives,
    compute_coefficients,
)
from anser.identification.kinematics import (
    RATES,
    gust_rates,
    record_gravity,
    with_attitude,
    with_specific_force,
)
from anser.identification.records import FlightRecord
from anser.identification.smoothing import integrate, noise_level, smooth

MODELS = ("short-period", "lateral", "derivatives")
"""Names of the model structures, as arguments of `anser.identify`."""
LONGITUDINAL, LATERAL = ("CL", "CD", "Cm"), ("CY", "Cl", "Cn")
_EXCITATION_MIN = 0.5
"""Least ratio of the standard deviation of a smoothed regressor to its noise; a regressor below this ratio is left out.

The ratio is small because only a fifth of the noise lies within the band of the motion."""
_MOTION_MIN = {"alpha": 2e-3, "beta": 2e-3, "p": 2e-4, "q": 2e-5, "r": 1e-4}
"""Ten times the least standard deviation of an excited motion variable: rad; rates non-dimensional or in rad/s."""
SURFACE_MIN = 5e-4
"""Least standard deviation of a deflection that counts as moved, rad."""
_EFFECT_MIN = 0.05
"""Least ratio of a surface's moment derivative to its greatest one at which the surface is a regressor of an axis."""

_GUST_NOTES: tuple[str, ...] = (
    "Turbulence: the rates of the air are regressors, q_gust and r_gust, with the sign of the rates of alpha and beta; "
    "the motion that the surfaces cause is the instrument of the regression in frequency.",
)

Series = Float[np.ndarray, " sample"]


class Equation(NamedTuple):
    """An equation linear in its parameters: a response, or its rate, equals a sum of regressors times parameters.

    Attributes
    ----------
    response, values
        Name of the response, and its measured values minus the known parts (gravity and gusts; `assumed_part`).
    prefix, regressors
        Start of the parameters' names, such as `CL`; regressors by the ending, such as `alpha` for `CL_alpha`.
    noise
        Standard deviations of the white noise of the regressors, by the same endings.
    is_rate
        Whether the equation is for the time derivative of the response.
    other_arguments
        Arguments of a coefficient that are not regressors, by name: the series, or its mean if it hardly varies.
    assumed_part
        Sum of `other_arguments` times the aircraft's derivatives, which `values` does not contain.
    """

    response: str
    prefix: str
    values: Series
    regressors: dict[str, Series]
    noise: dict[str, float]
    is_rate: bool
    other_arguments: Mapping[str, Series | float] = MappingProxyType({})
    assumed_part: Series | float = 0.0


class ModelData(NamedTuple):
    """A record with the equations of a model.

    `airframe` gives mass properties and known derivatives. `is_turbulent` is true if pitch or yaw rates of the air,
    from gusts, are among the regressors. `notes` are remarks on turbulence and on parameters that are not estimated.
    """

    record: FlightRecord
    equations: tuple[Equation, ...]
    airframe: AbstractAirframe | None
    is_turbulent: bool
    notes: tuple[str, ...]


def arrange(
    model: str,
    record: FlightRecord,
    airframe: AbstractAirframe | None,
    accelerometer_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    *,
    gusts: bool = True,
) -> ModelData:
    """Return the equations of `model` (a name in `MODELS`), with series from a record for response and regressors.

    In turbulence, the pitch and yaw rates of the air are the regressors `q_gust` and `r_gust`; `gusts=False` omits them
    from the linear models `short-period` and `lateral`. `accelerometer_m` is the position of the accelerometers
    relative to the centre of gravity, body axes, m.

    Raises ValueError if the record lacks a channel, if no surface moved, or if `airframe` is None for `derivatives`;
    also if one state of a linear model, or every flow angle and rate for `derivatives`, varies no more than its noise.
    """
    if model == "derivatives":
        if airframe is None:
            raise ValueError("aircraft: arrived none; expected an aircraft with mass, inertia and reference lengths")
        return _derivatives(record, airframe, accelerometer_m)
    if gusts:
        try:
            record = with_specific_force(record, accelerometer_m)
        except ValueError:
            gusts = False  # without forces the air and the aircraft cannot be told apart
    return arrange_linear(model, record, airframe, gust_rates(record) if gusts else {})


def _derivatives(
    record: FlightRecord, airframe: AbstractAirframe, accelerometer_m: tuple[float, float, float]
) -> ModelData:
    history = compute_coefficients(record, airframe, accelerometer_m=accelerometer_m)
    lengths, V = reference_lengths(airframe), float(np.mean(record["airspeed"]))
    scales = np.array([lengths.span, lengths.mean_chord, lengths.span], dtype=float) / (2.0 * V)
    noise = dict(zip(("p", "q", "r"), noise_level(record.stack(*RATES)) * scales, strict=True))
    series = dict(history.arguments)
    noise |= {key: float(noise_level(series[key])) for key in ("alpha", "beta")}
    series["alpha2"] = (series["alpha"] - np.mean(series["alpha"])) ** 2
    noise["alpha2"] = float(np.sqrt(4.0 * np.var(series["alpha"]) + 2.0 * noise["alpha"] ** 2) * noise["alpha"])
    moved = _moved_surfaces(record)
    effects, own = _surface_axes(record, airframe, moved), airframe_derivatives(airframe, record)
    still = {name: float(np.mean(record[name])) for name in record.surfaces if name in record and name not in moved}
    gusts = gust_rates(history.record)
    for flow, rate, length in (("alpha", "q", scales[1]), ("beta", "r", scales[2])):
        if flow in gusts:
            series[f"{rate}_gust"] = _averaged(gusts[flow], flow, airframe, record) * length
    equations, notes = [], list(_GUST_NOTES[: bool(gusts)])
    for coefficient in (*LONGITUDINAL, *LATERAL):
        if coefficient in LONGITUDINAL:
            flow = ("alpha", "alpha2", "q") if coefficient == "CD" else ("alpha", "q")
            surfaces = effects["longitudinal"]
        else:
            flow, surfaces = ("beta", "p", "r"), effects["lateral"]
        excited = [name for name in flow if name != "alpha2" and _is_excited(name, series[name])]
        excited += ["alpha2"] if "alpha2" in flow and "alpha" in excited else []
        if not excited:
            notes.append(f"{coefficient} is not estimated: {', '.join(flow)} vary no more than their noise.")
            continue
        gust = "q_gust" if coefficient in LONGITUDINAL else "r_gust"
        names = (*excited, *surfaces, *([gust] if gust in series else []))
        idle = [name for name in flow if name not in excited]
        notes += [f"{coefficient}_{name} is not estimated: {name} varies no more than its noise." for name in idle]
        regressors = {name: series[name] for name in names}
        levels = {name: float(noise.get(name, 0.0)) for name in names}
        # The effects of other arguments are those of the aircraft, with their part of the coefficient's constant.
        others: dict[str, Series | float] = {name: float(np.mean(series[name])) for name in idle}
        others |= still | {name: series[name] for name in moved if name not in surfaces}
        assumed_part = sum(own.get(f"{coefficient}_{name}", 0.0) * x for name, x in others.items())
        values = history.coefficients[coefficient] - assumed_part
        equations.append(Equation(coefficient, coefficient, values, regressors, levels, False, others, assumed_part))
    if not equations:
        raise ValueError("record: arrived without excitation of flow angles and rates; expected a manoeuvre")
    return ModelData(record, tuple(equations), airframe, bool(gusts), tuple(notes))


def arrange_linear(
    model: str, record: FlightRecord, airframe: AbstractAirframe | None, gusts: Mapping[str, Series]
) -> ModelData:
    """Return the equations of `short-period` (states alpha, q) or `lateral` (beta, p, r) with the data of a record.

    `gusts` are the rates of alpha and beta from `gust_rates`, rad/s; empty for calm air. If an airframe is given, the
    inputs are only the surfaces with a moment about the model's axes. Raises ValueError if the record lacks a channel,
    a state varies no more than its noise, or no surface moved.
    """
    record = with_attitude(record)
    moved = _moved_surfaces(record)
    V, alpha = record.stack("airspeed", "alpha")
    gx, gy, gz = record_gravity(record)
    states = {"alpha": alpha, "beta": record.channels.get("beta", np.zeros_like(alpha))}
    states |= dict(zip(("p", "q", "r"), record.stack(*RATES), strict=True))
    if model == "short-period":
        names, prefixes = ("alpha", "q"), ("Z", "M")
        gravity = (gz * np.cos(alpha) - gx * np.sin(alpha)) / V
    else:
        names, prefixes = ("beta", "p", "r"), ("Y", "L", "N")
        gravity = gy / V
    if airframe is not None:
        moved = _surface_axes(record, airframe, moved)["longitudinal" if model == "short-period" else "lateral"]
    noise = {name: float(noise_level(states[name])) for name in names}
    silent = [name for name in names if not _is_excited(name, states[name])]
    if silent or not moved:
        arrived = f"{', '.join(silent)} that vary no more than their noise" if silent else "no surface that moved"
        raise ValueError(f"record: arrived {arrived}; expected a manoeuvre that excites the model {model}")
    regressors = {name: states[name] for name in names} | {name: record[name] for name in moved}
    flow, rate = ("alpha", "q") if model == "short-period" else ("beta", "r")
    if flow in gusts:
        gravity = gravity + gusts[flow]
        regressors[f"{rate}_gust"] = _averaged(gusts[flow], flow, airframe, record)
    equations = []
    for name, prefix in zip(names, prefixes, strict=True):
        # The part of the rate that gravity and gusts explain is known: its integral is subtracted from the flow angle.
        known = integrate(gravity - np.mean(gravity), record.step_s) if name in ("alpha", "beta") else 0.0
        levels = {key: noise.get(key, 0.0) for key in regressors}
        equations.append(Equation(name, prefix, states[name] - known, regressors, levels, is_rate=True))
    return ModelData(record, tuple(equations), airframe, flow in gusts, _GUST_NOTES[: flow in gusts])


def _averaged(gust: Series, flow: str, airframe: AbstractAirframe | None, record: FlightRecord) -> Series:
    """Return a gust rate (rad/s) averaged over the aircraft by a first-order lag; unchanged if there is no airframe.

    The time constant is 4 b / (pi V) for the flow angle `alpha` and 3 b / (pi V) for `beta`, with the span b
    (MIL-F-8785C, section 3.7).
    """
    if airframe is None:
        return gust
    V, span = float(np.mean(record["airspeed"])), float(reference_lengths(airframe).span)
    constant = {"alpha": 4.0, "beta": 3.0}[flow] * span / (np.pi * V) / record.step_s
    b, a = bilinear([1.0], [constant, 1.0], 1.0)
    return np.asarray(lfilter(b, a, gust))


def _is_excited(name: str, values: Series) -> bool:
    return _varies(values, 0.1 * _MOTION_MIN[name])


def _varies(values: Series, least: float) -> bool:
    """Return whether the smoothed values' standard deviation exceeds `least` and half of the noise level."""
    smoothed = smooth(values, 1.0)
    return float(np.std(smoothed.values)) > max(_EXCITATION_MIN * float(smoothed.noise), least)


def _moved_surfaces(record: FlightRecord) -> tuple[str, ...]:
    moved = tuple(name for name in record.surfaces if name in record and _varies(record[name], SURFACE_MIN))
    if not moved:
        present = [name for name in record.surfaces if name in record]
        arrived = f"{', '.join(present)} that do not move" if present else f"none of {', '.join(record.surfaces)}"
        raise ValueError(f"record: arrived {arrived}; expected the deflections of a manoeuvre, deg")
    return moved


def _surface_axes(record: FlightRecord, airframe: AbstractAirframe, moved: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Return the moved surfaces with pitching moments (`longitudinal`) and with roll or yaw moments (`lateral`).

    A surface without any moment in the airframe's model is in both groups.
    """
    own = airframe_derivatives(airframe, record)
    axes: dict[str, tuple[str, ...]] = {"longitudinal": (), "lateral": ()}
    for name in moved:
        roll, pitch, yaw = (abs(own[f"{moment}_{name}"]) for moment in ("Cl", "Cm", "Cn"))
        least = _EFFECT_MIN * max(roll, pitch, yaw)
        axes["longitudinal"] += (name,) if pitch >= least else ()
        axes["lateral"] += (name,) if max(roll, yaw) >= least else ()
    return axes
