"""The live page in a browser, against its server: a drag, the keyboard, undo, a refusal, a flight."""

import json
import math
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest

import anser
from anser.config.shipped_files import shipped_files
from anser.scenario.build import _motion, motion_after_events
from anser.scenario.schema_aircraft import Goal
from anser.scenario.schema_airspace import Event
from support.chromium import Chromium, skip_without_chromium

skip_without_chromium()
pytest.importorskip("starlette")

from anser.live.documents import merge_into_toml  # noqa: E402
from anser.live.page import render_live_page  # noqa: E402
from anser.live.server import LiveServer  # noqa: E402

DOCUMENT = tomllib.loads(Path(shipped_files()["storm-sampling"]).read_text(encoding="utf-8"))
# Three aircraft: with one added, the fleet keeps its size of four, for which one set of programs is compiled.
DOCUMENT["aircraft"], DOCUMENT["goal"] = DOCUMENT["aircraft"][:3], DOCUMENT["goal"][:3]
LIMIT_S = 120.0


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("folder")
    other = {key: table for key, table in DOCUMENT.items() if key != "separation"} | {"name": "other"}
    (folder / "other.toml").write_text(merge_into_toml("# without a separation\n", other), encoding="utf-8")
    server = LiveServer(DOCUMENT, folder)
    try:
        with Chromium(tmp_path_factory.mktemp("browser"), software=True) as browser:
            browser.folder, browser.url = folder, server.url
            browser._ask("Page.navigate", url=server.url)
            wait_for(browser, "location.protocol === 'http:' && window.live?.answer?.status === 'planned'")
            yield browser
            assert browser.faults == []
    finally:
        server.close()


def wait_for(browser, condition):
    """Wait until an expression in the page is true."""
    end = time.monotonic() + LIMIT_S
    while not browser.run(f"Boolean({condition})"):
        if time.monotonic() > end:
            raise TimeoutError(f"{condition}; {browser.run('live.status.textContent')}; {browser.faults}")
        time.sleep(0.05)
    browser.settle()


def answered(browser):
    """Wait until the newest scenario has its answer."""
    wait_for(browser, "live.requests.answered === live.requests.number && !live.requests.due && !live.requests.flying")


def position_of(browser, key):
    return browser.run(
        f"(() => {{ const b = document.querySelector('[data-key=\"{key}\"]').getBoundingClientRect();"
        " return [b.x + b.width / 2, b.y + b.height / 2]; })()"
    )


def press(browser, key, count=1):
    for _ in range(count):
        for kind in ("keyDown", "keyUp"):
            browser._ask("Input.dispatchKeyEvent", type=kind, key=key, code=key, **KEYS.get(key, {}))


KEYS = {"Enter": {"text": "\r", "windowsVirtualKeyCode": 13}}


def test_the_drag_of_a_goal_gives_a_new_plan_and_undo_returns_to_the_former(page):
    answered(page)
    before = page.run(
        "[live.scenario.get('goal[0].north_m'), live.answer.aircraft[0].length_m, live.scenario.done.length]"
    )
    x, y = position_of(page, "goal[0]")
    page.mouse("mousePressed", x, y, button="left", clickCount=1)
    for step in range(1, 11):
        page.mouse("mouseMoved", x + 3 * step, y + 2 * step, button="left", buttons=1)
    page.mouse("mouseReleased", x + 30, y + 20, button="left", clickCount=1)
    answered(page)
    after = page.run(
        "[live.scenario.get('goal[0].north_m'), live.answer.aircraft[0].length_m, live.scenario.done.length]"
    )
    assert after[0] < before[0]
    assert after[1] != before[1]
    assert after[2] == before[2] + 1  # the drag is one step
    assert page.run("live.latencies.length") > 0
    page.run("document.getElementById('undo').click()")
    answered(page)
    assert page.run("live.scenario.get('goal[0].north_m')") == before[0]
    assert page.run("live.answer.aircraft[0].length_m") == pytest.approx(before[1], rel=1e-9)


def test_a_refusal_is_drawn_and_leads_to_the_input(page):
    answered(page)
    page.run("live.scenario.set('separation.horizontal_m', 6000)")
    answered(page)
    assert page.run("live.answer.status") == "refused"
    assert page.run("document.querySelectorAll('.ring').length") >= 2
    assert len(page.run("document.querySelector('#answer .problem').textContent")) > 20
    assert "refused: best attempt" in page.run("document.querySelector('.legend').textContent")
    assert (
        page.run("document.querySelectorAll('#map .track:not(.unproven), #profile .track:not(.unproven)').length") == 0
    )
    assert page.run("document.querySelector('#map .attempt').textContent") == "refused: best attempt"
    assert page.run("[document.getElementById('fly').disabled, document.getElementById('fly').title]") == [
        True,
        "No certified plan: the answer says why.",
    ]
    page.run("document.querySelector('#answer [data-jump]').click()")
    assert page.run("document.activeElement.closest('#inputs') !== null")
    page.run("live.scenario.undo()")
    answered(page)
    assert page.run("live.answer.status") == "planned"
    assert page.run("document.querySelectorAll('.ring, .attempt, #inputs .bound, .legend:not([hidden])').length") == 0
    assert page.run("document.getElementById('fly').disabled") is False


