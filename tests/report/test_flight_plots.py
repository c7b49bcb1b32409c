"""Figures of a flight from Python: each by its name, for a notebook and for a file."""

import numpy as np
import pytest

from anser.report import FlightPlots
from anser.report.flight_figures import FLIGHT_FIGURES

PNG = b"\x89PNG"


@pytest.fixture(scope="module")
def plots(flight):
    """Of the flight of conftest at 2 Hz: enough to be drawn, and quickly."""
    return FlightPlots(flight[0].isel(time=slice(None, None, 20)))


@pytest.mark.parametrize("name", ["tracks", "profile", "separation"])
def test_each_is_a_figure_that_a_notebook_shows(plots, name):
    figure = getattr(plots, name)()
    assert figure._repr_png_().startswith(PNG)
    assert name in plots.names
    labels = {text.get_text() for text in figure.legends[0].get_texts()}
    assert labels == {"anna", "bert", "<b>cläre</b> & co"}


def test_a_separation_is_the_least_distance_to_any_other(plots, flight):
    data = flight[0].isel(time=slice(None, None, 20))
    drawn = plots.separation().axes[0].lines[0].get_ydata()
    places = np.stack([data[name].values for name in ("north_m", "east_m", "altitude_m")], axis=-1)
    away = np.linalg.norm(places[:, 1:] - places[:, :1], axis=-1).min(axis=1)
    np.testing.assert_allclose(drawn, away, rtol=1e-12)


def test_the_profile_shows_the_limits_that_are_near(flight):
    data = flight[0].isel(time=slice(None, None, 20))
    least = float(data["airspeed_m_s"].min()) + 0.1
    tight = data.assign_attrs(scenario=f'{{"limits": {{"speed_min_m_s": {least}, "speed_max_m_s": 1e4}}}}')
    lines = [line.get_ydata() for line in FlightPlots(tight).profile().axes[1].lines]
    assert [least, least] in [list(values) for values in lines]
    assert not any(np.any(np.asarray(values) == 1e4) for values in lines)


def test_one_aircraft_has_no_separation_and_a_name_must_be_known(flight):
    alone = FlightPlots(flight[0].isel(aircraft=slice(0, 1), time=slice(None, None, 20)))
    assert "separation" not in alone.names
    with pytest.raises(ValueError, match="plot: arrived 'separation', which there is not of this flight: one aircraft"):
        alone.separation()
    with pytest.raises(
        ValueError, match="plot: arrived 'wheels'; expected one of tracks, profile, altitudes, airspeed"
    ):
        alone("wheels")
    assert repr(alone).startswith("figures of a flight: tracks")


def test_width_and_title(plots):
    figure = plots.bank(width_mm=88, title=False)
    assert figure.get_figwidth() == pytest.approx(88 / 25.4)
    assert figure.get_suptitle() == ""
    assert plots("load_factor").get_suptitle().endswith(": load factors")
    with pytest.raises(ValueError, match="width_mm: arrived 5; expected 60 to 400 mm"):
        plots("bank", width_mm=5)
    with pytest.raises(ValueError, match="width_mm: arrived '88 mm'; expected a number of mm, such as 88"):
        plots.bank(width_mm="88 mm")


def test_each_name_has_a_method():
    assert {name.replace("-", "_") for name in FLIGHT_FIGURES} <= set(dir(FlightPlots))
    assert FlightPlots.load_factor.__doc__.startswith("Normal load factor")
