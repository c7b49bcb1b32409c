"""The linear model about a trim point with its modes.

As a labelled dataset, as JSON and as a python-control system.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import xarray as xr

from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.f16 import AbstractF16
from anser.analysis.linearization import CHANNELS, LinearModel, linearize_loop
from anser.analysis.linearization import linearize as linear_model
from anser.analysis.modes import Mode, modes_of, wind_axis_states
from anser.analysis.trim_points import ConditionError, resolve_airframe, steady_trim
from anser.compiling.options import compiled, enable_compilation_cache
from anser.control.gains import AutopilotGains, published_gains
from anser.control.inversion_autopilot import Loop
from anser.control.limits import FlightLimits, default_limits
from anser.environment.environment import Environment, standard_environment
from anser.results.documents import (
    finite_or_none,
    install_hint,
    notebook_table,
    software_versions,
    version_attributes,
    write_json,
)
from anser.results.netcdf import write_netcdf
from anser.simulation.response import LoopCase
from anser.steady.trim import TrimPoint, trim_target
from anser.units import DEG_RAD, RAD_DEG
from anser.variables import STANDARD_SURFACES

if TYPE_CHECKING:
    import control


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
        "provenance": software_versions(),
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


_HELD = 0.01
"""Error that a loop may have while it holds a trim point, in rad, rad/s or m/s. In a steady turn it asks for a sideslip
of 0 where the trim point has some tenths of a millirad."""

_MODE = ("mode", "natural frequency, rad/s", "damping ratio", "time constant, s")

_open_model = compiled(linear_model)


@dataclasses.dataclass(frozen=True, repr=False)
class LinearizationResult:
    """A linear model with its modes; printed, it is these.

    Attributes
    ----------
    model
        Matrices, names, and the condition.
    modes
        Fastest first.
    trim
        The trim point that it is a model about.
    condition
        What was asked for, with units in the names.
    """

    model: LinearModel
    modes: tuple[Mode, ...]
    trim: TrimPoint
    condition: dict[str, str | float | int]

    def __repr__(self) -> str:
        rows = [{key: key for key in _MODE}, *self._modes()]
        widths = [max(len(row[key]) for row in rows) for key in _MODE]
        lines = (
            "  ".join(
                f"{cell:<{w}}" if k == 0 else f"{cell:>{w}}"
                for k, (cell, w) in enumerate(zip(row.values(), widths, strict=True))
            )
            for row in rows
        )
        return "\n".join([self._title(), *(f"  {one}" for one in lines)])

    def _repr_html_(self) -> str:
        return notebook_table(self._title(), self._modes())

    def _title(self) -> str:
        of, model = self.condition, self.model
        sizes = f"{len(model.states)} states, {len(model.inputs)} inputs, {len(model.outputs)} outputs"
        return f"{of['aircraft']} at {of['speed_m_s']:g} m/s and {of['altitude_m']:g} m, {of['loop']} loop: {sizes}"

    def _modes(self) -> list[dict[str, str]]:
        numbers = ((one.natural_frequency, one.damping_ratio, one.time_constant) for one in self.modes)
        cells = (
            (one.name, *(f"{value:.4g}" for value in three)) for one, three in zip(self.modes, numbers, strict=True)
        )
        return [dict(zip(_MODE, row, strict=True)) for row in cells]

    @property
    def dataset(self) -> xr.Dataset:
        """All of it, labelled: see `anser.results.linear_dataset`."""
        return linear_dataset(self.model, self.modes, self.condition)

    def document(self) -> dict[str, Any]:
        """All of it in plain data, for JSON."""
        return linear_document(self.model, self.modes, self.condition)

    def state_space(self) -> "control.StateSpace":
        """System of the python-control library, with the names; sampled if the model is.

        Raises
        ------
        ImportError
            The library is not installed.
        """
        try:
            import control
        except ImportError:
            raise ImportError(install_hint("python-control", "control")) from None
        model = self.model
        return control.StateSpace(
            *(np.asarray(matrix) for matrix in (model.A, model.B, model.C, model.D)),
            float(model.step),
            states=list(model.states),
            inputs=list(model.inputs),
            outputs=list(model.outputs),
            name=str(self.condition["aircraft"]),
        )

    def write(self, path: Path) -> None:
        """Write a new file: NetCDF or JSON, by the suffix.

        Raises
        ------
        FileExistsError
            `path` exists: nothing is overwritten.
        ValueError
            Another suffix.
        """
        if path.suffix == ".nc":
            write_netcdf(self.dataset, path)
        elif path.suffix == ".json":
            write_json(self.document(), path)
        else:
            raise ValueError(f"{path}: expected a name that ends with .nc or .json")


def linearize(
    aircraft: str | AbstractAirframe = "f16",
    variant: str = "textbook",
    *,
    speed_m_s: float,
    altitude_m: float,
    x_cg_over_c: float | None = None,
    path_angle_deg: float = 0.0,
    turn_rate_deg_s: float = 0.0,
    path_rate_deg_s: float = 0.0,
    pitch_rate_deg_s: float = 0.0,
    loop: Literal["open", "rates", "attitude", "velocity"] = "open",
    actuators: bool = False,
    step_s: float = 0.01,
    environment: Environment | None = None,
    gains: AutopilotGains | None = None,
) -> LinearizationResult:
    """Trim an aircraft and linearize it there, by itself or under its autopilot.

    Parameters
    ----------
    aircraft
        Name of an airframe of the library, or an airframe.
    variant, x_cg_over_c
        Of the library's airframe: see `load_airframe`.
    speed_m_s, altitude_m
        True airspeed and geometric altitude.
    path_angle_deg, turn_rate_deg_s, path_rate_deg_s
        Climb angle; rate of the course, right positive; rate of the climb angle, up positive (a path bent upwards).
    pitch_rate_deg_s
        Body pitch rate of a pull-up with wings level and no roll and yaw rate ([SL] section 3.6); not with the two
        rates above.
    loop
        "open": the aircraft by itself, in continuous time. Otherwise the loop of its autopilot that is commanded, from
        sample to sample.
    actuators
        In the open loop: whether the inputs are commands to the actuators, which are then states.
    step_s
        Sampling period of the autopilot.
    environment
        Air, wind and gravity; the standard ones without it.
    gains
        Of the autopilot; the published ones without them.

    Returns
    -------
    Linearized
        With `dataset`, `modes`, `state_space()`, `document()` and `write(path)`. SI units and radians.

    Raises
    ------
    ConditionError
        There is no such steady flight, or the loop does not hold it, or it is within 1 deg of the vertical; the message
        says which and why.
    ValueError
        No such airframe, a centre of gravity for one that is not the library's, or a pitch rate with another rate.
    """
    enable_compilation_cache()
    airframe, of = resolve_airframe(aircraft, variant, x_cg_over_c)
    if isinstance(airframe, AbstractF16) and airframe is not aircraft:
        of["x_cg_over_c"] = float(airframe.x_cg)
    environment = standard_environment() if environment is None else environment
    rates = (rate * DEG_RAD for rate in (turn_rate_deg_s, path_rate_deg_s, pitch_rate_deg_s))
    target = trim_target(speed_m_s, altitude_m, path_angle_deg * DEG_RAD, 0.0, *rates)
    trim = steady_trim(airframe, environment, target)
    if loop == "open":
        model = _open_model(airframe, environment, trim.state, trim.controls, actuators=actuators)
    else:
        limits = default_limits()
        model = linearize_loop(LoopCase(airframe, environment, gains or published_gains(), limits, trim, step_s), loop)
        _must_hold(model, limits, loop)
    if not bool(model.regular):
        raise ConditionError(
            "Nose or path stands within 1 deg of the vertical, where roll and yaw, or the course, mean nothing: "
            "no linear model in these states."
        )
    condition = {
        **of,
        "speed_m_s": speed_m_s,
        "altitude_m": altitude_m,
        "path_angle_deg": path_angle_deg,
        "turn_rate_deg_s": turn_rate_deg_s,
        "path_rate_deg_s": path_rate_deg_s,
        "pitch_rate_deg_s": pitch_rate_deg_s,
        "loop": loop,
        "actuators": int(actuators or loop != "open"),
    }
    return LinearizationResult(model, modes_of(model), trim, condition)


def _must_hold(model: LinearModel, limits: FlightLimits, loop: Loop) -> None:
    """Refuse a trim point that the loop would leave at once: some command of it stands at a limit."""
    V, low, high = (float(speed) for speed in (model.x[0], limits.speed_min, limits.speed_max))
    if loop == "velocity" and not low <= V <= high:
        raise ConditionError(
            f"The velocity loop does not hold this flight: {V:.1f} m/s; the autopilot flies {low:g} to {high:g} m/s."
        )
    # The integrals' rates are the errors; from the outermost loop inwards the first that is not 0 is the cause.
    rates = dict(zip(model.states, np.asarray(model.x_dot).tolist(), strict=True))
    for inner in reversed(CHANNELS):
        for channel in CHANNELS[inner]:
            error = rates.get(f"{channel}_integral", 0.0)
            if abs(error) > _HELD:
                away = f"{error:+.2f} m/s" if channel == "V" else f"{error * RAD_DEG:+.2f} deg"
                raise ConditionError(
                    f"The {loop} loop does not hold this flight: the {channel} that it asks for is {away}"
                    f"{'/s' if inner == 'rates' else ''} off. "
                    "A command stands at a limit of the autopilot: bank, angle of attack, load factor or body rate."
                )
