"""A made-up flight of three aircraft, long enough to be thinned, with turns through South and a hold at the end."""

import json

import numpy as np

from anser.planning.limits import describe_bend
from anser.results import summarize, to_dataset
from anser.variables import CATALOGUE, RECORDED_KEYS
from support.made_scenario import made_scenario

ARRIVAL, END, STEP = 80.0, 130.0, 0.025
# start north, east, altitude; goal north, east; goal velocity north, east; bend
AIRCRAFT = {
    "anna": (1000.0, 9000.0, 1000.0, 100.0, 0.0, 25.0, 0.0, 0.0),
    "bert": (-2000.0, -8000.0, 1500.0, 0.0, 0.0, 0.0, 0.0, 900.0),
    "<b>cläre</b> & co": (-6000.0, 5000.0, 1250.0, 0.0, 100.0, 0.0, 15.0, -1500.0),
}

SCENARIO = {
    "arrival": {"rule": "together"},
    "limits": {
        "speed_min_m_s": 90.0,
        "speed_max_m_s": 240.0,
        "bank_max_deg": 70.0,
        "climb_rate_max_m_s": 80.0,
        "altitude_min_m": 100.0,
        "altitude_max_m": 15000.0,
        "load_factor_min": -1.0,
        "load_factor_max": 5.0,
    },
    "separation": {"horizontal_m": 500.0, "vertical_m": 150.0},
    "keep_out": [
        {
            "name": "storm",
            "north_m": 4000.0,
            "east_m": -4000.0,
            "radius_m": 900.0,
            "bottom_m": 0.0,
            "top_m": 2000.0,
            "speed_m_s": 10.0,
            "course_deg": 45.0,
        }
    ],
}


def _lagged(time, values, lag):
    return np.interp(time - lag, time, values)


def _wrapped(angle):
    return np.arctan2(np.sin(angle), np.cos(angle))


