"""What an aircraft measures, by standard names."""

import numpy as np
import pytest
from law_cases import FLAT, belief_of

from anser.control import named_signals


def test_attitude_flow_and_speed():
    belief = belief_of()
    signals = {name: float(value) for name, value in named_signals(belief).items()}
    names = ("Roll", "Pitch", "Yaw")
    np.testing.assert_allclose([signals[f"eulerAngle_{n}"] for n in names], [0.05, 0.06, 0.8], rtol=1e-12)
    assert signals["trueAirspeed"] == pytest.approx(np.linalg.norm([172.0, 1.0, 9.0]))
    assert signals["angleOfAttack"] == pytest.approx(np.arctan2(9.0, 172.0))
    # Equivalent airspeed: the same dynamic pressure at 1.225 kg/m^3, the standard's at sea level.
    assert 0.5 * 1.225 * signals["equivalentAirspeed"] ** 2 == pytest.approx(signals["dynamicPressure"], rel=1e-5)
    assert signals["altitudeMsl"] == pytest.approx(3060.0)


def test_body_rates_are_inertial():
    flat, still = named_signals(belief_of(environment=FLAT)), (0.02, -0.01, 0.03)
    np.testing.assert_allclose([flat[f"bodyAngularRate_{n}"] for n in ("Roll", "Pitch", "Yaw")], still, rtol=1e-12)
    belief = belief_of((0.0, 0.0, 0.0), (170.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    seen = named_signals(belief)
    # Heading North, level: the Earth's rotation 7.292e-5 rad/s at 0.6 rad latitude, and V/R about -East.
    assert float(seen["bodyAngularRate_Roll"]) == pytest.approx(7.292115e-5 * np.cos(0.60016), rel=1e-4)
    assert float(seen["bodyAngularRate_Yaw"]) == pytest.approx(-7.292115e-5 * np.sin(0.60016), rel=1e-4)
    assert float(seen["bodyAngularRate_Pitch"]) == pytest.approx(-170.0 / 6.36e6, rel=1e-2)
