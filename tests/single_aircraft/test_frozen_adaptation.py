"""Margins of an autopilot whose estimates are frozen as they are at a time of a flight."""

import numpy as np
import pytest

import anser
from anser.analysis import margins_at
from anser.single_aircraft import frozen_adaptation
from anser.single_aircraft.frozen_adaptation import frozen_margins


@pytest.mark.long
def test_what_is_learnt_gives_back_the_margins_that_half_an_elevator_costs():
    f16 = anser.aircraft("f16")
    time_s = np.arange(0.0, 40.001, 0.01)
    pulse = 1.0 * ((time_s > 25.0) & (time_s < 28.0)) - 1.0 * ((time_s >= 28.0) & (time_s < 31.0))
    flight = anser.simulate(
        f16,
        f16.trim(speed_m_s=150.0, altitude_m=1000.0),
        controller="adaptive",
        command={"course_deg": 8.0 * pulse, "path_angle_deg": 2.0 * pulse},
        change={"time_s": 20.0, "surface_effectiveness": {"elevator": 0.5}},
        duration_s=40.0,
        record_period_s=0.1,
    )
    nominal = margins_at("f16", speed_m_s=150.0, altitude_m=1000.0, inversion="incremental")
    healthy, fault, learnt = (flight.margins(time_s) for time_s in (10.0, 24.0, None))
    assert learnt.attrs["time_s"] == 40.0

    def gain(margins):
        return float(margins["gain_up_db"].sel(breakpoint="Q"))

    np.testing.assert_allclose(healthy["gain_up_db"], nominal["gain_up_db"], rtol=1e-3)
    # the rate loop is half as fast: its command may rise by half as much
    assert gain(fault) == pytest.approx(gain(nominal) - 6.0, abs=1.0)
    assert gain(learnt) == pytest.approx(gain(nominal), abs=0.6)


def test_a_flight_without_estimates_and_a_time_beyond_it_are_refused():
    f16 = anser.aircraft("f16")
    flight = anser.simulate(f16, f16.trim(speed_m_s=150.0, altitude_m=1000.0), duration_s=1.0)
    with pytest.raises(ValueError, match="without estimates"):
        flight.margins()
    estimates = {"coefficient_increment": ("time", np.zeros(flight.dataset.sizes["time"]))}
    with pytest.raises(ValueError, match="expected 0 to 1"):
        frozen_margins(flight.dataset.assign(estimates), 1.5)
    for lag in ("actuator_lag", "engine_lag"):
        with pytest.raises(ValueError, match=f"{lag}=False; expected one of the aircraft with its lags"):
            frozen_margins(flight.dataset.assign(estimates).assign_attrs({lag: 0}), 0.5)


def test_the_margins_are_those_of_the_aircraft_with_its_centre_of_gravity(monkeypatch):
    f16 = anser.aircraft("f16", x_cg_over_c=0.38)
    flight = anser.simulate(f16, f16.trim(speed_m_s=150.0, altitude_m=1000.0), duration_s=1.0)
    resolved = []

    def resolve(*arguments):
        resolved.append(arguments)
        raise LookupError

    monkeypatch.setattr(frozen_adaptation, "resolve_airframe", resolve)
    estimates = {"coefficient_increment": ("time", np.zeros(flight.dataset.sizes["time"]))}
    with pytest.raises(LookupError):
        frozen_margins(flight.dataset.assign(estimates), 0.5)
    assert resolved == [("f16", "textbook", 0.38)]
