"""Runs of checks: a failing check does not stop the run, and every failure is reported."""

import threading

import pytest

from anser.verification import CHECKS, verify
from anser.verification.suite import select_checks
from support.verification_cases import ALL, BROKEN, EMPTY, GOOD, WRONG


def test_each_check_has_an_outcome_despite_other_failures():
    outcomes = verify(checks=ALL)
    assert [outcome.check.key for outcome in outcomes] == ["good", "wrong", "broken", "empty", "nonsense"]
    assert [outcome.passes for outcome in outcomes] == [True, False, False, False, False]
    assert [len(outcome.comparisons) for outcome in outcomes] == [4, 3, 0, 0, 3]
    assert all(outcome.seconds >= 0.0 for outcome in outcomes)


def test_a_raised_error_is_named():
    broken, empty, good = verify(checks=(BROKEN, EMPTY, GOOD))
    assert broken.problem == "ArithmeticError: no such [figure]"
    assert empty.problem == "it compared nothing"
    assert good.problem is None


def test_an_interrupt_stops_the_run():
    def interrupted():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        verify(checks=[GOOD.__class__("key", "", "", "", "", interrupted)])


def test_keys_select_each_check_once_in_order():
    assert select_checks(["wrong", "good", "wrong"], ALL) == (GOOD, WRONG)
    assert select_checks(None, ALL) == ALL
    assert select_checks([], ALL) == ()


def test_an_unknown_key_is_refused_before_the_run_with_the_closest_key():
    reports = []
    with pytest.raises(ValueError, match=r"arrived 'brocken'; the closest is broken; known are good, wrong, broken"):
        verify(["good", "brocken"], lambda *report: reports.append(report), ALL)
    assert reports == []
    with pytest.raises(ValueError, match="the closest is ussa76; known are ussa76, wgs84"):
        verify(["usa"])
    with pytest.raises(ValueError, match="known are good"):
        select_checks([""], ALL)


def test_progress_names_each_check_and_ends_with_1():
    reports = []
    verify(["good", "wrong"], lambda key, part: reports.append((key, part)), ALL)
    assert reports == [("good", 0.0), ("wrong", 0.5), ("done", 1.0)]


def test_every_check_is_described():
    keys = [check.key for check in CHECKS]
    assert len(set(keys)) == len(keys)
    required = {"ussa76", "wgs84", "f16-derivatives", "f16-trim", "f16-turn", "f16-aero-shots", "f16-engine-shots"}
    assert required | {"arc-lengths"} <= set(keys)
    for check in CHECKS:
        assert check.key == check.key.lower().replace(" ", "-")
        assert check.title
        assert 0 < len(check.source) <= 40, check.source
        assert 0 < len(check.tolerance_reason) <= 40, check.tolerance_reason
        assert check.explanation.endswith("."), check.key


def test_a_check_case_is_selected_by_number():
    for key in ("9", "09", "nesc-9", "nesc-09"):
        assert [check.key for check in select_checks([key])] == ["nesc-09"]
    assert [check.key for check in select_checks(["13.1"])] == ["nesc-13.1"]
    assert [check.key for check in select_checks(["nesc-13.2"])] == ["nesc-13.2-5kt", "nesc-13.2-10kt"]
    parts = ["13.1", "13.2-5kt", "13.2-10kt", "13.3", "13.4"]
    assert [check.key for check in select_checks(["13"])] == [f"nesc-{part}" for part in parts]
    with pytest.raises(ValueError, match="arrived 'nesc-14'; the closest is nesc-1"):
        select_checks(["14"])


def test_long_checks_run_in_parallel_and_keep_their_order():
    from dataclasses import replace

    started = []

    def meet():
        """Pass only if both checks run at the same time."""
        started.append(threading.current_thread())
        barrier.wait(timeout=30)
        return GOOD.measure()

    barrier = threading.Barrier(2)
    long, short = replace(GOOD, key="long", measure=meet, long=True), replace(GOOD, key="short", measure=meet)
    outcomes = verify(checks=(long, short, WRONG))
    assert [outcome.check.key for outcome in outcomes] == ["long", "short", "wrong"]
    assert [outcome.passes for outcome in outcomes] == [True, True, False]
    assert len(set(started)) == 2
