"""A linear model about a trim point: labelled, with its modes, as a dataset, JSON or a python-control system."""

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import xarray as xr

from anser.aircraft import AbstractAirframe, AbstractF16
from anser.compiling import compiled, enable_compilation_cache
from anser.control import AutopilotGains, FlightLimits, default_limits, published_gains
from anser.environment import Environment, standard_environment
from anser.execution.conditions import ConditionError, airframe_of, steady_trim
from anser.results import linear_dataset, linear_document, notebook_table, write_json, write_netcdf
from anser.results.extras import missing
from anser.simulation import (
    CHANNELS,
    LinearModel,
    Loop,
    LoopCase,
    Mode,
    TrimPoint,
    linearize_loop,
    modes_of,
    trim_target,
)
from anser.simulation import linearize as linear_model
from anser.units import DEG_RAD, RAD_DEG

if TYPE_CHECKING:
    import control

_HELD = 0.01
"""Error that a loop may have while it holds a trim point, in rad, rad/s or m/s. In a steady turn it asks for a sideslip
of 0 where the trim point has some tenths of a millirad."""

_MODE = ("mode", "natural frequency, rad/s", "damping ratio", "time constant, s")

_open_model = compiled(linear_model)


@dataclasses.dataclass(frozen=True, repr=False)
class Linearized:
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
            raise ImportError(missing("python-control", "control")) from None
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
) -> Linearized:
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
    airframe, of = airframe_of(aircraft, variant, x_cg_over_c)
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
    return Linearized(model, modes_of(model), trim, condition)


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
