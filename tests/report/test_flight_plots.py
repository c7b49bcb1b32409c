"""Figures of a flight from Python, by name, for notebooks and files."""

import numpy as np
import pytest

from anser.report import FlightPlots
from anser.report.flight_figures import FLIGHT_FIGURES

PNG = b"\x89PNG"


@pytest.fixture(scope="module")
def plots(flight):
    """The made-up flight at 2 Hz, for quick drawing."""
    return FlightPlots(flight[0].isel(time=slice(None, None, 20)))


@pytest.mark.parametrize("name", ["tracks", "profile", "separation"])
def test_notebooks_display_each_figure(plots, name):
    figure = getattr(plots, name)()
    assert figure._repr_png_().startswith(PNG)
    assert name in plots.names
    labels = {text.get_text() for text in figure.legends[0].get_texts()}
    assert labels == {"anna", "bert", "<b>cläre</b> & co"}


def test_the_separation_is_the_least_distance_to_another_aircraft(plots, flight):
    data = flight[0].isel(time=slice(None, None, 20))
    plotted = plots.separation().axes[0].lines[0].get_ydata()
    positions = np.stack([data[name].values for name in ("north_m", "east_m", "altitude_m")], axis=-1)
    distances = np.linalg.norm(positions[:, 1:] - positions[:, :1], axis=-1).min(axis=1)
    np.testing.assert_allclose(plotted, distances, rtol=1e-12)


def test_the_profile_contains_only_limits_near_the_data(flight):
    data = flight[0].isel(time=slice(None, None, 20))
    speed_min = float(data["airspeed_m_s"].min()) + 0.1
    tight = data.assign_attrs(scenario=f'{{"limits": {{"speed_min_m_s": {speed_min}, "speed_max_m_s": 1e4}}}}')
    lines = [line.get_ydata() for line in FlightPlots(tight).profile().axes[1].lines]
    assert [speed_min, speed_min] in [list(values) for values in lines]
    assert not any(np.any(np.asarray(values) == 1e4) for values in lines)


def test_a_single_aircraft_has_no_separation_and_unknown_names_are_refused(flight):
    alone = FlightPlots(flight[0].isel(aircraft=slice(0, 1), time=slice(None, None, 20)))
    assert "separation" not in alone.names
    with pytest.raises(ValueError, match="plot: arrived 'separation', which there is not of this flight: one aircraft"):
        alone.separation()
    with pytest.raises(
        ValueError, match="plot: arrived 'wheels'; expected one of tracks, profile, altitudes, airspeed"
    ):
        alone("wheels")
    assert repr(alone).startswith("figures of a flight: tracks")


def test_width_and_title_are_applied(plots):
    figure = plots.bank(width_mm=88, title=False)
    assert figure.get_figwidth() == pytest.approx(88 / 25.4)
    assert figure.get_suptitle() == ""
    assert plots("load_factor").get_suptitle().endswith(": load factors")
    with pytest.raises(ValueError, match="width_mm: arrived 5; expected 60 to 400 mm"):
        plots("bank", width_mm=5)
    with pytest.raises(ValueError, match="width_mm: arrived '88 mm'; expected a number of mm, such as 88"):
        plots.bank(width_mm="88 mm")


def test_every_figure_has_a_method():
    assert {name.replace("-", "_") for name in FLIGHT_FIGURES} <= set(dir(FlightPlots))
    assert FlightPlots.load_factor.__doc__.startswith("Normal load factor")
