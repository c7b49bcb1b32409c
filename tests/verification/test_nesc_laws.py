"""The flights under NASA's control laws do not hang on how often the law is sampled."""

import json
from importlib import resources

import pytest

from anser.verification.nesc_cases import LAW_FLIGHTS
from anser.verification.nesc_laws import LAW_STEPS, fly_laws

CHECKPOINTS = json.loads(resources.files("anser.verification").joinpath("data/nesc_checkpoints.json").read_text())


@pytest.mark.long
def test_half_the_sampling_rate_moves_little():
    """A sample's delay grows by 1.4 ms: at most a quarter of a tolerance, a second after the heading command."""
    (case,) = (case for case in LAW_FLIGHTS if case.number == "13.3")
    given = CHECKPOINTS["cases"]["13p3"]
    fine, coarse = fly_laws([case], LAW_STEPS)["13.3"], fly_laws([case], LAW_STEPS // 2)["13.3"]
    shares = {
        (name, time_s): abs(fine[name][round(10 * time_s)] - coarse[name][round(10 * time_s)]) / column["tolerance"]
        for name, column in given["columns"].items()
        if "tolerance" in column
        for time_s in given["times_s"]
    }
    assert max(shares.values()) < 0.5
    assert max(share for (_, time_s), share in shares.items() if time_s not in given["not_judged_s"]) < 0.35
    assert max(share for (_, time_s), share in shares.items() if time_s >= 20.0) < 0.2
