"""Simulated flight of one aircraft: open loop under prescribed controls, or closed loop under prescribed commands."""

import dataclasses
import functools
import json
import os
from collections.abc import Mapping, Sequence
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Bool, Float

from anser.aircraft.actuators import without_lag
from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.engines import InstantEngine
from anser.analysis.trim_points import Inversion, require_seconds
from anser.compiling.options import compiled_by_older_generator, enable_compilation_cache
from anser.config.errors import quoted_list
from anser.control.inversion_autopilot import InversionAutopilot
from anser.environment.air import STANDARD_LAYERS, Layers
from anser.environment.atmosphere import atmosphere_layers
from anser.environment.environment import AbstractWind, Environment
from anser.environment.gridded_wind import GriddedWind, has_left_field
from anser.files import result_folder
from anser.numerics.arrays import as_array, bucket_size
from anser.numerics.randomness import flight_randomness
from anser.parts.controllers import AbstractController, AbstractGuidance
from anser.parts.input_signals import InputSignal
from anser.parts.perception import AbstractEstimator, AbstractSensors, Instant
from anser.results.dataset import air_variables, qnh_attributes, value_range
from anser.results.documents import version_attributes
from anser.results.faults import dataset_fault, format_fault
from anser.results.variable_labels import catalogue_attributes, to_dataset_units
from anser.scenario.user_parts import check_user_parts, resolved_parts
from anser.sensing.adaptation import AdaptiveEstimator, adaptive_estimator
from anser.sensing.estimators import TrackingEstimator
from anser.sensing.ideal_sensors import IdealSensors
from anser.simulation.closed_loop import fly_alone, trimmed_vehicle
from anser.simulation.open_loop import CONTROLLER_KEYS, FeedbackControls, PrescribedCommand, PrescribedControls
from anser.simulation.recorders import AbstractRecorder, History
from anser.simulation.vehicle import Vehicle
from anser.single_aircraft.air import read_air
from anser.single_aircraft.changes import read_changes
from anser.single_aircraft.controls import describe_inputs, sample_inputs, sample_times
from anser.single_aircraft.excitation import read_excitation
from anser.single_aircraft.frozen_adaptation import AdaptationHistory, frozen_margins, increment_variables
from anser.single_aircraft.model import aircraft as load_aircraft
from anser.single_aircraft.starts import air_path, reference_inputs, resolve_start
from anser.steady.trim import TrimPoint
from anser.units import DEG_RAD
from anser.variables import catalogue

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OPEN_LOOP = "none: open loop"  #: Attribute `controller` of the dataset of a flight without a controller.
_ROWS = 512  # least number of rows of a compiled flight; longer flights have 2, 4, 8 ... times as many
_INVERSIONS: dict[str, Inversion] = {"inversion": "model", "incremental": "incremental", "adaptive": "incremental"}
"""Inversion of each autopilot of the package, by the name of the autopilot; "adaptive" also corrects the model."""


