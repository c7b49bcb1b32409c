"""NASA's F-16 from its DAVE-ML files as an airframe: the built-in s119 variant, trimmed and under the autopilot."""

import dataclasses
import re
from importlib import resources

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.aircraft import DaveMlAircraft, dave_ml_airframe
from anser.aircraft.air_data import Wrench, air_data
from anser.aircraft.dave_ml_aircraft import DaveMlEngine
from anser.aircraft_files import load_f16
from anser.dave_ml import read_dave_ml
from anser.environment import StandardAtmosphere, standard_environment
from anser.units import DEG_RAD
from support.states import air_at
from support.trims import target_deg, trim

NASA = resources.files("anser.dave_ml").joinpath("nasa")
INPUTS = tuple(f"{surface}Deflection" for surface in ("elevator", "aileron", "rudder"))
S119 = load_f16("s119", x_cg_over_c=0.25)


def model(name):
    return read_dave_ml(NASA.joinpath(f"{name}.dml").read_bytes(), f"{name}.dml")


def built(**changes):
    parts = {
        "aerodynamics": model("F16_aero"),
        "inertia": model("F16_inertia"),
        "propulsion": model("F16_prop"),
        "actuators": S119.actuators,
        "inputs": INPUTS,
        "alpha_range": (-10 * DEG_RAD, 45 * DEG_RAD),
        "beta_range": (-30 * DEG_RAD, 30 * DEG_RAD),
        "inertia_inputs": {"vrsPositionOfCM": 25.0},
    }
    return dave_ml_airframe(**{**parts, **changes})


@pytest.fixture(scope="module")
def f16():
    return built()


@eqx.filter_jit
@eqx.filter_vmap(in_axes=(None, 0))
def wrench_of(airframe, x):
    flow = x[0] * jnp.stack([jnp.cos(x[1]) * jnp.cos(x[2]), jnp.sin(x[2]), jnp.sin(x[1]) * jnp.cos(x[2])])
    wrench = airframe.aerodynamics(air_data(flow, 0.0, StandardAtmosphere().at(0.0)), x[3:6], x[6:9])
    return jnp.concatenate([wrench.force_b, wrench.moment_b])


def test_the_aircraft_from_files_equals_the_built_in_variant(f16):
    """Forces and moments about the centre of gravity at 10,000 states; mass and inertia."""
    assert isinstance(f16, DaveMlAircraft)
    low = [60.0, -9 * DEG_RAD, -29 * DEG_RAD, -1.0, -1.0, -1.0, -24 * DEG_RAD, -21 * DEG_RAD, -30 * DEG_RAD]
    high = [300.0, 44 * DEG_RAD, 29 * DEG_RAD, 1.0, 1.0, 1.0, 24 * DEG_RAD, 21 * DEG_RAD, 30 * DEG_RAD]
    x = jnp.asarray(np.random.default_rng(1).uniform(low, high, size=(10_000, 9)))
    expected, computed = (np.asarray(wrench_of(airframe, x)) for airframe in (S119, f16))
    scale = np.max(np.abs(expected), axis=0)
    # the file writes pi with nine figures: 1e-9 of what depends on it
    np.testing.assert_allclose(computed / scale, expected / scale, atol=5e-9)
    for leaf, expected_leaf in zip(
        jax.tree.leaves(f16.mass_properties), jax.tree.leaves(S119.mass_properties), strict=True
    ):
        np.testing.assert_allclose(leaf, expected_leaf, rtol=1e-12, atol=1e-9)


def test_the_inverse_of_the_thrust_is_exact(f16):
    @jax.jit
    @jax.vmap
    def both(power):
        air = air_at(3000.0, 0.5)
        thrust = f16.engine.propulsion(power, air).force_b[0]
        return thrust, S119.engine.propulsion(power, air).force_b[0], f16.engine.power_for_thrust(thrust, air)

    powers = jnp.linspace(0.0, 100.0, 41)
    thrust, expected, back = both(powers)
    np.testing.assert_allclose(thrust, expected, rtol=1e-12)
    np.testing.assert_allclose(back, powers, atol=1e-9)


class CurvedEngine(DaveMlEngine):
    """An engine whose thrust grows with the square of the power."""

    def propulsion(self, power, air_data):
        return Wrench(jnp.zeros(3).at[0].set(8.0 * power**2), jnp.zeros(3))


