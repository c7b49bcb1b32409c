"""Verification by whole missions: effects of a round Earth and of the integration step on the results."""

import functools
from collections.abc import Iterator

import numpy as np

from anser.analysis.step_flights import fly_climb_and_turn
from anser.config.shipped_files import shipped_files
from anser.constants import EARTH_ROTATION_RAD_S, STANDARD_GRAVITY_M_S2
from anser.missions.runs import FlightResult, run
from anser.scenario.files import loads
from anser.scenario.schema import Scenario
from anser.simulation.fleet_summary import ARRIVAL_MARGIN_S
from anser.spatial.wgs84 import radii_of_curvature
from anser.units import DEG_RAD, RAD_DEG
from anser.verification.checks import Check, Comparison, make_check

MISSION = "three-aircraft"
"""Name of the shipped scenario of the reference mission of three aircraft."""

SINGLE_AIRCRAFT = "single-aircraft"
"""Name of the shipped scenario of the founding work's case of a single aircraft."""

STEPS_S = (0.02, 0.01, 0.005, 0.0025)
"""Integration steps, s: 50, 100, 200 and 400 Hz; the second is the default."""

_DURATION_S = 75.0
"""Duration of the flown mission, s: longer than the arrival (60.4 s) needs; comparisons end at the arrival."""
_STRAIGHT_S = (10.0, 50.0)
_TRACKING_BOUND_M = 1.5
_MEAN_RADIUS_M = float(sum(map(float, radii_of_curvature(np.pi / 4)))) / 2


@functools.cache
def mission(earth: str = "flat", step_s: float = 0.01) -> FlightResult:
    """Fly the reference mission with an Earth model and a step until after its arrivals; cached by the arguments.

    `step_s` is the step of the integration and of the autopilots, s. Raises RuntimeError if the flight is too short for
    the search for the arrivals.
    """
    flight = run(mission_scenario(earth, step_s))
    arrival_s = max(aircraft["planned_arrival_s"] for aircraft in flight.summary["aircraft"])
    required_duration_s = arrival_s + ARRIVAL_MARGIN_S
    if required_duration_s > _DURATION_S:
        raise RuntimeError(
            f"{MISSION}.toml: flown for {_DURATION_S:g} s, its arrival needs {required_duration_s:.1f} s"
        )
    return flight


def mission_scenario(earth: str, step_s: float) -> Scenario:
    """Return the shortened scenario of the reference mission with the given Earth model and step (s)."""
    return _scenario(MISSION).replace("timing.duration_s", _DURATION_S, "timing.step_s", step_s, "earth", earth)


def published_flights() -> dict[str, FlightResult]:
    """Fly the founding work's cases of one and of three aircraft; return the flights as "single" and "three"."""
    return {"single": run(_scenario(SINGLE_AIRCRAFT)), "three": mission()}


def _scenario(name: str) -> Scenario:
    return loads(shipped_files()[name].read_text(encoding="utf-8"), f"{name}.toml")


def flat_and_round() -> Iterator[Comparison]:
    """Compare the reference mission flown over a flat and over a round Earth.

    Lift and bank of the first aircraft must differ as theory predicts; miss, path and arrival spread must agree.
    """
    flat, round_earth = mission("flat"), mission("wgs84")
    lowest, highest = _STRAIGHT_S
    straight = [flight.dataset.isel(aircraft=0).sel(time=slice(lowest, highest)) for flight in (flat, round_earth)]
    down, across = _apparent_accelerations(straight[1])
    lift = STANDARD_GRAVITY_M_S2 * (straight[1].load_factor - straight[0].load_factor).values
    bank = (straight[1].bank_deg - straight[0].bank_deg).values
    tilt = -across / STANDARD_GRAVITY_M_S2 * RAD_DEG
    interval = f"aircraft-1, mean of {lowest:g} to {highest:g} s"
    # Straight flight; the remaining difference comes from the climbs of two closed loops.
    yield Comparison("lift per mass", interval, "m/s^2", float(down.mean()), float(lift.mean()), 0.05 * 0.0254)
    yield Comparison("bank", interval, "deg", float(tilt.mean()), float(bank.mean()), 0.05 * 0.148)
    requirements = flat.scenario.requirements
    for k, (flat_aircraft, round_aircraft) in enumerate(_aircraft_of(flat, round_earth)):
        name, misses = flat_aircraft["name"], (flat_aircraft["miss_m"], round_aircraft["miss_m"])
        yield Comparison("miss", name, "m", *misses, 0.01 * requirements.miss_max_m)
        distance = _greatest_distance(flat, round_earth, k)
        yield Comparison("path, greatest difference", name, "m", 0.0, distance, _drift_m(flat, k))
        airspeeds = [flight.dataset.airspeed_m_s.isel(aircraft=k).values for flight in (flat, round_earth)]
        arrived = flat.dataset.time.values <= flat_aircraft["arrival_s"]
        difference = float(np.max(np.abs((airspeeds[0] - airspeeds[1])[arrived])))
        yield Comparison("airspeed, greatest difference", name, "m/s", None, difference, None)
    spreads, limit = (_spread_s(flat), _spread_s(round_earth)), 0.01 * requirements.arrival_spread_max_s
    yield Comparison("arrival spread", "fleet", "s", *spreads, limit)


