"""The F-16 of TP-1538: trim compared with the textbook model, linear models, scenarios, deviations, missions."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

import anser
from anser.aircraft_files import load_airframe
from anser.config import ScenarioError
from anser.scenario import build_flight, load

SCENARIO = Path(__file__).parents[2] / "scenarios" / "three-aircraft.toml"
ONE = load(SCENARIO.with_name("single-aircraft.toml"))
ALL = [x for k in range(3) for x in (f"aircraft[{k}].variant", "tp1538")]


def values_by_name(trim):
    return {name: value for name, value, _ in trim.quantities}


@pytest.mark.parametrize("speed", [110.0, 150.0, 220.0])
def test_level_trim_differs_from_the_textbook_by_the_tunnel_asymmetry_only(speed):
    """The textbook model smoothed the tables: alpha agrees within 0.3 deg, elevator 0.6 deg, thrust 8 %.

    At 220 m/s the leading-edge flap is further up than the fixed flap of the textbook model.
    """
    whole, reduced = (values_by_name(anser.trim("f16", speed, 1000.0, variant=v)) for v in ("tp1538", "textbook"))
    assert whole["angle of attack"] == pytest.approx(reduced["angle of attack"], abs=0.3)
    assert whole["elevator"] == pytest.approx(reduced["elevator"], abs=0.6)
    assert whole["thrust"] == pytest.approx(reduced["thrust"], rel=0.08)
    assert abs(whole["sideslip"]) < 0.5
    assert 0.1 < abs(whole["rudder"]) < 2.0
    mach, alpha = whole["Mach number"], whole["angle of attack"]
    flap = np.clip(1.38 * alpha - 9.05 * 0.7 * mach**2 + 1.45, 0.0, 25.0)
    assert whole["leading edge flap"] == pytest.approx(flap, abs=1e-6)


def test_the_trimmed_flap_and_filter_are_at_rest():
    trim = anser.trim("f16", 150.0, 1000.0, variant="tp1538")
    state, actuators = trim.point.state, load_airframe("f16", "tp1538").actuators
    assert trim.diagnosis is None
    np.testing.assert_allclose(state.actuators.alpha_lag, trim.point.alpha, atol=1e-12)
    assert float(jnp.abs(state.surfaces[:3] - trim.point.controls.surfaces[:3]).max()) < 1e-12
    assert actuators.state_names[-1] == "alpha_lag"


@pytest.mark.long
def test_the_linear_model_includes_the_flap():
    linearization = anser.linearize("f16", "tp1538", speed_m_s=150.0, altitude_m=1000.0, actuators=True)
    assert linearization.condition["x_cg_over_c"] == 0.30
    names = list(linearization.model.states)
    assert names[-2:] == ["leading_edge_flap", "alpha_lag"]
    commands = np.asarray(linearization.model.B)
    assert not commands[:, list(linearization.model.inputs).index("leading_edge_flap_command")].any()
    # flap' = (1.38 (2 alpha - x) - flap) / 0.136, x' = 7.25 (alpha - x)
    A = np.asarray(linearization.model.A)
    flap, x, alpha = (names.index(n) for n in ("leading_edge_flap", "alpha_lag", "alpha"))
    np.testing.assert_allclose(A[flap, [alpha, x, flap]] * 0.136, [2.76, -1.38, -1.0], atol=1e-9)
    np.testing.assert_allclose(A[x, [alpha, x]], [7.25, -7.25], atol=1e-9)


def test_deviations_of_a_scenario_reach_the_airframe():
    path = "aircraft[0].deviation."
    deviations = (path + "mass", 1.1, path + "cg_shift", 0.02, path + "coefficients.Cmq", 0.5)
    nominal, deviating = (
        build_flight(ONE.replace("aircraft[0].variant", "tp1538", *changes)).aircraft(0)[0].airframe
        for changes in ((), deviations)
    )
    np.testing.assert_allclose(deviating.mass_properties.mass, 1.1 * nominal.mass_properties.mass, rtol=1e-14)
    np.testing.assert_allclose(deviating.x_cg, nominal.x_cg + 0.02, rtol=1e-14)
    np.testing.assert_allclose(deviating.tables.cells[0][..., 6], 0.5 * nominal.tables.cells[0][..., 6], rtol=1e-14)
    with pytest.raises(ScenarioError, match="tp1538"):
        load(SCENARIO).replace("aircraft[0].variant", "tp1539")


@pytest.mark.long
@pytest.mark.parametrize("planner", ["published", "certified"])
def test_three_aircraft_arrive_together(planner):
    summary = anser.run(load(SCENARIO).replace(*ALL, "fleet.planner", planner)).summary
    assert summary["fleet"]["arrival_spread_s"] < 0.05
    for aircraft in summary["aircraft"]:
        assert aircraft["status"] == "arrived"
        assert aircraft["miss_m"] < 3.0
