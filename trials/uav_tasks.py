"""Random tasks of three identical aircraft over moving boats: planned, flown, checked against the requirements.

``python -m trials.uav_tasks [count] [first seed]`` flies the small electric aircraft of the library, ``--airframe FILE
--airspeed 50`` another one: distances grow with its airspeed. Gains and limits are the defaults of the aircraft.
"""

import argparse
import math
import sys
import time
from pathlib import Path

import numpy as np

import anser
from anser.missions import NoPlanError
from anser.scenario import Scenario, validate

_AIRSPEED_M_S, _WIND_M_S, _BOAT_MOST_M_S = 25.0, 10.0, 5.0
_AEROSONDE = {"type": "aerosonde"}
_APART_M = 300.0


def task(seed: int, airframe: dict[str, str], airspeed_m_s: float) -> Scenario:
    """A task determined by its seed: random positions, courses and boats, up to two minutes away."""
    scale = airspeed_m_s / _AIRSPEED_M_S
    rng = np.random.default_rng(seed)
    aircraft, goals, meeting_points, bearing = [], [], [], float(rng.uniform(0.0, 2.0 * math.pi))
    for k in range(3):
        boat, start = f"boat-{k + 1}", _apart(rng, [entry["start"] for entry in aircraft], 900.0 * scale)
        meeting_point = _apart(rng, meeting_points, 900.0 * scale)
        meeting_points.append(meeting_point)
        goals.append(
            {
                "name": boat,
                "kind": "surface",
                "north_m": meeting_point["north_m"] + 2200.0 * scale * math.cos(bearing),
                "east_m": meeting_point["east_m"] + 2200.0 * scale * math.sin(bearing),
                "altitude_m": 0.0,
                "speed_m_s": float(rng.uniform(0.0, _BOAT_MOST_M_S)),
                "course_deg": float(rng.uniform(-180.0, 180.0)),
            }
        )
        aircraft.append(
            {
                "name": f"uav-{k + 1}",
                **airframe,
                "goal": boat,
                "start": {
                    **start,
                    "altitude_m": float(rng.uniform(250.0, 500.0)),
                    "speed_m_s": airspeed_m_s,
                    "course_deg": float(rng.uniform(-180.0, 180.0)),
                },
                "rendezvous": {"stand_off_up_m": float(rng.uniform(160.0, 300.0))},
            }
        )
    return validate(
        {
            "format": 2,
            "name": f"uav-task-{seed}",
            "timing": {"duration_s": 480.0},
            "fleet": {"speed_m_s": airspeed_m_s},
            "wind": {"speed_m_s": _WIND_M_S, "from_deg": float(rng.uniform(0.0, 360.0))},
            "hold": {"radius_m": 300.0 * scale**2},
            "separation": {"horizontal_m": 100.0},
            "aircraft": aircraft,
            "goal": goals,
        }
    )


def _apart(rng: np.random.Generator, positions: list, half_m: float) -> dict[str, float]:
    while True:
        north, east = (float(x) for x in rng.uniform(-half_m, half_m, 2))
        if all(math.hypot(north - position["north_m"], east - position["east_m"]) > _APART_M for position in positions):
            return {"north_m": north, "east_m": east}


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def main(count: int, first_seed: int, airframe: dict[str, str], airspeed_m_s: float) -> int:
    """Fly `count` tasks; return 0 if every planned flight meets its requirements."""
    successes, refused, failed_seeds = 0, 0, []
    began = time.monotonic()
    for seed in range(first_seed, first_seed + count):
        scenario = task(seed, airframe, airspeed_m_s)
        try:
            result = anser.run(scenario)
        except NoPlanError as error:
            refused += 1
            _say(f"{seed}: no plan: {str(error).splitlines()[0][:120]}")
            continue
        requirements = result.summary["requirements"]
        failed = [entry for entry in requirements if not entry["met"]]
        aircraft_results, fleet = result.summary["aircraft"], result.summary["fleet"]
        miss = max(entry["miss_m"] or math.inf for entry in aircraft_results)
        slow, fast = (
            min(entry["speed_min_m_s"] for entry in aircraft_results),
            max(entry["speed_max_m_s"] for entry in aircraft_results),
        )
        _say(
            f"{seed}: {aircraft_results[0]['arrival_s']:.1f} s, miss {miss:.2f} m, "
            f"spread {fleet['arrival_spread_s']:.4f} s, "
            f"{slow:.1f} to {fast:.1f} m/s{'' if not failed else ', not met: ' + str(failed)}"
        )
        successes += not failed
        failed_seeds += [seed] if failed else []
    _say(
        f"{count} tasks in {time.monotonic() - began:.0f} s: {successes} planned and flown as required, "
        f"{refused} without a plan, {len(failed_seeds)} short: {failed_seeds}"
    )
    return 1 if failed_seeds else 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("count", type=int, nargs="?", default=50)
    parser.add_argument("first", type=int, nargs="?", default=0)
    parser.add_argument("--airframe", type=Path)
    parser.add_argument("--airspeed", type=float, default=_AIRSPEED_M_S)
    options = parser.parse_args()
    which = _AEROSONDE if options.airframe is None else {"airframe": str(options.airframe.resolve())}
    sys.exit(main(options.count, options.first, which, options.airspeed))