def test_a_plan_of_the_published_planner_is_not_called_certified(page):
    answered(page)
    assert page.run("document.querySelector('#answer .head').textContent") == "Certified plan"
    page.run("live._take({ ...live.answer, certified: false }), live.drawNow()")  # as the server says it
    assert page.run("document.querySelector('#answer .head').textContent") == "Plan, not certified"
    assert page.run("document.querySelector('#answer .answer').className") == "answer mixed"
    page.run("live._take({ ...live.answer, certified: true }), live.drawNow()")
    assert page.run("document.querySelector('#answer .answer').className") == "answer good"


def test_an_answer_that_waits_for_the_newer_scenario_is_grey_and_says_so(page):
    answered(page)
    look = "[getComputedStyle(document.querySelector('#answer > .waits')).display,"
    look += " getComputedStyle(document.querySelector('#answer > .answer')).filter]"
    assert page.run(look) == ["none", "none"]
    page.run("window.listener = live.connection.listeners.plan; window.kept = []")
    page.run("live.connection.listeners.plan = (message) => kept.push(message)")  # the answer is on its way
    page.run("live.scenario.set('wind.speed_m_s', 2)")
    wait_for(page, "document.body.classList.contains('late')")
    assert page.run(look) == ["block", "grayscale(1)"]
    assert "planning again" in page.run("document.querySelector('#answer > .waits').textContent")
    wait_for(page, "kept.length")
    page.run("live.connection.listeners.plan = listener; kept.forEach(listener)")
    answered(page)
    assert page.run("document.body.classList.contains('late')") is False
    assert page.run(look) == ["none", "none"]
    page.run("live.scenario.undo()")


def test_the_links_of_a_refusal_lead_to_inputs_and_a_key_without_input_has_none(page):
    answered(page)
    keys = ["separation.horizontal_m", "aircraft[1].start.speed_m_s", "goal", "nothing.of_this_name"]
    problem = {"text": "a reason", "keys": keys, "aircraft": [], "positions": []}
    page.run(f"live.problems = [{json.dumps(problem)}]; live.drawNow()")
    links = "[...document.querySelectorAll('#answer .problem .jump')]"
    assert page.run(f"{links}.map((one) => one.dataset.jump)") == keys[:3]
    names = page.run(f"{links}.map((one) => one.textContent)")
    assert names[0] == "→ Separation"
    assert names[1].endswith("speed")
    for k, path in enumerate([keys[0], keys[1], "goal[0].name"]):
        page.run(f"{links}[{k}].click()")
        assert page.run("document.activeElement.dataset.path") == path
    assert page.run("document.querySelector('[data-path=\"aircraft[1].start.speed_m_s\"]').closest('details').open")
    assert page.run("document.querySelectorAll('#inputs [aria-invalid=true]').length") == 2
    page.run("live.problems = []; live.drawNow()")


def test_a_keep_out_is_dragged_by_its_disc(page):
    answered(page)
    page.run("window.ask = live.requests.ask; live.requests.ask = () => {}")  # keep-outs have programs of their own
    if not page.run("live.scenario.list('keep_out').length"):
        page.run("live.add('keep_out')")
    page.run("live.scenario.set('keep_out[0].radius_m', Math.round(60 / live.map.view.scale)); live.drawNow()")
    before = page.run("live.scenario.get('keep_out[0].north_m')")
    x, y = position_of(page, "keep_out[0]")
    page.mouse("mousePressed", x - 40, y + 20, button="left", clickCount=1)
    page.mouse("mouseMoved", x - 40, y - 10, button="left", buttons=1)
    page.mouse("mouseReleased", x - 40, y - 10, button="left", clickCount=1)
    moved_px = page.run(f"(live.scenario.get('keep_out[0].north_m') - {before}) * live.map.view.scale")
    assert moved_px == pytest.approx(30.0, abs=1.0)
    page.run("live.requests.ask = ask")
    page.run(f"live.opened({json.dumps(DOCUMENT)}, null)")


