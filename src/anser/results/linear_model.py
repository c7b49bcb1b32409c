"""A linear model and its modes, labelled: as a dataset and as plain data for JSON. SI units and radians throughout."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from anser.results.plain import finite_or_none
from anser.results.provenance import version_attributes, versions
from anser.simulation import LinearModel, Mode, wind_axis_states
from anser.variables import STANDARD_SURFACES

LINEAR_FORMAT_VERSION = 1
"""Raised when a name is taken away or changes its meaning."""

_UNITS = {
    **dict.fromkeys(("alpha", "beta", "phi", "theta", "psi", "gamma", "chi", "mu"), "rad"),
    **dict.fromkeys(("P", "Q", "R", "P_w", "R_w"), "rad s-1"),
    "V": "m s-1",
    "altitude": "m",
    "power": "percent",
    "throttle": "1",
    "n_z": "1",
    # the memory of the autopilot's sensors
    **dict.fromkeys(("X", "Y", "Z"), "N"),
    **dict.fromkeys(("P_dot", "Q_dot", "R_dot"), "rad s-2"),
}
_SAME_UNIT = ("filter", "slow", "command", "residual", "last")
_TIMES_SECOND = {"rad": "rad s", "rad s-1": "rad", "m s-1": "m"}

_MODE_FIGURES = {
    "eigenvalue_real": ("s-1", "Real part of the eigenvalue, in continuous time"),
    "eigenvalue_imag": ("s-1", "Imaginary part of the eigenvalue, in continuous time"),
    "natural_frequency": ("rad s-1", "Natural frequency of the undamped oscillation"),
    "damping_ratio": ("1", "Damping ratio"),
    "time_constant": ("s", "Time constant of the envelope; negative if it grows"),
    "period": ("s", "Period"),
    "time_to_half": ("s", "Time to half the amplitude; negative: minus the time to double"),
}
"""Units and words; the names in dataset and JSON have the unit as their suffix."""
_SUFFIX = {"s-1": "_1_s", "rad s-1": "_rad_s", "1": "", "s": "_s"}


def unit_of(name: str, surfaces: Sequence[str] = STANDARD_SURFACES) -> str:
    """Unit of a state, an input or an output, as CF writes it.

    Parameters
    ----------
    name
        In a `LinearModel`.
    surfaces
        Names of the airframe's control surfaces.

    Raises
    ------
    ValueError
        No unit is known for this name.
    """
    moving = {f"{surface}_velocity": "rad s-1" for surface in surfaces}
    units = {**_UNITS, **dict.fromkeys(surfaces, "rad"), **moving}
    channel, _, kind = name.rpartition("_")
    base = channel if kind in (*_SAME_UNIT, "integral") and name not in units else name
    if base not in units:
        raise ValueError(f"no unit is known for {name}, of an aircraft with the surfaces {', '.join(surfaces)}")
    return _TIMES_SECOND[units[base]] if base != name and kind == "integral" else units[base]


def linear_dataset(
    model: LinearModel, modes: Sequence[Mode], attributes: Mapping[str, str | int | float]
) -> xr.Dataset:
    """Label a linear model and its modes.

    Parameters
    ----------
    model, modes
        The model and what `modes_of` makes of it.
    attributes
        What it is a model of.

    Returns
    -------
    xr.Dataset
        A (state_rate, state), B (state_rate, input), C (output, state), D (output, input); the condition that is
        departed from; figures of the modes over (mode) and what part each state has in them over (mode, wind_state),
        see `wind_axis_states`. An element of A has the unit of its row, per second in continuous time, over that of its
        column: `state_unit` and so on stand beside the names. Infinite times are inf.
    """
    sampled = float(model.step) > 0
    wind_states, _ = wind_axis_states(model)
    coordinates: dict[str, Any] = {}
    for dimension, names in (
        ("state_rate", model.states),
        ("state", model.states),
        ("input", model.inputs),
        ("output", model.outputs),
        ("wind_state", wind_states),
    ):
        coordinates[dimension] = (dimension, np.array(names))
        coordinates[f"{dimension}_unit"] = (dimension, np.array([unit_of(name, model.surfaces) for name in names]))
    coordinates["mode_name"] = ("mode", np.array([mode.name for mode in modes]))
    coordinates["mode_order"] = ("mode", np.array([mode.order for mode in modes], dtype=np.int32))
    after = "next states" if sampled else "rates of the states"
    data: dict[str, Any] = {
        "A": (("state_rate", "state"), np.asarray(model.A), {"long_name": f"From states to {after}"}),
        "B": (("state_rate", "input"), np.asarray(model.B), {"long_name": f"From inputs to {after}"}),
        "C": (("output", "state"), np.asarray(model.C), {"long_name": "From states to outputs"}),
        "D": (("output", "input"), np.asarray(model.D), {"long_name": "From inputs to outputs"}),
        "state_at_condition": ("state", np.asarray(model.x), {"long_name": "State departed from"}),
        "rate_at_condition": ("state", np.asarray(model.x_dot), {"long_name": "Its rate"}),
        "input_at_condition": ("input", np.asarray(model.u), {"long_name": "Input departed from"}),
        "output_at_condition": ("output", np.asarray(model.y), {"long_name": "Output departed from"}),
    }
    for name, (row, column) in {"A": ("state", "state"), "B": ("state", "input"), "C": ("output", "state")}.items():
        per_second = " s-1" if name != "C" and not sampled else ""
        data[name][2]["units"] = f"{row}_unit{per_second} / {column}_unit"
    data["D"][2]["units"] = "output_unit / input_unit"
    for name, over in (("state", ""), ("rate", " s-1"), ("input", ""), ("output", "")):
        data[f"{name}_at_condition"][2]["units"] = f"{'state' if name == 'rate' else name}_unit{over}"
    for name, (unit, words) in _MODE_FIGURES.items():
        values = np.array([_figure(mode, name) for mode in modes])
        data[name + _SUFFIX[unit]] = ("mode", values, {"units": unit, "long_name": words})
    shares = np.array([[dict(mode.shares)[state] for state in wind_states] for mode in modes])
    data["share"] = (("mode", "wind_state"), shares, {"units": "1", "long_name": "Part of a state in a mode"})
    return xr.Dataset(data, coordinates, {**attributes, "step_s": float(model.step), **version_attributes()})


def linear_document(
    model: LinearModel, modes: Sequence[Mode], attributes: Mapping[str, str | int | float]
) -> dict[str, Any]:
    """Say the same as `linear_dataset` in plain data: names, numbers, lists; infinite times are None."""
    return {
        "format_version": LINEAR_FORMAT_VERSION,
        "provenance": versions(),
        "condition": dict(attributes),
        "units": "SI and radians",
        "step_s": float(model.step),
        "states": _named(model.surfaces, model.states, model.x, model.x_dot),
        "inputs": _named(model.surfaces, model.inputs, model.u),
        "outputs": _named(model.surfaces, model.outputs, model.y),
        **{name: np.asarray(getattr(model, name)).tolist() for name in "ABCD"},
        "modes": [
            {
                "name": mode.name,
                "order": mode.order,
                **{
                    name + _SUFFIX[unit]: finite_or_none(_figure(mode, name))
                    for name, (unit, _) in _MODE_FIGURES.items()
                },
                "shares": {state: share for state, share in mode.shares if share >= 0.005},
            }
            for mode in modes
        ],
    }


def _named(surfaces: Sequence[str], names: tuple[str, ...], values: Any, rates: Any = None) -> list[dict[str, Any]]:
    columns = {"value": values} if rates is None else {"value": values, "rate": rates}
    rows = zip(names, *columns.values(), strict=True)
    return [
        {"name": n, "unit": unit_of(n, surfaces), **dict(zip(columns, map(float, of), strict=True))} for n, *of in rows
    ]


def _figure(mode: Mode, name: str) -> float:
    if name.startswith("eigenvalue"):
        return mode.eigenvalue.real if name.endswith("real") else mode.eigenvalue.imag
    return getattr(mode, name)
