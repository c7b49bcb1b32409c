"""Rare events of flights that are really flown: their intervals overlap that of brute force."""

import time

import numpy as np
import pytest

import anser
from anser.campaigns.rare_flights import RareFlights
from anser.campaigns.subset import estimate, subset_simulation
from anser.results import wilson_interval
from campaigns.study_cases import STUDIES, study_of

SHORT = anser.load(STUDIES / "short-approach.toml")
"""One aircraft for 14 s in moderate turbulence, with errors of its navigation: 3e4 normal numbers, 12 ms a flight."""
THRESHOLD_M = 1.6
RARE = {"statistic": "miss_m", "threshold": THRESHOLD_M, "flights": 400, "repetitions": 4}
BRUTE = 20_000
FAR = 1 << 30
"""Numbers of flights that no walk flies."""


def flights_of(seed, **changes):
    study = study_of(sampling=None, vary=[], rare={**RARE, **changes}, seed=seed)
    return RareFlights(study, SHORT)


def brute_force(count=BRUTE, seed=1):
    """Values of flights that are independent of each other and of every walk."""
    flights = flights_of(seed)
    size = flights.batch
    return np.concatenate(
        [flights.fly(flights.space.fresh(FAR + np.arange(since, since + size))) for since in range(0, count, size)]
    )


def walked(seed, **changes):
    """Probability and interval, as `anser rare` finds them, and how many flights that took."""
    flights = flights_of(seed, **changes)
    flown = 0

    def limit_state(points, numbers):
        nonlocal flown
        flown += points.size
        parts = [points[k : k + flights.batch] for k in range(0, points.size, flights.batch)]
        return np.concatenate([flights.fly(part) for part in parts])

    found = subset_simulation(flights.space, limit_state, flights.threshold, flights.plan, seed)
    return estimate(found, flights.threshold, 0.95), found, flown


def repeated(times=20, brute=BRUTE, threshold_m=THRESHOLD_M, say=lambda *words: None):
    """How many intervals of so many seeds overlap that of brute force."""
    began = time.perf_counter()
    values = brute_force(brute)
    breached = int(np.sum(values > threshold_m))
    low, high = wilson_interval(breached, values.size, 0.95)
    say(f"brute force: {breached} of {values.size}: {low:.3g} to {high:.3g}, {time.perf_counter() - began:.0f} s")
    overlaps = 0
    for seed in range(100, 100 + times):
        ours, _, flown = walked(seed, threshold=threshold_m)
        overlap = ours.probability is not None and ours.low <= high and low <= ours.high
        overlaps += overlap
        p = ours.probability or np.nan
        say(f"seed {seed}: {p:.3g} ({ours.low:.3g} to {ours.high:.3g}), {flown} flights, overlaps: {overlap}")
    say(f"{overlaps} of {times} overlap, {time.perf_counter() - began:.0f} s")
    return overlaps


@pytest.mark.long
def test_intervals_overlap_that_of_brute_force():
    assert repeated() >= 19
