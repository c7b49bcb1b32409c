"""JSON document of the verification."""

import json

from anser.verification import verify
from anser.verification.checks import FORMAT_VERSION, to_document
from support.verification_cases import ALL, FLOWN, GOOD, WRONG


def test_a_round_trip_preserves_the_document():
    document = to_document(verify(checks=ALL), 1.0)
    restored = json.loads(json.dumps(document, allow_nan=False))
    assert restored == document
    assert set(restored) == {"format_version", "provenance", "passed", "seconds", "checks"}
    assert restored["format_version"] == FORMAT_VERSION == 2
    assert {"anser", "jax", "python"} <= set(restored["provenance"])
    assert restored["passed"] is False
    for check in restored["checks"]:
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


def test_figures_are_unrounded():
    (check,) = to_document(verify(checks=[GOOD]), 1.0)["checks"]
    assert check["passed"] is True
    judged = check["comparisons"][1]
    assert (judged["expected"], judged["obtained"], judged["tolerance"]) == (4.16, 4.1571, 0.005)
    assert judged["error"] == 4.1571 - 4.16
    assert (judged["time_s"], judged["reference"], judged["passed"]) == (30.0, "sim_05", True)
    listed = check["comparisons"][2]
    assert (listed["expected"], listed["error"], listed["tolerance"], listed["passed"]) == (None, None, None, None)


def test_the_reason_of_a_comparison_precedes_that_of_its_check():
    document = to_document(verify(["wrong"], checks=ALL), 1.0)
    reasons = [comparison["why"] for comparison in document["checks"][0]["comparisons"]]
    assert reasons == ["half the last digit", "half the last digit", "my own"]


def test_a_figure_that_is_not_finite_is_null_and_named():
    document = to_document(verify(["nonsense"], checks=ALL), 1.0)
    x, y, z = document["checks"][0]["comparisons"]
    assert (x["obtained"], x["error"], x["passed"], x["problem"]) == (None, None, False, "obtained nan")
    assert (y["obtained"], y["error"], y["passed"], y["problem"]) == (None, None, False, "obtained -inf")
    assert (z["obtained"], z["passed"], z["problem"]) == (2.0, True, None)
    assert "NaN" not in json.dumps(document)
    assert "Infinity" not in json.dumps(document)


def test_a_check_without_published_figure_is_neither_passed_nor_failed():
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


def test_a_failing_check_has_a_reason_and_does_not_pass():
    document = to_document(verify(["broken"], checks=ALL), 1.0)
    (check,) = document["checks"]
    assert check["problem"] == "ArithmeticError: no such [figure]"
    assert check["comparisons"] == []
    assert not document["passed"]
    assert not to_document((), 0.0)["passed"]