def test_an_aircraft_is_added_with_a_goal_of_its_own_in_one_step_of_the_history(page):
    answered(page)
    count, steps = page.run("[live.scenario.list('aircraft').length, live.scenario.done.length]")
    page.run("window.ask = live.requests.ask; live.requests.ask = () => {}")  # a larger fleet has other programs
    page.run("document.querySelector('[aria-label=\"Add aircraft with a goal of its own\"]').click()")
    assert page.run("live.scenario.list('aircraft').at(-1).goal === live.scenario.list('goal').at(-1).name")
    assert page.run("[live.scenario.list('aircraft').length, live.scenario.done.length]") == [count + 1, steps + 1]
    velocities = "live.scenario.list('goal').slice(-2).map((one) => [one.speed_m_s, one.course_deg])"
    assert page.run(f"(([a, b]) => a[0] === b[0] && a[1] === b[1])({velocities})")
    page.run("live.scenario.undo()")
    assert page.run("live.scenario.list('aircraft').length") == count
    page.run("live.requests.ask = ask")
    page.run(f"live.opened({json.dumps(DOCUMENT)}, null)")
    answered(page)


def test_a_prescribed_arrival_time_begins_with_that_of_the_plan(page):
    answered(page)
    last_s = page.run("live.answer.last_s")
    page.run("window.ask = live.requests.ask; live.requests.ask = () => {}")  # another rule has other programs
    page.run(
        "(() => { const { input } = live.inputs.fields.get('arrival.rule');"
        " input.value = 'at'; input.dispatchEvent(new Event('change')); })()"
    )
    assert page.run("live.scenario.get('arrival.rule')") == "at"
    assert 0.0 <= page.run("live.scenario.get('arrival.time_s')") - last_s < 0.1
    page.run("live.scenario.undo()")
    assert page.run("live.scenario.get('arrival.time_s')") is None
    page.run("live.requests.ask = ask")
    page.run(f"live.opened({json.dumps(DOCUMENT)}, null)")
    answered(page)


def test_the_reason_of_an_invalid_first_answer_is_shown(page):
    answered(page)
    nameless = json.loads(json.dumps(DOCUMENT))
    nameless["aircraft"][1]["name"] = ""
    study = tomllib.loads(shipped_files()["how-surely"].read_text(encoding="utf-8"))
    assert "vary" in study
    for document in (
        nameless,
        study,
        DOCUMENT | {"goal": [{"name": "a", "kind": "surface", "waypoints": []}]},
        {"aircraft": 3},
    ):
        page.run(f"live.opened({json.dumps(document)}, null)")
        answered(page)
        shown = "[live.invalid, live.answer, document.querySelector('#answer .head').textContent]"
        assert page.run(shown) == [True, None, "Not a valid scenario"]
        assert len(page.run("document.querySelector('#answer .problem').textContent")) > 20
        assert page.faults == []
    page.run(f"live.opened({json.dumps(DOCUMENT)}, null)")
    answered(page)
    assert page.run("live.answer.status") == "planned"


def flown(goal, events, times_s):
    """Positions of a goal in a flight with events: north, east and altitude, m."""
    goal, events = Goal(**goal), [Event(**event) for event in events]
    motion = motion_after_events(goal, _motion(goal), events)
    return [[north, east, -down] for north, east, down in (motion.position_n(time_s).tolist() for time_s in times_s)]


def test_goals_move_on_the_page_as_in_flight(page):
    straight = {"name": "a", "kind": "airborne", "north_m": 100.0, "east_m": -50.0, "altitude_m": 900.0}
    straight |= {"speed_m_s": 12.0, "course_deg": 30.0, "climb_rate_m_s": 1.5}
    legs = [(0.0, 0.0, 0.0, 500.0), (40.0, 400.0, 100.0, 620.0), (90.0, 300.0, 700.0, 620.0)]
    route = {
        "name": "a",
        "kind": "airborne",
        "waypoints": [dict(zip(("time_s", "north_m", "east_m", "altitude_m"), leg, strict=True)) for leg in legs],
    }
    turn, stop = {"kind": "goal-turns", "goal": "a"}, {"kind": "goal-stops", "goal": "a"}
    first, second = (
        turn | {"time_s": 20.0, "course_deg": 90.0, "speed_m_s": 5.0},
        turn | {"time_s": 50.0, "course_deg": -200.0},
    )
    cases = [
        (first, second),
        (second, first),
        (stop | {"time_s": 30.0}, second),
        (turn | {"time_s": 40.0, "course_deg": 10.0},),
        (),
        (second,),
        (turn | {"time_s": 95.0, "course_deg": 10.0},),
    ]
    times_s = [0.0, 19.0, 20.0, 45.0, 50.0, 80.0, 120.0]
    for goal in (straight, route):
        for events in cases:
            places = page.run(
                f"{json.dumps(times_s)}.map((time) => motionAt({json.dumps(goal)}, time, {json.dumps(events)})).map((one) => [one.north_m, one.east_m, one.altitude_m])"
            )
            np.testing.assert_allclose(places, flown(goal, events, times_s), atol=1e-3)
    # "turns right by 90°" starts from the course at the played time
    offered = page.run(
        "(() => { const { flights, scenario } = live, { table } = scenario;"
        f" scenario.table = {{ goal: [{json.dumps(straight)}], event: {json.dumps([first, stop | {'time_s': 60.0}])} }};"
        " const courses = [10, 30, 70].map((time) => { flights.time = time; return flights._offers()[0][1].course_deg; });"
        " scenario.table = table; flights.time = null; return courses; })()"
    )
    assert offered == [120, 180, 180]


