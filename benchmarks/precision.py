"""How much flights in float32 differ from those in float64, and how much faster they are.

`python benchmarks/precision.py studies/what-matters.toml` flies the flights of a study, chunk by chunk and in turns, in
both precisions, as a campaign does it, and prints how the differences of miss and arrival are distributed. Times are
told as ratios of chunks that were flown one after the other, by the clock and in seconds of the processor: the machine
may be busy with other things.
"""

import argparse
import time
from pathlib import Path

import numpy as np

from anser.campaigns import load_study
from anser.campaigns.flights import applied_values, dispersed_scenario
from anser.campaigns.sampling import flight_seeds
from anser.missions import fly_many
from anser.missions.flight_batches import FlightCase
from anser.results.flight_rows import FlightRow
from anser.simulation.precision import PRECISIONS, Precision

SHARES = (0.5, 0.95, 0.99, 1.0)


def cases_of(study: Path, flights: int) -> list[FlightCase]:
    """The first flights of a study, with its values and seeds."""
    wanted, scenario, given = load_study(study)
    applied = applied_values(wanted, scenario, given)
    seeds = flight_seeds(wanted, next(iter(applied.values())).size)[:flights].tolist()
    rows = [{path: values[k] for path, values in applied.items()} for k in range(len(seeds))]
    return [FlightCase(dispersed_scenario(scenario, seed, row)) for seed, row in zip(seeds, rows, strict=True)]


def flown(cases: list[FlightCase], precision: Precision) -> tuple[list[FlightRow], np.ndarray]:
    """Rows of a chunk, and the seconds that it took: by the clock, and of all cores together."""
    began = np.array([time.perf_counter(), time.process_time()])
    rows = fly_many(cases, batch=len(cases), precision=precision)
    return rows, np.array([time.perf_counter(), time.process_time()]) - began


def numbers(rows: list[FlightRow], key: str) -> np.ndarray:
    """A number of every aircraft of every flight; NaN where it has none."""
    return np.array([one[key] for row in rows for one in row.aircraft], dtype=float)


def main() -> None:
    """Fly, compare, print."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("study", type=Path)
    asked.add_argument("--flights", type=int, default=256)
    asked.add_argument("--batch", type=int, default=64)
    given = asked.parse_args()
    cases = cases_of(given.study, given.flights)
    chunks = [cases[k : k + given.batch] for k in range(0, len(cases), given.batch)]
    for precision in PRECISIONS:
        print(
            f"{precision}: the first chunk took {flown(chunks[0], precision)[1][0]:.1f} s, with compiling", flush=True
        )
    found: dict[Precision, list[FlightRow]] = {precision: [] for precision in PRECISIONS}
    ratios = []
    for chunk in chunks:
        seconds = {}
        for precision in PRECISIONS:
            rows, seconds[precision] = flown(chunk, precision)
            found[precision] += rows
        ratios.append(seconds["float64"] / seconds["float32"])
    met = [[row.met for row in found[precision]] for precision in PRECISIONS]
    print(
        f"met every requirement: {sum(met[0])} and {sum(met[1])} of {len(cases)}; "
        f"another outcome in {np.sum(np.not_equal(met[0], met[1]))}"
    )
    for key in ("miss_m", "arrival_s"):
        first, second = (numbers(found[precision], key) for precision in PRECISIONS)
        off = np.abs(first - second)
        words = ", ".join(f"{100 * share:g} % {np.quantile(off, share):.2g}" for share in SHARES)
        print(f"{key}: median {np.median(first):.4g}; difference {words}")
    for what, found_ratios in zip(("by the clock", "of the processor"), np.transpose(ratios), strict=True):
        low, middle, high = np.quantile(found_ratios, (0.0, 0.5, 1.0))
        print(f"float64 takes {middle:.2f} times as long {what} ({low:.2f} to {high:.2f} in {len(chunks)} pairs)")


if __name__ == "__main__":
    main()