def test_the_inverse_of_a_curved_thrust_is_close_and_saturates_at_the_ends_only(f16):
    fields = {field.name: getattr(f16.engine, field.name) for field in dataclasses.fields(f16.engine)}
    engine = CurvedEngine(**fields)
    powers = jnp.linspace(0.0, 100.0, 37)
    found = jax.jit(jax.vmap(lambda power: engine.power_for_thrust(8.0 * power**2, air_at(3000.0, 0.5))))(powers)
    # A straight line over ten percent errs by 2.5 percent of power near idle, and by 1 percent at 20.
    np.testing.assert_allclose(found, powers, atol=0.9)
    np.testing.assert_allclose(found[powers > 15.0], powers[powers > 15.0], atol=0.02)
    assert float(engine.power_for_thrust(-1.0, air_at(3000.0, 0.5))) == 0.0
    assert float(engine.power_for_thrust(1e6, air_at(3000.0, 0.5))) == 100.0


@pytest.mark.long
def test_the_trim_equals_that_of_the_built_in_variant(f16):
    environment, target = standard_environment(), target_deg(150.0, 1000.0)
    file_trim, built_in_trim = trim(f16, environment, target), trim(S119, environment, target)
    assert file_trim.converged
    # the engine's angular momentum is not in the files: a rad of sideslip less
    np.testing.assert_allclose(
        [file_trim.alpha, file_trim.power], [built_in_trim.alpha, built_in_trim.power], rtol=1e-6
    )


def test_slopes_are_finite_at_rest(f16):
    def total(x):
        wrench = f16.aerodynamics(air_data(x[:3], 0.0, StandardAtmosphere().at(0.0)), x[3:6], x[6:9])
        return jnp.sum(wrench.force_b) + jnp.sum(wrench.moment_b)

    assert np.all(np.isfinite(jax.jit(jax.grad(total))(jnp.zeros(9))))


@pytest.mark.parametrize(
    ("other", "words"),
    [
        (
            {"aerodynamics": model("F16_prop")},
            "aerodynamics: the file has no variable named aeroBodyForceCoefficient_X",
        ),
        ({"inertia": model("F16_prop")}, "inertia: the file has no variable named bodyMomentOfInertia_Roll"),
        ({"propulsion": model("F16_aero")}, "propulsion: the file has no variable named thrustBodyForce_X"),
        ({"inputs": ("elevatorDeflection",)}, "inputs of the surfaces: arrived elevatorDeflection; expected one of"),
        ({"inputs": (*INPUTS[:2], "el")}, "arrived el for rudder; expected an input of its own"),
        ({"inputs": (*INPUTS[:2], "angleOfAttack")}, "arrived angleOfAttack for rudder; expected an input of its own"),
    ],
)
def test_files_of_another_kind_are_refused_by_name(other, words):
    with pytest.raises(ValueError, match=words):
        built(**other)


def test_the_input_of_a_surface_may_be_a_var_id(f16):
    by_id = built(inputs=("el", "ail", "rdr"))
    x = jnp.asarray([[150.0, 0.1, 0.05, 0.1, -0.1, 0.2, 0.1, -0.2, 0.3]])
    np.testing.assert_array_equal(wrench_of(by_id, x), wrench_of(f16, x))


def test_body_rates_are_no_required_inputs(f16):
    """A file without the yaw rate: NASA's, with that variable a constant."""
    text = NASA.joinpath("F16_aero.dml").read_text(encoding="utf-8")
    (variable,) = re.findall(r"<variableDef[^>]*bodyAngularRate_Yaw.*?</variableDef>", text, re.DOTALL)
    constant = re.sub(
        r"<variableDef ", '<variableDef initialValue="0" ', re.sub(r"<isInput\s*/>|<isStdAIAA\s*/>", "", variable)
    )
    constant = constant.replace("bodyAngularRate_Yaw", "steadyRate_Yaw")
    text = re.sub(r"<checkData>.*</checkData>", "", text.replace(variable, constant), flags=re.DOTALL)
    without = built(aerodynamics=read_dave_ml(text.encode(), "aero.dml"))
    x = jnp.array([[150.0, 0.1, 0.05, 0.1, 0.2, yaw_rate, 0.05, 0.02, 0.0] for yaw_rate in (0.0, 0.5)])
    (steady, yawing), expected = np.asarray(wrench_of(without, x)), np.asarray(wrench_of(f16, x[:1]))[0]
    np.testing.assert_allclose(steady, expected, rtol=1e-12)
    np.testing.assert_array_equal(yawing, steady)
