"""Random tasks of three aircraft in random wind fields from files: planned, flown, checked against the requirements.

``python -m trials.wind_field_flights [count] [first seed]``. A field has up to 30 m/s of wind and a vertical shear of
up to 0.02 1/s in a layer that turns with altitude, waves and a rotation in the horizontal, thermals, and a trend.
"""

import argparse
import math
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

import anser
from anser.missions import NoPlanError
from anser.scenario import Scenario, validate

SPEED_MAX_M_S, SHEAR_MAX_PER_S = 30.0, 0.02
_WAVE_MAX_M_S, _ROTATION_MAX_PER_S, _THERMAL_MAX_M_S, _TREND_MAX = 4.0, 2e-4, 3.0, 0.1
_HALF_M, _ALTITUDES_M, _DURATION_S = 30_000.0, np.linspace(0.0, 5000.0, 26), 420.0
_APART_M = 2000.0


@dataclass(frozen=True)
class FieldTrial:
    """Outcome of one seed."""

    seed: int
    shear_per_s: float  #: Greatest vertical shear of the field, 1/s.
    speed_m_s: float  #: Greatest wind of the field, m/s.
    refusal: str  #: Reason for a missing plan; empty for a plan.
    difference_m_s: float  #: Proven bound of the difference between field and layers along the plan, m/s.
    unmet: tuple[str, ...]  #: Requirements that the flight did not meet.


def write_field(path: Path, seed: int) -> tuple[float, float]:
    """Write the wind field of a seed; return its greatest vertical shear (1/s) and speed (m/s)."""
    rng = np.random.default_rng(seed)
    times, axis = np.array([0.0, 0.5, 1.0]) * _DURATION_S, np.linspace(-_HALF_M, _HALF_M, 41)
    t, h, n, e = np.meshgrid(times, _ALTITUDES_M, axis, axis, indexing="ij")
    course, turn = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(-0.5, 0.5)
    base, shear, bottom = rng.uniform(0.0, 18.0), rng.uniform(0.0, SHEAR_MAX_PER_S), rng.uniform(500.0, 1500.0)
    rise = np.clip(h - bottom, 0.0, rng.uniform(300.0, 1000.0))
    direction = course + turn * rise / 1000.0
    trend = 1.0 + rng.uniform(0.0, _TREND_MAX) * t / _DURATION_S
    north, east = (trend * (base + shear * rise) * part for part in (np.cos(direction), np.sin(direction)))
    rotation, wave, wave_course = (
        rng.uniform(-1.0, 1.0) * _ROTATION_MAX_PER_S,
        rng.uniform(0.0, _WAVE_MAX_M_S),
        rng.uniform(0.0, 7.0),
    )
    phase = 2.0 * math.pi * (n * math.cos(wave_course) + e * math.sin(wave_course)) / rng.uniform(8e3, 3e4)
    north, east = north - rotation * e + wave * np.sin(phase), east + rotation * n + wave * np.cos(phase)
    up = np.zeros_like(n)
    for _ in range(rng.integers(0, 3)):
        center_n, center_e = rng.uniform(-6e3, 6e3, 2)
        distance = np.hypot(n - center_n, e - center_e) / rng.uniform(1500.0, 3000.0)
        up += rng.uniform(0.0, _THERMAL_MAX_M_S) * np.exp(-(distance**2)) * np.clip(h / 500.0, 0.0, 1.0)
    velocity = np.stack([east, north, up])
    factor = min(1.0, SPEED_MAX_M_S / np.max(np.linalg.norm(velocity, axis=0)))
    spacing = _ALTITUDES_M[1] - _ALTITUDES_M[0]
    shears = np.linalg.norm(np.diff(velocity, axis=2), axis=0) / spacing
    factor = min(factor, SHEAR_MAX_PER_S / np.max(shears))
    dims = ("time", "altitude", "north", "east")
    names = ("eastward_wind", "northward_wind", "upward_air_velocity")
    variables = {
        short: (dims, factor * values, {"standard_name": name, "units": "m s-1"})
        for short, name, values in zip("uvw", names, velocity, strict=True)
    }
    coordinates = {"time": ("s", times), "altitude": ("m", _ALTITUDES_M), "north": ("m", axis), "east": ("m", axis)}
    coords = {name: (name, values, {"units": unit}) for name, (unit, values) in coordinates.items()}
    xr.Dataset(variables, coords).to_netcdf(path, engine="netcdf4")
    return float(factor * np.max(shears)), float(factor * np.max(np.linalg.norm(velocity, axis=0)))


