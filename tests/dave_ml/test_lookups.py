"""Tables compared with SciPy: grids, steps, ends, scattered points."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from files import model
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import LinearNDInterpolator, RegularGridInterpolator, interp1d
from scipy.spatial import ConvexHull

from anser.dave_ml import DaveMlError, read_dave_ml

FILE = model("features").definition
TABLES = ("line_neither", "line_min", "line_max", "line_both", "line_limited", "line_discrete", "line_floor", "line_ceiling",
          "simple", "two_axes", "mixed", "three_axes", "transposed", "scattered_line", "scattered", "scattered_both", "deep")  # fmt: skip
X, Y = st.floats(-2.0, 2.5), st.floats(-1.9, 1.9)
U, E, F = (FILE.breakpoints[name].points for name in ("U", "E", "F"))
LINE, PLANE, SOLID = (FILE.gridded[name].values for name in ("LINE", "PLANE", "SOLID"))


@jax.jit
def looked_up(x, y, flap=0.0):
    return model("features").evaluate({"x": x, "y": y, "flap": flap}, TABLES)


@settings(deadline=None, max_examples=50)
@given(x=X)
def test_the_ends_of_a_line(x):
    values = looked_up(x, 0.0)
    line = interp1d(U, LINE, fill_value="extrapolate")
    expected = {
        "line_neither": np.clip(x, -1.5, 2.0),
        "line_min": min(x, 2.0),
        "line_max": max(x, -1.5),
        "line_both": x,
        "line_limited": np.clip(x, -0.7, 1.6),
    }
    for name, clipped in expected.items():
        np.testing.assert_allclose(values[name], line(clipped), rtol=1e-12, atol=1e-12, err_msg=name)


def test_steps():
    # DAVE-ML 2.0.2 reference, section 6.3: half-way points round up; a breakpoint's own value is its own in all three.
    middle = (U[1:] + U[:-1]) / 2
    for k, at in enumerate(middle):
        neighbourhood = {shift: looked_up(at + shift, 0.0) for shift in (-1e-9, 0.0, 1e-9)}
        assert [float(neighbourhood[s]["line_discrete"]) for s in neighbourhood] == [LINE[k], LINE[k + 1], LINE[k + 1]]
        assert all(float(neighbourhood[s]["line_floor"]) == LINE[k] for s in neighbourhood)
        assert all(float(neighbourhood[s]["line_ceiling"]) == LINE[k + 1] for s in neighbourhood)
    for k, at in enumerate(U):
        values = looked_up(at, 0.0)
        assert [float(values[f"line_{interpolation}"]) for interpolation in ("discrete", "floor", "ceiling")] == [
            LINE[k]
        ] * 3
    for at, value in ((-1.9, LINE[0]), (2.4, LINE[-1])):
        values = looked_up(at, 0.0)
        assert [float(values[f"line_{interpolation}"]) for interpolation in ("discrete", "floor", "ceiling")] == [
            value
        ] * 3


@settings(deadline=None, max_examples=50)
@given(x=X, y=Y, flap=st.floats(-30.0, 60.0))
def test_grids(x, y, flap):
    values = looked_up(x, y, flap)
    options = {"bounds_error": False, "fill_value": None}
    clipped = np.clip(y, -1.0, 1.0), np.clip(x, -1.5, 2.0)
    plane = RegularGridInterpolator((E, U), PLANE, **options)([clipped])[0]
    np.testing.assert_allclose(values["two_axes"], plane, rtol=1e-12, atol=1e-12)
    # the same table with its axes exchanged
    np.testing.assert_allclose(values["transposed"], plane, rtol=1e-12, atol=1e-12)
    nearest = U[np.argmin(abs(U - clipped[1]))]
    if np.sum(np.isclose(abs(U - clipped[1]), abs(nearest - clipped[1]))) == 1:
        mixed = RegularGridInterpolator((E, U), PLANE, **options)([(max(y, -1.0), nearest)])[0]
        np.testing.assert_allclose(values["mixed"], mixed, rtol=1e-12, atol=1e-12)
    # a third axis of one breakpoint, along which nothing changes
    solid = RegularGridInterpolator((E, F), SOLID[:, :, 0], **options)([(clipped[0], min(flap, 40.0))])[0]
    np.testing.assert_allclose(values["three_axes"], solid, rtol=1e-12, atol=1e-12)
    deep = RegularGridInterpolator((U, E), PLANE.T, **options)
    at = [(np.clip(float(values["two_axes"]), -1.5, 2.0), np.clip(float(values["line_both"]), -1.0, 1.0))]
    np.testing.assert_allclose(values["deep"], deep(at)[0], rtol=1e-12, atol=1e-12)


def test_functions_of_the_same_arguments_share_a_lookup():
    aerodynamics, propulsion = model("F16_aero").evaluator.tables[0][0], model("F16_prop").evaluator.tables[0][0]
    assert sorted(map(len, aerodynamics.results)) == [2, 2, 4, 10]
    assert sorted(aerodynamics.arguments) == ["absbeta", "alpha", "beta", "el"]
    assert aerodynamics.tables.axes.even
    assert [len(group) for group in propulsion.results] == [3]
    # one after the other where one is of the other
    assert [len(stage) for stage in model("features").evaluator.tables] == [5, 1]


def hull_projection(points, at):
    """Nearest point on the edges of a polygon."""
    hull = ConvexHull(points)
    nearest = None
    for a, b in points[hull.simplices]:
        t = np.clip(np.dot(at - a, b - a) / np.dot(b - a, b - a), 0.0, 1.0)
        foot = a + t * (b - a)
        if nearest is None or np.linalg.norm(at - foot) < np.linalg.norm(at - nearest):
            nearest = foot
    return nearest


@settings(deadline=None, max_examples=50)
@given(x=X, y=Y)
def test_scattered_points(x, y):
    inner, points = FILE.ungridded["INNER"], FILE.ungridded["POINTS"]
    values = looked_up(x, y)
    at = np.array([x, y])
    inside = LinearNDInterpolator(inner.points, inner.values)
    expected = inside(at)[0]
    if np.isnan(expected):
        # held: at the nearest place of the hull, a hair inside
        foot = hull_projection(inner.points, at)
        expected = inside(foot + 1e-9 * (inner.points.mean(axis=0) - foot))[0]
    np.testing.assert_allclose(values["scattered"], expected, atol=1e-7)
    around = LinearNDInterpolator(points.points, points.values)(at)[0]
    if not np.isnan(around):
        np.testing.assert_allclose(values["scattered_both"], around, rtol=1e-9, atol=1e-9)


@settings(deadline=None, max_examples=30)
@given(x=X)
def test_scattered_points_on_a_line(x):
    np.testing.assert_allclose(
        looked_up(x, 0.0)["scattered_line"], np.interp(x, [-1.0, 0.2, 1.0], [2.0, -3.0, 4.0]), atol=1e-12
    )


LINEAR = """<DAVEfunc><fileHeader/>{variables}<ungriddedTableDef utID="t">{points}</ungriddedTableDef>
<variableDef name="r" varID="r" units=""><isOutput/></variableDef><function name="f">{arguments}<dependentVarRef varID="r"/>
<functionDefn><ungriddedTableRef utID="t"/></functionDefn></function></DAVEfunc>"""


def scattered_model(points, values, extrapolation):
    names = [f"x{k}" for k in range(points.shape[1])]
    return read_dave_ml(
        LINEAR.format(
            variables="".join(f'<variableDef name="{n}" varID="{n}" units=""/>' for n in names),
            points="".join(f"<dataPoint>{' '.join(map(repr, map(float, (*p, v))))}</dataPoint>" for p, v in zip(points, values, strict=True)),
            arguments="".join(f'<independentVarRef varID="{n}" extrapolate="{extrapolation}"/>' for n in names),
        ),
        "scattered",
    )  # fmt: skip


@pytest.mark.parametrize("dimensions", [2, 3, 4, 5])
def test_scattered_points_reproduce_a_linear_function(dimensions):
    draw = np.random.default_rng(dimensions)
    points, slope = draw.normal(size=(40, dimensions)), draw.normal(size=dimensions)
    evaluator = scattered_model(points, points @ slope + 0.7, "both").evaluator
    ats = draw.normal(size=(50, dimensions)) * 1.5
    inputs = {f"x{k}": jnp.array(ats[:, k]) for k in range(dimensions)}
    found = jax.jit(jax.vmap(evaluator.evaluate))(inputs)["r"]
    np.testing.assert_allclose(found, ats @ slope + 0.7, atol=1e-9)
    slopes = jax.jit(jax.grad(lambda x: evaluator.evaluate(x)["r"]))
    gradient = slopes({key: values[0] for key, values in inputs.items()})
    np.testing.assert_allclose([gradient[f"x{k}"] for k in range(dimensions)], slope, atol=1e-9)


@pytest.mark.parametrize("dimensions", [2, 3])
def test_held_values_stay_within_those_of_the_table(dimensions):
    draw = np.random.default_rng(7)
    points, values = draw.normal(size=(30, dimensions)), draw.normal(size=30)
    evaluator = scattered_model(points, values, "neither").evaluator
    ats = draw.normal(size=(200, dimensions)) * 5
    found = jax.jit(jax.vmap(evaluator.evaluate))({f"x{k}": jnp.array(ats[:, k]) for k in range(dimensions)})["r"]
    assert np.all((found >= values.min() - 1e-12) & (found <= values.max() + 1e-12))


def test_points_in_more_dimensions_than_are_triangulated_are_refused():
    draw = np.random.default_rng(1)
    with pytest.raises(DaveMlError, match="20 scattered points of 6 coordinates"):
        scattered_model(draw.normal(size=(20, 6)), np.ones(20), "both")