def test_the_steps_of_the_history_and_the_removal_of_a_table(page):
    answered(page)
    page.run("window.ask = live.requests.ask; live.requests.ask = () => {}")
    events = [
        {
            "time_s": 9.0 + k,
            "kind": "keep-out-appears",
            "keep_out": {
                "name": f"cell-{k}",
                "north_m": 900.0 * k,
                "east_m": 0.0,
                "radius_m": 300.0,
                "speed_m_s": 10.0,
            },
        }
        for k in range(3)
    ]
    table = DOCUMENT | {"event": events, "gust": [{"time_s": 3.0}], "excitation": [{"begin_s": 1.0}]}
    page.run(f"live.opened({json.dumps(table)}, null); live.drawNow()")
    count = page.run("live.scenario.list('goal').length")
    # Delete without a handle or a summary in focus, then with one
    page.run("document.querySelector('[data-key=\"goal[0]\"]').focus(); document.activeElement.blur()")
    press(page, "Delete")
    assert page.run("live.scenario.list('goal').length") == count
    page.run("document.querySelector('[data-key=\"event[1].keep_out\"]').focus()")
    press(page, "Delete")
    page.run("live.drawNow()")
    press(page, "Delete")  # the handle of this number is that of the next one now
    assert page.run("live.scenario.list('event').map((one) => one.time_s)") == [9.0, 11.0]
    assert page.run("['gust', 'excitation'].map((key) => live.scenario.list(key).length)") == [1, 1]
    page.run("document.querySelector('#inputs summary[data-path=\"goal[2]\"]').focus()")
    press(page, "Delete")
    assert page.run("live.scenario.list('goal').length") == count - 1
    # the keep-out of an event begins where it appears
    radius = "document.querySelector('#map .ground circle.keep-out')"
    assert page.run(
        "(() => { live.flights.rows = new FlightRows('x'); live.flights.rows.time_s = [0, 40]; live.flights.time = 19;"
        f" live.drawNow(); const y = Number({radius}.getAttribute('cy'));"
        " Object.assign(live.flights, { rows: null, time: null }); return live.map.position(0, y).north_m; })()"
    ) == pytest.approx(100.0, abs=1.0 + 0.1 / page.run("live.map.view.scale"))
    # a name that another aircraft has
    names = page.run("live.scenario.list('aircraft').map((one) => one.name)")
    field = "live.inputs.fields.get('aircraft[1].name').input"
    page.run(f"{field}.value = {json.dumps(names[0])}; {field}.dispatchEvent(new Event('change'))")
    assert page.run("live.scenario.list('aircraft').map((one) => one.name)") == names
    assert page.run(f"{field}.value") == names[1]
    assert f"another aircraft has the name {names[0]}" in page.run("live.status.textContent")
    # several changes are one step, also of a full history
    page.run("for (let k = 0; k < 120; k++) live.scenario.edit((table) => { table.seed = k; })")
    before = page.run("JSON.stringify(live.scenario.table)")
    page.run("live.add('pair'); live.scenario.undo()")
    assert page.run("JSON.stringify(live.scenario.table)") == before
    # an edit while a save is on its way
    page.run("live.scenario.saved('a.toml', JSON.stringify(live.scenario.table))")
    assert page.run("live.scenario.changed") is False
    page.run("live.scenario.saved('a.toml', 'another text')")
    assert page.run(
        "[live.scenario.changed, JSON.parse(sessionStorage.getItem(live.scenario.storageKey)).changed]"
    ) == [True, True]
    page.run("live.requests.ask = ask")
    page.run(f"live.opened({json.dumps(DOCUMENT)}, null)")
    answered(page)


