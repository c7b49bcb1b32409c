"""Linear model of an aircraft about a trim point, with its modes, as a dataset, JSON or a python-control system."""

import dataclasses
import re
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
from anser.analysis.trim_points import ConditionError, flight_point, require_step, resolve_airframe, steady_trim
from anser.compiling.options import compiled, enable_compilation_cache
from anser.control.gains import AutopilotGains
from anser.control.inversion_autopilot import Loop
from anser.control.limits import FlightLimits
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
from anser.results.variable_labels import unit_attributes
from anser.simulation.response import LoopCase
from anser.steady.trim import TrimPoint, trim_target
from anser.units import DEG_RAD, RAD_DEG
from anser.variables import STANDARD_SURFACES

if TYPE_CHECKING:
    import control


LINEAR_FORMAT_VERSION = 1
"""Format version of the JSON document; raised when a name is removed or changes meaning."""

_UNITS = {
    **dict.fromkeys(("alpha", "beta", "phi", "theta", "psi", "gamma", "chi", "mu"), "rad"),
    **dict.fromkeys(("P", "Q", "R", "P_w", "R_w"), "rad s-1"),
    "V": "m s-1",
    "altitude": "m",
    "power": "percent",
    "throttle": "1",
    "n_z": "1",
    # the state of the autopilot's sensors
    **dict.fromkeys(("X", "Y", "Z"), "N"),
    **dict.fromkeys(("P_dot", "Q_dot", "R_dot"), "rad s-2"),
}
_SAME_UNIT = ("filter", "slow", "command", "residual", "last")
"""Suffixes of names that have the unit of the name without suffix."""
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
"""Unit and long name of each figure of a mode; in dataset and JSON, the figure's name ends with the unit."""
_SUFFIX = {"s-1": "_1_s", "rad s-1": "_rad_s", "1": "", "s": "_s"}


def unit_of(name: str, surfaces: Sequence[str] = STANDARD_SURFACES) -> str:
    """Return the unit of a state, an input or an output of a `LinearModel`, such as "rad s-1" (CF notation).

    Raises ValueError if the name has no known unit.
    """
    surface_rates = {f"{surface}_velocity": "rad s-1" for surface in surfaces}
    units = {**_UNITS, **dict.fromkeys(surfaces, "rad"), **surface_rates}
    channel, _, suffix = name.rpartition("_")
    base = channel if suffix in (*_SAME_UNIT, "integral") and name not in units else name
    if base not in units:
        raise ValueError(f"no unit is known for {name}, of an aircraft with the surfaces {', '.join(surfaces)}")
    return _TIMES_SECOND[units[base]] if base != name and suffix == "integral" else units[base]


def linear_dataset(
    model: LinearModel, modes: Sequence[Mode], attributes: Mapping[str, str | int | float]
) -> xr.Dataset:
    """Return a linear model and its modes (`modes_of`) as a labelled dataset; `attributes` name aircraft and condition.

    - matrices A (state_rate, state), B (state_rate, input), C (output, state), D (output, input)
    - states, their rates, inputs and outputs at the reference condition
    - figures of the modes, such as the damping ratio, over (mode); an infinite time is inf
    - participation of the states of `wind_axis_states` in the modes, over (mode, wind_state)

    The coordinates `state_unit`, `input_unit` and `output_unit` are the units of the signals. An element of a matrix
    has the unit of the row divided by the unit of the column; rows of A and B are per second in continuous time.
    """
    sampled = float(model.step) > 0
    wind_states, _ = wind_axis_states(model)
    coordinates: dict[str, Any] = {}
    names_by_dimension = {"state_rate": model.states, "state": model.states, "input": model.inputs}
    names_by_dimension |= {"output": model.outputs, "wind_state": wind_states}
    for dimension, names in names_by_dimension.items():
        coordinates[dimension] = (dimension, np.array(names))
        coordinates[f"{dimension}_unit"] = (dimension, np.array([unit_of(name, model.surfaces) for name in names]))
    coordinates["mode_name"] = ("mode", np.array([mode.name for mode in modes]))
    coordinates["mode_order"] = ("mode", np.array([mode.order for mode in modes], dtype=np.int32))
    next_or_rates = "next states" if sampled else "rates of the states"
    rate_unit = "state_unit" if sampled else "state_unit s-1"
    shares = np.array([[dict(mode.shares)[state] for state in wind_states] for mode in modes])
    data = {
        name: (dimensions, np.asarray(values), unit_attributes(unit, long_name))
        for name, dimensions, values, unit, long_name in (
            ("A", ("state_rate", "state"), model.A, f"{rate_unit} / state_unit", f"From states to {next_or_rates}"),
            ("B", ("state_rate", "input"), model.B, f"{rate_unit} / input_unit", f"From inputs to {next_or_rates}"),
            ("C", ("output", "state"), model.C, "output_unit / state_unit", "From states to outputs"),
            ("D", ("output", "input"), model.D, "output_unit / input_unit", "From inputs to outputs"),
            ("state_at_condition", "state", model.x, "state_unit", "State departed from"),
            ("rate_at_condition", "state", model.x_dot, "state_unit s-1", "Its rate"),
            ("input_at_condition", "input", model.u, "input_unit", "Input departed from"),
            ("output_at_condition", "output", model.y, "output_unit", "Output departed from"),
            *(
                (name + _SUFFIX[unit], "mode", [_figure(mode, name) for mode in modes], unit, long_name)
                for name, (unit, long_name) in _MODE_FIGURES.items()
            ),
            ("share", ("mode", "wind_state"), shares, "1", "Part of a state in a mode"),
        )
    }
    return xr.Dataset(data, coordinates, {**attributes, "step_s": float(model.step), **version_attributes()})


