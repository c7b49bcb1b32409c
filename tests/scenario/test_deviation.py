"""Aircraft with deviations from the nominal airframe of autopilot and planner."""

from pathlib import Path

import jax
import numpy as np
import pytest

from anser.aircraft import AirData
from anser.aircraft.f16 import F16_COEFFICIENTS
from anser.aircraft_files.deviations import F16_FACTORS, Deviation
from anser.config import ScenarioError
from anser.scenario import build_flight, load, validate
from support.states import air_at

SCENARIOS = Path(__file__).parents[2] / "scenarios"


def vehicle_with(*changes):
    scenario = load(SCENARIOS / "three-aircraft.toml")
    return build_flight(scenario.replace(*changes) if changes else scenario).aircraft(0)[0]


def test_every_coefficient_of_the_build_up_has_a_factor():
    assert F16_FACTORS == F16_COEFFICIENTS


def test_a_deviation_changes_the_airframe_but_not_the_belief():
    nominal = vehicle_with()
    path = "aircraft[0].deviation."
    flown = vehicle_with(
        path + "mass", 1.1, path + "second_moment_x", 1.3, path + "cg_shift", 0.02, path + "thrust", 0.9
    )
    assert nominal.estimator.model is None
    properties, published = flown.airframe.mass_properties, nominal.airframe.mass_properties
    np.testing.assert_allclose(properties.mass, 1.1 * published.mass, rtol=1e-14)
    Jxx, Jyy, Jzz = np.diag(published.inertia_b)
    longer = 0.3 * 0.5 * (Jyy + Jzz - Jxx)
    np.testing.assert_allclose(np.diag(properties.inertia_b), [Jxx, Jyy + longer, Jzz + longer], rtol=1e-14)
    np.testing.assert_allclose(flown.airframe.x_cg, nominal.airframe.x_cg + 0.02, rtol=1e-14)
    thrust, full = (
        vehicle.airframe.engine.propulsion(90.0, air_at(1000.0, 0.5)).force_b[0] for vehicle in (flown, nominal)
    )
    np.testing.assert_allclose(thrust, 0.9 * full, rtol=1e-12)
    for believed, vehicle in zip(
        jax.tree.leaves(flown.estimator.model), jax.tree.leaves(nominal.airframe), strict=True
    ):
        np.testing.assert_array_equal(believed, vehicle)


@pytest.mark.parametrize("name", ["Cm0", "Cnp", "CYdr"])
def test_a_coefficient_is_multiplied(name):
    changed = vehicle_with(f"aircraft[0].deviation.coefficients.{name}", 1.5).airframe
    rates, surfaces = np.array([0.1, 0.05, -0.02]), np.array([0.05, -0.1, 0.2])

    def moments(airframe):
        data = AirData(*(np.asarray(value) for value in (150.0, 0.1, 0.05, 1.1, 12000.0, 0.45, 1000.0)))
        return np.asarray(airframe.aerodynamics(data, rates, surfaces).moment_b)

    differs = moments(changed) != moments(vehicle_with().airframe)
    np.testing.assert_array_equal(differs, {"Cm0": [0, 1, 0], "Cnp": [0, 0, 1], "CYdr": [0, 0, 1]}[name])


def test_factors_on_moments_of_inertia_of_earlier_versions():
    """Factors of 1, as in older records, are accepted; other factors are refused with the replacement keys."""
    path = "aircraft[0].deviation."
    values = load(SCENARIOS / "three-aircraft.toml").model_dump()
    values["aircraft"][0]["deviation"] |= {"roll_inertia": 1.0, "pitch_inertia": 1.0, "yaw_inertia": 1.0}
    assert validate(values, "older").aircraft[0].deviation == Deviation()
    remedy = "second_moment_x and second_moment_z, make Jyy"
    with pytest.raises(ScenarioError, match=rf"deviation.pitch_inertia .*: arrived 1.2; expected nothing: .*{remedy}"):
        vehicle_with(path + "pitch_inertia", 1.2)


def test_an_impossible_deviation_is_refused():
    with pytest.raises(
        ScenarioError, match=r"deviation.mass \(aircraft .aircraft-1.\): arrived 0.0; expected a number from 0.1"
    ):
        vehicle_with("aircraft[0].deviation.mass", 0.0)
