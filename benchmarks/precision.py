"""Differences between flights in float32 and in float64, and the gain in speed.

`python benchmarks/precision.py studies/what-matters.toml` flies the flights of a study chunk by chunk, alternately in
both precisions, as a campaign does, and prints the distributions of the differences of miss and arrival. Times are
given as ratios of consecutive chunks, in wall-clock time and in processor time, because the machine may be busy.
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
from anser.simulation.flight import PRECISIONS, Precision

SHARES = (0.5, 0.95, 0.99, 1.0)


def cases_of(study: Path, flights: int) -> list[FlightCase]:
    """The first flights of a study, with its values and seeds."""
    study_config, scenario, sampled_values = load_study(study)
    applied = applied_values(study_config, scenario, sampled_values)
    seeds = flight_seeds(study_config, next(iter(applied.values())).size)[:flights].tolist()
    return [FlightCase(dispersed_scenario(scenario, seed, applied, k)) for k, seed in enumerate(seeds)]


def flown(cases: list[FlightCase], precision: Precision) -> tuple[list[FlightRow], np.ndarray]:
    """Rows of a chunk, and its wall-clock and processor times, s."""
    start_times = np.array([time.perf_counter(), time.process_time()])
    flight_rows = fly_many(cases, batch=len(cases), precision=precision)
    return flight_rows, np.array([time.perf_counter(), time.process_time()]) - start_times


def numbers(flight_rows: list[FlightRow], key: str) -> np.ndarray:
    """A quantity of every aircraft of every flight; NaN if missing."""
    return np.array([aircraft[key] for flight_row in flight_rows for aircraft in flight_row.aircraft], dtype=float)


def main() -> None:
    """Fly, compare, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("study", type=Path)
    parser.add_argument("--flights", type=int, default=256)
    parser.add_argument("--batch", type=int, default=64)
    options = parser.parse_args()
    cases = cases_of(options.study, options.flights)
    chunks = [cases[k : k + options.batch] for k in range(0, len(cases), options.batch)]
    for precision in PRECISIONS:
        print(
            f"{precision}: the first chunk took {flown(chunks[0], precision)[1][0]:.1f} s, with compiling", flush=True
        )
    rows_by_precision: dict[Precision, list[FlightRow]] = {precision: [] for precision in PRECISIONS}
    ratios = []
    for chunk in chunks:
        seconds = {}
        for precision in PRECISIONS:
            flight_rows, seconds[precision] = flown(chunk, precision)
            rows_by_precision[precision] += flight_rows
        ratios.append(seconds["float64"] / seconds["float32"])
    successes = [[flight_row.met for flight_row in rows_by_precision[precision]] for precision in PRECISIONS]
    print(
        f"met every requirement: {sum(successes[0])} and {sum(successes[1])} of {len(cases)}; "
        f"another outcome in {np.sum(np.not_equal(successes[0], successes[1]))}"
    )
    for key in ("miss_m", "arrival_s"):
        values_64, values_32 = (numbers(rows_by_precision[precision], key) for precision in PRECISIONS)
        difference = np.abs(values_64 - values_32)
        quantiles_text = ", ".join(f"{100 * share:g} % {np.quantile(difference, share):.2g}" for share in SHARES)
        print(f"{key}: median {np.median(values_64):.4g}; difference {quantiles_text}")
    for clock, clock_ratios in zip(("by the clock", "of the processor"), np.transpose(ratios), strict=True):
        low, middle, high = np.quantile(clock_ratios, (0.0, 0.5, 1.0))
        print(f"float64 takes {middle:.2f} times as long {clock} ({low:.2f} to {high:.2f} in {len(chunks)} pairs)")


if __name__ == "__main__":
    main()
