"""Flights of aircraft whose estimator learns: faults found, drift of estimates in calm flight, false alarms.

`python -m trials.adaptive_flights faults|healthy|calm --flights 200` prints a table. Flights start in level flight of
the F-16 at 150 m/s and 1,000 m, with sensor noise and, on request, light turbulence.
"""

import argparse
import functools
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import typer

from anser.aircraft.changes import AirframeChange, AirframeChanges
from anser.analysis.step_flights import step_case
from anser.analysis.trim_points import resolve_airframe, steady_trim
from anser.control.inversion_autopilot import InversionAutopilot
from anser.environment.environment import standard_environment
from anser.numerics.randomness import flight_randomness
from anser.parts.perception import Instant
from anser.scenario.build_sensing import build_navigation_estimator, build_vehicle_sensors
from anser.scenario.schema_sensing import Navigation
from anser.sensing.adaptation import adaptive_estimator
from anser.sensing.fault_detection import CENTRE_OF_GRAVITY, ENGINE, ICE, NO_FAULT, SURFACE
from anser.sensing.noisy_sensors import NoisySensors
from anser.simulation.closed_loop import fly_alone, trimmed_vehicle
from anser.simulation.open_loop import PrescribedCommand
from anser.simulation.recorders import History
from anser.simulation.vehicle import Vehicle
from anser.single_aircraft.air import read_air
from anser.steady.trim import trim_target

SPEED_M_S, ALTITUDE_M, STEP_S, STRIDE = 150.0, 1000.0, 0.01, 50
FAULT_S, MANOEUVRE_S = 20.0, 30.0
FAULTS: dict[str, tuple[int, dict[str, Any]]] = {
    "elevator half effective": (SURFACE, {"surface": (0, 0.5)}),
    "aileron half effective": (SURFACE + 1, {"surface": (1, 0.5)}),
    "rudder half effective": (SURFACE + 2, {"surface": (2, 0.5)}),
    "centre of gravity 5 % aft": (CENTRE_OF_GRAVITY, {"cg_shift": 0.05}),
    "ice": (ICE, {"drag": 1.2, "lift_slope": 0.9}),
    "engine 20 % weak": (ENGINE, {"thrust": 0.8}),
}


class Flights(NamedTuple):
    """Recorded variables of a batch over (flight, row), and the times of the rows, s."""

    time_s: np.ndarray
    history: dict[str, np.ndarray]


def change_of(surface: tuple[int, float] | None = None, **factors: float) -> AirframeChange:
    """Return a change of an airframe with three surfaces."""
    effectiveness = np.ones(3)
    if surface is not None:
        effectiveness[surface[0]] = surface[1]
    values = {"drag": 1.0, "lift_slope": 1.0, "thrust": 1.0, "mass": 1.0, "actuator_bandwidth": 1.0, "cg_shift": 0.0}
    scalars = {name: jnp.asarray(factors.get(name, value)) for name, value in values.items()}
    return AirframeChange(jnp.asarray(effectiveness), second_moments=jnp.ones(3), **scalars)


def commands(flights: int, duration_s: float, seed: int, *, calm: bool) -> np.ndarray:
    """Return the commanded airspeed (m/s), path angle and course (rad) of each flight, with one random manoeuvre."""
    time_s = np.arange(round(duration_s / STEP_S)) * STEP_S
    rng = np.random.default_rng(seed)
    values = np.zeros((flights, len(time_s), 3))
    values[:, :, 0] = SPEED_M_S
    if calm:
        return values
    for k in range(flights):
        turn, climb = np.radians(rng.uniform(5.0, 20.0)), np.radians(rng.uniform(1.5, 4.0))
        signs, width = rng.choice([-1.0, 1.0], 2), rng.uniform(2.5, 4.0)
        for index, size, sign in ((2, turn, signs[0]), (1, climb, signs[1])):
            first = (time_s >= MANOEUVRE_S) & (time_s < MANOEUVRE_S + width)
            second = (time_s >= MANOEUVRE_S + width) & (time_s < MANOEUVRE_S + 2.0 * width)
            values[k, :, index] = sign * size * (first * 1.0 - second * 1.0)
        values[k, :, 0] += np.where(time_s >= MANOEUVRE_S, rng.choice([-1.0, 1.0]) * rng.uniform(2.0, 6.0), 0.0)
    return values