def steps() -> Iterator[Comparison]:
    """Compare the arrivals of the reference mission at different integration steps.

    Between the default step (100 Hz) and half of it, misses and arrival spread may differ by a hundredth of the
    requirements. The other listed differences have no tolerance.
    """
    finest, halved, default = (mission(step_s=STEPS_S[k]) for k in (-1, 2, 1))
    requirements, rates = finest.scenario.requirements, "100 Hz against 200 Hz"
    for halved_aircraft, default_aircraft in _aircraft_of(halved, default):
        point, misses = f"{halved_aircraft['name']}, {rates}", (halved_aircraft["miss_m"], default_aircraft["miss_m"])
        yield Comparison("miss", point, "m", *misses, 0.01 * requirements.miss_max_m)
    spreads, limit = (_spread_s(halved), _spread_s(default)), 0.01 * requirements.arrival_spread_max_s
    yield Comparison("arrival spread", rates, "s", *spreads, limit)
    for step_s in STEPS_S[:-1]:
        flight, rates = mission(step_s=step_s), f"{1 / step_s:.0f} Hz against {1 / STEPS_S[-1]:.0f} Hz"
        miss_changes = [abs(a["miss_m"] - b["miss_m"]) for a, b in _aircraft_of(flight, finest)]
        yield Comparison("miss, greatest change", rates, "m", None, max(miss_changes), None)
        spread_change = abs(_spread_s(flight) - _spread_s(finest))
        yield Comparison("arrival spread, change", rates, "s", None, spread_change, None)
        path = max(_greatest_distance(flight, finest, k) for k in range(len(miss_changes)))
        yield Comparison("path, greatest difference", rates, "m", None, path, None)


def _aircraft_of(*flights: FlightResult) -> Iterator[tuple[dict, ...]]:
    """Yield, for each aircraft, its summary entries in several flights of the same fleet."""
    return zip(*(flight.summary["aircraft"] for flight in flights), strict=True)


def climb_and_turn_error() -> Iterator[Comparison]:
    """Compare with 0 the greatest position error of the founding F-16's climb-and-turn, by velocity commands alone."""
    flight = fly_climb_and_turn("founding")
    error = float(flight.summary["aircraft"][0]["position_error_max_m"])
    yield Comparison("position error, greatest", "whole flight", "m", 0.0, error, _TRACKING_BOUND_M)


def _apparent_accelerations(dataset) -> tuple[np.ndarray, np.ndarray]:
    """Return the accelerations, down and to the right, m/s^2, that the Earth's rotation and curvature add.

    Source: [SL] eq. 1.7-18.
    """
    speed, course = dataset.ground_speed_m_s.values, dataset.ground_course_deg.values * DEG_RAD
    latitude = dataset.latitude_deg.values * DEG_RAD
    east = speed * np.sin(course)
    down = -(2 * EARTH_ROTATION_RAD_S * np.cos(latitude) * east + speed**2 / _MEAN_RADIUS_M)
    turning = 2 * EARTH_ROTATION_RAD_S * np.sin(latitude) + east * np.tan(latitude) / _MEAN_RADIUS_M
    return down, turning * speed


def _greatest_distance(flight: FlightResult, reference: FlightResult, k: int) -> float:
    """Return the greatest distance, m, between aircraft `k` in two flights, until the arrival in `flight`."""
    arrived = flight.dataset.time.values <= flight.summary["aircraft"][k]["arrival_s"]
    offsets = [
        (flight.dataset[name].isel(aircraft=k) - reference.dataset[name].isel(aircraft=k)).values[arrived]
        for name in ("north_m", "east_m", "altitude_m")
    ]
    return float(np.max(np.sqrt(sum(offset**2 for offset in offsets))))


def _drift_m(flight: FlightResult, k: int) -> float:
    """Return a bound, m, of the drift of aircraft `k`, whose plan neglects the Earth's rotation and curvature.

    The bound is a / K_P times the time to the arrival, with the neglected acceleration a and the proportional gain K_P
    of the velocity loop.
    """
    scenario, aircraft = flight.scenario, flight.summary["aircraft"][k]
    speed = aircraft["speed_mean_m_s"]
    unmodelled = 2 * EARTH_ROTATION_RAD_S * speed + speed**2 / _MEAN_RADIUS_M
    gain = min(scenario.aircraft[k].gains.velocity.proportional)
    return unmodelled / gain * aircraft["arrival_s"]


def _spread_s(flight: FlightResult) -> float:
    return float(flight.summary["fleet"]["arrival_spread_s"])


MISSION_CHECKS: tuple[Check, ...] = (
    make_check("climb-and-turn", climb_and_turn_error, long=True),
    make_check("flat-round", flat_and_round, long=True),
    make_check("step-size", steps, long=True),
)
