"""Sensitivities: known by construction, and reported as not computed for constant outputs."""

import numpy as np
import pytest
import xarray as xr

from anser.campaigns.sampling import flight_seeds, sample_study
from anser.campaigns.sensitivity import RANK, SOBOL, influences, ordered_values
from campaigns.study_cases import WIND, study_of

COURSE = {"path": "wind.from_deg", "distribution": "uniform", "low": 0.0, "high": 9.0}
AIR = {"path": "turbulence.intensity", "distribution": "choice", "values": ["light", "severe", "moderate"]}
PATHS = ["wind.speed_m_s", "wind.from_deg"]


def flown(study, failed=()):
    """A miss of twice the wind's speed plus its direction, and a constant spread."""
    applied = sample_study(study, {})
    speed, course = applied["wind.speed_m_s"], applied["wind.from_deg"]
    miss = np.stack([2.0 * speed + course, np.zeros_like(speed)], axis=1)
    miss[list(failed)] = np.nan
    data = {
        "miss_m": (("flight", "aircraft"), miss),
        "arrival_spread_s": ("flight", np.ones_like(speed)),
        "met": ("flight", np.isfinite(miss[:, 0]) & (speed < 4.5)),
        **{path: ("flight", values) for path, values in applied.items()},
    }
    return xr.Dataset(data, coords={"flight": np.arange(speed.size)})


def saltelli(**changes):
    return study_of(sampling={"method": "saltelli", "flights": 256}, vary=[WIND, COURSE], **changes)


def values_of(entries, output, measure):
    return [entry.value for entry in entries.entries if (entry.output, entry.measure) == (output, measure)]


def test_sobol_indices_divide_the_variance():
    study = saltelli()
    sensitivities = influences(flown(study), study, PATHS)
    assert sensitivities.kind == SOBOL
    assert sensitivities.flights == 1024
    # variances of 2 U(0, 9) and U(0, 9): four to one, no interaction
    for measure in ("first", "total"):
        assert values_of(sensitivities, "miss_m", measure) == pytest.approx([0.8, 0.2], abs=0.03)
    # met is a step in the speed alone
    assert values_of(sensitivities, "met", "total") == pytest.approx([1.0, 0.0], abs=0.03)
    assert sensitivities.not_computed == {"arrival_spread_s": "it is the same in every flight"}
    assert all(entry.low <= entry.value <= entry.high for entry in sensitivities.entries)


def test_random_effects_are_attributed_to_no_input():
    study = saltelli()
    data = flown(study)
    noise_by_seed = {seed: np.random.default_rng(seed).uniform(0.0, 9.0) for seed in flight_seeds(study, 1024).tolist()}
    noise = np.array([noise_by_seed[seed] for seed in flight_seeds(study, 1024).tolist()])
    alone = data.assign(arrival_spread_s=("flight", data["wind.speed_m_s"].values + noise))
    sensitivities = influences(alone, study, PATHS)
    # half of the variance is the speed's, nothing the direction's, neither by itself nor in combination
    for measure in ("first", "total"):
        assert values_of(sensitivities, "arrival_spread_s", measure) == pytest.approx([0.5, 0.0], abs=0.08)
    assert values_of(sensitivities, "arrival_spread_s", "total")[1] == 0.0
    # with a seed of its own for each flight, all of the noise is in the total index of every input
    noise = np.random.default_rng(1).uniform(0.0, 9.0, 1024)
    unpaired = data.assign(arrival_spread_s=("flight", data["wind.speed_m_s"].values + noise))
    assert values_of(influences(unpaired, study, PATHS), "arrival_spread_s", "total")[1] == pytest.approx(0.5, abs=0.1)


def test_a_flight_without_a_value_leaves_indices_of_met_only():
    study = saltelli()
    sensitivities = influences(flown(study, failed=(5, 9)), study, PATHS)
    assert {entry.output for entry in sensitivities.entries} == {"met"}
    assert sensitivities.not_computed["miss_m"].startswith("2 of 1024 flights have no such number")


def test_complete_blocks_of_a_partial_campaign_are_used():
    study = saltelli()
    data = flown(study)
    # blocks are of four: the third is not whole, and the chunks came in another order
    part = data.isel(flight=[*range(512, 1024), *range(11), *range(12, 512)])
    sensitivities = influences(part, study, PATHS)
    assert sensitivities.flights == 1020
    selected = data.isel(flight=[k for k in range(1024) if k // 4 != 2])
    assert sensitivities.entries == influences(selected, study, PATHS).entries


def test_rank_correlations_count_failures_as_the_worst():
    study = study_of(sampling={"flights": 400}, vary=[WIND, COURSE])
    data = flown(study)
    sensitivities = influences(data, study, PATHS)
    assert sensitivities.kind == RANK
    speed, course = values_of(sensitivities, "miss_m", "rank")
    assert speed > 0.8 > course > 0.3
    assert values_of(sensitivities, "met", "rank")[0] < -0.8
    greatest = [int(k) for k in np.argsort(data["miss_m"].values[:, 0])[-3:]]
    failed = influences(flown(study, failed=greatest), study, PATHS)
    assert values_of(failed, "miss_m", "rank")[0] == pytest.approx(speed, abs=1e-3)
    assert sensitivities.not_computed == {"arrival_spread_s": "it is the same in every flight"}


def test_texts_are_ranked_in_the_order_of_the_study():
    study = study_of(sampling={"flights": 6}, vary=[AIR])
    values = np.array(["severe", "light", "moderate"])
    np.testing.assert_array_equal(ordered_values(values, study, AIR["path"]), [1.0, 0.0, 2.0])
    assert ordered_values(values, study_of(), "fleet.planner") is None
    np.testing.assert_array_equal(ordered_values(np.array([True, False]), study, "x"), [1.0, 0.0])


def test_unsupported_saltelli_sampling_is_refused():
    from anser.config import ScenarioError

    for changes, said in (
        ({"correlated": [{"paths": PATHS, "coefficients": [[1.0, 0.5], [0.5, 1.0]]}]}, "none with the method saltelli"),
        ({"sampling": {"method": "saltelli", "flights": 100}}, "a power of 2 for a Sobol sequence"),
        ({"sampling": {"method": "saltelli", "flights": 4194304}}, "2500000 blocks of 4 flights at most"),
        ({"vary": []}, "one table [[vary]] at least with the method saltelli"),
    ):
        with pytest.raises(ScenarioError) as caught:
            study_of(**{"sampling": {"method": "saltelli", "flights": 8}, "vary": [WIND, COURSE], **changes})
        assert said in str(caught.value)