@functools.lru_cache
def compiled_flights(count: int, turbulence: str) -> Callable[..., dict[str, jax.Array]]:
    """Return the program of a batch of flights of `count` samples, for any change, command and random numbers."""
    airframe, _ = resolve_airframe("f16", "textbook")
    environment = standard_environment()
    trim = steady_trim(airframe, environment, trim_target(SPEED_M_S, ALTITUDE_M))
    case = step_case(airframe, SPEED_M_S, ALTITUDE_M, "incremental")
    navigation = Navigation(sensors="satellite-inertial")
    air = read_air(turbulence=None if turbulence == "none" else turbulence)

    def fly_row(changes: AirframeChanges, command: jax.Array, source: Any) -> dict[str, jax.Array]:
        vehicle = Vehicle(
            airframe=airframe,
            sensors=NoisySensors(build_vehicle_sensors(navigation)),
            estimator=adaptive_estimator(build_navigation_estimator(navigation, airframe), airframe),
            guidance=PrescribedCommand(command),
            controller=InversionAutopilot(case.gains, case.limits),
            gusts=air.gusts(airframe),
            changes=changes,
        )
        instant = Instant(environment, jnp.asarray(0, dtype=jnp.int32), jnp.asarray(STEP_S), source)
        start = trimmed_vehicle(vehicle, instant, trim)
        return fly_alone(vehicle, environment, start, STEP_S, count, History(stride=STRIDE), source)[2]

    return jax.jit(jax.vmap(fly_row, in_axes=(None, 0, 0)))


def fly(change: AirframeChange, values: np.ndarray, seed: int, turbulence: str) -> Flights:
    """Fly a batch with one change at `FAULT_S` and a command for each flight."""
    changes = AirframeChanges(jnp.asarray([FAULT_S]), jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], change))
    sources = jax.tree.map(lambda *keys: jnp.stack(keys), *[flight_randomness(seed, k) for k in range(len(values))])
    history = compiled_flights(values.shape[1], turbulence)(changes, jnp.asarray(values), sources)
    stored = {key: np.asarray(value) for key, value in history.items()}
    return Flights(np.arange(next(iter(stored.values())).shape[1]) * STRIDE * STEP_S, stored)


def fault_table(flights: int, turbulence: str) -> list[tuple[str, int, int, float]]:
    """Return for each fault how many flights found it within 10 s of the manoeuvre's start, named it, and its size."""
    rows = []
    for number, (name, (code, change)) in enumerate(FAULTS.items()):
        flown = fly(change_of(**change), commands(flights, 45.0, number, calm=False), number, turbulence)
        row = int(np.searchsorted(flown.time_s, MANOEUVRE_S + 10.0))
        reported = flown.history["fault"][:, row]
        size = float(np.median(flown.history["fault_size"][reported == code, row])) if np.any(reported == code) else 0.0
        share = effectiveness_share(flown, change)
        before = flown.history["fault"][:, int(np.searchsorted(flown.time_s, FAULT_S))]
        rows.append((name, int(np.sum(reported != NO_FAULT)), int(np.sum(reported == code)), size))
        typer.echo(
            f"{name}: found {rows[-1][1]}, named {rows[-1][2]} of {flights}, size {size:.3f}, "
            f"effectiveness within 10 % in {100 * share:.0f} %, early {int(np.sum(before != NO_FAULT))}, "
            f"codes {np.bincount(reported, minlength=8).tolist()}"
        )
    return rows


def effectiveness_share(flown: Flights, change: dict[str, Any]) -> float:
    """Return the part of the flights whose effectiveness is within 10 % 5 s after the end of the manoeuvre."""
    if "surface" not in change:
        return float("nan")
    surface, factor = change["surface"]
    row = int(np.searchsorted(flown.time_s, MANOEUVRE_S + 13.0))
    estimate = flown.history[f"{('pitch', 'roll', 'yaw')[surface]}_effectiveness_estimate"][:, row]
    return float(np.mean(np.abs(estimate / factor - 1.0) < 0.1))


def main() -> None:
    """Run one part and print its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", choices=("faults", "healthy", "calm"))
    parser.add_argument("--flights", type=int, default=200)
    parser.add_argument("--turbulence", default="none")
    options = parser.parse_args()
    start = time.process_time()
    if options.part == "faults":
        fault_table(options.flights, options.turbulence)
    elif options.part == "healthy":
        alarms, batch = 0, min(options.flights, 250)
        for number in range(options.flights // batch):
            flown = fly(change_of(), commands(batch, 60.0, 100 + number, calm=False), 100 + number, options.turbulence)
            alarms += int(np.sum(flown.history["fault"][:, -1] != NO_FAULT))
            codes = np.bincount(flown.history["fault"][:, -1], minlength=8)
            typer.echo(f"{alarms} false alarms in {(number + 1) * batch} healthy flights, codes {codes.tolist()}")
    else:
        flown = fly(change_of(), commands(options.flights, 300.0, 0, calm=True), 7, options.turbulence)
        names = ("cz_alpha", "cm_alpha", "cl_beta", "cn_beta", "cm_q")
        for key in (*names, "roll_effectiveness", "pitch_effectiveness", "yaw_effectiveness"):
            values = flown.history[f"{key}_estimate"]
            drift = np.abs(values - values[:, :1]).max(axis=1) / np.abs(values[:, 0])
            typer.echo(f"{key}: greatest drift {100 * drift.max():.2f} %, median {100 * np.median(drift):.2f} %")
    typer.echo(f"{time.process_time() - start:.0f} s of CPU")


if __name__ == "__main__":
    main()
