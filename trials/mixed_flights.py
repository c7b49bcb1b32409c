"""Many flights of different kinds in one process: how much memory and how many memory regions it comes to hold.

``python -m trials.mixed_flights --flights 300 --out build/mixed-flights.jsonl``

The flights differ in what is compiled for them: fleets, planners, sensors, noise, events, what is recorded. The exit
code is 1 where the process held more than ``--most-gib`` at any time or a flight ended in a fault. A flight that finds
no plan, or misses, is a flight.
"""

import argparse
import json
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import anser
from anser.missions import NoPlanError
from anser.scenario import Scenario, load

SCENARIOS = ("single-aircraft", "three-aircraft", "three-uavs", "turning-ships", "uncertain-world", "lost-aircraft")
RECORD_PERIODS_S = (0.1, 0.5)
_FOLDER = Path(__file__).parents[1] / "scenarios"
_STATUS, _REGIONS = Path("/proc/self/status"), Path("/proc/self/maps")


def mixed_scenarios(count: int, seed: int, names: Sequence[str]) -> Iterator[tuple[str, Scenario]]:
    """Scenarios in random order, each with a seed of its own."""
    random = np.random.default_rng([41, seed])
    for number in range(count):
        name, period_s = str(random.choice(names)), float(random.choice(RECORD_PERIODS_S))
        scenario = load(_FOLDER / f"{name}.toml")
        yield f"{name} {period_s:g} s", scenario.replace("seed", number, "timing.record_period_s", period_s)


def memory() -> dict[str, int]:
    """Resident memory of this process now and at its greatest, KiB, and its memory regions."""
    status = _STATUS.read_text()
    resident, greatest = (int(status.split(f"{name}:")[1].split()[0]) for name in ("VmRSS", "VmHWM"))
    return {"resident_kib": resident, "greatest_kib": greatest, "regions": _REGIONS.read_bytes().count(b"\n")}


def fly(scenario: Scenario) -> str:
    """Fly a scenario; what came of it."""
    try:
        return "met" if anser.run(scenario).met else "not met"
    except NoPlanError:
        return "no plan"
    except Exception as error:  # noqa: BLE001 - the fault is what is looked for
        return f"fault: {error!r}"


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--scenarios", nargs="+", default=SCENARIOS, metavar="NAME")
    parser.add_argument("--most-gib", type=float, default=3.0)
    parser.add_argument("--out", type=Path, required=True, help="a row of each flight is added")
    options = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for name, scenario in mixed_scenarios(options.flights, options.seed, options.scenarios):
        began = time.perf_counter()
        outcome = fly(scenario)
        rows.append({"flight": name, "outcome": outcome, "took_s": round(time.perf_counter() - began, 1)} | memory())
        with options.out.open("a") as file:
            file.write(json.dumps(rows[-1]) + "\n")
    greatest_gib = max(row["greatest_kib"] for row in rows) / (1 << 20)
    faults = [row for row in rows if row["outcome"].startswith("fault")]
    print(  # noqa: T201
        f"{len(rows)} flights: at most {greatest_gib:.2f} GiB, {max(row['regions'] for row in rows)} memory regions, "
        f"{len(faults)} faults"
    )
    sys.exit(1 if faults or greatest_gib > options.most_gib else 0)


if __name__ == "__main__":
    main()
