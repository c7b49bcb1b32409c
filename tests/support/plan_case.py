"""A made-up plan: aircraft on straight lines to a ring of goals, with known speeds, distances and margins."""

import numpy as np

from anser.results.plan_record import ClosestApproach, PlanDetails, PlanExtremes, PlanSamples
from support.made_scenario import made_scenario

SPEED, STEP, GRAVITY = 150.0, 0.5, 9.81
CELL = {"name": "cell", "north_m": 4000.0, "east_m": 4000.0, "speed_m_s": 10.0, "radius_m": 1000.0, "top_m": 3000.0}


def plan_case(
    names=("anna", "bert", "carl"),
    arrivals=(60.0, 60.0, 40.25),
    separation_m=None,
    keep_outs=(),
    distance_min_m=None,
    **extra_details,
):
    """Samples and details of a plan; the aircraft come from several sides, the last arrives between two samples."""
    arrival = np.resize(np.asarray(arrivals, dtype=float), len(names))
    time = np.union1d(STEP * np.arange(int(arrival.max() / STEP) + 1), arrival)
    angle = 2.0 * np.pi * np.arange(len(names)) / len(names) + 0.3
    to_go = SPEED * (arrival[None, :] - time[:, None]) + 1000.0
    flying = time[:, None] <= arrival[None, :]
    course = np.mod(angle + 2.0 * np.pi, 2.0 * np.pi) - np.pi

    def known(values):
        return np.where(flying, values, np.nan)

    history = {
        "north": known(to_go * np.cos(angle)),
        "east": known(to_go * np.sin(angle)),
        "altitude": known(1000.0 + 100.0 * np.arange(len(names)) + 0.0 * to_go),
        "velocity_north": known(-SPEED * np.cos(angle) + 0.0 * to_go),
        "velocity_east": known(-SPEED * np.sin(angle) + 0.0 * to_go),
        "velocity_down": known(0.0 * to_go),
        "airspeed": known(SPEED + 0.0 * to_go),
        "ground_speed": known(SPEED + 0.0 * to_go),
        "course": known(course + 0.0 * to_go),
        "ground_course": known(course + 0.0 * to_go),
        "path_angle": known(0.0 * to_go),
        "climb_rate": known(0.0 * to_go),
        "bank": known(0.2 * np.sin(0.1 * time)[:, None] + 0.0 * to_go),
        "load_factor": known(1.0 + 0.0 * to_go),
        "thrust_surplus": known(0.0 * to_go),
    }
    drift = 5.0 * time[:, None]
    goals = np.stack(
        [known(1000.0 * np.cos(angle) + drift), known(1000.0 * np.sin(angle) + 0.0 * drift), known(0.0 * to_go)], axis=2
    )
    ones = np.ones(len(names))
    extremes = PlanExtremes(
        SPEED * arrival,
        SPEED * ones,
        {
            "airspeed_min": SPEED * ones,
            "airspeed_max": SPEED * ones,
            "bank_max": 0.2 * ones,
            "load_factor_max": ones,
            "load_factor_min": ones,
            "climb_rate_max": 0.0 * ones,
            "altitude_min": 1000.0 + 100.0 * np.arange(len(names)),
            "altitude_max": 1000.0 + 100.0 * np.arange(len(names)),
            "thrust_surplus_max": 0.0 * ones,
            "thrust_deficit_max": 0.0 * ones,
        },
    )
    gap = np.linspace(9000.0, 520.0, time.size)
    pair = np.tile([0, 1], (time.size, 1))
    closest = ClosestApproach(gap, pair, 512.5, (0, 1), 59.75, 510.0, 50.49)
    if len(names) == 1:
        closest = ClosestApproach(np.nan * gap, 0 * pair - 1, np.nan, (-1, -1), np.nan, np.nan, np.nan)
    room = np.full((len(names), len(keep_outs)), 250.0) + 10.0 * np.arange(len(names))[:, None]
    samples = PlanSamples(
        time_s=time,
        is_regular=np.isclose(np.mod(time, STEP), 0.0),
        arrival_times_s=arrival,
        history=history,
        goal_positions_n=goals,
        extremes=extremes,
        find_closest_by_distance=lambda: closest,
        closest_by_separation=None if separation_m is None else closest,
        keep_out_margin_m=room,
        keep_out_margin_time_s=np.full(room.shape, 12.0),
    )
    tables = {"fleet": {"speed_m_s": SPEED, "planner": "certified"}, "keep_out": list(keep_outs)}
    if separation_m is not None:
        tables["separation"] = {"horizontal_m": separation_m[0], "vertical_m": separation_m[1]}
    if distance_min_m is not None:
        tables["requirements"] = {"separation_min_m": distance_min_m}
    scenario = made_scenario(names, [f"buoy-{k % 2 + 1}" for k in range(len(names))], seed=7, **tables)
    details = {
        "scenario": scenario,
        "paths": ("nominal",) * len(names),
        "messages": (None,) * len(names),
        "limits": {
            "airspeed_min": 90.0,
            "airspeed_max": 240.0,
            "bank_max": np.pi / 4,
            "load_factor_max": 5.0,
            "load_factor_min": 0.5,
            "climb_rate_max": 80.0,
            "altitude_min": 100.0,
            "altitude_max": 15240.0,
            "thrust_surplus_max": 2.0 * ones,
        },
    }
    return samples, PlanDetails(**(details | extra_details))
