"""Random tasks of three aircraft of one kind over moving boats: planned, flown, held to their limits.

``python -m trials.uav_tasks [count] [first seed]`` flies the small electric aircraft of the library, ``--airframe FILE
--airspeed 50`` another one: places are farther apart as its airspeed is higher. No gain and no limit is given: they
follow from the aircraft.
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
    """A task that two numbers of its own make: places, courses and boats at random, two minutes away or less."""
    scale = airspeed_m_s / _AIRSPEED_M_S
    rng = np.random.default_rng(seed)
    aircraft, goals, places, away = [], [], [], float(rng.uniform(0.0, 2.0 * math.pi))
    for k in range(3):
        boat, start = f"boat-{k + 1}", _apart(rng, [one["start"] for one in aircraft], 900.0 * scale)
        place = _apart(rng, places, 900.0 * scale)
        places.append(place)
        goals.append(
            {
                "name": boat,
                "kind": "surface",
                "north_m": place["north_m"] + 2200.0 * scale * math.cos(away),
                "east_m": place["east_m"] + 2200.0 * scale * math.sin(away),
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


def _apart(rng: np.random.Generator, others: list, half_m: float) -> dict[str, float]:
    while True:
        north, east = (float(x) for x in rng.uniform(-half_m, half_m, 2))
        if all(math.hypot(north - one["north_m"], east - one["east_m"]) > _APART_M for one in others):
            return {"north_m": north, "east_m": east}


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def main(count: int, first: int, airframe: dict[str, str], airspeed_m_s: float) -> int:
    """Fly so many tasks; 0 where every one that has a plan keeps what is required of it."""
    met, refused, short = 0, 0, []
    began = time.monotonic()
    for seed in range(first, first + count):
        wanted = task(seed, airframe, airspeed_m_s)
        try:
            flown = anser.run(wanted)
        except NoPlanError as error:
            refused += 1
            _say(f"{seed}: no plan: {str(error).splitlines()[0][:120]}")
            continue
        requirements = flown.summary["requirements"]
        failed = [one for one in requirements if not one["met"]]
        rows, fleet = flown.summary["aircraft"], flown.summary["fleet"]
        miss = max(one["miss_m"] or math.inf for one in rows)
        slow, fast = min(one["speed_min_m_s"] for one in rows), max(one["speed_max_m_s"] for one in rows)
        _say(
            f"{seed}: {rows[0]['arrival_s']:.1f} s, miss {miss:.2f} m, spread {fleet['arrival_spread_s']:.4f} s, "
            f"{slow:.1f} to {fast:.1f} m/s{'' if not failed else ', not met: ' + str(failed)}"
        )
        met += not failed
        short += [seed] if failed else []
    _say(
        f"{count} tasks in {time.monotonic() - began:.0f} s: {met} planned and flown as required, {refused} without a "
        f"plan, {len(short)} short: {short}"
    )
    return 1 if short else 0


if __name__ == "__main__":
    asked = argparse.ArgumentParser()
    asked.add_argument("count", type=int, nargs="?", default=50)
    asked.add_argument("first", type=int, nargs="?", default=0)
    asked.add_argument("--airframe", type=Path)
    asked.add_argument("--airspeed", type=float, default=_AIRSPEED_M_S)
    given = asked.parse_args()
    which = _AEROSONDE if given.airframe is None else {"airframe": str(given.airframe.resolve())}
    sys.exit(main(given.count, given.first, which, given.airspeed))
