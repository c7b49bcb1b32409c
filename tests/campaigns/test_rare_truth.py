"""Rare events of simulated flights: intervals overlap those of brute force."""

import time

import numpy as np
import pytest

import anser
from anser.campaigns import subset_simulation
from anser.campaigns.rare_flights import RareFlights
from anser.campaigns.subset import estimate
from anser.missions import fly_many
from anser.missions.flight_batches import FlightCase
from anser.results.sampling_statistics import wilson_interval
from campaigns.study_cases import STUDIES, study_of

SHORT = anser.load(STUDIES / "short-approach.toml")
"""One aircraft for 14 s in moderate turbulence, with errors of its navigation: 3e4 normal numbers, 12 ms a flight."""
THRESHOLD_M = 1.7
"""Missed by more in about one flight of a thousand."""
TIMES, REPETITIONS, POINTS = 20, 4, 100
BRUTE = 20_000
FAR = 1 << 30
"""Numbers of flights that no walk flies."""


def flights_of(seed, threshold_m=THRESHOLD_M, times=TIMES):
    """Several studies with a common seed; the flights have different numbers."""
    repetitions = times * REPETITIONS
    table = {
        "statistic": "miss_m",
        "threshold": threshold_m,
        "flights": repetitions * POINTS,
        "repetitions": repetitions,
    }
    return RareFlights(study_of(sampling=None, vary=[], rare=table, seed=seed), SHORT)


def brute_force(flights, count=BRUTE):
    """Values of independent flights that no chain uses."""
    starts = range(0, count, flights.batch)
    return np.concatenate([flights.fly(flights.space.sample(FAR + k + np.arange(flights.batch))) for k in starts])


def repeated(seed=1, threshold_m=THRESHOLD_M, brute=BRUTE, say=lambda *text: None):
    """Number of small studies whose intervals overlap that of brute force."""
    began, flights, flown = time.perf_counter(), flights_of(seed, threshold_m), 0
    values = brute_force(flights, brute)
    breached = int(np.sum(values > threshold_m))
    low, high = wilson_interval(breached, values.size, 0.95)
    say(f"brute force: {breached} of {values.size}: {low:.3g} to {high:.3g}, {time.perf_counter() - began:.0f} s")

    def limit_state(points, numbers):
        nonlocal flown
        flown += points.size
        parts = [points[k : k + flights.batch] for k in range(0, points.size, flights.batch)]
        values = np.concatenate([flights.fly(part) for part in parts])
        say(f"{flown} flights, {time.perf_counter() - began:.0f} s")
        return values

    walked = subset_simulation(flights.space, limit_state, flights.threshold, flights.plan, seed)
    overlaps = 0
    for k in range(TIMES):
        ours = estimate(walked[k * REPETITIONS : (k + 1) * REPETITIONS], threshold_m, 0.95)
        overlaps += ours.probability is not None and ours.low <= high and low <= ours.high
        say(f"{k}: {ours.probability} ({ours.low:.3g} to {ours.high:.3g})")
    combined = estimate(walked, threshold_m, 0.95)
    say(f"{overlaps} of {TIMES} overlap; all together {combined}; {flown} flights, {time.perf_counter() - began:.0f} s")
    return overlaps


@pytest.mark.long
def test_intervals_overlap_the_interval_of_brute_force():
    assert repeated() >= 19


@pytest.mark.long
def test_a_new_point_flies_like_the_flight_of_its_number():
    flight_rows = fly_many([FlightCase(SHORT, k, seed=1) for k in range(4)])
    misses = [flight_row.aircraft[0]["miss_m"] for flight_row in flight_rows]
    flights = flights_of(1, times=1)
    np.testing.assert_allclose(flights.fly(flights.space.sample(np.arange(4))), misses, rtol=1e-7)


@pytest.mark.long
def test_the_worst_flight_is_reproduced_individually(tmp_path):
    """A simulated level with a threshold that most flights exceed."""
    (tmp_path / "short.toml").write_text((STUDIES / "short-approach.toml").read_text())
    text = (STUDIES / "how-rarely.toml").read_text().replace("short-approach", "short")
    text = text.replace("threshold = 2.0", "threshold = 0.1").replace("flights = 1000", "flights = 500")
    (tmp_path / "study.toml").write_text(text)
    event = anser.rare(tmp_path / "study.toml", tmp_path / "out", processes=1)
    assert event.estimate.low > 0.5
    flown = event.fly_worst()
    assert flown.summary["aircraft"][0]["miss_m"] == pytest.approx(event.document["worst"][0]["miss_m"], rel=1e-6)
