"""NESC check-cases: as defined they pass, with changed physics they fail."""

import dataclasses
import json
from importlib import resources

import numpy as np
import pytest

from anser.verification.checks import NOT_JUDGED
from anser.verification.nesc import NESC_CHECKS, _column_names, _comparison
from anser.verification.nesc_cases import FREE_FLIGHTS, LAW_FLIGHTS
from anser.verification.nesc_flight import fly_free

CHECKPOINTS = json.loads(resources.files("anser.verification").joinpath("data/nesc_checkpoints.json").read_text())


LONG = ("nesc-11", "nesc-12", *(f"nesc-{case.number}" for case in LAW_FLIGHTS))  # the F-16 over the round Earth


@pytest.mark.parametrize(
    "check",
    [pytest.param(c, marks=pytest.mark.long if c.key in LONG else (), id=c.key) for c in NESC_CHECKS],
)
def test_a_case_passes(check):
    comparisons = check.measure()
    short = [(c.group, c.point, c.error, c.tolerance) for c in comparisons if c.fails]
    assert not short
    published = CHECKPOINTS["cases"].get(check.key.removeprefix("nesc-").replace(".", "p"))
    listed = [c for c in comparisons if c.expected is None]
    assert all(np.isfinite(c.obtained) for c in listed)
    if published is None:
        settled = 2 if check.key == "nesc-13.2-5kt" else 0
        assert (check.tolerance_reason == NOT_JUDGED) == (settled == 0)
        assert len(listed) == len(comparisons) - settled
        return
    # Every checkpoint with a tolerance above zero, against both participants; unjudged columns and checkpoints once.
    columns, within_scatter = sum("tolerance" in c for c in published["columns"].values()), _column_names(published)[1]
    times, not_judged = len(published["times_s"]), len(published.get("not_judged_s", []))
    judged = columns - len(within_scatter)
    assert len(comparisons) - len(listed) == judged * 2 * (times - not_judged)
    assert len(listed) == judged * not_judged + len(within_scatter) * times


def test_a_column_that_a_zero_would_meet_is_not_judged():
    judged = 0
    for key, published in CHECKPOINTS["cases"].items():
        zero, within_scatter = _column_names(published)
        for name, column in published["columns"].items():
            if "tolerance" not in column:
                continue
            values = np.array([column["sim_04"], column["sim_05"]])
            values = np.abs(values[:, ~np.isin(published["times_s"], published.get("not_judged_s", []))])
            is_zero = values.max() <= 1e-6 * column["tolerance"]
            meets = values.max() <= column["tolerance"]
            assert (is_zero, meets and not is_zero) == (name in zero, name in within_scatter), (key, name)
            judged += 0 if name in within_scatter else values.size
    assert judged == 6798
    (check,) = (check for check in NESC_CHECKS if check.key == "nesc-13.1")
    assert "not judged: aero_bodyForce_lbf_Y, aero_bodyMoment_ftlbf_L, aero_bodyMoment_ftlbf_M" in check.explanation
    assert "240 are zero up to rounding" in NESC_CHECKS[0].explanation


def test_a_case_without_checkpoints_is_listed_every_five_seconds():
    unpublished = [case for case in LAW_FLIGHTS if case.number.replace(".", "p") not in CHECKPOINTS["cases"]]
    assert [case.number for case in unpublished] == ["13.2-5kt", "13.2-10kt", "13.4", "16"]
    for case in unpublished:
        assert case.times_s[0] == 0.0
        assert set(np.diff(case.times_s)) == {5.0}
        assert case.times_s[-1] == (180.0 if case.number == "16" else 60.0)


def test_every_case_of_the_checkpoints_is_checked():
    keys = {check.key.removeprefix("nesc-").replace(".", "p") for check in NESC_CHECKS}
    assert set(CHECKPOINTS["cases"]) <= keys


@pytest.fixture(scope="module")
def wrong():
    """The ten flights, five of them with a changed Earth, body or wind that the checkpoints must detect."""
    changes = {
        1: {"earth": "rotating-sphere"},
        2: {"body": "brick"},
        3: {"body": "undamped-brick"},
        6: {"wind_east_ft_s": (1.0, 1.0)},
        9: {"earth": "sphere"},
    }
    return fly_free([dataclasses.replace(case, **changes.get(case.number, {})) for case in FREE_FLIGHTS])


@pytest.mark.parametrize(
    ("number", "column"),
    [
        (1, "altitudeMsl_ft"),  # gravitation of a sphere instead of J2
        (2, "bodyAngularRateWrtEi_deg_s_Pitch"),  # damping in a case without damping
        (3, "bodyAngularRateWrtEi_deg_s_Pitch"),
        (6, "feVelocity_ft_s_Y"),  # a foot per second of wind
        (9, "longitude_deg"),  # an Earth at rest
    ],
)
def test_changed_physics_fails(wrong, number, column):
    published = CHECKPOINTS["cases"][f"{number:02d}"]
    values, tolerance = published["columns"][column]["sim_05"], published["columns"][column]["tolerance"]
    comparisons = [
        _comparison(column, wrong[number], t, "sim_05", value, tolerance)
        for t, value in zip(published["times_s"], values, strict=True)
    ]
    assert comparisons[0].passes, "the start is the same"
    assert not comparisons[-2].passes


def test_the_tolerance_includes_half_of_the_tenth_digit():
    log = {"eiPosition_ft_X": np.array([20955646.334]), "eulerAngle_deg_Yaw": np.array([-111.5])}
    position = _comparison("eiPosition_ft_X", log, 0.0, "sim_05", 20955646.33, 1e-4)
    assert position.tolerance == pytest.approx(0.005 + 1e-4, rel=1e-12)
    yaw = _comparison("eulerAngle_deg_Yaw", log, 0.0, "sim_05", 248.5, 1e-7)
    assert yaw.obtained == pytest.approx(248.5, abs=1e-12)
    assert _comparison("eulerAngle_deg_Yaw", log, 0.0, "sim_05", 0.0, 1e-7).tolerance == pytest.approx(1e-7)
