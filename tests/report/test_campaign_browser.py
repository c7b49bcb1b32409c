"""Report of a campaign in a real browser: no errors, no requests outside the file, every plot drawn."""

import pytest

from anser.campaigns import campaign_report, flights
from anser.campaigns.campaign_report import write_campaign
from anser.campaigns.flights import create_store, fly_campaign
from campaigns.study_cases import THREE, WIND, made_up, study_of
from support.chromium import Chromium, skip_without_chromium

skip_without_chromium()

EVIL = "</script><script>window.harmed = true</script><img src=x onerror='window.harmed = true'>"
KEEP = {"series": ["position_error", "load_factor", "status"]}
BEND = {"path": "aircraft[0].bend", "distribution": "choice", "values": ["left", "right"]}


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaign")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(flights, "fly_many", made_up)
        patch.setattr(
            campaign_report,
            "fly_many",
            lambda cases, tell, batch, series, **_: made_up(cases, batch=batch, series=series),
        )
        study = study_of(sampling={"flights": 80}, vary=[WIND, BEND], description=EVIL, keep=KEEP)
        store = create_store(folder, study, THREE, {})
        fly_campaign(store)
        return write_campaign(store, worst=2, background=3)[0]


@pytest.fixture(scope="module")
def browser(page, tmp_path_factory):
    with Chromium(tmp_path_factory.mktemp("chromium"), 1280, 800, software=True) as opened:
        opened.open(page)
        opened.settle()
        yield opened


def test_every_plot_is_drawn_without_errors_or_requests(browser, page):
    for key in ("converging", "distributions", "series", "against"):
        for end in ("start", "end"):
            browser.run(f"document.getElementById('{key}').scrollIntoView({{ block: '{end}' }})")
            browser.settle()
    assert (
        browser.run("anser.charts.length") == 1 + 4 + 4 + 2 + 2
    )  # met, four quantities twice, two of three series, two inputs
    assert browser.run("anser.charts.filter((chart) => !chart.plot).length") == 0
    assert browser.run("document.querySelectorAll('.map .worst-track').length") == 2
    assert browser.run("typeof window.harmed") == "undefined"
    assert browser.run("document.querySelector('.lead').textContent") == EVIL
    assert browser.faults == []
    assert [url for url in browser.requests if not url.startswith(("data:", "blob:"))] == [page.as_uri()]


def test_bands_have_a_line_and_two_edges_for_each_aircraft(browser):
    browser.run("document.getElementById('series').scrollIntoView()")
    browser.settle()
    plot = "anser.charts.find((chart) => chart.title.textContent === 'Distance to the planned point (m)').plot"
    assert browser.run(f"[{plot}.series.length, {plot}.bands.length]") == [10, 3]
    low, high = browser.run(f"[{plot}.scales.y.min, {plot}.scales.y.max]")
    extremes = browser.run(f"[{plot}.data[1][0], {plot}.data[8][150]]")  # the least and the greatest of what is made up
    assert low < extremes[0] < extremes[1] < high
    browser.run(f"{plot}.setCursor({{ left: 100, top: 50 }})")
    readout = browser.run("document.querySelector('[data-plots=series] .readout').textContent")
    assert " s: aircraft-1 " in readout
    assert "aircraft-3 " in readout


def test_the_scatter_plots_follow_the_selected_quantity(browser):
    browser.run("document.getElementById('against').scrollIntoView()")
    browser.settle()
    scale = "(() => { const s = anser.charts.at(-1).plot.scales.y; return [s.min, s.max]; })()"
    previous_scale = browser.run(scale)
    browser.run(
        "{ const s = document.getElementById('quantity'); s.value = 'arrival_s'; s.dispatchEvent(new Event('change')); }"
    )
    browser.settle()
    low, high = browser.run(scale)
    assert previous_scale[1] < low  # misses of some metres, arrivals at some 60 s
    assert high > low
    assert browser.run("anser.charts.at(-1).plot.axes[0]._values") == ["left", "right"]


def test_a_row_of_the_worst_flights_highlights_its_tracks(browser):
    browser.run("document.querySelector('#worst tr[data-flight]').dispatchEvent(new Event('mouseenter'))")
    assert browser.run("document.querySelectorAll('.map.focused .worst-track.chosen').length") == 1
    browser.run("document.querySelector('#worst tr[data-flight]').dispatchEvent(new Event('mouseleave'))")
    assert browser.run("document.querySelectorAll('.map.focused').length") == 0


def test_the_page_is_no_wider_than_the_window(browser):
    for width in (420, 1280):
        browser.resize(width, 800)
        browser.settle()
        assert browser.run("document.documentElement.scrollWidth") <= width


def test_printed_tables_fit_their_box_and_ticks_do_not_overlap(browser):
    browser.resize(760, 1000)
    try:
        browser.run("Theme.print(true)")
        browser.settle()
        wide = "[...document.querySelectorAll('.scroll')].filter((one) => one.scrollWidth > one.clientWidth).length"
        assert browser.run(wide) == 0
        text = "document.querySelector('#worst td.command')"
        assert browser.run(f"{text}.scrollWidth <= {text}.clientWidth")
        ticks_and_width = (
            "anser.charts.filter((one) => one.plot).map(({ plot: { axes: [x], bbox } }) => [x._values, bbox.width])"
        )
        for ticks, width in browser.run(ticks_and_width):
            assert 6.6 * 2 * sum(map(len, ticks)) < width
    finally:
        browser.run("Theme.print(false)")
        browser.resize(1280, 800)


def test_equal_numbers_are_written_as_text_and_close_numbers_get_distinct_ticks(browser):
    assert browser.run("[alike([300, 300 + 1e-7, null]), alike([300.011, 300.012]), alike([1])]") == [
        True,
        False,
        False,
    ]
    assert browser.run("[300.0111, 300.0112].map((one) => ticked(one, 1e-4))") == ["300.0111", "300.0112"]
    quantity = "{ words: 'miss', unit: 'm', kept: [2.5, 2.5], part: [50, 100], upper: true, quantiles: [] }"
    text = browser.run(
        f"(() => {{ const one = new Distribution(document.createElement('div'), {quantity}); one.draw();"
        " Chart.all.pop(); return one.root.textContent; })()"
    )
    assert text == "miss (m)The same in all 2 flights that have it: 2.5 m"
