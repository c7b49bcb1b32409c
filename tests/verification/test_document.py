"""The JSON contract."""

import json

from anser.verification import verify
from anser.verification.checks import FORMAT_VERSION, to_document
from support.verification_cases import ALL, FLOWN, GOOD, WRONG


def test_round_trip_keeps_everything():
    document = to_document(verify(checks=ALL), 1.0)
    again = json.loads(json.dumps(document, allow_nan=False))
    assert again == document
    assert set(again) == {"format_version", "provenance", "passed", "seconds", "checks"}
    assert again["format_version"] == FORMAT_VERSION == 2
    assert {"anser", "jax", "python"} <= set(again["provenance"])
    assert again["passed"] is False
    for check in again["checks"]:
        assert set(check) == {
            "key",
            "title",
            "source",
            "why",
            "explanation",
            "seconds",
            "passed",
            "verdict",
            "problem",
            "comparisons",
        }
        for comparison in check["comparisons"]:
            assert set(comparison) == {
                "group",
                "where",
                "unit",
                "expected",
                "obtained",
                "error",
                "tolerance",
                "why",
                "time_s",
                "reference",
                "passed",
                "problem",
            }


def test_figures_arrive_unrounded():
    (check,) = to_document(verify(checks=[GOOD]), 1.0)["checks"]
    assert check["passed"] is True
    second = check["comparisons"][1]
    assert (second["expected"], second["obtained"], second["tolerance"]) == (4.16, 4.1571, 0.005)
    assert second["error"] == 4.1571 - 4.16
    assert (second["time_s"], second["reference"], second["passed"]) == (30.0, "sim_05", True)
    listed = check["comparisons"][2]
    assert (listed["expected"], listed["error"], listed["tolerance"], listed["passed"]) == (None, None, None, None)


def test_reason_of_a_comparison_goes_before_that_of_its_check():
    document = to_document(verify(["wrong"], checks=ALL), 1.0)
    reasons = [comparison["why"] for comparison in document["checks"][0]["comparisons"]]
    assert reasons == ["half the last digit", "half the last digit", "my own"]


def test_what_is_not_finite_is_null_and_named():
    document = to_document(verify(["nonsense"], checks=ALL), 1.0)
    x, y, z = document["checks"][0]["comparisons"]
    assert (x["obtained"], x["error"], x["passed"], x["problem"]) == (None, None, False, "obtained nan")
    assert (y["obtained"], y["error"], y["passed"], y["problem"]) == (None, None, False, "obtained -inf")
    assert (z["obtained"], z["passed"], z["problem"]) == (2.0, True, None)
    assert "NaN" not in json.dumps(document)
    assert "Infinity" not in json.dumps(document)


def test_what_has_no_published_figure_is_neither_passed_nor_failed():
    flown, good = to_document(verify(checks=[FLOWN]), 1.0), to_document(verify(checks=[FLOWN, GOOD]), 1.0)
    assert flown["passed"] is None
    assert [(check["passed"], check["verdict"]) for check in good["checks"]] == [
        (None, "flown, not judged"),
        (True, "passed"),
    ]
    assert good["passed"] is True
    assert [c["passed"] for c in flown["checks"][0]["comparisons"]] == [None, None]
    (wrong,) = to_document(verify(checks=[WRONG]), 1.0)["checks"]
    assert (wrong["passed"], wrong["verdict"]) == (False, "failed")


def test_a_check_that_broke_says_why_and_nothing_passed():
    document = to_document(verify(["broken"], checks=ALL), 1.0)
    (check,) = document["checks"]
    assert check["problem"] == "ArithmeticError: no such [figure]"
    assert check["comparisons"] == []
    assert not document["passed"]
    assert not to_document((), 0.0)["passed"]
