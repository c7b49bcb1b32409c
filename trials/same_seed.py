"""The same flights again: in another order, in batches of another size, in one and in two processes.

``python -m trials.same_seed scenarios/uncertain-world.toml --flights 64``

Random numbers are the same to the last bit by construction (`tests/numerics/test_randomness.py`). Flights are compared
by what is kept of them: in batches of one size to the last bit, between sizes within 1e-9 of each quantity's scale;
those that differ by more are listed with the quantity.
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
_ENOUGH = 1e-9

Rows = dict[str, np.ndarray]


def departures(one: Rows, other: Rows) -> dict[str, np.ndarray]:
    """Of each quantity the greatest difference of each flight, in its scale."""
    count = one["flight"].size
    return {
        key: np.max(np.abs(np.asarray(one[key], float) - other[key]).reshape(count, -1), axis=1) / scale
        for key, scale in SCALES.items()
    }


def same_bits(one: Rows, other: Rows) -> bool:
    """Whether all is the same to the last bit."""
    return all(np.array_equal(one[key], other[key], equal_nan=True) for key in one)


def _again(asked: tuple[str, int, int]) -> Rows:
    import jax

    jax.config.update("jax_enable_x64", True)
    enable_compilation_cache()
    path, first, batch = asked
    return fly_many(path, batch, first, batch)


def in_processes(path: str, batch: int, workers: int) -> list[Rows]:
    """Two batches of flights that overlap by half, in so many processes."""
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        return list(pool.map(_again, [(path, 0, batch), (path, batch // 2, batch)]))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario")
    parser.add_argument("--flights", type=int, default=64)
    asked = parser.parse_args()
    enable_compilation_cache()
    half = asked.flights // 2
    once, twice = (in_processes(asked.scenario, asked.flights, workers) for workers in (1, 2))
    bits = [same_bits(one, other) for one, other in zip(once, twice, strict=True)]
    print(f"one process and two, batches of {asked.flights}: same bits {bits}")  # noqa: T201
    halves = slice(half, None), slice(half)
    shared = [{key: values[part] for key, values in rows.items()} for rows, part in zip(once, halves, strict=True)]
    print(f"another place in the batch, {half} flights: same bits {same_bits(*shared)}")  # noqa: T201
    alone = fly_many(asked.scenario, asked.flights, 0, 1)
    off = departures(once[0], alone)
    worst = np.max(np.stack(list(off.values())), axis=0)
    share = np.mean(worst <= _ENOUGH)
    print(f"alone and in a batch: within 1e-9 of scale {100 * share:.1f} % of flights, greatest {worst.max():.2g}")  # noqa: T201
    for flight in np.flatnonzero(worst > _ENOUGH):
        told = ", ".join(f"{key} {values[flight]:.2g}" for key, values in off.items() if values[flight] > _ENOUGH)
        print(f"  flight {flight}: {told}")  # noqa: T201


if __name__ == "__main__":
    import jax

    jax.config.update("jax_enable_x64", True)
    main()
