"""The live page in a browser, against its server: a drag, the keyboard, undo, a refusal, a flight."""

import time
import tomllib
from pathlib import Path

import pytest

from anser.config.shipped_files import shipped_files
from support.chromium import Chromium, skip_without_chromium

skip_without_chromium()
pytest.importorskip("starlette")

from anser.live.server import LiveServer  # noqa: E402

DOCUMENT = tomllib.loads(Path(shipped_files()["storm-sampling"]).read_text(encoding="utf-8"))
LIMIT_S = 120.0


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    server = LiveServer(DOCUMENT, tmp_path_factory.mktemp("folder"))
    try:
        with Chromium(tmp_path_factory.mktemp("browser")) as browser:
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


@pytest.mark.long
def test_the_keyboard_flies(page):
    answered(page)
    page.run("document.getElementById('fly').focus()")
    press(page, "Enter")
    wait_for(page, "live.flights.known.length === 1 && !live.flights.number")
    assert page.run("live.flights.rows.names.length") == len(DOCUMENT["aircraft"])
    assert page.run("live.flights.rows.end") == pytest.approx(DOCUMENT["timing"]["duration_s"], abs=2.0)
