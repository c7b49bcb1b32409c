"""Figure of a plan for small and large fleets; reproducible files."""

import re

import pytest
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg

from anser.report import draw_plan
from anser.report.plan_figures import _plan
from anser.report.style import PRINT_STYLE
from anser.results import plan_dataset
from support.plan_case import CELL, plan_case


def _draw(tmp_path, *case, **options):
    dataset = plan_dataset(*plan_case(*case, **options))
    written = draw_plan(dataset, tmp_path)
    assert sorted(path.name for path in written) == ["plan.png", "plan.svg"]
    assert (tmp_path / "plan.png").read_bytes().startswith(b"\x89PNG")
    return dataset, (tmp_path / "plan.svg").read_text()


def _texts(svg):
    return re.findall(r">([^<>]+)</text>", svg)


def test_names_stay_within_the_map():
    dataset = plan_dataset(*plan_case())
    with rc_context(PRINT_STYLE):
        figure = _plan(dataset)
        FigureCanvasAgg(figure).draw()
        map_axes = figure.axes[0]
        box = map_axes.get_window_extent()
        names = [text for text in map_axes.texts if text.get_text().split(",")[0] in dataset["aircraft"].values]
        extents = [(extent.x0, extent.x1) for extent in (text.get_window_extent() for text in names)]
    assert len(extents) == dataset.sizes["aircraft"]
    assert all(box.x0 <= start < stop <= box.x1 for start, stop in extents), (box, extents)


@pytest.mark.long
def test_the_plan_of_a_small_fleet_has_separation_and_a_moving_keep_out(tmp_path):
    dataset, svg = _draw(tmp_path, separation_m=(500.0, 150.0), keep_outs=(CELL,))
    texts = _texts(svg)
    for name in ("anna, 60.00 s", "bert, 60.00 s", "carl, 40.25 s", "buoy-1", "buoy-2", "cell", "0 to 3,000 m"):
        assert name in texts, name
    for limit in ("100", "90", "240", "45", "\u221245", "500"):
        assert limit in texts, limit
    assert "ceiling 15,240 m" in texts
    assert "closest: anna and bert at 59.8 s, 510 m in the plane, 50 m in altitude" in texts
    assert "150 m in altitude count as 500 m" in texts
    assert any("arrivals from 40.25 s to 60.00 s" in word for word in texts)

    second_folder = tmp_path / "again"
    second_folder.mkdir()
    draw_plan(dataset, second_folder)
    assert (second_folder / "plan.svg").read_text() == svg
    with pytest.raises(FileExistsError):
        draw_plan(dataset, tmp_path)


@pytest.mark.long
def test_a_large_fleet_has_short_labels(tmp_path):
    _, svg = _draw(tmp_path, [f"aircraft-{k:02d}" for k in range(1, 21)], (60.0,), distance_min_m=200.0)
    texts = _texts(svg)
    assert {f"{k:02d}" for k in range(1, 21)} <= set(texts)
    assert any('names without "aircraft-"' in word for word in texts)
    assert "closest: aircraft-01 and aircraft-02 at 59.8 s, 510 m in the plane, 50 m in altitude" in texts
    assert "200" in texts


def test_the_plan_of_a_single_aircraft_names_its_problem(tmp_path):
    problems = ('aircraft "anna": too slow', "more")
    _, svg = _draw(tmp_path, ("anna",), (20.0,), problems=problems)
    texts = _texts(svg)
    assert "a single aircraft" in texts
    assert 'not flyable: aircraft "anna": too slow (and 1 more)'.replace('"', "&quot;") in texts or any(
        "too slow (and 1 more)" in word for word in texts
    )
