"""Command `verify` end to end: a table or JSON alone on standard output, shortfalls on standard error, exit codes."""

import json
import sys

import pytest

from anser.cli import main
from anser.verification import suite
from anser.verification.checks import Comparison
from support.verification_cases import ALL, BROKEN, FLOWN, GOOD, NONSENSE, WRONG


@pytest.fixture
def anser(monkeypatch, capsys):
    """Run `anser verify` in this process, with output to a file: exit code, standard output, standard error."""

    def call(*options, checks=None):
        if checks is not None:
            monkeypatch.setattr(suite, "CHECKS", checks)
        monkeypatch.setattr(sys, "argv", ["anser", "verify", *options])
        monkeypatch.setenv("COLUMNS", "60")
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        return ended.value.code or 0, printed.out, printed.err

    return call


def _line_with(printed, *parts):
    """Return the single line of a table that contains every part."""
    lines = [line for line in printed.splitlines() if all(part in line for part in parts)]
    assert len(lines) == 1, (parts, printed)
    return lines[0]


def test_real_checks_pass_with_one_table(anser):
    code, printed, err = anser("--case", "wgs84", "--case", "arc-lengths")
    assert code == 0
    assert err == ""
    heading = _line_with(printed, "check", "quantity")
    for name in ("expected", "obtained", "error", "tolerance", "why that tolerance", "source"):
        assert name in heading
    line = _line_with(printed, "arc-lengths", "lateral, six-point estimate m (gamma_f -30 deg, b_4 0.01, c_4 0)")
    for part in ("5993.500", "5993.460", "-0.04", "0.05", "half the last digit", "[TH]"):
        assert part in line
    assert "…" not in printed
    assert "64 of 64 comparisons passed, " in printed


def test_every_row_stays_on_one_line_in_a_narrow_terminal(anser):
    wide_check = GOOD.__class__("k" * 30, "t", "s" * 90, "w" * 90, "e.", GOOD.measure)
    _, printed, _ = anser(checks=(wide_check,))
    line = _line_with(printed, "alpha deg (V 400 ft/s)")
    assert wide_check.key in line
    assert wide_check.source in line
    assert wide_check.tolerance_reason in line


def test_the_worst_point_of_each_quantity_is_shown(anser):
    code, printed, err = anser(checks=(GOOD,))
    assert code == 0
    line = _line_with(printed, "alpha deg (V 400 ft/s)")
    for part in ("4.1600", "4.1571", "-0.0029", "0.005", "[XY] tab. 1"):
        assert part in line
    assert "V 300 ft/s" not in printed
    # without a published figure: the end of the flight
    assert "half the last digit" not in _line_with(printed, "altitude_ft (t 30 s)", "15598.9", "flown, not judged")
    assert "2 of 2 comparisons passed; 2 more flown, not judged" in printed
    assert "Nothing is judged" not in printed
    assert err == ""


def test_a_wrong_figure_ends_with_1_and_is_named(anser):
    code, printed, err = anser(checks=(GOOD, WRONG))
    assert code == 1
    assert "3 of 5 comparisons passed; 2 more flown, not judged" in printed
    assert "my own" in _line_with(printed, "wrong", "alpha deg (V 500 ft/s)")
    assert err.splitlines() == [
        "falls short: wrong: alpha deg (V 500 ft/s): expected 2.180, obtained 2.143, error -0.037, tolerance 0.005 "
        "(2 of 3 points fall short)"
    ]


def test_a_failing_check_ends_with_1_and_the_others_are_shown(anser):
    code, printed, err = anser(checks=(BROKEN, GOOD))
    assert code == 1
    assert "ArithmeticError: no such [figure]" in _line_with(printed, "broken")
    _line_with(printed, "good", "alpha")
    assert "2 of 2 comparisons passed" in printed
    assert "1 of 2 checks could not be computed" in printed
    assert err.splitlines() == ["falls short: broken: could not be computed: ArithmeticError: no such [figure]"]


def test_figures_that_are_not_finite_end_with_1(anser):
    code, printed, err = anser(checks=(NONSENSE,))
    assert code == 1
    assert "nan" in _line_with(printed, "nonsense", "x m (here)")
    assert "-inf" in _line_with(printed, "nonsense", "y m (here)")
    assert len(err.splitlines()) == 2
    assert "1 of 2 comparisons passed" in printed


def test_a_check_without_published_figures_is_flown_not_judged(anser):
    code, printed, err = anser(checks=(GOOD, FLOWN))
    assert (code, err) == (0, "")
    assert "2 of 2 comparisons passed; 4 more flown, not judged" in printed
    assert "Nothing is judged in flown: no published figures come with this package." in printed
    _line_with(printed, " flown  altitude_ft (t 30 s)", "flown, not judged")
    code, printed, _ = anser("--json", checks=(FLOWN,))
    document = json.loads(printed)
    assert (code, document["passed"]) == (0, None)
    assert (document["checks"][0]["passed"], document["checks"][0]["verdict"]) == (None, "flown, not judged")


def test_a_bound_is_printed_as_exactly_as_its_tolerance(anser):
    bound = Comparison("error", "all", "%", 0.0, 1.2923, 1.3)
    _, printed, _ = anser(checks=(GOOD.__class__("b", "t", "s", "printed bound", "e.", lambda: (bound,)),))
    assert "1.292" in _line_with(printed, "error % (all)")


def test_json_is_alone_on_standard_output(anser):
    code, printed, err = anser("--json", checks=ALL)
    assert code == 1

    def refuse(word):
        raise AssertionError(word)

    document = json.loads(printed, parse_constant=refuse)
    assert [check["key"] for check in document["checks"]] == ["good", "wrong", "broken", "empty", "nonsense"]
    assert document["checks"][0]["comparisons"][1]["obtained"] == 4.1571
    assert err.count("falls short: ") == 5
    code, printed, err = anser("--json", checks=(GOOD,))
    assert (code, err) == (0, "")
    assert json.loads(printed)["passed"] is True


def test_the_option_case_selects_a_check(anser):
    code, printed, err = anser("--case", "good", checks=ALL)
    assert code == 0
    assert "wrong" not in printed
    assert err == ""


def test_an_unknown_case_ends_with_2_before_the_run(anser):
    code, printed, err = anser("--case", "good", "--case", "brocken", checks=ALL)
    assert code == 2
    assert printed == ""
    assert err.startswith("--case: arrived 'brocken'; the closest is broken; known are good, wrong, broken, empty")
    assert "Traceback" not in err


def test_the_option_list_prints_the_checks_without_a_run(anser):
    code, printed, err = anser("--list", checks=ALL)
    assert code == 0
    assert err == ""
    for check in ALL:
        assert check.title in _line_with(printed, f" {check.key} ")
        assert "[XY] tab. 1" in printed
    code, printed, err = anser("--list", "--json", checks=ALL)
    assert (code, err) == (0, "")
    listed = [{"key": check.key, "title": check.title, "source": check.source} for check in ALL]
    assert json.loads(printed)["checks"] == listed
