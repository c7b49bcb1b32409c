"""Controller from a DAVE-ML file: NASA's F-16 control law against gains evaluated by hand, and refusals."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from anser.control import dave_ml_law
from anser.control.dave_ml_laws import named_signals
from anser.dave_ml import read_dave_ml
from anser.units import DEG_RAD, KNOT_M_S, RAD_DEG
from anser.verification.nesc_flight import published_model
from support.law_cases import FLAT, belief_of, lqr_by_hand

TRIM = {"trimmedPilotControl_throttle": 0.139, "trimmedPilotControl_long": 0.13}
HANDS_OFF = dict.fromkeys((f"pilotControl_{axis}" for axis in ("throttle", "long", "lat", "yaw")), 0.0)


@pytest.fixture(scope="module")
def law():
    return dave_ml_law(published_model("F16_control"))


def commands(**changes):
    switches = {"stabilityAugmentationOn_disc": 1.0, "autopilotOn_disc": 1.0}
    values = {**HANDS_OFF, **TRIM, **switches, "lateralDeviationError": 0.0, **changes}
    return {name: jnp.asarray(value) for name, value in values.items()}


def test_the_autopilot_equals_gains_by_hand(law):
    belief = belief_of()
    s = {name: float(value) for name, value in eqx.filter_jit(named_signals)(belief).items()}
    keas = s["equivalentAirspeed"] + 0.05 * KNOT_M_S
    command = commands(
        equivalentAirspeedCommand=keas,
        altitudeMslCommand=s["altitudeMsl"] + 0.2 * 0.3048,
        trueBaseCourseCommand=s["eulerAngle_Yaw"] + s["angleOfSideslip"] + 0.3 * DEG_RAD,
    )
    controls, signals, memory = eqx.filter_jit(law.control)(None, belief, command, 0.01)
    assert signals is None
    assert memory is None
    theta_wanted = 2.653813535191715 + 0.05 * 0.2
    surfaces, power = lqr_by_hand(
        -0.05,
        s["angleOfAttack"] * RAD_DEG,
        s["angleOfSideslip"] * RAD_DEG,
        s["eulerAngle_Roll"] * RAD_DEG - 3.0,  # ten times the course error
        s["eulerAngle_Pitch"] * RAD_DEG - theta_wanted,
        *(s[f"bodyAngularRate_{axis}"] for axis in ("Roll", "Pitch", "Yaw")),
        TRIM["trimmedPilotControl_long"],
        TRIM["trimmedPilotControl_throttle"],
    )
    np.testing.assert_allclose(controls.surfaces * RAD_DEG, surfaces, rtol=1e-9, atol=1e-9)
    assert float(belief.airframe.engine.gearing(controls.throttle)) == pytest.approx(power, rel=1e-9)


def test_a_law_switched_off_holds_the_trim(law):
    switches = {"stabilityAugmentationOn_disc": 0.0, "autopilotOn_disc": 0.0}
    command = commands(equivalentAirspeedCommand=150.0, altitudeMslCommand=3e3, trueBaseCourseCommand=0.1, **switches)
    memory = law.init(belief_of().state, jnp.zeros(3))
    controls, _, _ = eqx.filter_jit(law.control)(memory, belief_of(environment=FLAT), command, 0.01)
    np.testing.assert_allclose(controls.surfaces * RAD_DEG, [-25 * 0.13, 0.0, 0.0], atol=1e-12)


def test_an_unknown_command_is_refused(law):
    with pytest.raises(ValueError, match="bankCommand"):
        law.control(None, belief_of(), commands(bankCommand=0.1), 0.01)


def test_a_missing_command_is_named(law):
    with pytest.raises(ValueError, match="equivalentAirspeedCommand"):
        law.control(None, belief_of(), commands(), 0.01)


def test_surfaces_without_an_output_are_refused():
    with pytest.raises(ValueError, match="flapDeflection"):
        dave_ml_law(published_model("F16_control"), ("elevator", "flap"))


def test_a_law_with_states_is_refused():
    text = """<?xml version="1.0"?>
<DAVEfunc xmlns="http://daveml.org/2010/DAVEML">
  <fileHeader name="law"><author name="N" org="O"/><creationDate date="2026-11-25"/></fileHeader>
  <variableDef name="memory" varID="x" units="nd"><isState/></variableDef>
  <variableDef name="elevatorDeflection" varID="el" units="deg" initialValue="0"><isOutput/></variableDef>
  <variableDef name="powerLeverAngle" varID="pwr" units="pct" initialValue="0"><isOutput/></variableDef>
</DAVEfunc>"""
    with pytest.raises(ValueError, match=r"has states \(x\)"):
        dave_ml_law(read_dave_ml(text, "law.dml"), ("elevator",))
