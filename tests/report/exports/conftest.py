"""A made-up flight with distinct values in each variable, valid attitudes, and a moving goal of two aircraft."""

import numpy as np
import pytest

from anser.results import to_dataset
from anser.variables import CATALOGUE, DERIVED_KEYS

TIMES, NAMES, GOALS = 60, ("anna", "bert", "cläre <b>"), ("boat", "buoy", "boat")
ARRIVAL_S = 4.0


def _attitude_quaternion(roll, pitch, yaw):
    """Quaternion of the rotation from NED to body axes, scalar first, from roll, pitch and yaw."""
    cr, cp, cy, sr, sp, sy = (f(angle / 2) for f in (np.cos, np.sin) for angle in (roll, pitch, yaw))
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def _history(time):
    generator = np.random.default_rng(11)
    shape = (time.size, len(NAMES))
    history = {}
    for variable in CATALOGUE:
        if variable.key in DERIVED_KEYS:
            continue
        if variable.dtype == "bool":
            history[variable.key] = generator.random(shape) < 0.3
        elif variable.dtype == "int32":
            history[variable.key] = generator.integers(0, 3, shape)
        else:
            history[variable.key] = generator.uniform(-3.0, 3.0, shape)
    t, k = time[:, None], np.arange(len(NAMES))[None, :]
    yaw = np.mod(0.9 * t + 2.0 * k + np.pi, 2 * np.pi) - np.pi
    roll, pitch = 1.1 * np.sin(t + k), 0.4 * np.cos(0.7 * t - k)
    history |= {"roll": roll, "pitch": pitch, "yaw": yaw}
    history |= {f"quaternion_{n}": part for n, part in enumerate(_attitude_quaternion(roll, pitch, yaw))}
    history |= {
        "north": 150.0 * t - 4000.0 * k,
        "east": 9000.0 * np.sin(0.1 * t + k),
        "altitude": 1000.0 + 30.0 * t + 0 * k,
    }
    goal_index = np.array([[0, 1, 0]])
    history |= {"goal_north": 20.0 * t * (goal_index == 0) + 700.0, "goal_east": 900.0 * goal_index + 0 * t}
    history |= {"goal_altitude": np.zeros(shape), "rendezvous_altitude": np.full(shape, 300.0)}
    history |= {f"rendezvous_{axis}": history[f"goal_{axis}"] + 10.0 * (k + 1) for axis in ("north", "east")}
    return history


@pytest.fixture(scope="session")
def flown():
    """Dataset and summary."""
    time = np.linspace(0.0, 5.9, TIMES)
    attributes = {
        "title": "made-up",
        "description": "Fish & <script>chips</script>",
        "reference_latitude_deg": 47.5,
        "reference_longitude_deg": 179.95,
    }
    aircraft = [
        {"name": name, "goal": goal, "status": "arrived", "planned_arrival_s": ARRIVAL_S, "arrival_s": ARRIVAL_S}
        | {"miss_m": 0.25}
        for name, goal in zip(NAMES, GOALS, strict=True)
    ]
    return to_dataset(time, _history(time), NAMES, attributes), {"scenario": {"name": "made-up"}, "aircraft": aircraft}