def linear_document(
    model: LinearModel, modes: Sequence[Mode], attributes: Mapping[str, str | int | float]
) -> dict[str, Any]:
    """Return the content of `linear_dataset` as plain data for JSON.

    Infinite times are None; participation factors below 0.005 are omitted.
    """
    return {
        "format_version": LINEAR_FORMAT_VERSION,
        "provenance": software_versions(),
        "condition": dict(attributes),
        "units": "SI and radians",
        "step_s": float(model.step),
        "states": _named_elements(model.surfaces, model.states, model.x, model.x_dot),
        "inputs": _named_elements(model.surfaces, model.inputs, model.u),
        "outputs": _named_elements(model.surfaces, model.outputs, model.y),
        **{name: np.asarray(getattr(model, name)).tolist() for name in "ABCD"},
        "modes": [
            {
                "name": mode.name,
                "order": mode.order,
                **{n + _SUFFIX[unit]: finite_or_none(_figure(mode, n)) for n, (unit, _) in _MODE_FIGURES.items()},
                "shares": {state: share for state, share in mode.shares if share >= 0.005},
            }
            for mode in modes
        ],
    }


def _named_elements(
    surfaces: Sequence[str], names: tuple[str, ...], values: Any, rates: Any = None
) -> list[dict[str, Any]]:
    columns = {"value": values} if rates is None else {"value": values, "rate": rates}
    element_values = zip(names, *columns.values(), strict=True)
    return [
        {"name": name, "unit": unit_of(name, surfaces), **dict(zip(columns, map(float, numbers), strict=True))}
        for name, *numbers in element_values
    ]


def _figure(mode: Mode, figure: str) -> float:
    if figure.startswith("eigenvalue"):
        return mode.eigenvalue.real if figure.endswith("real") else mode.eigenvalue.imag
    return getattr(mode, figure)


_ERROR_TOLERANCE = 0.01
"""Largest control error at which a loop holds a trim point, in rad, rad/s or m/s.

The trim point of a steady turn has a sideslip below 0.001 rad, but the loop commands zero sideslip."""

_MODE_COLUMNS = ("mode", "natural frequency, rad/s", "damping ratio", "time constant, s")

_open_model = compiled(linear_model)


