"""Latency of the live page in a headless browser: `python -m trials.live_latency --drags 40`.

Goals of three UAVs, then of six, are dragged at random, with a pointer event each sixtieth of a second. The latency of
an answer is the time from the newest pointer event of its scenario to the painted frame. The server's CPU time for each
answer is listed too, because wall times of a busy machine state little.
"""

import argparse
import os
import random
import sys
import tempfile
import time
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from anser.live.documents import merge_into_toml
from trials.live_drags import (
    HANDLES,
    Chromium,  # pyright: ignore[reportAttributeAccessIssue]
    answered,
    cpu_s,
    served,
    wait_for,
)

_SCENARIO = Path(__file__).parents[1] / "scenarios" / "three-uavs.toml"
_OFFSET_EAST_M = 6000.0  # of the second three UAVs and their goals
_STEPS, _STEP_S, _REACH_PX = 12, 1 / 60, 30.0
_WARM_DRAGS = 5  # before the measurement
_LIMITS_MS = {3: (120.0, 400.0), 6: (400.0, None)}  # median and 95 %, by the number of aircraft


def scenario_text(aircraft_count: int) -> str:
    """Text of the scenario with three UAVs, or with six: two groups of three side by side."""
    text = _SCENARIO.read_text(encoding="utf-8")
    if aircraft_count == 3:
        return text
    values = tomllib.loads(text)
    for k in range(3):
        aircraft, goal = values["aircraft"][k], values["goal"][k]
        start = aircraft["start"] | {"east_m": aircraft["start"]["east_m"] + _OFFSET_EAST_M}
        values["aircraft"].append(aircraft | {"name": f"uav-{k + 4}", "goal": f"boat-{k + 4}", "start": start})
        values["goal"].append(goal | {"name": f"boat-{k + 4}", "east_m": goal["east_m"] + _OFFSET_EAST_M})
    return merge_into_toml(text, values)


def drag_goal(browser: Chromium, draw: random.Random) -> None:
    """Drag a random goal to and fro, with a pointer event each sixtieth of a second."""
    goals = [handle for handle in browser.run(HANDLES) if handle[0].startswith("goal[") and handle[0].endswith("]")]
    _, x, y, _ = draw.choice(goals)
    dx, dy = (draw.uniform(-_REACH_PX, _REACH_PX) for _ in range(2))
    browser.mouse("mousePressed", x, y, button="left", clickCount=1)
    begin = time.monotonic()
    for k in range(1, _STEPS + 1):
        share = np.sin(np.pi * k / _STEPS)
        browser.mouse("mouseMoved", x + share * dx, y + share * dy, button="left", buttons=1)
        time.sleep(max(0.0, begin + k * _STEP_S - time.monotonic()))
    browser.mouse("mouseReleased", x, y, button="left", clickCount=1)


def measure(folder: Path, aircraft_count: int, drags: int, seed: int) -> tuple[list[dict[str, Any]], float]:
    """Latencies of the answers to drags as the page lists them, and the server's CPU time for an answer, s."""
    draw = random.Random(seed)
    with (
        served(folder, scenario_text(aircraft_count)) as (server, url),
        Chromium(folder / "browser", 1280, 900, software=True) as browser,
    ):
        browser._ask("Page.navigate", url=url)
        wait_for(browser, "location.protocol === 'http:' && window.live?.answer?.status === 'planned'", server)
        begin_s = 0.0
        for k in range(_WARM_DRAGS + drags):
            if k == _WARM_DRAGS:
                browser.run("live.latencies.length = 0")
                begin_s = cpu_s(server)
            drag_goal(browser, draw)
            answered(browser, server)
            time.sleep(0.1)  # the last frame is painted
        used_s = cpu_s(server) - begin_s
        latencies = browser.run("[...live.latencies]")
    return latencies, used_s / len(latencies)


def main() -> int:
    """Measure both fleets; return 1 if a latency is above its limit."""
    parser = argparse.ArgumentParser(prog="python -m trials.live_latency", description=__doc__)
    parser.add_argument("--drags", type=int, default=40, help="number of drags of each fleet")
    parser.add_argument("--seed", type=int, default=1, help="seed of the drags")
    options = parser.parse_args()
    is_slow = False
    for aircraft_count, limits_ms in _LIMITS_MS.items():
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
            latencies, server_s = measure(Path(folder), aircraft_count, options.drags, options.seed)
        shares_ms = np.percentile([entry["latency_ms"] for entry in latencies], [50, 95])
        elapsed_ms = np.median([entry["elapsed_ms"] for entry in latencies])
        is_slow |= any(limit is not None and value > limit for value, limit in zip(shares_ms, limits_ms, strict=True))
        sys.stdout.write(
            f"{aircraft_count} aircraft, {len(latencies)} answers: median {shares_ms[0]:.0f} ms, "
            f"95 % {shares_ms[1]:.0f} ms; "
            f"plan and answer on the server {elapsed_ms:.0f} ms, CPU time {1e3 * server_s:.0f} ms for an answer; "
            f"load of the machine {os.getloadavg()[0]:.1f}\n"
        )
    return int(is_slow)


if __name__ == "__main__":
    sys.exit(main())
