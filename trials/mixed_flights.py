"""Many different flights in one process: growth of its memory and of its number of memory regions.

``python -m trials.mixed_flights --flights 300 --out build/mixed-flights.jsonl``

The flights need different compiled programs: fleets, planners, sensors, noise, events, recorded variables. The exit
code is 1 if the process exceeded ``--most-gib`` at any time or a flight ended in a fault. A flight without a plan or
with a miss is no fault.
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
    """Scenarios in random order, with different seeds."""
    random = np.random.default_rng([41, seed])
    for number in range(count):
        name, period_s = str(random.choice(names)), float(random.choice(RECORD_PERIODS_S))
        scenario = load(_FOLDER / f"{name}.toml")
        yield f"{name} {period_s:g} s", scenario.replace("seed", number, "timing.record_period_s", period_s)


def memory() -> dict[str, int]:
    """Current and greatest resident memory of this process, KiB, and its number of memory regions."""
    status = _STATUS.read_text()
    resident, greatest = (int(status.split(f"{name}:")[1].split()[0]) for name in ("VmRSS", "VmHWM"))
    return {"resident_kib": resident, "greatest_kib": greatest, "regions": _REGIONS.read_bytes().count(b"\n")}


def fly(scenario: Scenario) -> str:
    """Fly a scenario; return the outcome."""
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
    results: list[dict[str, Any]] = []
    for name, scenario in mixed_scenarios(options.flights, options.seed, options.scenarios):
        start_time = time.perf_counter()
        outcome = fly(scenario)
        results.append(
            {"flight": name, "outcome": outcome, "took_s": round(time.perf_counter() - start_time, 1)} | memory()
        )
        with options.out.open("a") as file:
            file.write(json.dumps(results[-1]) + "\n")
    greatest_gib = max(result["greatest_kib"] for result in results) / (1 << 20)
    faults = [result for result in results if result["outcome"].startswith("fault")]
    print(  # noqa: T201
        f"{len(results)} flights: at most {greatest_gib:.2f} GiB, "
        f"{max(result['regions'] for result in results)} memory regions, {len(faults)} faults"
    )
    sys.exit(1 if faults or greatest_gib > options.most_gib else 0)


if __name__ == "__main__":
    main()