def test_another_arrival_rule_leaves_no_key_of_the_former(page):
    answered(page)
    page.run("window.ask = live.requests.ask; live.requests.ask = () => {}")  # another rule has other programs
    names = [aircraft["name"] for aircraft in DOCUMENT["aircraft"]]
    full = DOCUMENT | {"arrival": {"rule": "sequence", "spacing_s": 9.0, "order": names, "time_s": 70.0}}
    full["aircraft"] = [
        aircraft | {"arrive_s": 70.0, "arrive_from_s": 60.0, "arrive_to_s": 80.0} for aircraft in full["aircraft"]
    ]
    page.run(f"live.opened({json.dumps(full)}, null); live.drawNow()")
    keys = {
        "at": {"time_s"},
        "sequence": {"spacing_s", "order"},
        "times": {"arrive_s"},
        "windows": {"arrive_from_s", "arrive_to_s"},
    }
    for rule in ("earliest", "together", *keys):
        kept = page.run(
            "(() => { const { input } = live.inputs.fields.get('arrival.rule'), { scenario } = live;"
            f" input.value = '{rule}'; input.dispatchEvent(new Event('change'));"
            " const kept = [...Object.keys(scenario.table.arrival), ...scenario.list('aircraft').flatMap(Object.keys)];"
            " const steps = scenario.done.length; scenario.undo(); return [kept, steps]; })()"
        )
        assert kept[1] == 1
        assert {key for key in kept[0] if key.startswith("arrive_") or key in full["arrival"]} == {"rule"} | keys.get(
            rule, set()
        )
        assert page.run("JSON.stringify(live.scenario.table)") == page.run(f"JSON.stringify({json.dumps(full)})")
    page.run("live.requests.ask = ask")
    page.run(f"live.opened({json.dumps(DOCUMENT)}, null)")
    answered(page)


def test_the_scene_of_a_flight_has_the_rendezvous_of_the_plan_and_the_events(page):
    answered(page)
    assert page.run("interpolated([0, 1, 2], [5, -5, 0], 0.5)") == 0
    assert page.run("interpolated([0, 0.5, 1], [5, 4, NaN], 0.75)") == 4
    # rows of a flight with holds after the arrival, without the values of the last row of the first aircraft
    run = page.run(
        "(() => { const { answer, scenario } = live, { table } = scenario, [one] = answer.drawn, end = one.track.time_s.at(-1);"
        " scenario.table = { ...table, event: [{ time_s: end + 5, kind: 'goal-stops', goal: one.goal },"
        " { time_s: 7, kind: 'keep-out-appears', keep_out: { name: 'cell', north_m: 1, east_m: 2, radius_m: 300 } }] };"
        " const rows = new FlightRows('x');"
        " rows.append({ time_s: [0, end, end + 40, end + 41], aircraft: answer.drawn.map(({ name, track }, k) => ({ name,"
        " ...Object.fromEntries(['north_m', 'east_m', 'altitude_m'].map((axis) =>"
        " [axis, [track[axis][0], track[axis].at(-1), track[axis].at(-1), k ? 0 : null]]))})) });"
        " const run = runOf(flownFleet(answer.drawn, rows), live, scenario.list('event'));"
        " scenario.table = table;"
        " const at = (name, time) => run.cache.get(name)[0][run.time.findLastIndex((value) => value <= time)];"
        " return { left: rows.until(0, end + 41).here, keep_out: run.keepOuts.at(-1), goal: [at('goal_north_m', end + 6), at('goal_north_m', end + 30)],"
        " shift: run.time[run.time.findLastIndex((value) => value <= end)] - end, speed: motionAt(scenario.list('goal').find((goal) => goal.name === one.goal), end),"
        " marker: at('rendezvous_north_m', end), rendezvous: one.rendezvous.north_m }; })()"
    )
    course = math.radians(run["speed"]["course_deg"])
    moved_m = run["speed"]["speed_m_s"] * math.cos(course) * run["shift"]
    assert run["marker"] == pytest.approx(run["rendezvous"] + moved_m, abs=0.01)
    assert run["goal"][0] == pytest.approx(run["goal"][1], abs=0.01)  # stopped
    assert (run["keep_out"]["from_s"], run["keep_out"]["radius_m"]) == (7, 300)
    assert run["left"] is None


def test_a_repeated_flight_that_fails_leaves_no_tracks_of_the_former(page):
    answered(page)
    shown = page.run(
        "(() => { const { flights, connection, scenario } = live, { send } = connection, answers = [];"
        " connection.send = (type, content, answer) => type === 'fly' ? 100 + answers.push(answer) : 0;"
        " const rows = Object.assign(new FlightRows(JSON.stringify(scenario.table)), { names: ['one'], time_s: [0, 9],"
        " north_m: [[0, 500]], east_m: [[0, 90]], altitude_m: [[300, 300]] });"
        " Object.assign(flights, { rows, time: 9 });"
        " flights._add({ kind: 'goal-stops', goal: scenario.list('goal')[0].name });"
        " const between = flights.rows === rows; answers[0]({ type: 'failed', problems: [] });"
        " connection.send = send; return [between, flights.rows]; })()"
    )
    assert shown == [True, None]
    page.run(f"live.opened({json.dumps(DOCUMENT)}, null)")
    answered(page)


