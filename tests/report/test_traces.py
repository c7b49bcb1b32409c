"""Lines of a report: labels from attributes, thinned without losing peaks or gaps, no line across a wrapped angle."""

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.report.traces import Pen, axis_title, pens_of, spread_indices, thin_indices, time_trace, with_gaps


def variable(values, **attrs):
    labels = {"units": "degree", "long_name": "Course", "symbol": "χ_c"} | attrs
    return xr.DataArray(
        np.asarray(values, dtype=float)[:, None],
        coords={"time": np.arange(float(len(values)))},
        dims=("time", "aircraft"),
        attrs=labels,
    )


PEN = Pen(0, "a &amp; b", "aircraft-0", "#0072B2", 100)


@settings(deadline=None, max_examples=30)
@given(count=st.integers(1, 9000), limit=st.integers(4, 2000), seed=st.integers(0, 2**31))
def test_thinning_keeps_ends_and_peaks_within_the_limit(count, limit, seed):
    values = np.random.default_rng(seed).normal(size=count)
    kept = thin_indices(values, limit)
    assert kept.size <= limit
    assert (kept[0], kept[-1]) == (0, count - 1)
    assert np.all(np.diff(kept) > 0)
    assert values[kept].max() == values.max()
    assert values[kept].min() == values.min()


def test_thinning_keeps_a_peak_of_one_sample_and_a_gap():
    values = np.zeros(50_000)
    values[31_234] = 7.0
    values[10_000:20_000] = np.nan
    kept = thin_indices(values, 200)
    assert values[kept].tolist().count(7.0) == 1
    assert np.isnan(values[kept]).any()
    assert np.isfinite(values[kept]).any()


@settings(deadline=None, max_examples=30)
@given(count=st.integers(1, 9000), limit=st.integers(2, 2000))
def test_even_thinning_keeps_both_ends(count, limit):
    kept = spread_indices(count, limit)
    assert kept.size <= limit
    assert (kept[0], kept[-1]) == (0, count - 1)
    # Rounding down to samples moves each index by less than one.
    assert np.ptp(np.diff(kept)) <= 1 if kept.size > 1 else kept.size == 1


def test_a_gap_stands_where_an_angle_wraps():
    x, y = with_gaps(np.arange(4.0), np.array([170.0, 179.0, -179.0, -170.0]), 180.0)
    np.testing.assert_array_equal(y, [170.0, 179.0, np.nan, -179.0, -170.0])
    np.testing.assert_array_equal(x, [0.0, 1.0, 2.0, 2.0, 3.0])


def test_only_angles_get_gaps():
    wrapped = [170.0, -170.0, 10.0]
    assert np.isnan(time_trace(variable(wrapped), PEN).y).sum() == 1
    assert np.isnan(time_trace(variable(wrapped, units="m"), PEN).y).sum() == 0


@pytest.mark.parametrize(
    ("attrs", "title"),
    [
        ({}, "Course <i>χ</i><sub>c</sub> (°)"),
        ({"units": "m s-1", "long_name": "Speed", "symbol": "V"}, "Speed <i>V</i> (m/s)"),
        ({"units": "1", "long_name": "Throttle", "symbol": "δ_t"}, "Throttle <i>δ</i><sub>t</sub>"),
        ({"units": "Pa", "long_name": "p < q", "symbol": "p"}, "p &lt; q <i>p</i> (Pa)"),
    ],
)
def test_axis_title_comes_from_the_attributes(attrs, title):
    assert axis_title(variable([0.0], **attrs)) == title


def test_a_command_is_dashed_in_the_color_of_its_aircraft():
    response, command = time_trace(variable([0.0, 1.0]), PEN), time_trace(variable([0.0, 1.0]), PEN, dashed=True)
    assert response.line.color == command.line.color == PEN.color
    assert response.line.dash == "solid"
    assert command.line.dash != "solid"
    assert "Course" in response.hovertemplate
    assert response.legendgroup == PEN.group


def test_pens_escape_names_and_share_the_points():
    dataset = xr.Dataset(coords={"aircraft": ["a<b", *(f"n{i}" for i in range(99))]})
    pens = pens_of(dataset)
    assert pens[0].name == "a&lt;b"
    assert len({pen.group for pen in pens}) == 100
    assert pens[0].points == 400
    assert pens_of(dataset.isel(aircraft=slice(3)))[0].points == 2000
