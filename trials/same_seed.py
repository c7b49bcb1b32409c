"""The same flights in another order, in batches of another size, in one and in two processes.

``python -m trials.same_seed scenarios/uncertain-world.toml --flights 64``

Random numbers are identical to the last bit by construction (`tests/numerics/test_randomness.py`). The recorded
results of flights are compared: in batches of equal size to the last bit, between sizes within 1e-9 of each quantity's
scale; greater differences are listed by quantity.
"""

import argparse
import multiprocessing
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from anser.compiling import enable_compilation_cache
from trials.noisy_flights import fly_many

SCALES = {
    "planned_arrival_s": 100.0,
    "arrival_s": 100.0,
    "miss_m": 1.0e4,
    "speed_min_m_s": 150.0,
    "speed_max_m_s": 150.0,
    "bank_max_rad": 1.0,
    "climb_rate_max_m_s": 150.0,
    "separation_m": 1.0e4,
    "clearance_m": 1.0e4,
    "status": 1.0,
    "goal_covariance": 100.0,
    "own_covariance": 100.0,
    "frozen_s": 100.0,
}
_TOLERANCE = 1e-9

Rows = dict[str, np.ndarray]


def departures(rows: Rows, reference: Rows) -> dict[str, np.ndarray]:
    """Greatest difference of each flight, by quantity, relative to its scale."""
    count = rows["flight"].size
    return {
        key: np.max(np.abs(np.asarray(rows[key], float) - reference[key]).reshape(count, -1), axis=1) / scale
        for key, scale in SCALES.items()
    }


def same_bits(rows: Rows, reference: Rows) -> bool:
    """Whether two results are identical to the last bit."""
    return all(np.array_equal(rows[key], reference[key], equal_nan=True) for key in rows)


def _again(job: tuple[str, int, int]) -> Rows:
    import jax

    jax.config.update("jax_enable_x64", True)
    enable_compilation_cache()
    path, first_flight, batch = job
    return fly_many(path, batch, first_flight, batch)


def in_processes(path: str, batch: int, workers: int) -> list[Rows]:
    """Two batches of flights that overlap by half, in a number of processes."""
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        return list(pool.map(_again, [(path, 0, batch), (path, batch // 2, batch)]))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario")
    parser.add_argument("--flights", type=int, default=64)
    options = parser.parse_args()
    enable_compilation_cache()
    half = options.flights // 2
    single_process, two_processes = (in_processes(options.scenario, options.flights, workers) for workers in (1, 2))
    bits = [
        same_bits(batch_rows, reference_rows)
        for batch_rows, reference_rows in zip(single_process, two_processes, strict=True)
    ]
    print(f"one process and two, batches of {options.flights}: same bits {bits}")  # noqa: T201
    halves = slice(half, None), slice(half)
    shared = [
        {key: values[part] for key, values in batch.items()} for batch, part in zip(single_process, halves, strict=True)
    ]
    print(f"another place in the batch, {half} flights: same bits {same_bits(*shared)}")  # noqa: T201
    alone = fly_many(options.scenario, options.flights, 0, 1)
    differences = departures(single_process[0], alone)
    worst = np.max(np.stack(list(differences.values())), axis=0)
    share = np.mean(worst <= _TOLERANCE)
    print(f"alone and in a batch: within 1e-9 of scale {100 * share:.1f} % of flights, greatest {worst.max():.2g}")  # noqa: T201
    for flight in np.flatnonzero(worst > _TOLERANCE):
        quantities = ", ".join(
            f"{key} {values[flight]:.2g}" for key, values in differences.items() if values[flight] > _TOLERANCE
        )
        print(f"  flight {flight}: {quantities}")  # noqa: T201


if __name__ == "__main__":
    import jax

    jax.config.update("jax_enable_x64", True)
    main()
