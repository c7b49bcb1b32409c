"""Step tests flown from level trim: labelled records and figures, one compiled batch for each loop."""

from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from anser.aircraft import AbstractAirframe, AircraftState, air_data
from anser.compiling import compiled, enable_compilation_cache
from anser.control import AutopilotGains, FlightLimits
from anser.environment import Environment, standard_environment
from anser.execution.conditions import ConditionError, Inversion, airframe_of
from anser.execution.step_cases import step_case
from anser.execution.step_tests import CHANNEL_KEYS, STEP_S, StepTest
from anser.execution.stepped_flight import SteppedFlight
from anser.sensing import Instant
from anser.simulation import Loop, LoopCase, TrimPoint
from anser.simulation.recorder import AbstractRecorder, AircraftSample
from anser.simulation.response import loop_flight
from anser.simulation.step_metrics import step_metrics
from anser.spatial import bank_about_velocity, path_angles, rotate, rotate_back, rotation_from_quaternion
from anser.variables import CATALOGUE, catalogue

_VARIABLES = {variable.key: variable for variable in CATALOGUE}
_ANGLES_THAT_WRAP = ("bank", "course")

_measure = compiled(step_metrics)


def fly_steps(
    tests: Sequence[StepTest],
    *,
    aircraft: str | AbstractAirframe = "f16",
    variant: str = "textbook",
    speed_m_s: float = 150.0,
    altitude_m: float = 1000.0,
    inversion: Inversion = "model",
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[SteppedFlight, ...]:
    """Fly step tests from level trim in the standard atmosphere and still air.

    With the published gains of the F-16; another aircraft has gains and limits of its own.

    Tests of one loop and duration are one batch, compiled once.

    Parameters
    ----------
    tests
        What to command.
    aircraft, variant
        Of the library, or an airframe.
    speed_m_s, altitude_m
        True airspeed and geometric altitude of the trim point.
    inversion
        Of the model, or of the change from what the sensors measure.
    progress
        Called with the loop that is flown next.

    Raises
    ------
    ConditionError
        No level trim there, or a speed beyond those that the autopilot flies; the message says which and why.
    ValueError
        No such airframe.
    """
    enable_compilation_cache()
    airframe, of = airframe_of(aircraft, variant)
    environment, case = standard_environment(), step_case(airframe, speed_m_s, altitude_m, inversion)
    for test in tests:
        _must_be_flown(test, speed_m_s, case.limits)
    attributes = {**of, "speed_m_s": speed_m_s, "altitude_m": altitude_m, "inversion": inversion}
    found: dict[StepTest, SteppedFlight] = {}
    batches: dict[tuple[Loop, float], list[StepTest]] = {}
    for test in tests:
        batches.setdefault((test.loop, test.duration_s), []).append(test)
    for (loop, duration), batch in batches.items():
        progress(loop)
        sizes = jnp.asarray([_si(test) for test in batch])
        record = _fly(
            airframe, environment, case.gains, case.limits, case.trim, sizes, round(duration / STEP_S) + 1, loop
        )
        rows = {key: np.asarray(values) for key, values in record.items()}
        for k, test in enumerate(batch):
            one = {key: values[k] for key, values in rows.items()}
            found[test] = _flight(test, one, airframe, attributes)
    return tuple(found[test] for test in tests)


def _must_be_flown(test: StepTest, speed_m_s: float, limits: FlightLimits) -> None:
    wanted, low, high = speed_m_s + test.size[0], float(limits.speed_min), float(limits.speed_max)
    if test.loop == "velocity" and not low <= wanted <= high:
        raise ConditionError(
            f"The velocity loop does not fly the {wanted:g} m/s that the step asks for: {low:g} to {high:g} m/s only."
        )


def _si(test: StepTest) -> list[float]:
    keys = CHANNEL_KEYS[test.loop].values()
    return [size / _VARIABLES[key].factor for size, key in zip(test.size, keys, strict=True)]


class _StepRecorder(AbstractRecorder):
    """Outputs of all loops and what they take, at each sample."""

    every: int = eqx.field(static=True, default=1)

    def init(self, aircraft: int) -> None:
        """Nothing is kept."""

    def take(self, memory: None, sample: AircraftSample, instant: Instant) -> None:
        """Nothing is kept."""

    def row(self, sample: AircraftSample, instant: Instant) -> dict[str, Array]:
        """By the keys of the catalogue."""
        outputs = _outputs(sample.truth.airframe, instant.environment, sample.truth.state)
        return {**outputs, "throttle": jnp.asarray(sample.controls.throttle)}


@compiled
def _fly(
    airframe: AbstractAirframe,
    environment: Environment,
    gains: AutopilotGains,
    limits: FlightLimits,
    trim: TrimPoint,
    sizes: Float[Array, "tests 3"],
    count: int,
    loop: Loop,
) -> dict[str, Float[Array, "tests steps"]]:
    """Fly a batch of steps: history by the keys of the catalogue, SI units and radians."""
    held = _outputs(airframe, environment, trim.state)
    case = LoopCase(airframe, environment, gains, limits, trim, STEP_S)
    before = jnp.stack([held[key] for key in CHANNEL_KEYS[loop].values()])

    def one(size: Float[Array, "3"]) -> dict[str, Array]:
        value = before + size
        record = loop_flight(case, value, count, loop, _StepRecorder())
        wanted = dict(zip(CHANNEL_KEYS[loop].values(), value, strict=True))
        commands = {f"{key}_command": jnp.full(count, value) for key, value in wanted.items()}
        return {**record, **{key: jnp.unwrap(record[key]) for key in _ANGLES_THAT_WRAP}, **commands}

    return jax.vmap(one)(sizes)


def _outputs(airframe: AbstractAirframe, environment: Environment, state: AircraftState) -> dict[str, Array]:
    """What all three loops control, and the controls, of one aircraft at one instant in steady wind."""
    R_bn = rotation_from_quaternion(state.quaternion)
    wind_n = environment.wind.at(state.position_n, 0.0)
    velocity_air_b = state.velocity_b - rotate(R_bn, wind_n)
    altitude = -state.position_n[2]
    data = air_data(velocity_air_b, altitude, environment.atmosphere.at(altitude))
    gamma, chi = path_angles(rotate_back(R_bn, velocity_air_b))
    return {
        **dict(zip(CHANNEL_KEYS["rates"].values(), state.rates_b, strict=True)),
        "bank": bank_about_velocity(R_bn, data.alpha, data.beta),
        "alpha": data.alpha,
        "beta": data.beta,
        "airspeed": data.V,
        "path_angle": gamma,
        "course": chi,
        **dict(zip(airframe.actuators.names, state.surfaces, strict=True)),
        "power": state.power,
        "outside_tables": jnp.where(airframe.outside_tables(data), 1.0, 0.0),
    }


def _flight(
    test: StepTest, record: dict[str, np.ndarray], airframe: AbstractAirframe, attributes: dict[str, Any]
) -> SteppedFlight:
    """Figures and labelled record of one flight of a batch."""
    time = STEP_S * np.arange(len(record["power"]))
    until = round(test.read_at_s / STEP_S) + 1
    measured = np.stack([record[key][:until] for key in CHANNEL_KEYS[test.loop].values()], axis=1)
    surfaces = np.stack([record[name][:until] for name in airframe.actuators.names], axis=1)
    stops = (airframe.actuators.lower, airframe.actuators.upper)
    size = jnp.asarray(_si(test))
    figures = _measure(jnp.asarray(time[:until]), jnp.asarray(measured), size, jnp.asarray(surfaces), stops)
    metrics = jax.tree.map(np.asarray, figures)
    labelled = {v.key: v for v in catalogue(airframe.actuators.names)}
    variables = {}
    for key, values in record.items():
        v = labelled[key]
        labels = {"units": v.unit, "symbol": v.symbol, "long_name": v.long_name, "frame": v.frame}
        variables[v.name] = ("time", (v.factor * values).astype(v.dtype), labels)
    dataset = xr.Dataset(
        variables,
        coords={"time": ("time", time, {"units": "s", "long_name": "Time", "symbol": "t"})},
        attrs={
            **attributes,
            "surfaces": " ".join(airframe.actuators.names),
            "key": test.key,
            "loop": test.loop,
            "commanded": [_VARIABLES[CHANNEL_KEYS[test.loop][channel]].name for channel in test.commanded],
            "read_at_s": test.read_at_s,
        },
    )
    return SteppedFlight(test, dataset, metrics)
