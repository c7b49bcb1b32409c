"""Evaluation in JAX: required variables only, jit, vmap, gradients, changed numbers without recompilation."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from files import ALL, FEATURES, NASA, formula_model, model
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from anser.dave_ml import read_dave_ml
from anser.units import DEG_RAD, FOOT_M

STATE = {"vt": 500.0, "alpha": 7.3, "beta": -3.2, "p": 0.4, "q": 0.1, "r": -0.2, "el": -4.0, "ail": 3.0, "rdr": 5.0}


def test_names_and_varids_mean_the_same():
    aero = model("F16_aero")
    by_name = {aero.definition.variables[key].name: value for key, value in STATE.items()}
    ours = aero.evaluate(STATE, ("cz", "aeroBodyForceCoefficient_Z"))
    theirs = aero.evaluate(by_name, ("cz",))
    assert float(ours["cz"]) == float(ours["aeroBodyForceCoefficient_Z"]) == float(theirs["cz"])
    assert set(aero.evaluate(STATE)) == set(aero.outputs)


def test_unrelated_inputs_and_variables_are_not_needed():
    aero = model("F16_aero")
    assert float(aero.evaluate({"alpha": 5.0}, ("cxq",))["cxq"]) == pytest.approx(1.34, rel=1e-15)
    assert float(aero.evaluate({"alpha": 5.0, "el": 0.0}, ("cxt",))["cxt"]) == pytest.approx(-0.004, rel=1e-12)
    traced = jax.make_jaxpr(lambda x: aero.evaluator.evaluate(x, ("cxt",)))({"alpha": 1.0, "el": 1.0})
    # of the groups of tables, that of two functions of elevator and angle of attack alone
    assert "f64[44,4,2]" in str(traced)
    assert "f64[11,2,10]" not in str(traced)
    assert float(aero.evaluate({}, ("sref",))["sref"]) == 300.0


@pytest.mark.parametrize(
    ("inputs", "outputs", "says"),
    [
        ({"alpha": 5.0}, ("cz",), r"missing: .*vt \(trueAirspeed, ft_s\)"),
        ({**STATE, "gamma": 1.0}, ("cz",), '"gamma" is varID or name of no variable'),
        ({**STATE, "cxt": 1.0}, ("cz",), '"cxt" is no input'),
        (STATE, ("lift",), '"lift" is varID or name of no variable'),
        ({**STATE, "alpha": jnp.ones(3)}, ("cz",), r"shape \(3,\).*vmap"),
    ],
)
def test_invalid_inputs_and_outputs_are_refused(inputs, outputs, says):
    with pytest.raises(ValueError, match=says):
        model("F16_aero").evaluate(inputs, outputs)


def test_limits_of_variables_hold_for_inputs_calculations_and_tables():
    aero, control, all_of_it = model("F16_aero"), model("F16_control"), model("features")
    assert float(aero.evaluate({"vt": 0.0}, ("vt",))["vt"]) == 0.1
    zeros = dict.fromkeys(control.inputs, 0.0)
    assert float(control.evaluate({**zeros, "altMsl": 1e4}, ("deltaThetaCmd",))["deltaThetaCmd"]) == -5.0
    assert float(all_of_it.evaluate({"x": 2.5, "y": 1.9}, ("x",))["x"]) == 2.5
    assert float(all_of_it.evaluate({"x": 9.0}, ("x",))["x"]) == 2.5


def test_defaults_of_inputs():
    engine, inertia = model("F16_prop"), model("F16_inertia")
    assert float(engine.evaluate({})["FEX"]) == 1060.0  # power 0, at sea level, at rest
    # X of the centre of mass ahead of the moment reference: (35 - 30) % of 11.32 ft
    assert float(inertia.evaluate({"CG_PCT_MAC": 30.0})["DXCG"]) == pytest.approx(0.566, rel=1e-14)
    assert float(inertia.evaluate({})["DXCG"]) == 0.0


def test_si_units():
    engine, aero = model("F16_prop"), model("F16_aero")
    raw = engine.evaluate({"PWR": 80.0, "ALT": 20000.0, "RMACH": 0.5})["FEX"]
    si = engine.evaluate_si({"PWR": 0.8, "ALT": 20000.0 * FOOT_M, "RMACH": 0.5})["FEX"]
    np.testing.assert_allclose(si, raw * 4.4482216152605, rtol=1e-14)
    angles = {"alpha", "beta", "el", "ail", "rdr"}
    converted = {k: v * (DEG_RAD if k in angles else FOOT_M if k == "vt" else 1.0) for k, v in STATE.items()}
    for key, value in aero.evaluate_si(converted, ("cx", "cz", "cn")).items():
        np.testing.assert_allclose(value, aero.evaluate(STATE, ("cx", "cz", "cn"))[key], rtol=1e-14)
    with pytest.raises(ValueError, match=r"variable T_IDLE \(idleThrust\): unit \"lb\""):
        engine.evaluate_si({}, ("T_IDLE",))


def test_states_and_derivatives_are_exposed():
    text = FEATURES.decode().replace(
        '<variableDef name="flap"', '<variableDef name="s" varID="s" units="nd" initialValue="1"><isState/></variableDef>'
        '<variableDef name="ds" varID="ds" units="_s"><calculation><math><apply><minus/><ci>s</ci></apply></math>'
        '</calculation><isStateDeriv/></variableDef><variableDef name="flap"', 1
    )  # fmt: skip
    m = read_dave_ml(text, "f")
    assert (m.variables_with_role("isState"), m.variables_with_role("isStateDeriv")) == (("s",), ("ds",))
    assert "s" in m.inputs
    assert float(m.evaluate({"s": 3.0}, ("ds",))["ds"]) == -3.0
    # NASA's two control laws have none: they are gains, limits and switches
    for name in ("F16_control", "F16_gnc"):
        assert model(name).variables_with_role("isState") == model(name).variables_with_role("isStateDeriv") == ()


@pytest.mark.long
@pytest.mark.parametrize("name", [name for name in ALL if model(name).inputs])
def test_vmap_agrees_with_single_evaluations(name):
    m = model(name)
    draw = np.random.default_rng(3)
    columns = {key: draw.uniform(-2.0, 30.0, 7) for key in m.inputs}
    batched = jax.jit(jax.vmap(m.evaluate))(columns)
    evaluate = jax.jit(m.evaluate)
    for k in range(7):
        single = evaluate({key: column[k] for key, column in columns.items()})
        for key, value in single.items():
            together = batched[key] if np.ndim(batched[key]) == 0 else batched[key][k]
            np.testing.assert_allclose(together, value, rtol=1e-12, atol=1e-13)


def test_changed_numbers_do_not_recompile():
    @eqx.filter_jit
    @eqx.debug.assert_max_traces(max_traces=1)
    def force(evaluator, state):
        return evaluator.evaluate(state, ("cz",))["cz"]

    original = model("F16_aero")
    modified = read_dave_ml(NASA["F16_aero"].replace(b"-.416,-.731", b"-.516,-.731", 1), "other")
    state = {key: jnp.asarray(value) for key, value in STATE.items()}
    # what the new number adds at 7.3 deg, between 5 and 10
    change = -0.1 * (10.0 - 7.3) / 5.0 * (1.0 - np.radians(3.2) ** 2)
    np.testing.assert_allclose(force(modified.evaluator, state) - force(original.evaluator, state), change, rtol=1e-6)
    force(original.evaluator.with_constants({"cbar": 12.0}), state)


def test_values_calculated_from_changed_constants_are_updated():
    evaluator = model("features").evaluator
    assert float(evaluator.constants["k_squared"]) == 2.25
    changed = evaluator.with_constants({"factor": 3.0})
    assert float(changed.constants["k_squared"]) == 9.0
    product = {
        name: float(e.evaluate({"x": 0.5, "y": 0.5}, ("product",))["product"])
        for name, e in (("a", evaluator), ("b", changed))
    }
    assert product == {"a": 0.375, "b": 0.75}
    with pytest.raises(ValueError, match="no constant"):
        evaluator.with_constants({"two_axes": 1.0})
    # traced, too
    slope = jax.jit(jax.grad(lambda k: evaluator.with_constants({"k": k}).evaluate({}, ("k_squared",))["k_squared"]))
    assert float(slope(3.0)) == 6.0


def test_a_replaced_value_stays_until_one_of_its_sources_changes():
    replaced = model("features").evaluator.with_constants({"k_squared": 7.0})
    others = {name for name in replaced.constants if name not in ("k", "factor", "k_squared")}
    again = replaced.with_constants({name: float(replaced.constants[name]) for name in others})
    assert float(again.constants["k_squared"]) == 7.0
    assert float(again.with_constants({"factor": 3.0}).constants["k_squared"]) == 9.0


def test_a_constant_calculated_from_literals_can_be_replaced():
    # NASA's file has pi to nine digits
    aero = model("F16_aero").evaluator
    assert float(aero.constants["rtd"]) != 180.0 / np.pi
    exact = aero.with_constants({"rtd": 180.0 / np.pi})
    assert float(exact.constants["rtd"]) == 180.0 / np.pi


SMOOTH = sorted(
    set(model("features").outputs)
    - {"below", "above", "switch", "line_discrete", "line_floor", "line_ceiling", "mixed"}
)


@jax.jit
def _values(x, y):
    return model("features").evaluate({"x": x, "y": y, "flap": 7.0}, SMOOTH)


@jax.jit
def _slopes(x, y):
    def values_at(x):
        return _values(x, y)

    return jax.jvp(values_at, (x,), (jnp.ones_like(x),))[1], jax.jacrev(values_at)(x)


@pytest.mark.long
@settings(deadline=None, max_examples=30)
@given(x=st.floats(-1.93, 1.93), y=st.floats(-1.85, 1.85))
def test_gradients_against_differences(x, y):
    # not where functions have no slope, or one that changes within the step
    assume(min(abs(x), abs(y), abs(abs(x) - np.pi / 2), abs(x - y)) > 1e-2)
    # At x = -0.25, y = 0.2 both arguments of a table of tables reach breakpoints: the slope is that of a cell beside the path.
    assume(abs(4.0 * x - round(4.0 * x)) > 1e-4)
    h = 1e-6
    up, middle_values, down = (jax.device_get(_values(x + shift, y)) for shift in (h, 0.0, -h))
    forward, backward = jax.device_get(_slopes(x, y))
    for key in SMOOTH:
        np.testing.assert_allclose(forward[key], backward[key], rtol=1e-9, atol=1e-11)
        middle = middle_values[key]
        left_slope, right_slope = (middle - down[key]) / h, (up[key] - middle) / h
        # One of the one-sided differences where the slope jumps at a breakpoint nearby.
        scale = 1.0 + abs(float(left_slope)) + abs(float(right_slope)) + float(abs(middle))
        assert (
            min(left_slope, right_slope) - 1e-3 * scale
            <= float(forward[key])
            <= max(left_slope, right_slope) + 1e-3 * scale
        ), key


CORNERS = {
    "square root of 0": "<apply><root/><ci>x</ci></apply>",
    "power 1/2 of 0": "<apply><power/><ci>x</ci><cn>0.5</cn></apply>",
    "power of 0": "<apply><power/><ci>x</ci><ci>y</ci></apply>",
    "direction of nothing": '<apply><csymbol definitionURL="" encoding="text">atan2</csymbol><ci>x</ci><ci>x</ci></apply>',
    "branch not taken": "<piecewise><piece><apply><divide/><cn>1</cn><ci>x</ci></apply><apply><gt/><ci>x</ci><cn>0</cn></apply>"
    "</piece><otherwise><ci>x</ci></otherwise></piecewise>",
    "logarithm not taken": "<piecewise><piece><apply><ln/><ci>x</ci></apply><apply><gt/><ci>x</ci><cn>0</cn></apply></piece>"
    "<otherwise><ci>y</ci></otherwise></piecewise>",
    **{
        f"end of {name}": f"<apply><{name}/><apply><plus/><ci>x</ci><cn>1</cn></apply></apply>"
        for name in ("arcsin", "arcsec", "arccsc", "arcsech")
    },
    "arccot of 0": "<apply><arccot/><ci>x</ci></apply>",
    "arccsch not taken": "<piecewise><piece><apply><arccsch/><ci>x</ci></apply><apply><gt/><ci>x</ci><cn>0</cn></apply>"
    "</piece><otherwise><ci>x</ci></otherwise></piecewise>",
}


@pytest.mark.parametrize("corner", CORNERS)
def test_gradients_are_finite_where_a_slope_is_not(corner):
    m = formula_model(CORNERS[corner])
    value_and_slopes = jax.jit(jax.value_and_grad(lambda s: m.evaluate(s)["z"]))
    value, slopes = value_and_slopes({"x": jnp.array(0.0), "y": jnp.array(1.5)})
    assert np.isfinite(value)
    assert all(np.isfinite(slope) for slope in slopes.values())


INVERSES = {
    "arcsec": (-1.4, lambda a: 1.0 / (abs(a) * np.sqrt(a * a - 1.0))),
    "arccsc": (-1.4, lambda a: -1.0 / (abs(a) * np.sqrt(a * a - 1.0))),
    "arccot": (0.0, lambda a: -1.0 / (1.0 + a * a)),
    "arcsech": (0.4, lambda a: -1.0 / (a * np.sqrt(1.0 - a * a))),
    "arccsch": (-0.4, lambda a: -1.0 / (abs(a) * np.sqrt(1.0 + a * a))),
    "arccoth": (1.4, lambda a: 1.0 / (1.0 - a * a)),
}
"""Argument and derivative of each function: Abramowitz and Stegun, eqs. 4.4.52 to 4.4.57 and 4.6.37 to 4.6.42."""


@pytest.mark.parametrize("name", INVERSES)
def test_slopes_of_inverse_functions(name):
    value, slope = INVERSES[name]
    m = formula_model(f"<apply><{name}/><ci>x</ci></apply>")
    gradient = jax.jit(jax.grad(lambda x: m.evaluate({"x": x})["z"]))(jnp.array(value))
    assert float(gradient) == pytest.approx(slope(value), rel=1e-14)
    assert m.evaluate({"x": jnp.float32(value)})["z"].dtype == jnp.float32


def test_gradient_with_respect_to_a_table():
    aero = model("F16_aero").evaluator
    slope = eqx.filter_jit(eqx.filter_grad(lambda e: e.evaluate({"alpha": 7.5}, ("cxq",))["cxq"]))(aero)
    leaves = [leaf for lookup in slope.tables[0] for leaf in lookup.tables.cells if np.any(leaf)]
    assert len(leaves) == 1
    # The value is the coefficient of 1 plus half of that of the fraction.
    np.testing.assert_allclose(np.unique(leaves[0]), [0.0, 0.5, 1.0], atol=1e-12)


def test_single_precision_stays_single():
    def single(tree):
        return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float32), tree)

    evaluate = eqx.filter_jit(lambda evaluator, state: evaluator.evaluate(state, ("cz", "cn")))
    values = evaluate(single(model("F16_aero").evaluator), single(STATE))
    exact = model("F16_aero").evaluate(STATE, ("cz", "cn"))
    for key, value in values.items():
        assert value.dtype == jnp.float32
        np.testing.assert_allclose(value, exact[key], rtol=1e-4)
