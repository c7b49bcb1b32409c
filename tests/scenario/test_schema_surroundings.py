"""Wind in a scenario file."""

import math

import pytest

from anser.scenario import loads
from support.two_aircraft import changed


def test_wind_blows_from_where_it_comes() -> None:
    text = changed(
        ("[wind]\nspeed_m_s = 0.0\nfrom_deg = 0.0", "[wind]\nspeed_m_s = 10.0\nfrom_deg = 240.0\nup_m_s = 1")
    )
    # from 240 deg means towards 60 deg; tolerance: rounding of sine and cosine
    expected = (10 * math.cos(math.radians(60)), 10 * math.sin(math.radians(60)), 1.0)
    assert loads(text).wind.velocity_m_s(0.0) == pytest.approx(expected, abs=1e-13)
