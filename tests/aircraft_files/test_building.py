"""Airframes built from aircraft files: coefficients, tables, actuators, engines, surfaces."""

import math

import jax.numpy as jnp
import numpy as np
import pytest

from anser.aircraft import AirData, ElectricPropeller, FirstOrderActuators, JetEngine, NoEngine, SecondOrderActuators
from anser.aircraft_files import load_airframe
from anser.airframe_data import derivative_index
from anser.config import ScenarioError
from support.aerosonde_file import AEROSONDE, TABLE, built

AIR = AirData(*(jnp.asarray(x) for x in (25.0, 0.1, 0.06, 1.1, 343.75, 0.07, 1000.0)))


def test_a_table_replaces_a_coefficient():
    airframe = built(("Cm0 = 0.0135\nCm_alpha = -2.74\n", ""), ("Cm = -0.99\n", ""), text=AEROSONDE + TABLE)
    for alpha, elevator, expected in ((0.0, 0.0, 0.0), (5.0, 0.0, -0.25), (10.0, 15.0, -0.75), (40.0, -40.0, -1.0)):
        air = AirData(*(getattr(AIR, name) for name in ("V",)), jnp.deg2rad(alpha), *(jnp.zeros(()),), AIR.density,
                      AIR.qbar, AIR.mach, AIR.altitude)  # fmt: skip
        surfaces = jnp.array([jnp.deg2rad(elevator), 0.0, 0.0])
        assert float(airframe.coefficients(air, jnp.zeros(3), surfaces)[4]) == pytest.approx(expected, abs=1e-12)


def test_derivatives_per_degree_are_converted():
    text = AEROSONDE
    for name, value in (
        ("CL_alpha", 5.61),
        ("Cm_alpha", -2.74),
        ("CY_beta", -0.98),
        ("Cl_beta", -0.13),
        ("Cn_beta", 0.073),
    ):
        text = text.replace(f"{name} = {value}\n", f"{name} = {math.radians(value)!r}\n")
    surfaces = {"CL = 0.13": 0.13, "CD = 0.0135": 0.0135, "Cm = -0.99": -0.99, "CY = 0.075": 0.075, "Cl = 0.17": 0.17,
                "Cn = -0.011": -0.011, "CY = 0.19": 0.19, "Cl = 0.0024": 0.0024, "Cn = -0.069": -0.069}  # fmt: skip
    for line, value in surfaces.items():
        text = text.replace(f"\n{line}\n", f"\n{line[:2]} = {math.radians(value)!r}\n")
    degrees = built(("[aerodynamics]\n", '[aerodynamics]\nper = "deg"\n'), text=text)
    np.testing.assert_allclose(degrees.derivatives, built().derivatives, rtol=1e-14)


def test_kinds_of_actuators_and_engines():
    assert isinstance(built().actuators, FirstOrderActuators)
    second_order = built(*[("lag_s = 0.05", "frequency_rad_s = 40.0\ndamping = 0.7")] * 3)
    assert isinstance(second_order.actuators, SecondOrderActuators)
    with pytest.raises(ScenarioError, match="all actuators are of one order"):
        built(("lag_s = 0.05", "frequency_rad_s = 40.0\ndamping = 0.7"))
    assert isinstance(built().engine, ElectricPropeller)
    head, _, tail = AEROSONDE.partition("[engine.electric_propeller]")
    tail = tail[tail.index("[validity]") : tail.index("[[check.forces]]")]
    assert isinstance(built(text=head + tail).engine, NoEngine)
    jet = "[engine.jet]\nidle_N = [[0, 0], [0, 0]]\nfull_N = [[90, 80], [70, 60]]\naltitude_m = [0, 1000]\nmach = [0, 0.2]\n"
    engine = built(text=head + jet + "lag_s = 1.0\n" + tail).engine
    assert isinstance(engine, JetEngine)
    assert float(engine.propulsion(100.0, AIR).force_b[0]) == pytest.approx(66.5)
    constant = built(text=head + "[engine.jet]\nfull_N = 50\nlag_s = 1\n" + tail).engine
    assert float(constant.propulsion(50.0, AIR).force_b[0]) == pytest.approx(25.0)


ELEVONS = """
[[surface]]
name = "SIDE_elevon"
lower_deg = -25.0
upper_deg = 20.0
rate_limit_deg_s = 200.0
lag_s = 0.05
CL = 0.07
Cm = -0.5
Cl = SIGN0.1
"""


def test_elevons_replace_elevator_and_aileron():
    head, tail = AEROSONDE.index("[[surface]]"), AEROSONDE.index("[engine.electric")
    pair = ELEVONS.replace("SIDE", "left").replace("SIGN", "") + ELEVONS.replace("SIDE", "right").replace("SIGN", "-")
    text = AEROSONDE[:head] + pair + AEROSONDE[tail:].partition("# The source's own checks")[0]
    airframe = built(text=text)
    assert airframe.actuators.names == ("left_elevon", "right_elevon")
    assert not airframe.actuators.controls_yaw
    assert float(airframe.derivatives[derivative_index("Cl_right_elevon", airframe.actuators.names)]) == -0.1
    np.testing.assert_allclose(airframe.actuators.lower, np.radians(-25.0))
    roll, _, _ = (
        airframe.aerodynamics(AIR, jnp.zeros(3), jnp.array([0.1, -0.1])).moment_b
        - airframe.aerodynamics(AIR, jnp.zeros(3), jnp.zeros(2)).moment_b
    )
    assert float(roll) > 0.0


def test_files_of_equal_content_share_an_airframe():
    """Aircraft with a shared file form one aircraft group, compiled once."""
    assert built() is load_airframe("aerosonde")


def test_a_side_force_at_rest_is_found():
    assert built().symmetric
    assert not built(("CY_beta", "CY0 = 0.001\nCY_beta")).symmetric
    assert not built(("CY_beta", "CY_alpha = 0.001\nCY_beta")).symmetric
    assert built(("CY_beta", "CY_p = 0.001\nCY_beta")).symmetric
    side = TABLE.replace('replaces = "Cm"', 'replaces = "{}"')
    assert not built(text=AEROSONDE + side.format("CY")).symmetric
    assert built(text=AEROSONDE + side.format("CY_r")).symmetric
