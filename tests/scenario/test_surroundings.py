"""The Earth and the wind of a scenario: both notations, refusals, and the environment built from them."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.config import ScenarioError
from anser.environment import FlatEarth, LayeredWind, RotatingEarth, SteadyWind
from anser.scenario import loads
from anser.scenario.build_environment import build_environment
from anser.units import DEG_RAD

TEXT = (Path(__file__).parents[2] / "scenarios" / "three-aircraft.toml").read_text()
LAYERS = "[wind]\nlayers = [{ altitude_m = 0, speed_m_s = 4, from_deg = 270 }, { altitude_m = 2000, speed_m_s = 12, from_deg = 180, up_m_s = 1 }]"


def _with(text):
    return TEXT.replace("[timing]", f"{text}\n\n[timing]", 1)


def test_the_earth_is_flat_by_default_and_round_by_word_or_table():
    assert isinstance(build_environment(loads(TEXT)).earth, FlatEarth)
    word = loads(_with('earth = "wgs84"'))
    table = loads(_with('[earth]\nmodel = "wgs84"'))
    assert word.hash == table.hash != loads(TEXT).hash
    earth = build_environment(loads(_with('[earth]\nmodel = "wgs84"\nlatitude_deg = 30\nlongitude_deg = -70'))).earth
    assert isinstance(earth, RotatingEarth)
    np.testing.assert_allclose([earth.latitude, earth.longitude], [30 * DEG_RAD, -70 * DEG_RAD], rtol=1e-15)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('earth = "mars"', 'earth: arrived "mars"; expected "flat" or "wgs84", or a table [earth]'),
        ("earth = 3", 'earth: arrived 3; expected a table [earth], or the word "flat" or "wgs84"'),
        ('[earth]\nmodel = "round"', 'earth.model: arrived "round"; expected "flat" or "wgs84"'),
        ('[earth]\nmodle = "wgs84"', 'perhaps "model"'),
        (f"{LAYERS}\nspeed_m_s = 3", "wind.speed_m_s: arrived 3 beside layers; expected one of the three: speed_m_s"),
        (
            LAYERS.replace("2000", "0"),
            "wind.layers[1].altitude_m: arrived 0; expected more than the layer before it, 0 m",
        ),
        (LAYERS.replace("= 12", "= 149.9").replace("up_m_s = 1", "up_m_s = 20"), "wind.layers: arrived 151.2"),
        ("[wind]\nlayers = []", "wind.layers: arrived a list of 0; expected a list of layers, at least one"),
        (LAYERS.replace("from_deg = 180", "from = 180"), 'perhaps "from_deg"'),
    ],
)
def test_a_refusal_names_the_expected_value(text, message):
    with pytest.raises(ScenarioError) as refused:
        loads(_with(text))
    assert message in str(refused.value)


@settings(deadline=None, max_examples=30)
@given(st.floats(-1000.0, 5000.0))
def test_the_wind_of_the_checks_equals_the_wind_of_the_flight(altitude):
    scenario = loads(_with(LAYERS))
    wind = build_environment(scenario).wind
    assert isinstance(wind, LayeredWind)
    flown = np.asarray(wind.at(jnp.array([0.0, 0.0, -altitude]), 0.0)) * [1, 1, -1]
    np.testing.assert_allclose(scenario.wind.velocity_m_s(altitude), flown, atol=1e-13)


def test_steady_wind_stays_one_vector():
    assert isinstance(build_environment(loads(TEXT)).wind, SteadyWind)