def test_a_limit_exceeded_with_the_other_sign_is_the_first_bar(page):
    answered(page)
    page.run(
        "(() => { const answer = structuredClone(live.answer); live._take(answer);"
        " Object.assign(answer.aircraft[1].limits.at(-1), { label: 'exceeded', bound: -3, utilization: null });"
        " Object.assign(answer.aircraft[0].limits[0], { label: 'unknown', bound: null, utilization: null });"
        " live.shown = null; live.drawNow(); })()"
    )
    assert page.run("document.querySelector('#answer .bars li.over .name').textContent") == "exceeded"
    assert "unknown" not in page.run("document.querySelector('#answer .bars').textContent")
    page.run(f"live.opened({json.dumps(DOCUMENT)}, null)")
    answered(page)


def test_entries_of_a_recorded_page_are_the_same_in_any_order_and_a_page_needs_no_storage(page, tmp_path):
    answered(page)
    planned = page.run("live.answer")
    refused, invalid = planned | {"status": "refused"}, {"status": "invalid", "problems": []}
    entries = [
        {"label": str(k), "scenario": DOCUMENT, "answer": answer}
        for k, answer in enumerate((invalid, refused, planned, refused))
    ]
    (tmp_path / "recorded.html").write_text(render_live_page(entries), encoding="utf-8")
    page.open(tmp_path / "recorded.html")
    look = "[live.answer?.status ?? null, live.certified !== null, document.querySelectorAll('#map .ghost').length]"
    looks = [page.run(look)]
    for k in (1, 2, 3, 2, 1, 0):
        page.run(f"document.getElementById('{'next' if k > len(looks) - 1 else 'previous'}').click()")
        looks.append(page.run(look))
    count = len(DOCUMENT["aircraft"])
    assert looks[:4] == [[None, False, 0], ["refused", False, 0], ["planned", True, 0], ["refused", True, count]]
    assert looks[4:] == looks[2::-1]
    page.run("document.querySelector('#inputs summary[data-path=\"aircraft[0]\"]').focus()")
    press(page, "Delete")
    assert page.run("live.scenario.list('aircraft').length") == count
    forbidden = "Object.defineProperty(window, 'sessionStorage', { get() { throw new DOMException('forbidden'); } });"
    with page.before_every_page(forbidden):
        page._ask("Page.navigate", url=page.url)
        wait_for(page, "location.protocol === 'http:' && window.live?.answer?.status === 'planned'")
    page.run("live.scenario.set('wind.speed_m_s', 2); live.scenario.undo()")
    answered(page)


def test_flown_tracks_vanish_when_the_scenario_changes_and_fade_while_it_is_flown(page):
    answered(page)
    page.run(
        "live.flights.rows = Object.assign(new FlightRows(JSON.stringify(live.scenario.table)),"
        " { names: ['one'], time_s: [0, 9],"
        " north_m: [[0, 500]], east_m: [[0, 90]], altitude_m: [[300, 300]] });"
        "live.flights.time = 9; live.drawNow()"
    )
    assert page.run("document.querySelectorAll('#map .flown[stroke]').length") >= 1
    page.run("live.flights.number = 7; live.flights.incoming = live.flights.rows")
    page.run("live.scenario.set('wind.speed_m_s', 2); live.drawNow()")
    assert "the scenario before the change" in page.run("document.querySelector('.legend').textContent")
    assert page.run("document.querySelector('#map .of-flight').classList.contains('outdated')")
    page.run("live.flights.number = 0; live.scenario.set('wind.speed_m_s', 3); live.drawNow()")
    assert page.run("document.querySelectorAll('#map .flown[stroke]').length") == 0
    assert page.run("document.getElementById('player').hidden")
    page.run(f"live.opened({json.dumps(DOCUMENT)}, null)")
    answered(page)


def test_the_late_answer_to_a_stopped_flight_does_not_end_the_present_one(page):
    answered(page)
    numbers = page.run(
        "(() => { const { flights, connection } = live, { send } = connection, answers = [];"
        " connection.send = (type, content, answer) => type === 'fly' ? 100 + answers.push(answer) : 0;"
        " flights.start(); flights.start(); answers[0]({ type: 'failed', problems: [] });"
        " const between = flights.number; answers[1]({ type: 'failed', problems: [] });"
        " connection.send = send; return [between, flights.number]; })()"
    )
    assert numbers == [102, 0]
    page.run(f"live.opened({json.dumps(DOCUMENT)}, null)")
    answered(page)


def test_the_keyboard_moves_a_goal(page):
    answered(page)
    page.run("document.querySelector('[data-key=\"goal[0]\"]').focus()")
    north_m = page.run("live.scenario.get('goal[0].north_m')")
    press(page, "ArrowUp")
    answered(page)
    assert page.run("live.scenario.get('goal[0].north_m')") > north_m
    assert page.run("live.answer.status") == "planned"


