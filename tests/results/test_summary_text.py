"""Text of a flight's summary: a few lines for any number of aircraft."""

import copy

from anser.results.summary_format import format_summary, format_summary_html
from support.made_flight import make_flight


def test_the_text_has_arrivals_and_unmet_requirements():
    _, summary = make_flight()
    summary["scenario"]["name"] = "three"
    lines = format_summary(summary).splitlines()
    assert len(lines) == 5
    assert lines[0] == "three: 3 of 3 aircraft arrived, all requirements met"
    assert lines[1].startswith("  anna: arrived at 80.")
    assert ", planned 80.00 s, miss " in lines[1]
    assert lines[-1].endswith(" s flown")

    summary["aircraft"][1] |= {"status": "no plan", "arrival_s": None, "planned_arrival_s": None, "miss_m": None}
    summary["requirements"][0]["met"] = False
    summary["fleet"]["arrival_spread_s"] = None
    lines = format_summary(summary).splitlines()
    assert lines[0] == f"three: 2 of 3 aircraft arrived, not met: {summary['requirements'][0]['name']}"
    assert lines[2] == "  bert: no plan"
    assert "arrival spread" not in lines[-1]
    table = format_summary_html(summary)
    assert table.count("<tr>") == 4
    assert "<td>bert</td><td>no plan</td><td>–</td><td>–</td><td>–</td>" in table
    assert f"<b>{lines[0]}</b>" in table


def test_a_failure_after_the_arrival_is_not_reported_as_success():
    """Every number up to the arrival meets its requirement; the verdict must not be "all requirements met"."""
    _, summary = make_flight()
    summary["aircraft"][1]["status"] = "the aircraft reached the ground"
    assert all(entry["met"] for entry in summary["requirements"])
    lines = format_summary(summary).splitlines()
    assert lines[0] == f"{summary['scenario']['name']}: 2 of 3 aircraft arrived, the flight failed"
    assert lines[2] == "  bert: the aircraft reached the ground"


def test_the_text_of_a_large_fleet_has_the_first_aircraft():
    _, summary = make_flight()
    summary["aircraft"] = [copy.deepcopy(summary["aircraft"][0]) for _ in range(20)]
    summary["aircraft"][9]["status"] = "no plan"
    lines = format_summary(summary).splitlines()
    assert len(lines) == 8
    assert lines[0].startswith(f"{summary['scenario']['name']}: 19 of 20 aircraft arrived")
    assert lines[-2] == "  and 15 more, of which 1 failed"
