"""What outputs depend on: found where it is known by construction, and told where there is nothing to find."""

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
    """The miss is twice the wind's speed and once its direction; the spread is always the same."""
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
    return [one.value for one in entries.entries if (one.output, one.measure) == (output, measure)]


def test_sobol_indices_share_the_variance_out():
    study = saltelli()
    found = influences(flown(study), study, PATHS)
    assert found.kind == SOBOL
    assert found.flights == 1024
    # variances of 2 U(0, 9) and U(0, 9): four to one, no interaction
    for measure in ("first", "total"):
        assert values_of(found, "miss_m", measure) == pytest.approx([0.8, 0.2], abs=0.03)
    # met is a step in the speed alone
    assert values_of(found, "met", "total") == pytest.approx([1.0, 0.0], abs=0.03)
    assert found.not_computed == {"arrival_spread_s": "it is the same in every flight"}
    assert all(one.low <= one.value <= one.high for one in found.entries)


def test_what_is_random_in_a_flight_is_put_down_to_no_input():
    study = saltelli()
    data = flown(study)
    drawn = {seed: np.random.default_rng(seed).uniform(0.0, 9.0) for seed in flight_seeds(study, 1024).tolist()}
    noise = np.array([drawn[seed] for seed in flight_seeds(study, 1024).tolist()])
    alone = data.assign(arrival_spread_s=("flight", data["wind.speed_m_s"].values + noise))
    found = influences(alone, study, PATHS)
    # half of the variance is the speed's, nothing the direction's, neither by itself nor in combination
    for measure in ("first", "total"):
        assert values_of(found, "arrival_spread_s", measure) == pytest.approx([0.5, 0.0], abs=0.08)
    assert values_of(found, "arrival_spread_s", "total")[1] == 0.0
    # with a seed of its own for each flight, all of the noise is in the total index of every input
    noise = np.random.default_rng(1).uniform(0.0, 9.0, 1024)
    apart = data.assign(arrival_spread_s=("flight", data["wind.speed_m_s"].values + noise))
    assert values_of(influences(apart, study, PATHS), "arrival_spread_s", "total")[1] == pytest.approx(0.5, abs=0.1)


def test_a_flight_without_a_number_leaves_met_alone():
    study = saltelli()
    found = influences(flown(study, failed=(5, 9)), study, PATHS)
    assert {one.output for one in found.entries} == {"met"}
    assert found.not_computed["miss_m"].startswith("2 of 1024 flights have no such number")


def test_of_a_part_whole_blocks_count_in_their_order():
    study = saltelli()
    data = flown(study)
    # blocks are of four: the third is not whole, and the chunks came in another order
    part = data.isel(flight=[*range(512, 1024), *range(11), *range(12, 512)])
    found = influences(part, study, PATHS)
    assert found.flights == 1020
    kept = data.isel(flight=[k for k in range(1024) if k // 4 != 2])
    assert found.entries == influences(kept, study, PATHS).entries


def test_rank_correlations_count_a_failure_as_the_worst():
    study = study_of(sampling={"flights": 400}, vary=[WIND, COURSE])
    data = flown(study)
    found = influences(data, study, PATHS)
    assert found.kind == RANK
    speed, course = values_of(found, "miss_m", "rank")
    assert speed > 0.8 > course > 0.3
    assert values_of(found, "met", "rank")[0] < -0.8
    greatest = [int(k) for k in np.argsort(data["miss_m"].values[:, 0])[-3:]]
    failed = influences(flown(study, failed=greatest), study, PATHS)
    assert values_of(failed, "miss_m", "rank")[0] == pytest.approx(speed, abs=1e-3)
    assert found.not_computed == {"arrival_spread_s": "it is the same in every flight"}


def test_texts_rank_as_the_study_lists_them_and_those_of_a_table_not_at_all():
    study = study_of(sampling={"flights": 6}, vary=[AIR])
    values = np.array(["severe", "light", "moderate"])
    np.testing.assert_array_equal(ordered_values(values, study, AIR["path"]), [1.0, 0.0, 2.0])
    assert ordered_values(values, study_of(), "fleet.planner") is None
    np.testing.assert_array_equal(ordered_values(np.array([True, False]), study, "x"), [1.0, 0.0])


def test_saltelli_sampling_is_refused_where_it_cannot_be():
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
