"""The page is complete, agrees with the summary, needs no network, and escapes names from files."""

import copy
import json
import re

import numpy as np
import pytest

from anser.report import write_comparison, write_report
from anser.report.flight_data import scene_keep_outs
from anser.report.flight_margins import Margin
from anser.report.flight_page import _SCRIPTS, difference_table, scenario_differences, summary_cards, verdict_html
from anser.report.page_templates import read_asset
from support.made_flight import make_flight

EVIL = "</script><script>alert(1)</script>"


@pytest.fixture(scope="module")
def page(flight, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(*flight, path)
    return path.read_text(encoding="utf-8")


def markup(page):
    """The page without scripts and packed numbers."""
    for name in _SCRIPTS:
        assert page.count(read_asset(name)) == 1
        page = page.replace(read_asset(name), "")
    return re.sub(r'"packed":"[^"]*"', "", page)


def page_data(page):
    (text,) = re.findall(r'<script type="application/json" id="flights">(.*?)</script>', page, re.DOTALL)
    return json.loads(text)


def test_the_page_is_self_contained(page):
    ours = markup(page)
    assert not re.search(r"""(src|href)\s*=\s*["']?(https?:)?//""", ours)
    assert "@import" not in ours
    assert "cdn" not in ours.lower()
    assert "default-src 'none'" in ours
    assert "connect-src 'none'" in ours
    # only the page's own scripts may run
    (allowed,) = re.findall(r"script-src ([^;]*);", ours)
    assert re.fullmatch(r"('sha256-[\w+/=]+' ?)+", allowed)


def test_the_verdict_comes_first(page, flight):
    ours = markup(page)
    assert "<title>Three &lt;aircraft&gt; · anser flight report</title>" in ours
    assert re.search(r"All 3 aircraft arrived together, within [\d.]+&nbsp;ms", ours)
    assert "All requirements met." in ours
    positions = [
        ours.index(mark) for mark in ('class="answer', "What was tight", 'id="scene"', 'id="events"', 'id="plan"')
    ]
    assert positions == sorted(positions)
    for text in (flight[1]["scenario"]["hash"], "Seed 7", "numpy", "Bank angle to the right", "the whole scenario"):
        assert text in ours


def test_plots_use_the_record_and_labels_of_the_dataset(flight, tmp_path):
    dataset, summary = flight
    renamed = dataset.copy()
    renamed["bank_deg"] = renamed["bank_deg"].assign_attrs(long_name="Schräglage <i>")
    write_report(renamed, summary, tmp_path / "report.html")
    (run,) = page_data((tmp_path / "report.html").read_text(encoding="utf-8"))["runs"]
    assert run["variables"]["bank_deg"]["words"] == "Schräglage <i>"
    assert run["variables"]["bank_deg"]["symbol"] == "<i>μ</i>"
    assert run["variables"]["course_command_deg"]["symbol"] == "<i>χ</i><sub>c</sub>"
    assert (run["times"], run["every"]) == (dataset.sizes["time"], 1)
    (limits,) = [section for section in run["sections"] if section["key"] == "limits"]
    panels = {panel["response"]: panel["limits"] for panel in limits["panels"]}
    assert panels["bank_deg"] == [-70.0, 70.0]
    assert panels["height_over_floor_m"] == [0.0]
    assert panels["separation_kept"] == [1.0]


def test_a_long_flight_is_thinned_with_a_note(flight, tmp_path):
    dataset, summary = flight
    long = dataset.isel(time=np.arange(4 * dataset.sizes["time"]) % dataset.sizes["time"])
    long = long.assign_coords(time=("time", 0.025 * np.arange(long.sizes["time"]), dataset["time"].attrs))
    write_report(long, summary, tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    (run,) = page_data(page)["runs"]
    assert run["every"] == 2
    assert run["times"] == long.sizes["time"] // 2 + 1  # and the last one
    assert "one record in 2 is drawn" in page


def test_names_are_escaped(flight, tmp_path):
    dataset, summary = flight
    summary = copy.deepcopy(summary)
    summary["aircraft"][0] |= {"name": EVIL, "goal": EVIL, "status": EVIL}
    summary["scenario"] = {"name": EVIL, "hash": EVIL}
    summary["requirements"][0]["name"] = EVIL
    summary["versions"] = {EVIL: EVIL}
    scenario = json.loads(dataset.attrs["scenario"]) | {EVIL: EVIL}
    hostile_dataset = dataset.assign_coords(aircraft=[EVIL, *dataset["aircraft"].values[1:]])
    hostile_dataset = hostile_dataset.assign_attrs(description=EVIL, scenario=json.dumps(scenario))
    hostile_dataset["bank_deg"] = hostile_dataset["bank_deg"].assign_attrs(long_name=EVIL, symbol=EVIL, units=EVIL)
    original_summary = copy.deepcopy(summary)
    pages = [tmp_path / "one.html", tmp_path / "two.html"]
    write_report(hostile_dataset, summary, pages[0])
    write_comparison([(EVIL, hostile_dataset, summary), ("b", dataset, flight[1])], pages[1])
    assert original_summary == summary
    for path in pages:
        ours = markup(path.read_text(encoding="utf-8"))
        assert "<script>alert" not in ours
        assert "</script><script>alert" not in ours
        assert "<b>cläre" not in ours
        assert "&lt;script&gt;alert(1)" in ours
        assert ours.count("<script") == ours.count("</script>") == 1 + len(_SCRIPTS)
        assert page_data(path.read_text(encoding="utf-8"))["runs"][0]["aircraft"][0]["name"] == EVIL


def test_an_aircraft_that_failed_is_still_reported(flight, tmp_path):
    dataset, summary = flight
    broken = dataset.copy(deep=True)
    for name in broken.data_vars:
        if broken[name].dtype.kind == "f":
            broken[name].values[2000:, 1] = np.nan
    summary = copy.deepcopy(summary)
    summary["aircraft"][1] |= {"arrival_s": None, "miss_m": None, "status": "out of thrust"}
    summary["requirements"][0] |= {"value": None, "met": False}
    path = tmp_path / "report.html"
    write_report(broken, summary, path)
    ours = markup(path.read_text(encoding="utf-8"))
    assert "2 of 3 aircraft arrived" in ours
    assert "<b>bert</b>: out of thrust." in ours
    assert "Requirements not met: <b>miss_max_m</b>." in ours
    assert "<td>–</td>" in ours
    assert "NaN" not in ours
    assert "nan" not in re.sub(r"<[^>]*>", "", ours.replace("provenance", ""))


def test_an_aircraft_without_arrival_has_no_least_or_greatest_figures():
    dataset, flown = make_flight()
    summary = copy.deepcopy(flown)
    summary["aircraft"][1] |= {"arrival_s": None, "miss_m": None, "status": "the aircraft reached the ground"}
    name = summary["aircraft"][1]["name"]
    assert (
        f'Greatest miss</p><p class="value">–<small></small></p><p class="note">{name} never arrived'
        in summary_cards(dataset, summary)
    )
    table = difference_table(["flown", "crashed"], [flown, summary], [{}, {}])
    table_row = next(line for line in table.split("<tr>") if "Greatest miss" in line)
    assert table_row.count("<td>–</td>") == 2  # that of the second, and the difference


def test_a_failure_after_the_arrival_fails_the_flight():
    summary = copy.deepcopy(make_flight()[1])
    summary["aircraft"][1]["status"] = "the aircraft reached the ground"
    assert all(entry["met"] for entry in summary["requirements"])
    verdict = verdict_html(summary, {})
    assert "2 of 3 aircraft arrived" in verdict
    assert "<b>bert</b>: the aircraft reached the ground." in verdict
    assert "All requirements met" not in verdict


@pytest.mark.parametrize(
    ("change", "head"),
    [
        ({"arrival_spread_s": 3.2, "met": False}, "All 3 aircraft arrived, but 3.20&nbsp;s apart"),
        ({"arrival_spread_s": None, "met": True}, "All 3 aircraft arrived as planned"),
    ],
)
def test_the_verdict_follows_the_summary(flight, tmp_path, change, head):
    summary = copy.deepcopy(flight[1])
    summary["fleet"]["arrival_spread_s"] = change["arrival_spread_s"]
    entry = next(e for e in summary["requirements"] if e["name"] == "arrival_spread_max_s")
    entry |= {"value": change["arrival_spread_s"], "met": change["met"]}
    write_report(flight[0], summary, tmp_path / "report.html")
    assert head in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_two_runs_stand_side_by_side(flight, tmp_path):
    dataset, summary = flight
    scenario = json.loads(dataset.attrs["scenario"])
    scenario["limits"]["bank_max_deg"] = 60.0
    second_run = dataset.isel(time=slice(0, 4000)).assign_attrs(scenario=json.dumps(scenario))
    path = tmp_path / "beside.html"
    write_comparison([("runs/a", dataset, summary), ("runs/b", second_run, summary)], path)
    ours = markup(path.read_text(encoding="utf-8"))
    assert ours.count('class="scene-place"') == 2
    assert '<code>limits.bank_max_deg</code></td><td class="text free">70.0</td><td class="text free">60.0</td>' in ours
    assert [run["label"] for run in page_data(path.read_text(encoding="utf-8"))["runs"]] == ["runs/a", "runs/b"]
    with pytest.raises(ValueError, match="two runs"):
        write_comparison([("a", dataset, summary)], tmp_path / "alone.html")


def test_scenario_entries_are_compared_by_name():
    first_scenario = {"a": 1, "goal": [{"name": "x", "v": 1}, {"name": "y", "v": 2}]}
    second_scenario = {"a": 1, "goal": [{"name": "y", "v": 3}, {"name": "x", "v": 1}], "b": [1]}
    assert scenario_differences(first_scenario, second_scenario) == [("goal.y.v", 2, 3), ("b", None, [1])]


def test_a_page_is_replaced_only_on_request_and_whole(flight, tmp_path):
    path = tmp_path / "report.html"
    path.write_text("mine")
    with pytest.raises(FileExistsError, match="not overwritten"):
        write_report(*flight, path)
    assert path.read_text() == "mine"
    write_report(*flight, path, overwrite=True)
    assert "</html>" in path.read_text(encoding="utf-8")
    assert list(tmp_path.iterdir()) == [path]


def test_dataset_and_summary_must_belong_together(flight, tmp_path):
    dataset, summary = flight
    with pytest.raises(ValueError, match="the summary"):
        write_report(dataset.isel(aircraft=slice(2)), summary, tmp_path / "report.html")
    with pytest.raises(ValueError, match="lacks fleet"):
        write_report(dataset, {k: v for k, v in summary.items() if k != "fleet"}, tmp_path / "report.html")
    fleet = [{k: v for k, v in aircraft.items() if k != "goal"} for aircraft in summary["aircraft"]]
    with pytest.raises(ValueError, match=r"lacks aircraft\.goal"):
        write_report(dataset, summary | {"aircraft": fleet}, tmp_path / "report.html")
    with pytest.raises(ValueError, match=f"scenario abc, the summary {summary['scenario']['hash']}"):
        write_report(dataset.assign_attrs(scenario_hash="abc"), summary, tmp_path / "report.html")
    with pytest.raises(ValueError, match="lacks throttle"):
        write_report(dataset.drop_vars("throttle"), summary, tmp_path / "report.html")
    assert list(tmp_path.iterdir()) == []


def test_a_single_aircraft_is_reported(flight, tmp_path):
    dataset, summary = flight[0].isel(aircraft=[0]), copy.deepcopy(flight[1])
    summary["aircraft"] = summary["aircraft"][:1]
    summary["fleet"] |= {"separation_min_m": None, "arrival_spread_s": 0.0}
    write_report(dataset, summary, tmp_path / "report.html")
    ours = markup((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert "The aircraft arrived as planned" in ours
    assert "Least distance of two" not in ours


def test_the_page_of_a_single_aircraft_has_no_figures_of_pairs(flight, tmp_path):
    dataset, summary = flight[0].isel(aircraft=[0]), copy.deepcopy(flight[1])
    summary["aircraft"] = summary["aircraft"][:1]
    summary["arrival"] |= {"error_max_s": 0.02}
    summary["fleet"] |= {"separation_min_m": None, "arrival_spread_s": 0.0}
    write_report(dataset, summary, tmp_path / "report.html")
    ours = markup((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert "Off the planned time" in ours
    for text in ("Arrival spread", "Distance between two aircraft", "s apart were allowed"):
        assert text not in ours


def test_the_verdict_on_a_sequence_has_the_spacing(flight, tmp_path):
    summary = copy.deepcopy(flight[1])
    summary["arrival"] = {"rule": "sequence", "common": False, "error_max_s": 0.01}
    summary["arrival"] |= {"spacing_s": 60.0, "spacing_error_max_s": 0.004}
    summary["fleet"]["arrival_spread_s"] = 120.004
    verdict = verdict_html(summary, {"arrival": {"rule": "sequence"}})
    assert "All 3 aircraft arrived 60&nbsp;s apart, within 4&nbsp;ms" in verdict
    write_report(flight[0], summary, tmp_path / "report.html")
    ours = markup((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert "Spacing error" in ours
    assert "120.00" not in ours


def test_the_verdict_names_an_exceeded_limit(flight):
    def margin(later):
        return Margin("Bank angle to the right", "limit", "°", 70.0, 72.1, True, False, after_arrival=later)

    summary = flight[1]
    clean_verdict = verdict_html(summary, {}, [])
    assert 'class="answer good"' in clean_verdict
    assert "All requirements met." in clean_verdict
    exceeded_verdict = verdict_html(summary, {}, [margin(True)])
    assert 'class="answer mixed"' in exceeded_verdict
    assert "All requirements met, but not all limits kept." in exceeded_verdict
    assert "<b>Bank angle to the right</b> (103 % of its limit, after the arrival)" in exceeded_verdict
    assert "after the arrival" not in verdict_html(summary, {}, [margin(False)])


def test_keep_outs_of_events_are_in_the_scene_from_their_event_on():
    standing, appearing = {"name": "mountain", "radius_m": 900.0}, {"name": "cell", "radius_m": 600.0}
    events = [
        {"kind": "goal-stops", "time_s": 5.0},
        {"kind": "keep-out-appears", "time_s": 20.0, "keep_out": appearing},
    ]
    assert scene_keep_outs({"keep_out": [standing], "event": events}) == [
        {**standing, "from_s": 0.0},
        {**appearing, "from_s": 20.0},
    ]
    assert scene_keep_outs({}) == []
