"""Measured signals by standard names."""

import numpy as np
import pytest

from anser.control.dave_ml_laws import named_signals
from support.law_cases import FLAT, belief_of


def test_attitude_flow_and_speed_are_those_of_the_belief():
    belief = belief_of()
    signals = {name: float(value) for name, value in named_signals(belief).items()}
    names = ("Roll", "Pitch", "Yaw")
    np.testing.assert_allclose([signals[f"eulerAngle_{n}"] for n in names], [0.05, 0.06, 0.8], rtol=1e-12)
    assert signals["trueAirspeed"] == pytest.approx(np.linalg.norm([172.0, 1.0, 9.0]))
    assert signals["angleOfAttack"] == pytest.approx(np.arctan2(9.0, 172.0))
    # Equivalent airspeed: the same dynamic pressure at 1.225 kg/m^3, the standard's at sea level.
    assert 0.5 * 1.225 * signals["equivalentAirspeed"] ** 2 == pytest.approx(signals["dynamicPressure"], rel=1e-5)
    assert signals["altitudeMsl"] == pytest.approx(3060.0)


def test_body_rates_are_those_relative_to_the_rotating_earth():
    names = ("Roll", "Pitch", "Yaw")
    flat, still = named_signals(belief_of(environment=FLAT)), (0.02, -0.01, 0.03)
    np.testing.assert_allclose([flat[f"bodyAngularRate_{n}"] for n in names], still, rtol=1e-12)
    # heading North, level, at rest in the local axes: these turn with the Earth, and by V/R about -East on the way
    signals = named_signals(belief_of((0.0, 0.0, 0.0), (170.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    assert float(signals["bodyAngularRate_Roll"]) == 0.0
    assert float(signals["bodyAngularRate_Yaw"]) == 0.0
    assert float(signals["bodyAngularRate_Pitch"]) == pytest.approx(-170.0 / 6.36e6, rel=1e-2)
    # heading East the local axes turn about North, and about down by V tan(latitude)/R
    signals = named_signals(belief_of((0.0, 0.0, np.pi / 2), (170.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    assert float(signals["bodyAngularRate_Pitch"]) == pytest.approx(-170.0 / 6.39e6, rel=1e-2)
    assert float(signals["bodyAngularRate_Yaw"]) == pytest.approx(-170.0 * np.tan(0.60016) / 6.39e6, rel=1e-2)
