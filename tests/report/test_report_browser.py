"""Report in a real browser: every part is drawn, moves, and agrees with the record."""

import time

import numpy as np
import pytest

from anser.report.style import COLORS, DARK_COLORS
from support.chromium import skip_without_chromium
from support.report_page import WINDOW, has_color, opened, picture_of

skip_without_chromium()

DARK_INK = "#e3e8ee"


def test_the_page_reads_the_recorded_values(browser, flight, path):
    opened(browser, path)
    dataset = flight[0]
    for name, k, time_s in (("course_deg", 1, 33.35), ("north_m", 2, 100.0), ("thrust_command_n", 0, 0.0)):
        read = browser.run(f"anser.runs[0].at('{name}', {k}, {time_s})")
        expected = float(dataset[name].isel(aircraft=k).sel(time=time_s, method="nearest"))
        # half the quantization step of a variable of this range
        assert read == pytest.approx(expected, abs=0.0051)
    # the plan and its errors end with the hold: a gap
    assert browser.run("Number.isNaN(anser.runs[0].at('position_error_m', 0, 120))") is True


def test_the_scene_shows_every_aircraft_and_moves_with_the_slider(browser, path):
    opened(browser, path)
    first_picture = picture_of(browser, ".scene")
    colors = browser.run("anser.runs[0].aircraft.map((one) => one.color)")
    assert all(has_color(first_picture, color) > 60 for color in colors)
    start_positions = browser.run("anser.scenes[0].flyers.map((f) => f.place.toArray()).flat()")
    browser.run("{ const s = document.getElementById('time'); s.value = '70'; s.dispatchEvent(new Event('input')); }")
    assert browser.run("anser.state.time") == 70.0
    end_positions = browser.run("anser.scenes[0].flyers.map((f) => f.place.toArray()).flat()")
    # 22 s and more at some 100 m/s: more than a kilometre each
    steps = np.subtract(end_positions, start_positions).reshape(3, 3)
    assert np.linalg.norm(steps, axis=1).min() > 1.0
    assert np.abs(picture_of(browser, ".scene") - first_picture).max(axis=-1).astype(bool).sum() > 200
    assert "70.0 of 130 s" in browser.run("document.getElementById('told').textContent")


def test_the_symbol_has_the_attitude(browser, flight, path):
    opened(browser, path)
    browser.run("anser.state.setTime(30)")
    browser.settle()
    then = flight[0].isel(aircraft=1).sel(time=30.0)
    axes = np.array(browser.run("Array.from(anser.scenes[0].flyers[1].symbol.matrix.elements)")).reshape(4, 4)[:3, :3]
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    yaw = np.radians(float(then["yaw_deg"]))
    # x east, y up, z south; made up without roll and pitch
    np.testing.assert_allclose(axes[0], [np.sin(yaw), 0.0, -np.cos(yaw)], atol=1e-4)
    np.testing.assert_allclose(axes[1], [0.0, 1.0, 0.0], atol=1e-4)
    np.testing.assert_allclose(axes[2], [np.cos(yaw), 0.0, np.sin(yaw)], atol=1e-4)


def test_the_camera_follows_the_aircraft(browser, path):
    opened(browser, path)
    browser.run("anser.state.setFocus('bert'); document.querySelector('[data-view=behind]').click()")
    for time_s in (20, 60):
        browser.run(f"anser.state.setTime({time_s})")
        target, position = browser.run(
            "[anser.scenes[0].controls.target.toArray(), anser.scenes[0].flyers[1].shownPlace.toArray()]"
        )
        np.testing.assert_allclose(target, position, atol=1e-6)
    # from behind it looks along the flight, over ground that goes on to the horizon
    eye, target, heading = browser.run(
        "(() => { const s = anser.scenes[0]; return [s.camera.position, s.controls.target, s.flyers[1].heading(60)].map("
        "(v) => v.toArray()); })()"
    )
    look = np.subtract(target, eye) / np.linalg.norm(np.subtract(target, eye))
    assert np.dot(look, heading) > 0.95
    assert browser.run("[anser.scenes[0].ground.wide.visible, anser.scenes[0].ground.plate.visible]") == [True, False]


def test_the_dark_scheme_applies_to_every_part(browser, path):
    opened(browser, path)
    light = browser.run("[getComputedStyle(document.body).backgroundColor, anser.runs[0].aircraft[0].color]")
    assert light == ["rgb(255, 255, 255)", COLORS[0].lower()]
    try:
        browser.scheme("dark")
        browser.settle()
        scene = picture_of(browser, ".scene")
        assert np.median(scene) < 0.2
        colors = browser.run("anser.runs[0].aircraft.map((one) => one.color)")
        assert colors == [color.lower() for color in DARK_COLORS[:3]]
        assert all(has_color(scene, color) > 60 for color in colors)
        plot = picture_of(browser, "#limits .plot")
        assert np.median(plot) < 0.2
        assert has_color(plot, colors[0]) > 100
        assert has_color(picture_of(browser, ".timeline"), DARK_INK) > 20  # the names
        assert browser.faults == []
    finally:
        browser.scheme("light")
    browser.settle()
    assert np.median(picture_of(browser, ".scene")) > 0.9


