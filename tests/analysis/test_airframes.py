"""Surveys of an airframe: refused ranges of the airspeed."""

import pytest

from anser.analysis.airframes import survey_airframe


@pytest.mark.parametrize("airspeeds_m_s", [(0.0, 100.0), (100.0, 50.0), (50.0, float("nan"))])
def test_airspeeds_that_are_not_positive_and_ascending_are_refused(airspeeds_m_s):
    with pytest.raises(ValueError, match=r"airspeeds_m_s: arrived \(.*; expected two positive numbers"):
        survey_airframe("aerosonde", airspeeds_m_s=airspeeds_m_s)