def task(seed: int, field: Path) -> Scenario:
    """Return the task of a seed in a wind field: random positions, courses and boats, up to two minutes away."""
    rng = np.random.default_rng((seed, 1))
    starts: list[dict[str, float]] = []
    aircraft, goals = [], []
    for k in range(3):
        start = _apart(rng, starts)
        starts.append(start)
        goals.append(
            {
                "name": f"boat-{k + 1}",
                "kind": "surface",
                "north_m": 4000.0 * math.cos(2.1 * k) + float(rng.uniform(-1e3, 1e3)),
                "east_m": 4000.0 * math.sin(2.1 * k) + float(rng.uniform(-1e3, 1e3)),
                "speed_m_s": float(rng.uniform(0.0, 10.0)),
                "course_deg": float(rng.uniform(-180.0, 180.0)),
            }
        )
        inward_deg = math.degrees(math.atan2(-start["east_m"], -start["north_m"]))
        aircraft.append(
            {
                "name": f"aircraft-{k + 1}",
                "goal": f"boat-{k + 1}",
                "start": {
                    **start,
                    "altitude_m": float(rng.uniform(800.0, 2500.0)),
                    "speed_m_s": 150.0,
                    "course_deg": inward_deg + float(rng.uniform(-60.0, 60.0)),
                },
                "rendezvous": {"stand_off_up_m": float(rng.uniform(600.0, 1500.0))},
            }
        )
    return validate(
        {
            "format": 2,
            "name": f"wind-field-task-{seed}",
            "timing": {"duration_s": _DURATION_S},
            "fleet": {"speed_m_s": 150.0},
            "wind": {"field": str(field)},
            "separation": {"horizontal_m": 500.0},
            "aircraft": aircraft,
            "goal": goals,
        }
    )


def _apart(rng: np.random.Generator, positions: list[dict[str, float]]) -> dict[str, float]:
    while True:
        distance, bearing = rng.uniform(9e3, 15e3), rng.uniform(0.0, 2.0 * math.pi)
        north, east = float(distance * math.cos(bearing)), float(distance * math.sin(bearing))
        if all(math.hypot(north - position["north_m"], east - position["east_m"]) > _APART_M for position in positions):
            return {"north_m": north, "east_m": east}


def fly(seed: int, folder: Path) -> FieldTrial:
    """Plan and fly the task of a seed."""
    path = folder / f"field-{seed}.nc"
    shear, speed = write_field(path, seed)
    scenario = task(seed, path)
    first_plan = anser.plan(scenario)
    try:
        plan = first_plan.plan
    except NoPlanError as error:
        return FieldTrial(seed, shear, speed, str(error), math.nan, ())
    difference = float(np.max(np.asarray(plan.certificate.bounds.wind_error_max)))
    result = anser.run(scenario, planned=first_plan)
    unmet = tuple(entry["name"] for entry in result.summary["requirements"] if not entry["met"])
    return FieldTrial(seed, shear, speed, "", difference, unmet)


def main(count: int, first_seed: int) -> int:
    """Fly `count` tasks; return 0 if every planned flight meets its requirements."""
    began, trials = time.monotonic(), []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first_seed, first_seed + count):
            trial = fly(seed, Path(folder))
            trials.append(trial)
            sys.stdout.write(f"{time.monotonic() - began:6.0f} s {trial}\n")
            sys.stdout.flush()
    planned = [trial for trial in trials if not trial.refusal]
    short = [trial.seed for trial in planned if trial.unmet]
    sys.stdout.write(f"{count} tasks: {len(planned)} planned, {count - len(planned)} refused, short: {short}\n")
    return 1 if short else 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("count", type=int, nargs="?", default=100)
    parser.add_argument("first", type=int, nargs="?", default=0)
    options = parser.parse_args()
    sys.exit(main(options.count, options.first))