@pytest.mark.long
def test_printed_plots_and_scene_are_complete_and_light(browser, path):
    opened(browser, path)
    # what is on the canvases when the printing begins: the least lightness of a colour, and how many pixels are inked
    browser.run(
        "window.inked = (canvas, data) => { let n = 0, c = 0; for (let k = 0; k < data.length; k += 4) if (data[k + 3] > 40) {"
        " n += 1; if (Math.max(data[k], data[k + 1], data[k + 2]) - Math.min(data[k], data[k + 1], data[k + 2]) > 90) c += 1; }"
        " return [n, c]; }; addEventListener('beforeprint', () => { window.onPaper = { dark: getComputedStyle("
        "document.body).backgroundColor, plots: anser.plots.list.map((plot) => inked(plot.plot.ctx.canvas,"
        " plot.plot.ctx.getImageData(0, 0, plot.plot.ctx.canvas.width, plot.plot.ctx.canvas.height).data)),"
        " wide: anser.plots.list.map((plot) => plot.plot.ctx.canvas.width), scene: anser.scenes[0].root.clientWidth }; })"
    )
    try:
        browser.scheme("dark")
        browser.settle()
        paper = browser.pdf()
        printed = browser.run("window.onPaper")
    finally:
        browser.scheme("light")
    assert printed["dark"] == "rgb(255, 255, 255)"
    assert len(printed["plots"]) > 25
    assert min(inked for inked, _ in printed["plots"]) > 500
    assert min(colored for _, colored in printed["plots"]) > 100
    assert min(printed["wide"]) > 500  # twice what they are on paper
    assert 600 < printed["scene"] < 700
    assert 5 <= paper.count(b"/Type /Page\n") <= 12
    # afterwards the page is as it was
    browser.settle()
    assert browser.run("[Theme.printing, document.documentElement.className]") == [False, ""]
    assert browser.faults == []


def test_the_ground_track_from_above_lies_below_the_path(browser, path):
    opened(browser, path)
    browser.run("document.querySelector('[data-view=above]').click()")
    browser.settle()
    assert browser.run("anser.scenes[0].camera.isOrthographicCamera") is True
    offset = browser.run(
        "(() => { const { eye, frame } = anser.scenes[0]; return Math.max(...frame.points.filter((_, k) => k % 2 === 0).map("
        "([x, y, z]) => { const [a, b] = [y * eye.lift, 0].map((h) => eye.pixelsOf(new THREE.Vector3(x, h, z)));"
        " return Math.hypot(a.x - b.x, a.y - b.y); })); })()"
    )
    assert offset < 0.1
    # a kilometre to the east is as long as the bar says, and north is up
    bar_text, wide, perKm, north = browser.run(
        "(() => { const s = anser.scenes[0], at = (x) => s.eye.pixelsOf(new THREE.Vector3(x, 0, 0)).x;"
        " return [s.bar.textContent, s.bar.getBoundingClientRect().width, at(1) - at(0), s.eye.northward()]; })()"
    )
    number, unit = bar_text.split()
    assert wide == pytest.approx(float(number) * (perKm if unit == "km" else perKm / 1000.0), abs=0.6)
    assert north == pytest.approx(0.0, abs=1e-6)
    browser.run("document.querySelector('[data-view=overview]').click()")
    browser.settle()
    assert browser.run("[anser.scenes[0].camera.isPerspectiveCamera, anser.scenes[0].bar.hidden]") == [True, True]


def test_courses_are_unwrapped_and_labelled_as_on_a_compass(browser, path):
    opened(browser, path)
    browser.run("document.getElementById('responses').scrollIntoView()")
    browser.settle()
    plot = "anser.plots.list.find((one) => one.panel.response === 'course_deg')"
    steps = browser.run(
        f"Math.max(...{plot}.responses.flatMap((row) => Array.from(row.slice(1), (v, k) => Math.abs(v - row[k]))))"
    )
    assert steps < 10.0
    ticks = browser.run(f"{plot}.plot.axes[1]._values.map(Number)")
    assert ticks == [tick % 360.0 for tick in ticks]
    read = browser.run(f"{plot}.readout.textContent.split(' / ').map(Number)")
    assert all(0.0 <= value < 360.0 for value in read)


def test_a_limited_command_is_named(browser, path):
    opened(browser, path)
    browser.run("document.getElementById('events').scrollIntoView()")
    texts = browser.run(
        "(() => { const found = [], draw = CanvasRenderingContext2D.prototype.fillText; CanvasRenderingContext2D.prototype"
        ".fillText = function (text, ...at) { found.push(text); draw.call(this, text, ...at); };"
        " anser.state.setTime(22); CanvasRenderingContext2D.prototype.fillText = draw; return found; })()"
    )
    assert texts.count("thrust") == 3
    assert "time (s)" in texts