@dataclasses.dataclass(frozen=True, repr=False)
class LinearizationResult:
    """Result of a linearization: linear model, modes (fastest first) and trim point; prints as a table of the modes.

    `condition` has aircraft, linearized loop, airspeed, altitude, angles and rates, with units in the names.
    """

    model: LinearModel
    modes: tuple[Mode, ...]
    trim: TrimPoint
    condition: dict[str, str | float | int]

    def __repr__(self) -> str:
        table = [_MODE_COLUMNS, *(tuple(cells.values()) for cells in self._modes())]
        widths = [max(map(len, column)) for column in zip(*table, strict=True)]
        lines = [self._title()]
        for name, *numbers in table:
            aligned = (f"{number:>{width}}" for number, width in zip(numbers, widths[1:], strict=True))
            lines.append("  ".join([f"  {name:<{widths[0]}}", *aligned]))
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return notebook_table(self._title(), self._modes())

    def _title(self) -> str:
        condition, model = self.condition, self.model
        sizes = f"{len(model.states)} states, {len(model.inputs)} inputs, {len(model.outputs)} outputs"
        flight = f"{condition['aircraft']} at {condition['speed_m_s']:g} m/s and {condition['altitude_m']:g} m"
        return f"{flight}, {condition['loop']} loop: {sizes}"

    def _modes(self) -> list[dict[str, str]]:
        rows = []
        for mode in self.modes:
            numbers = (mode.natural_frequency, mode.damping_ratio, mode.time_constant)
            cells = (mode.name, *(f"{number:.4g}" for number in numbers))
            rows.append(dict(zip(_MODE_COLUMNS, cells, strict=True)))
        return rows

    @property
    def dataset(self) -> xr.Dataset:
        """Matrices A, B, C, D, reference condition and modes as a labelled dataset: see `linear_dataset`."""
        return linear_dataset(self.model, self.modes, self.condition)

    def document(self) -> dict[str, Any]:
        """Return matrices, reference condition and modes as plain data for JSON: see `linear_document`."""
        return linear_document(self.model, self.modes, self.condition)

    def state_space(self) -> "control.StateSpace":
        """Return the model, continuous or sampled, as a system of the python-control library, with signal names.

        Raises ImportError if the library is not installed.
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
            # python-control allows no dots, which the name of an aircraft file has
            name=re.sub(r"\W", "_", str(self.condition["aircraft"])),
        )

    def write(self, path: Path) -> None:
        """Write the model and its modes to a new file: NetCDF or JSON, by the suffix .nc or .json.

        Raises FileExistsError if `path` exists, and ValueError if the suffix is neither .nc nor .json.
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
    speed_m_s: float | None = None,
    altitude_m: float | None = None,
    speed_cas_m_s: float | None = None,
    speed_eas_m_s: float | None = None,
    mach: float | None = None,
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
    """Trim an aircraft, and return the linear model of the airframe alone or with a loop of its autopilot closed.

    Raises ConditionError, with the reason, if the steady flight does not exist, if the loop does not hold the flight,
    or if the nose or the path is within 1 deg of the vertical. Raises ValueError if an argument is not valid, as `trim`
    does.

    Parameters
    ----------
    aircraft, variant, x_cg_over_c
        Name of an airframe, path of an aircraft file, or an airframe; variant and centre of gravity (fraction of the
        mean chord) of the F-16.
    speed_m_s, altitude_m, speed_cas_m_s, speed_eas_m_s, mach, path_angle_deg, turn_rate_deg_s, pitch_rate_deg_s
        Altitude, one of four forms of the airspeed, climb angle and rates of the steady flight: see `trim`. A pitch
        rate excludes turn and path rates.
    path_rate_deg_s
        Rate of the climb angle, up positive.
    loop
        "open": the airframe alone, in continuous time. Another value: the outermost closed loop of the autopilot; the
        model is sampled, and its inputs are the commands to this loop.
    actuators
        True: in the open loop, the inputs are commands to the actuators, and the deflections are states. False: the
        inputs are the deflections themselves. A closed loop always contains the actuators.
    step_s
        Sampling period of the autopilot.
    environment
        Air, wind and gravity; None: standard atmosphere and gravity, no wind.
    gains
        Gains of the autopilot; None: the published gains of the F-16, or gains derived from the aircraft. The F-16 has
        default limits of the autopilot, another aircraft has derived limits.
    """
    enable_compilation_cache()
    require_step(step_s)
    airframe, attributes = resolve_airframe(aircraft, variant, x_cg_over_c)
    if isinstance(airframe, AbstractF16) and airframe is not aircraft:
        attributes["x_cg_over_c"] = float(airframe.x_cg)
    environment = standard_environment() if environment is None else environment
    speed_m_s, altitude_m = flight_point(environment, altitude_m, speed_m_s, speed_cas_m_s, speed_eas_m_s, mach)
    rates = (rate * DEG_RAD for rate in (turn_rate_deg_s, path_rate_deg_s, pitch_rate_deg_s))
    target = trim_target(speed_m_s, altitude_m, path_angle_deg * DEG_RAD, 0.0, *rates)
    trim = steady_trim(airframe, environment, target)
    if loop == "open":
        model = _open_model(airframe, environment, trim.state, trim.controls, actuators=actuators)
    else:
        from anser.analysis.step_flights import derive_autopilot  # imports the flights of fleets

        flown_gains, limits, _ = derive_autopilot(airframe, speed_m_s, altitude_m, "model", step_s, environment)
        case = LoopCase(airframe, environment, flown_gains if gains is None else gains, limits, trim, step_s)
        model = linearize_loop(case, loop)
        _check_held(model, limits, loop)
    if not bool(model.regular):
        raise ConditionError(
            "Nose or path stands within 1 deg of the vertical, where roll and yaw, or the course, mean nothing: "
            "no linear model in these states."
        )
    condition = attributes | {
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


def _check_held(model: LinearModel, limits: FlightLimits, loop: Loop) -> None:
    """Raise ConditionError, with the cause, if the closed loop does not stay at the trim point in its first step."""
    V, low, high = (float(speed) for speed in (model.x[0], limits.speed_min, limits.speed_max))
    if loop == "velocity" and not low <= V <= high:
        raise ConditionError(
            f"The velocity loop does not hold this flight: {V:.1f} m/s; the autopilot flies {low:g} to {high:g} m/s."
        )
    # The integrals' rates are the errors; the outermost nonzero error, from the outer loop inwards, is the cause.
    rates = dict(zip(model.states, np.asarray(model.x_dot).tolist(), strict=True))
    for inner in reversed(CHANNELS):
        for channel in CHANNELS[inner]:
            error = rates.get(f"{channel}_integral", 0.0)
            if abs(error) > _ERROR_TOLERANCE:
                error_text = f"{error:+.2f} m/s" if channel == "V" else f"{error * RAD_DEG:+.2f} deg"
                raise ConditionError(
                    f"The {loop} loop does not hold this flight: the {channel} that it asks for is {error_text}"
                    f"{'/s' if inner == 'rates' else ''} off. "
                    "A command stands at a limit of the autopilot: bank, angle of attack, load factor or body rate."
                )
