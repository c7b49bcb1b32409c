"""The live page in a browser, against its server: a drag, the keyboard, undo, a refusal, a flight."""

import json
import time
import tomllib
from pathlib import Path

import pytest

import anser
from anser.config.shipped_files import shipped_files
from support.chromium import Chromium, skip_without_chromium

skip_without_chromium()
pytest.importorskip("starlette")

from anser.live.documents import merge_into_toml  # noqa: E402
from anser.live.server import LiveServer  # noqa: E402

DOCUMENT = tomllib.loads(Path(shipped_files()["storm-sampling"]).read_text(encoding="utf-8"))
LIMIT_S = 120.0


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("folder")
    other = {key: table for key, table in DOCUMENT.items() if key != "separation"} | {"name": "other"}
    (folder / "other.toml").write_text(merge_into_toml("# without a separation\n", other), encoding="utf-8")
    server = LiveServer(DOCUMENT, folder)
    try:
        with Chromium(tmp_path_factory.mktemp("browser"), software=True) as browser:
            browser.folder = folder
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
    page.run("document.querySelector('#answer [data-jump]').click()")
    assert page.run("document.activeElement.closest('#inputs') !== null")
    page.run("live.scenario.undo()")
    answered(page)
    assert page.run("live.answer.status") == "planned"
    assert page.run("document.querySelectorAll('.ring, #inputs .bound').length") == 0


def test_the_keyboard_moves_a_goal(page):
    answered(page)
    page.run("document.querySelector('[data-key=\"goal[0]\"]').focus()")
    north_m = page.run("live.scenario.get('goal[0].north_m')")
    press(page, "ArrowUp")
    answered(page)
    assert page.run("live.scenario.get('goal[0].north_m')") > north_m
    assert page.run("live.answer.status") == "planned"


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


@pytest.mark.long
def test_the_keyboard_flies(page):
    answered(page)
    page.run("document.getElementById('fly').focus()")
    press(page, "Enter")
    wait_for(page, "live.flights.known.length === 1 && !live.flights.number")
    assert page.run("live.flights.rows.names.length") == len(DOCUMENT["aircraft"])
    assert page.run("live.flights.rows.end") == pytest.approx(DOCUMENT["timing"]["duration_s"], abs=2.0)