@dataclasses.dataclass(frozen=True, repr=False)
class AircraftFlight:
    """Result of `anser.simulate`: time histories of one aircraft; prints as a summary of least and greatest values."""

    dataset: xr.Dataset  #: Variables of the catalogue over `time` (s); units in the names.

    def __repr__(self) -> str:
        lines = [f"{self.dataset.attrs['aircraft']}: {float(self.dataset.time[-1]):g} s, {self.dataset.attrs['end']}"]
        outside = int(self.dataset["outside_tables"].sum())
        if outside:
            lines.append(f"  outside the aircraft's data in {outside} of {self.dataset.sizes['time']} samples")
        fault = dataset_fault(self.dataset)
        if fault is not None:
            lines.append(f"  fault: {format_fault(fault.as_dict())}")
        for name in ("airspeed_m_s", "altitude_m", "alpha_deg", "beta_deg", "roll_deg", "pitch_deg", "load_factor"):
            first, last, least, greatest = value_range(self.dataset[name])
            lines.append(f"  {name:<14} {first:10.4g} to {last:10.4g}   (least {least:.4g}, greatest {greatest:.4g})")
        return "\n".join(lines)

    def plot(self) -> "Figure":
        """Return a figure of airspeed, altitude, flow angles, attitude, rates, load factor, controls, engine over time.

        A flight with an adaptive autopilot adds its estimates, with bands of two standard deviations and the truth.
        """
        from anser.report.aircraft_flight import aircraft_flight_figure

        return aircraft_flight_figure(self.dataset)

    def margins(self, time_s: float | None = None) -> xr.Dataset:
        """Compute the stability margins of the adaptive autopilot with its estimates frozen at `time_s`; None: the end.

        Result and errors: see `anser.single_aircraft.frozen_adaptation.frozen_margins`.
        """
        return frozen_margins(self.dataset, time_s)

    def save(self, folder: str | os.PathLike[str], *, force: bool = False) -> Path:
        """Write `flight.nc`, `flight.png` and `report.html` into a new folder, and return the folder.

        Raises FileExistsError if the folder exists and `force` is False.
        """
        with result_folder(Path(folder), replace=force) as staging:
            self.write_into(staging)
        return Path(folder)

    def write_into(self, folder: Path) -> None:
        """Write the files of `save` into an existing folder; raises FileExistsError if one of the files exists."""
        from anser.report.aircraft_flight import write_aircraft_report
        from anser.report.style import save_figure
        from anser.results.netcdf import write_netcdf

        write_netcdf(self.dataset, folder / "flight.nc")
        figure = self.plot()
        save_figure(figure, [folder / "flight.png"])
        write_aircraft_report(self.dataset, folder / "report.html", figure)

    def report(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> Path:
        """Write the report, one HTML file with figure, least and greatest values and conditions; return the path.

        Raises FileExistsError if the file exists and `overwrite` is False.
        """
        from anser.report.aircraft_flight import write_aircraft_report

        write_aircraft_report(self.dataset, Path(path), overwrite=overwrite)
        return Path(path)


def simulate(
    aircraft: Any,
    start: Any,
    controls: Any = None,
    *,
    duration_s: float,
    step_s: float = 0.01,
    record_period_s: float | None = None,
    increments: bool = False,
    controller: AbstractController | str | None = None,
    command: Mapping[str, Any] | AbstractGuidance | None = None,
    excitation: Mapping[str, InputSignal] | None = None,
    sensors: AbstractSensors | None = None,
    estimator: AbstractEstimator | None = None,
    wind: Mapping[str, Any] | None = None,
    turbulence: str | Mapping[str, Any] | None = None,
    gust: Sequence[Mapping[str, Any]] = (),
    earth: str | Mapping[str, Any] | None = None,
    atmosphere: Mapping[str, Any] | None = None,
    change: Mapping[str, Any] | Sequence[Mapping[str, Any]] = (),
    seed: int = 0,
    actuator_lag: bool = True,
    engine_lag: bool = True,
) -> AircraftFlight:
    """Fly one aircraft under prescribed controls (open loop), or with a controller under prescribed commands.

    Raises ValueError if an argument is not valid, ScenarioError if a table of air, Earth or change is not valid, and
    ConditionError if the start is a trim that has no steady flight.

    Parameters
    ----------
    aircraft
        `AircraftModel` from `anser.aircraft`, name of an airframe, path of an aircraft file, or an airframe.
    start
        Trim from `aircraft.trim(...)`, or any state by name: `{"airspeed_m_s": 150, "altitude_m": 1000,
        "alpha_deg": 12, ...}` (see `AircraftModel.start_names`).
    controls
        Surfaces (deg) and throttle (0..1), constant between samples; absent inputs keep their value at the start.

        - mapping by name to numbers, arrays with a value per sample, pairs (times, values), or signals such as
          `anser.doublet(1.0)`, which are increments to the start
        - table with a column `time_s` (CSV file, DataFrame, Dataset)
        - function `law(time_s, state) -> {"elevator": ...}` of the variables by name, written in `jax.numpy`
        - None: the controls of the start
    duration_s, step_s
        Duration of the flight, and period of samples and integration, s; a step from 0.001 to 0.05 s.
    record_period_s
        Period of the rows of the dataset, a multiple of the step; None: every sample.
    increments
        True: numbers, arrays and tables are increments to the controls, or to the motion, of the start. False: absolute
        values.
    controller
        Controller of the closed loop, in place of `controls`: an `anser.parts.AbstractController`, or the name of an
        autopilot with published (F-16) or derived gains and limits.

        - "inversion": dynamic inversion of the onboard model
        - "incremental": incremental inversion, from measured accelerations
        - "adaptive": incremental inversion, with an onboard model that is corrected in flight
    command
        Command to the controller: `airspeed_m_s`, `path_angle_deg`, `course_deg`, each given like a control; or an
        `anser.parts.AbstractGuidance`. Absent commands keep their value at the start.
    excitation
        Test inputs in the closed loop, signals by name:

        - surfaces (deg) and `throttle`, added after the control law and before the limits of the actuators
        - `airspeed_m_s`, `path_angle_deg`, `course_deg`, added to the command
        - `bank_deg`, `alpha_deg`, `beta_deg`, `roll_rate_deg_s`, `pitch_rate_deg_s`, `yaw_rate_deg_s`, added to the
          commands between the loops of an `InversionAutopilot`
    sensors, estimator
        Sensors, and the estimator of the state from their readings; None: no errors. The default estimator computes
        forces and moments of the unchanged aircraft ("adaptive" corrects them in flight).
    wind, turbulence, gust, earth, atmosphere
        Tables as in a scenario: `wind={"speed_m_s": 8, "from_deg": 270}`, `turbulence="moderate"`, `earth="wgs84"`,
        `atmosphere={"temperature_offset_k": 20}`. None: still air, a flat Earth with standard gravity, the standard
        atmosphere. A trim as the start must have been computed with the same atmosphere.
    change
        Change of the true aircraft at a time, unknown to its controller, with the keys of a scenario's event:
        `{"time_s": 20, "surface_effectiveness": {"elevator": 0.5}, "cg_shift": 0.05}`; or a sequence of changes.
    seed
        Seed of turbulence and sensor errors.
    actuator_lag, engine_lag
        False: the surfaces, or the engine power, take the commanded value at each sample. A controller by name has the
        gains for the aircraft with its lags.

    Returns
    -------
    AircraftFlight
        Its `dataset` ends with the last row up to `duration_s`, or before the first row on the ground (altitude 0),
        beyond the wind field of a file or with a non-finite value; the attribute `end` states which.
    """
    enable_compilation_cache()
    model = load_aircraft(aircraft)
    air = read_air(earth, wind, turbulence, gust, seed, atmosphere)
    environment = air.environment()
    points = [resolve_start(model.airframe, environment, start)]
    airframe, (point,) = set_lags(model.airframe, points, step_s, actuator_lag=actuator_lag, engine_lag=engine_lag)
    time_s = sample_times(duration_s, step_s)
    air.refuse_late_gusts(duration_s)
    if record_period_s is not None:
        require_seconds("record_period_s", record_period_s)
    stride = 1 if record_period_s is None else round(record_period_s / step_s)
    if record_period_s is not None and (stride < 1 or abs(stride * step_s / record_period_s - 1.0) > 1e-9):
        raise ValueError(
            f"record_period_s: arrived {record_period_s:g} s; expected a multiple of the step, {step_s:g} s"
        )
    rows = (time_s.size - 1) // stride + 1
    # few lengths are compiled; what is flown after the end is cut off
    count = bucket_size(rows, -(-_ROWS // stride)) * stride

    def sample(inputs: Any, reference: Mapping[str, float], subject: str, **options: bool) -> np.ndarray:
        table = sample_inputs(inputs, reference, time_s, subject=subject, **options)
        return np.pad(table, ((0, count - len(table)), (0, 0)), mode="edge")

    if controller is None:
        flight_controller = _open_loop(airframe, point, controls, increments, sample)
    elif controls is None:
        is_own = isinstance(controller, AbstractController)
        flight_controller = controller if is_own else autopilot(model.airframe, environment, point, controller, step_s)
    else:
        raise ValueError(
            "controls: arrived beside a controller; expected one of the two (a controller takes `command`)"
        )
    if command is not None and controller is None:
        raise ValueError("command: arrived without a controller; expected a controller that follows it")
    if increments and (_is_law(controls) or isinstance(command, AbstractGuidance)):
        raise ValueError(
            "increments: arrived True beside a function or a guidance; expected False: numbers, arrays and tables can "
            "be increments"
        )
    if isinstance(command, AbstractGuidance):
        guidance = command
    elif controller is None:
        guidance = PrescribedCommand(jnp.full((count, 3), jnp.nan))
    else:
        commanded, reference = {} if command is None else command, air_path(environment, point)
        table = sample(commanded, reference, "command", increments=increments)
        guidance = PrescribedCommand(as_array(table * np.array([1.0, DEG_RAD, DEG_RAD])))
    test_inputs = read_excitation(airframe.actuators, excitation, flight_controller, step_s)
    changes = read_changes(airframe, change, duration_s)
    own = resolved_parts(
        controller=controller if isinstance(controller, AbstractController) else None,
        guidance=command if isinstance(command, AbstractGuidance) else None,
        sensors=sensors,
        estimator=estimator,
    )
    sensors, estimator = own.sensors, own.estimator
    is_adaptive = controller == "adaptive"
    if estimator is None:
        estimator = TrackingEstimator(model=None if changes is None and not is_adaptive else airframe)
        estimator = adaptive_estimator(estimator, airframe) if is_adaptive else estimator
    parts = {
        "airframe": airframe,
        "sensors": IdealSensors() if sensors is None else sensors,
        "estimator": estimator,
        "guidance": guidance,
        "controller": flight_controller,
        "gusts": air.gusts(airframe),
        "changes": changes,
        "excitation": test_inputs,
    }
    check_user_parts(Vehicle(**parts), environment, step_s, "aircraft", own)
    recorder = AdaptationHistory(stride) if isinstance(estimator, AdaptiveEstimator) else History(stride=stride)
    instant = Instant(environment, as_array(0, np.int32), as_array(step_s), flight_randomness(seed))
    # A law is traced for its flight alone, and the program is dropped afterwards.
    is_law = isinstance(flight_controller, FeedbackControls)
    fly = compiled_by_older_generator(("count",), "flight")(_flown) if is_law else _fly
    history = fly(parts, instant, point, recorder, count)
    columns = {key: np.asarray(values)[:rows] for key, values in history.items()}
    kind = type(controller)
    part_name = controller if isinstance(controller, str) else f"{kind.__module__}.{kind.__qualname__}"
    attributes = {
        **model.identity,
        "controls": _described(controls) or "controls of the start" if controller is None else "",
        "controller": OPEN_LOOP if controller is None else part_name,
        "command": _described(command) if controller is not None else "",
        "step_s": step_s,
        **{name: "no" for name, is_kept in (("actuator_lag", actuator_lag), ("engine_lag", engine_lag)) if not is_kept},
        "seed": seed,
        "air": air.describe(),
        "air_tables": air.model_dump_json(),
        **({} if changes is None else {"change": json.dumps(change, default=_builtin)}),
        **({} if test_inputs is None else {"excitation": describe_inputs(excitation)}),
        **version_attributes(),
    }
    layers = atmosphere_layers(environment.atmosphere)
    is_outside = _outside_field(environment.wind, columns, time_s[::stride])
    names = airframe.actuators.names
    dataset = flight_dataset(time_s[::stride], columns, names, attributes, layers, is_outside)
    return AircraftFlight(dataset.assign(increment_variables(columns, dataset.sizes["time"], names)))


def _builtin(value: Any) -> Any:
    """Return NumPy's number as Python's, another object as its text."""
    return value.item() if isinstance(value, np.generic) else str(value)


def _described(inputs: Any) -> str:
    return "" if inputs is None else describe_inputs(inputs)


@jax.jit
def _outside(wind: AbstractWind, positions_n: Float[Array, "row 3"], times: Float[Array, " row"]) -> Array:
    return jax.vmap(has_left_field, in_axes=(None, 0, 0))(wind, positions_n, times)


def _outside_field(
    wind: AbstractWind, history: Mapping[str, np.ndarray], time_s: Float[np.ndarray, " row"]
) -> Bool[np.ndarray, " row"] | None:
    """Return for each row of a flight whether the position is beyond the wind field of a file; None for other wind."""
    if not isinstance(wind, GriddedWind):
        return None
    positions_n = np.stack([history["north"], history["east"], -history["altitude"]], axis=1)
    return np.asarray(_outside(wind, as_array(positions_n), as_array(time_s)))


def _flown(
    parts: dict[str, Any], instant: Instant, start: TrimPoint, recorder: AbstractRecorder, count: int
) -> dict[str, Array]:
    vehicle = Vehicle(**parts)
    state = trimmed_vehicle(vehicle, instant, start)
    return fly_alone(vehicle, instant.environment, state, instant.step, count, recorder, instant.randomness)[2]


_fly = compiled_by_older_generator(("count",), "flight")(_flown)


def set_lags(
    airframe: AbstractAirframe, points: list[TrimPoint], step_s: float, *, actuator_lag: bool, engine_lag: bool
) -> tuple[AbstractAirframe, list[TrimPoint]]:
    """Return the airframe and its trim points; a flag that is False removes the lag of actuators or engine.

    Deflections and power of the trim points are unchanged. A part that has no lag is sampled every `step_s` seconds.
    """
    lags = (("actuators", "surfaces", without_lag, actuator_lag), ("engine", "power", InstantEngine, engine_lag))
    for name, quantity, instant, is_kept in lags:
        if not is_kept:
            part: Any = instant(getattr(airframe, name), as_array(step_s))
            airframe = eqx.tree_at(attrgetter(name), airframe, part)
            states = [part.steady_state(getattr(point.state, quantity)) for point in points]
            where = attrgetter(f"state.{name}")
            points = [eqx.tree_at(where, point, state) for point, state in zip(points, states, strict=True)]
    return airframe, points


def _is_law(controls: Any) -> bool:
    """Return whether controls are a function of time and state."""
    return callable(controls) and not isinstance(controls, InputSignal | Mapping)


def _open_loop(
    airframe: AbstractAirframe, point: TrimPoint, controls: Any, increments: bool, sample: Any
) -> AbstractController:
    """Return the controller that applies `controls` of `simulate`; `sample` calls `sample_inputs`."""
    law: Any = controls
    if _is_law(controls):
        # A new object for each flight, traced anew: the values that the function refers to may have changed.
        return FeedbackControls(point.controls, functools.partial(law))
    reference, inputs = reference_inputs(airframe, point.controls), {} if controls is None else controls
    table = sample(inputs, reference, "controls", increments=increments)
    return PrescribedControls(as_array(table[:, :-1] * DEG_RAD), as_array(table[:, -1]))


def autopilot(
    airframe: AbstractAirframe, environment: Environment, point: TrimPoint, name: Any, step_s: float
) -> InversionAutopilot:
    """Return an autopilot by name ("inversion", "incremental", "adaptive") for the flight from a start `point`.

    Gains and limits are for level flight at the start's airspeed and altitude: published for an F-16, derived for
    another aircraft. Raises ValueError if the name is unknown, ConditionError if this level flight does not exist in
    the standard atmosphere.
    """
    from anser.analysis.step_flights import step_case

    if name not in _INVERSIONS:
        names = quoted_list(_INVERSIONS)
        raise ValueError(f"controller: arrived {name!r}; expected an anser.parts.AbstractController, {names}, or None")
    airspeed = air_path(environment, point)["airspeed_m_s"]
    case = step_case(airframe, airspeed, -float(point.state.position_n[2]), _INVERSIONS[name], step_s)
    return InversionAutopilot(case.gains, case.limits)


def flight_dataset(
    time_s: Float[np.ndarray, " row"],
    history: Mapping[str, Float[np.ndarray, " row"]],
    surfaces: Sequence[str],
    attributes: Mapping[str, Any],
    air_layers: Layers = STANDARD_LAYERS,
    is_outside: Bool[np.ndarray, " row"] | None = None,
) -> xr.Dataset:
    """Return the recorded variables of one aircraft as a dataset over time, up to the flight's end.

    `history` has the variables by key (SI units); `air_layers` describes the atmosphere; `is_outside` is True for a row
    beyond the wind field. The flight ends before the first row on the ground, beyond the wind field or with a
    non-finite motion; the attribute `end` states which. Raises ValueError if the first row is such a row.
    """
    motion = [history[key] for key in ("airspeed", "alpha", "altitude", "roll_rate", "pitch_rate", "yaw_rate")]
    endings = {
        "the motion became non-finite": ~np.all(np.isfinite(motion), axis=0),
        "the ground was reached": history["altitude"] <= 0.0,
        "the wind field of the file ended": np.zeros(time_s.size, bool) if is_outside is None else is_outside,
    }
    over = np.flatnonzero(np.any(list(endings.values()), axis=0))
    rows, end = time_s.size, "flown to the end"
    if over.size:
        rows = int(over[0])
        reason = next(reason for reason, flags in endings.items() if flags[rows])
        end = f"{reason} at {time_s[rows]:g} s"
    if rows == 0:
        raise ValueError(
            f"start: {end}; expected a finite state above the ground (altitude_m > 0) and within the wind field, if any"
        )
    left_out = {"status", *(CONTROLLER_KEYS if attributes["controller"] == OPEN_LOOP else ())}
    history = {**history, **air_variables(history["airspeed"], history["altitude"], air_layers)}
    data = {
        v.name: ("time", to_dataset_units(v, history[v.key][:rows]), catalogue_attributes(v))
        for v in catalogue(surfaces)
        if v.key in history and v.key not in left_out
    }
    coordinates = {"time": ("time", time_s[:rows], {"units": "s", "long_name": "Time", "symbol": "t"})}
    attributes = {**attributes, **qnh_attributes(air_layers), "surfaces": " ".join(surfaces), "end": end}
    return xr.Dataset(data, coordinates, attributes)