def _one(time, start_n, start_e, start_h, goal_n, goal_e, w_n, w_e, bend):
    goal = np.stack([goal_n + w_n * time, goal_e + w_e * time, 0.0 * time])
    rendezvous = goal + np.array([[0.0], [0.0], [300.0]])
    meeting = goal[:2, np.searchsorted(time, ARRIVAL)]
    s = np.clip(time / ARRIVAL, 0.0, 1.0)
    along = meeting - np.array([start_n, start_e])
    across = np.array([-along[1], along[0]]) / np.hypot(*along)
    path = np.array([[start_n], [start_e]]) + np.outer(along, s) + np.outer(across, bend * np.sin(np.pi * s) ** 2)
    hold, radius = np.maximum(time - ARRIVAL, 0.0), 1500.0
    turn = 140.0 * hold / radius
    unit = along / np.hypot(*along)
    path = path + radius * (np.outer(unit, np.sin(turn)) + np.outer(across, 1.0 - np.cos(turn)))
    altitude = start_h + (300.0 - start_h) * s**2 * (3.0 - 2.0 * s)
    v_n, v_e, v_h = (np.gradient(x, time) for x in (*path, altitude))
    speed, course = np.hypot(np.hypot(v_n, v_e), v_h), np.unwrap(np.arctan2(v_e, v_n))
    bank = np.arctan(speed * np.gradient(course, time) / 9.81)
    gamma = np.arcsin(v_h / speed)
    ripple = np.sin(1.7 * time) * np.exp(-time / 30.0)
    record = {
        variable.key: np.zeros(time.size, dtype=variable.dtype)
        for variable in CATALOGUE
        if variable.key in RECORDED_KEYS
    }
    record |= {
        "north": path[0] + 3.0 * ripple,
        "east": path[1] - 2.0 * ripple,
        "altitude": altitude + 2.0 * ripple,
        "velocity_down": -v_h,
        "quaternion_0": np.cos(course / 2.0),
        "quaternion_3": np.sin(course / 2.0),
        "roll": bank,
        "yaw": _wrapped(course),
        "load_factor": 1.0 / np.cos(bank),
        "planned_length": 1e4 - 1e3 * np.floor(np.minimum(time, ARRIVAL - 10.0) / 10.0),
        "renewal": np.where((time >= 40.0) & (time < 50.0), 2, 0),
        "thrust_limited": (time > 20.0) & (time < 25.0),
        "reference_north": path[0],
        "reference_east": path[1],
        "reference_altitude": altitude,
        "airspeed": speed + ripple,
        "airspeed_command": speed,
        "path_angle": _lagged(time, gamma, 0.8),
        "path_angle_command": gamma,
        "course": _wrapped(_lagged(time, course, 1.0)),
        "course_command": _wrapped(course),
        "bank": _lagged(time, bank, 0.6),
        "bank_command": bank,
        "alpha": 0.08 + 0.06 * _lagged(time, np.abs(bank), 0.3) + 0.005 * ripple,
        "alpha_command": 0.08 + 0.06 * np.abs(bank),
        "beta": 0.002 * ripple,
        "elevator": -0.04 - 0.02 * _lagged(time, np.abs(bank), 0.2) + 0.01 * ripple,
        "elevator_command": -0.04 - 0.02 * np.abs(bank) + 0.01 * ripple,
        "aileron": 0.05 * _lagged(time, np.gradient(bank, time), 0.1),
        "aileron_command": 0.05 * np.gradient(bank, time),
        "rudder": 0.01 * ripple,
        "rudder_command": 0.01 * ripple,
        "throttle": np.clip(0.25 + 0.004 * (speed - 140.0) + 0.5 * np.sin(gamma) + 0.02 * ripple, 0.0, 1.0),
        "position_error": 4.0 * np.abs(ripple),
        "lateral_bend": 0.0 * time + bend,
        "arrival_time": 0.0 * time + ARRIVAL,
        "phase": np.select([time < ARRIVAL - 10.0, time < ARRIVAL], [0, 1], 2),
        "outside_tables": time < -1.0,
        "status": np.zeros(time.size, dtype=int),
    }
    for axis, goal_values, rendezvous_values in zip(("north", "east", "altitude"), goal, rendezvous, strict=True):
        record |= {
            f"goal_{axis}": goal_values,
            f"goal_estimate_{axis}": goal_values,
            f"rendezvous_{axis}": rendezvous_values,
        }
    offset = rendezvous - np.stack([record["north"], record["east"], record["altitude"]])
    record["range_to_rendezvous"] = np.linalg.norm(offset, axis=0)
    record["clearance"] = np.linalg.norm(offset - np.array([[0.0], [0.0], [300.0]]), axis=0)
    return record


def make_flight(scenario_name="Three <aircraft>", repeat=1):
    """Dataset and summary of the flight; `repeat` multiplies the fleet."""
    time = np.arange(0.0, END + STEP / 2.0, STEP)
    records = [_one(time, *numbers) for numbers in AIRCRAFT.values()] * repeat
    names = tuple(f"{name}{turn or ''}" for turn in range(repeat) for name in AIRCRAFT)
    history = {key: np.stack([record[key] for record in records], axis=1) for key in records[0]}
    required = {"miss_max_m": 15.0, "arrival_spread_max_s": 1.0, "separation_min_m": 600.0}
    tables = {"requirements": required, "limits": {"speed_min_m_s": 30.0, "speed_max_m_s": 340.0}}
    flown = made_scenario(names, ("buoy", "tower", "ship") * repeat, name=scenario_name, seed=7, **tables)
    paths = [describe_bend(float(bend)) for bend in history["lateral_bend"][0]]
    summary = summarize(time, history, flown, 4.2, paths)
    attributes = {"reference_latitude_deg": 47.0, "reference_longitude_deg": 8.0, "scenario": json.dumps(SCENARIO)}
    return to_dataset(time, history, names, attributes), summary