@pytest.mark.long
def test_the_order_of_the_arrivals_is_edited(page):
    answered(page)
    page.run("live.scenario.set('arrival', { rule: 'sequence', spacing_s: 10 })")
    answered(page)
    first, second = (aircraft["name"] for aircraft in DOCUMENT["aircraft"][:2])
    page.run(f"document.querySelector('.order [aria-label=\"{second} earlier\"]').click()")
    answered(page)
    assert page.run("live.scenario.get('arrival.order').slice(0, 2)") == [second, first]
    assert page.run("live.answer.status") == "planned"
    arrivals_s = page.run("Object.fromEntries(live.answer.aircraft.map((one) => [one.name, one.arrival_s]))")
    assert arrivals_s[first] - arrivals_s[second] == pytest.approx(10.0, abs=1e-6)
    page.run("live.scenario.set('arrival', undefined)")
    answered(page)


def test_two_fingers_zoom_about_their_middle(page):
    box = page.run(
        "(() => { const b = live.map.svg.getBoundingClientRect(); return [b.x, b.y, b.width, b.height]; })()"
    )
    x, y = box[0] + 0.5 * box[2], box[1] + 0.12 * box[3]
    before = page.run(f"[live.map.view.scale, live.map.position({0.5 * box[2]}, {0.12 * box[3]})]")
    for kind, apart in (("touchStart", 30), ("touchMove", 45), ("touchMove", 60)):
        fingers = [{"x": x - apart, "y": y, "id": 0}, {"x": x + apart, "y": y, "id": 1}]
        page._ask("Input.dispatchTouchEvent", type=kind, touchPoints=fingers)
    page._ask("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    after = page.run(f"[live.map.view.scale, live.map.position({0.5 * box[2]}, {0.12 * box[3]})]")
    assert after[0] == pytest.approx(2.0 * before[0], rel=0.02)
    assert after[1]["north_m"] == pytest.approx(before[1]["north_m"], abs=2.0 / before[0])
    assert after[1]["east_m"] == pytest.approx(before[1]["east_m"], abs=2.0 / before[0])
    page.run("live.map.fit()")


def test_another_scenario_is_opened_with_its_sliders_and_saved_under_a_new_name(page):
    answered(page)
    value = "document.querySelector('[data-path=\"separation.horizontal_m\"]').value"
    assert page.run(value) == "150"
    page.run("live.scenario.changed = false; document.getElementById('open').click()")
    wait_for(page, "document.querySelector('dialog[open] .files button')")
    page.run("[...document.querySelectorAll('.files button')].find((one) => one.value === 'other.toml').click()")
    wait_for(page, "live.scenario.name === 'other.toml'")
    answered(page)
    assert page.run(value) == "0"  # the file has no separation
    page.run("live.scenario.set('wind.speed_m_s', 3)")
    answered(page)
    page.run("document.getElementById('save-as').click()")
    wait_for(page, "document.querySelector('dialog[open] input')")
    page.run("document.querySelector('dialog input').value = 'mine'")
    page.run("document.querySelector('dialog [value=save]').click()")
    wait_for(page, "live.scenario.name === 'mine.toml' && !live.scenario.changed")
    text = (page.folder / "mine.toml").read_text(encoding="utf-8")
    assert text.startswith("# without a separation\n")
    assert tomllib.loads(text)["wind"]["speed_m_s"] == 3
    before = page.run("live.answer.last_s")
    assert before == pytest.approx(float(anser.plan(page.folder / "mine.toml").arrival_s), abs=1e-9)
    page.run(f"live.opened({json.dumps(DOCUMENT)}, null)")
    answered(page)


def test_the_reason_stands_in_the_answer_while_the_search_goes_on(page):
    answered(page)
    page.run(
        "live.requests.flying = live.requests.number = 2 ** 53; live._preliminary({ number: 2 ** 53, answer:"
        " { status: 'searching', problems: [{ text: 'known so far', keys: [], aircraft: [], positions: [] }] } });"
        "live.drawNow()"
    )
    text = page.run("document.querySelector('#answer .answer').textContent")
    assert text.startswith("No certified plan so farknown so farFurther kinds of paths are being tried.")
    assert page.run("document.querySelector('#map .plan').classList.contains('stale')")
    page.run("live._preliminary({ number: 1, answer: { status: 'searching', problems: [] } })")
    assert page.run("live.problems.length") == 1  # an older one changes nothing
    page.run("live.requests.flying = 0; live.requests.number = live.requests.answered = live.connection.number")
    page.run(f"live.opened({json.dumps(DOCUMENT)}, null)")
    answered(page)
    assert page.run("live.searching") is False


def test_requests_of_a_page_that_is_loaded_anew_have_greater_numbers(page):
    before = page.run("live.connection.number")
    assert page.run("new Connection().number") >= before
    assert page.run("Number.isSafeInteger(1000 * (Date.now() + 100 * 365 * 86400e3))")  # a century from now


def test_an_empty_number_field_is_named(page):
    answered(page)
    page.run("live.scenario.set('arrival', { rule: 'sequence' })")
    answered(page)
    assert "The field “Spacing” is empty." in page.run("document.querySelector('#answer .problem').textContent")
    page.run(f"live.opened({json.dumps(DOCUMENT)}, null)")
    answered(page)
    field = "live.inputs.fields.get('goal[0].north_m').input"
    north_m = page.run("live.scenario.get('goal[0].north_m')")
    page.run(f"{field}.value = ''; {field}.dispatchEvent(new Event('change'))")
    assert page.run(f"Number({field}.value)") == north_m
    assert "the field was empty; the value before stays" in page.run("live.status.textContent")


def test_the_map_shows_what_is_added_or_opened(page):
    answered(page)
    page.run("live.map.zoom(6)")
    assert page.run("live.map.showsAll()") is False
    page.run("live.add('pair')")
    answered(page)
    assert page.run("live.map.showsAll()")
    page.run("live.map.zoom(6)")
    page.run(f"live.opened({json.dumps(DOCUMENT)}, null)")
    answered(page)
    assert page.run("live.map.showsAll()")
    # the first layout came before the scenario
    page.run("(() => { live.map.zoom(6); live.map.fitted = false; live._welcome(live.welcome); })()")
    assert page.run("live.map.showsAll()")
    answered(page)


def test_an_attempt_beyond_its_limits_is_not_drawn(page):
    answered(page)
    page.run(
        "(() => { const answer = structuredClone(live.answer); answer.status = 'refused';"
        " answer.aircraft[0].drawn = false; live._take(answer); live.shown = null; live.drawNow(); })()"
    )
    count = len(DOCUMENT["aircraft"]) - 1
    assert page.run("document.querySelectorAll('#map .track[stroke]').length") == count
    name = DOCUMENT["aircraft"][0]["name"]
    assert f"No attempt of {name} is near its limits" in page.run("document.querySelector('#answer').textContent")
    page.run(f"live.opened({json.dumps(DOCUMENT)}, null)")
    answered(page)


def test_the_closest_pair_is_shown_by_its_distances(page):
    answered(page)
    text = "[...document.querySelectorAll('#answer .fact')].map((line) => [line.textContent, line.className])[0]"
    page.run(
        "(() => { const answer = structuredClone(live.answer); Object.assign(answer.separation, { pair: ['a', 'b'],"
        " time_s: 12, distances_m: [0, 120], required_m: [500, 150], is_met: false });"
        " live._take(answer); live.shown = null; live.drawNow(); })()"
    )
    sentence = "Closest pair: a and b, 0 m in the plane and 120 m in altitude at 12.0 s, 500 m or 150 m required."
    assert page.run(text) == [sentence, "fact over"]
    assert "0 m / 120 m" in page.run("document.querySelector('#map').textContent")
    page.run(f"live.opened({json.dumps(DOCUMENT)}, null)")
    answered(page)


def test_after_a_flight_the_header_has_two_rows_and_the_scene_moves(page):
    answered(page)
    page.run(
        "live.flights.known = [{ id: 'a', report: 'report/a', name: '✓ ' + 'met at '.repeat(12) }];"
        "live.flights._choose(live.flights.known[0]); live.say('met at '.repeat(12));"
        "live.flights.rows = Object.assign(new FlightRows(JSON.stringify(live.scenario.table)),"
        " { names: live.answer.aircraft.map((one) => one.name),"
        " time_s: [0, 40, 80], ...Object.fromEntries(['north_m', 'east_m', 'altitude_m'].map((axis) =>"
        " [axis, live.answer.aircraft.map(({ track }) => [0, 0.5, 1].map((part) =>"
        " track[axis][Math.round(part * (track[axis].length - 1))]))])) });"
        "live.flights.setTime(10)"
    )
    wait_for(page, "live.scene.flown !== null && live.scene.state.time > 9")
    assert page.run("document.querySelector('header.top').getBoundingClientRect().height") < 90
    assert page.run("document.documentElement.scrollHeight <= innerHeight + 1")
    page.run("live.flights.setTime(60)")
    wait_for(page, "Math.abs(live.scene.state.time - 60) < 1")
    page.run("live.flights.leave(); live.flights.known = []; live.flights._choose(null); live.say('')")


@pytest.mark.long
def test_the_keyboard_flies(page):
    answered(page)
    page.run("document.getElementById('fly').focus()")
    press(page, "Enter")
    wait_for(page, "live.flights.known.length === 1 && !live.flights.number")
    assert page.run("live.flights.rows.names.length") == len(DOCUMENT["aircraft"])
    assert page.run("live.flights.rows.end") == pytest.approx(DOCUMENT["timing"]["duration_s"], abs=2.0)