def test_a_narrow_window_has_a_low_bar_and_a_full_scene(browser, path):
    opened(browser, path)
    try:
        browser.resize(400, 800)
        browser.settle()
        bar, scene, wide = browser.run(
            "[document.querySelector('.transport').offsetHeight, document.querySelector('.scene').offsetHeight,"
            " document.documentElement.scrollWidth]"
        )
        assert bar < 0.08 * 800
        assert scene < 0.8 * 400
        assert wide <= 400
    finally:
        browser.resize(*WINDOW)
    browser.settle()


def test_playback_starts_and_pauses(browser, path):
    opened(browser, path)
    browser.run("anser.state.setTime(10); document.getElementById('play').click()")
    limit = time.monotonic() + 10.0
    while browser.run("anser.state.time") < 11.0 and time.monotonic() < limit:
        browser.settle()
    browser.run("document.getElementById('play').click()")
    stopped = browser.run("anser.state.time")
    browser.settle()
    assert 11.0 <= stopped < 130.0
    assert browser.run("anser.state.time") == stopped


def test_every_plot_is_drawn_with_a_common_time_cursor(browser, path):
    opened(browser, path)
    for key in ("plan", "limits", "responses", "attitude", "controls"):
        for end in ("start", "end"):
            browser.run(f"document.getElementById('{key}').scrollIntoView({{ block: '{end}' }})")
            browser.settle()
    assert browser.run("anser.plots.list.filter((plot) => !plot.plot).length") == 0
    assert browser.run("anser.plots.list.length") > 25
    picture = picture_of(browser, "#limits .plot")
    assert has_color(picture, "#b3261e") > 100  # the limits
    assert has_color(picture, browser.run("anser.runs[0].aircraft[0].color")) > 100
    # the mouse in one plot sets the instant of all, and of the scene
    x, y, width = browser.run(
        "(() => { const b = document.querySelector('#limits .plot .u-over').getBoundingClientRect();"
        " return [b.left, b.top + b.height / 2, b.width]; })()"
    )
    browser.mouse("mouseMoved", x + 0.25 * width, y)
    browser.mouse("mouseMoved", x + 0.5 * width, y)
    browser.settle()
    assert browser.run("anser.state.time") == pytest.approx(65.0, abs=1.0)
    shown = browser.run(
        "[...anser.plots.visible].map((plot) => plot.plot.posToVal(plot.plot.cursor.left, 'x')).filter(Number.isFinite)"
    )
    assert len(shown) >= 6
    np.testing.assert_allclose(shown, browser.run("anser.state.time"), atol=0.5)
    expected = browser.run("printed(anser.runs[0].at('airspeed_m_s', 0, anser.state.time))")
    assert browser.run("document.querySelector('#limits .plot .readout').textContent") == expected


@pytest.mark.long
def test_zooming_in_time_fits_the_visible_values(browser, flight, path):
    opened(browser, path)
    browser.run("document.querySelector('[data-zoom=last]').click(); document.getElementById('plan').scrollIntoView()")
    browser.settle()
    low, high = browser.run("(() => { const s = anser.plots.list[0].plot.scales; return [s.x.min, s.x.max]; })()")
    assert (low, high) == pytest.approx((65.0, 85.0), abs=0.01)
    shown = flight[0]["range_to_rendezvous_m"].sel(time=slice(low, high))
    bottom, top = browser.run("(() => { const s = anser.plots.list[0].plot.scales; return [s.y.min, s.y.max]; })()")
    room = 0.05 * float(shown.max() - shown.min())
    # the last record after the window counts too: 0.025 s at 140 m/s
    assert (bottom, top) == pytest.approx((float(shown.min()) - room, float(shown.max()) + room), abs=4.0)
    browser.run("document.querySelector('[data-zoom=all]').click()")


def test_the_focus_applies_to_every_part(browser, path):
    opened(browser, path)
    browser.run("document.getElementById('controls').scrollIntoView()")
    browser.run(
        "{ const s = document.getElementById('focus'); s.value = 'bert'; s.dispatchEvent(new Event('change')); }"
    )
    browser.settle()
    assert browser.run("document.querySelector('.list-place .chosen button').textContent") == "bert"
    assert browser.run(
        "[...new Set([...document.querySelectorAll('.who')].map((w) => w.querySelector('.chosen').textContent))]"
    ) == ["bert"]
    browser.run("anser.state.toggle('anna', false)")
    assert browser.run("anser.scenes[0].flyers.map((f) => f.symbol.visible)") == [False, True, True]
    assert browser.faults == []


@pytest.mark.long
def test_the_page_is_no_wider_than_the_window(browser, path):
    opened(browser, path)
    try:
        for width in (420, 1280, 1920):
            browser.resize(width, 500)
            browser.settle()
            assert browser.run("document.documentElement.scrollWidth") <= width
            # the bar at the bottom hides none of its parts
            assert browser.run(
                "[...document.querySelectorAll('.transport > *')].every((one) => one.getBoundingClientRect().right <= innerWidth)"
            )
    finally:
        browser.resize(*WINDOW)
