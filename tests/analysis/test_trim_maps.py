"""Grid, speed steps and limits of a survey follow from the aircraft."""

import dataclasses
from types import SimpleNamespace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from anser.aircraft_files import load_airframe
from anser.analysis.envelope import (
    ALTITUDES_M,
    COMMANDS,
    MACHS,
    TOLERANCE,
    accepted_errors,
    command_meanings,
    default_altitudes,
    default_machs,
    speed_scale,
    survey_limits,
    trim_map,
)
from anser.analysis.margins import survey_margins
from anser.analysis.surveys import Survey
from anser.environment import standard_environment

F16, AEROSONDE = load_airframe("f16"), load_airframe("aerosonde")


def test_the_f16_keeps_its_grid_steps_and_limits():
    np.testing.assert_array_equal(default_altitudes(F16, coarse=False), ALTITUDES_M)
    np.testing.assert_array_equal(default_machs(F16, standard_environment(), 250.0, coarse=False), MACHS)
    assert len(default_altitudes(F16, coarse=True)) == 3
    assert len(default_machs(F16, standard_environment(), 250.0, coarse=True)) == 5
    np.testing.assert_array_equal(speed_scale(F16, np.array([100.0, 200.0])), 1.0)
    assert command_meanings(F16) == [command.meaning for command in COMMANDS]
    assert float(survey_limits(F16, (100.0, 200.0)).speed_max) == float(survey_limits().speed_max) == 340.0
    assert float(survey_limits(F16).alpha_min) == float(survey_limits().alpha_min)
    smooth = load_airframe("f16", "global")
    assert float(survey_limits(smooth).alpha_min) == float(smooth.alpha_range[0])


def test_another_aircraft_has_a_grid_within_its_data():
    lowest = float(default_altitudes(AEROSONDE, coarse=False)[0])
    machs = default_machs(AEROSONDE, standard_environment(), lowest, coarse=False)
    speeds = machs * float(standard_environment().atmosphere.at(lowest).speed_of_sound)
    assert (speeds.min(), speeds.max()) == pytest.approx((13.0, 40.0))
    assert 13.0 < speeds.min() < speeds.max() < 40.0


def test_given_altitudes_need_no_default_altitude_within_the_data():
    data = dataclasses.replace(AEROSONDE.validity, altitude=(jnp.asarray(0.0), jnp.asarray(200.0)))
    low = eqx.tree_at(lambda airframe: airframe.validity, AEROSONDE, data)
    with pytest.raises(ValueError, match="altitudes_m: arrived None; expected altitudes within the data, 0 to 200 m"):
        default_altitudes(low, coarse=False)
    survey = Survey(low)
    survey.call = lambda *_: SimpleNamespace(trimmable=np.ones(1, dtype=bool))  # nothing is trimmed here
    grid = trim_map(survey, (100.0,), None, coarse=True)
    assert grid.altitudes.tolist() == [100.0]
    assert (grid.airspeeds.min(), grid.airspeeds.max()) == pytest.approx((13.0, 40.0))


def test_another_aircraft_has_speed_steps_and_limits_in_proportion():
    speeds = np.array([15.0, 30.0])
    scale = speed_scale(AEROSONDE, speeds)
    np.testing.assert_allclose(10.0 * scale, speeds / 15.0)
    assert command_meanings(AEROSONDE)[0] == "speed +1/15 of the airspeed"
    errors = accepted_errors(np.zeros((2, 3)), scale)
    np.testing.assert_allclose(errors[:, 0], TOLERANCE[0] * scale)
    np.testing.assert_allclose(errors[:, 1:], np.broadcast_to(TOLERANCE[1:], (2, 2)))
    limits = survey_limits(AEROSONDE, speeds)
    assert (float(limits.speed_min), float(limits.speed_max)) == (7.5, 60.0)
    assert (limits.alpha_min, limits.alpha_max) == AEROSONDE.alpha_range


@pytest.mark.long
def test_the_loops_of_another_aircraft_are_stable_with_derived_gains():
    survey = survey_margins("aerosonde", altitudes_m=(500.0, 3000.0), machs=(0.06, 0.09))
    assert survey.counts()["unstable"] == survey.counts()["held_back"] == 0
    assert survey.counts()["stable"] >= 8
