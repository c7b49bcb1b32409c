"""Packed linear tables against scipy."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from anser.numerics import make_axes, make_tables

# Unevenly spaced on purpose, one of them of two points only.
X, Y, PAIR = [-20.0, -10.0, -5.0, 0.0, 12.0, 45.0], [-30.0, -12.0, 0.5, 30.0], [0.0, 1.0]
RNG = np.random.default_rng(0)
LINES = RNG.normal(size=(3, len(X)))
SHEETS = [RNG.normal(size=(len(X), len(Y))) for _ in range(4)]
BLOCK = RNG.normal(size=(len(X), len(Y), len(PAIR)))
SOLID = make_tables(make_axes([X, Y, PAIR], clamp=False), [((0, 1, 2), [BLOCK])])
look_up = jax.jit(lambda table, *at: table(*at)[0])
look_up_all = jax.jit(lambda table, *at: table(*at))
slopes = jax.jit(jax.jacfwd(lambda table, *at: table(*at)[0], argnums=1))
slopes_y = jax.jit(jax.jacfwd(lambda table, *at: table(*at)[0], argnums=2))
reverse_slopes = jax.jit(jax.jacrev(lambda table, *at: table(*at)[0], argnums=1))


def curves(*, clamp):
    return make_tables(make_axes([X], clamp=clamp), [((0,), LINES.tolist())])


def surfaces(*, clamp_x=False, clamp_y=False):
    return make_tables(make_axes([X, Y], clamp=[clamp_x, clamp_y]), [((0, 1), SHEETS)])


def by_scipy(x, y):
    """Bilinear interpolation, extrapolating the boundary cells (scipy: fill_value=None)."""
    at = [[x, y]]
    return [
        RegularGridInterpolator((X, Y), sheet, method="linear", bounds_error=False, fill_value=None)(at)[0]
        for sheet in SHEETS
    ]


@pytest.mark.parametrize("clamp", [True, False])
def test_tables_are_exact_at_the_breakpoints(clamp):
    # Up to the rounding of value + 1 * (next - value).
    for i, x in enumerate(X):
        np.testing.assert_allclose(look_up(curves(clamp=clamp), x), LINES[:, i], rtol=1e-14, atol=1e-15)
        for j, y in enumerate(Y):
            expected = [sheet[i, j] for sheet in SHEETS]
            table = surfaces(clamp_x=clamp, clamp_y=clamp)
            np.testing.assert_allclose(look_up(table, x, y), expected, rtol=1e-14, atol=1e-14)


@settings(deadline=None, max_examples=60)
@given(x=st.floats(-60.0, 90.0))
def test_curves_agree_with_numpy(x):
    clamped = [np.interp(x, X, line) for line in LINES]
    # Rounding of a few operations on numbers of up to 1 (within) and up to 30 (beyond the ends).
    np.testing.assert_allclose(look_up(curves(clamp=True), x), clamped, atol=1e-14)
    cell = 0 if x < X[0] else len(X) - 2
    extrapolated = [
        line[cell] + (x - X[cell]) * (line[cell + 1] - line[cell]) / (X[cell + 1] - X[cell]) for line in LINES
    ]
    expected = clamped if X[0] <= x <= X[-1] else extrapolated
    np.testing.assert_allclose(look_up(curves(clamp=False), x), expected, atol=1e-13)


@settings(deadline=None, max_examples=60)
@given(x=st.floats(-60.0, 90.0), y=st.floats(-90.0, 90.0))
def test_surfaces_agree_with_scipy(x, y):
    # Values of up to 1e3 where both are extrapolated: relative to that.
    np.testing.assert_allclose(look_up(surfaces(), x, y), by_scipy(x, y), rtol=1e-12, atol=1e-12)
    held_x, held_y = np.clip(x, X[0], X[-1]), np.clip(y, Y[0], Y[-1])
    # Each axis goes its own way.
    mixed = surfaces(clamp_x=True), surfaces(clamp_y=True), surfaces(clamp_x=True, clamp_y=True)
    for table, at in zip(mixed, ((held_x, y), (x, held_y), (held_x, held_y)), strict=True):
        np.testing.assert_allclose(look_up(table, x, y), by_scipy(*at), rtol=1e-12, atol=1e-12)


@settings(deadline=None, max_examples=30)
@given(x=st.floats(-60.0, 90.0), y=st.floats(-90.0, 90.0), a=st.tuples(*[st.floats(-2.0, 2.0)] * 4))
def test_bilinear_functions_are_reproduced_exactly(x, y, a):
    values = a[0] + a[1] * np.array(X)[:, None] + a[2] * np.array(Y)[None, :] + a[3] * np.outer(X, Y)
    table = make_tables(make_axes([X, Y], clamp=False), [((0, 1), [values])])
    # Coefficients of up to 2 times x y of up to 8e3.
    np.testing.assert_allclose(look_up(table, x, y)[0], a[0] + a[1] * x + a[2] * y + a[3] * x * y, atol=1e-9)


def test_a_table_of_two_breakpoints_is_linear():
    line = make_tables(make_axes([PAIR], clamp=False), [((0,), [[3.0, 5.0]])])
    np.testing.assert_allclose([look_up(line, x)[0] for x in (-1.0, 0.25, 2.0)], [1.0, 3.5, 7.0], rtol=1e-15)
    plane = make_tables(make_axes([PAIR, X], clamp=True), [((0, 1), [SHEETS[0][:2, [0] * 6]])])
    np.testing.assert_allclose(look_up(plane, 0.0, 3.0)[0], SHEETS[0][0, 0], rtol=1e-15)


def test_arguments_outside_the_breakpoints_are_reported():
    axes = make_axes([X, PAIR], clamp=True)
    for x, is_outside in ((-20.1, True), (-20.0, False), (3.0, False), (45.0, False), (45.1, True)):
        assert axes.outside(jnp.array([x, 1.0])).tolist() == [is_outside, False]
        assert axes.outside(jnp.array([x, 1.1])).tolist() == [is_outside, True]


@settings(deadline=None, max_examples=30)
@given(
    cell=st.integers(0, len(X) - 2), row=st.integers(0, len(Y) - 2), u=st.floats(0.01, 0.99), v=st.floats(0.01, 0.99)
)
def test_the_gradient_is_the_slope_of_the_cell(cell, row, u, v):
    dx, dy = X[cell + 1] - X[cell], Y[row + 1] - Y[row]
    x, y = X[cell] + u * dx, Y[row] + v * dy
    expected = (LINES[:, cell + 1] - LINES[:, cell]) / dx
    np.testing.assert_allclose(slopes(curves(clamp=True), x), expected, rtol=1e-12)
    np.testing.assert_allclose(reverse_slopes(curves(clamp=True), x), expected, rtol=1e-12)
    for k, sheet in enumerate(SHEETS):
        low, high = sheet[cell : cell + 2, row], sheet[cell : cell + 2, row + 1]
        along_x = ((1.0 - v) * (low[1] - low[0]) + v * (high[1] - high[0])) / dx
        along_y = ((1.0 - u) * (high[0] - low[0]) + u * (high[1] - low[1])) / dy
        table = surfaces(clamp_x=True, clamp_y=True)
        np.testing.assert_allclose(slopes(table, x, y)[k], along_x, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(slopes_y(table, x, y)[k], along_y, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(reverse_slopes(table, x, y)[k], along_x, rtol=1e-10, atol=1e-12)


def test_the_gradient_beyond_the_ends_is_zero_or_extrapolated():
    # Held: none. Extrapolated: that of the end cell. At the breakpoints: finite.
    assert jnp.all(slopes(curves(clamp=True), 60.0) == 0.0)
    end_slope = (LINES[:, -1] - LINES[:, -2]) / (X[-1] - X[-2])
    np.testing.assert_allclose(slopes(curves(clamp=False), 60.0), end_slope, rtol=1e-12)
    for x in X:
        for clamp in (True, False):
            assert jnp.all(jnp.isfinite(slopes(curves(clamp=clamp), x)))
            assert jnp.all(jnp.isfinite(slopes_y(surfaces(clamp_x=clamp, clamp_y=clamp), x, Y[0])))


def test_the_gradient_with_respect_to_the_cells_has_the_interpolation_weights():
    # Tables may be dispersed: the value is linear in the cells, with the weights 1, u, v, u v.
    table = surfaces()
    u, v = 0.25, 0.75
    x, y = X[1] + u * (X[2] - X[1]), Y[2] + v * (Y[3] - Y[2])
    gradient_of = jax.jit(jax.grad(lambda cells: eqx.tree_at(lambda t: t.cells[0], table, cells)(x, y)[0][1]))
    gradient = np.asarray(gradient_of(table.cells[0]))
    cell = 1 * (len(Y) - 1) + 2
    np.testing.assert_allclose(gradient[cell, :, 1], [1.0, u, v, u * v], rtol=1e-12)
    assert np.sum(gradient != 0.0) == 4


def test_a_batch_equals_single_evaluations():
    xs, ys = jnp.linspace(-50.0, 80.0, 41), jnp.linspace(70.0, -60.0, 41)
    line, sheet = curves(clamp=True), surfaces(clamp_x=True)
    batch = jax.jit(jax.vmap(sheet))(xs, ys)[0]
    assert batch.shape == (41, 4)
    np.testing.assert_allclose(batch, [look_up(sheet, x, y) for x, y in zip(xs, ys, strict=True)], atol=1e-13)
    np.testing.assert_allclose(jax.jit(jax.vmap(line))(xs)[0], [look_up(line, x) for x in xs], atol=1e-14)


def test_new_table_values_do_not_recompile():
    traces = []

    @jax.jit
    def value(table, x, y):
        traces.append(1)
        return table(x, y)

    for clamp in (True, False):
        value(surfaces(clamp_x=clamp), 3.0, 4.0)
    assert len(traces) == 1


@pytest.mark.parametrize("points", [[1.0], [], [0.0, 1.0, 1.0], [0.0, 2.0, 1.0], [0.0, float("nan")]])
def test_invalid_axes_are_refused(points):
    with pytest.raises(ValueError, match="two or more, strictly increasing"):
        make_axes([X, points], clamp=True)


def test_invalid_shapes_are_refused():
    axes = make_axes([X, Y], clamp=True)
    with pytest.raises(ValueError, match=r"\(5,\) on axes of \(6,\)"):
        make_tables(axes, [((0,), [[0.0] * 5])])
    with pytest.raises(ValueError, match=r"\(4, 6\) on axes of \(6, 4\)"):
        make_tables(axes, [((0, 1), [SHEETS[0].T])])


def test_groups_on_axes_of_several_lengths_equal_separate_tables():
    axes = make_axes([X, Y, PAIR], clamp=[True, False, True])
    columns = RNG.normal(size=(2, len(X), len(PAIR)))
    table = make_tables(axes, [((0,), LINES), ((0, 1), SHEETS), ((0, 2), columns)])
    plane = make_tables(make_axes([X, PAIR], clamp=True), [((0, 1), columns)])
    for x, y, z in ((-31.0, 2.0, 0.3), (3.0, -70.0, 1.7), (45.0, 30.0, 1.0)):
        line, sheet, column = look_up_all(table, x, y, z)
        np.testing.assert_allclose(line, look_up(curves(clamp=True), x), rtol=1e-14)
        np.testing.assert_allclose(sheet, look_up(surfaces(clamp_x=True), x, y), rtol=1e-14)
        np.testing.assert_allclose(column, look_up(plane, x, z), rtol=1e-14)


@settings(deadline=None, max_examples=30)
@given(x=st.floats(-30.0, 60.0), y=st.floats(-40.0, 40.0), z=st.floats(-1.0, 2.0))
def test_tables_with_three_axes_agree_with_scipy(x, y, z):
    at = [[x, y, z]]
    expected = RegularGridInterpolator((X, Y, PAIR), BLOCK, bounds_error=False, fill_value=None)(at)[0]
    np.testing.assert_allclose(look_up(SOLID, x, y, z)[0], expected, rtol=1e-12, atol=1e-12)


EVEN_X, EVEN_Y = np.linspace(-0.3, 0.9, 7), 1000.0 * np.arange(4) * 0.3048
EVEN = RNG.normal(size=(7, 4))
EVEN_TABLES = {
    clamp: make_tables(make_axes([EVEN_X, EVEN_Y], clamp=clamp), [((0, 1), [EVEN])]) for clamp in (False, True)
}


@pytest.mark.parametrize("clamp", [False, True])
@settings(deadline=None)
@given(x=st.floats(-2.0, 2.0), y=st.floats(-2000.0, 3000.0))
def test_tables_on_evenly_spaced_axes_agree_with_scipy(clamp, x, y):
    arguments = (np.clip(x, EVEN_X[0], EVEN_X[-1]), np.clip(y, EVEN_Y[0], EVEN_Y[-1])) if clamp else (x, y)
    expected = RegularGridInterpolator((EVEN_X, EVEN_Y), EVEN, bounds_error=False, fill_value=None)([arguments])[0]
    # the fractions of axes beyond their ends amplify rounding: up to 10 cells of values of order 1
    np.testing.assert_allclose(look_up(EVEN_TABLES[clamp], x, y)[0], expected, rtol=1e-12, atol=1e-12)


def test_one_uneven_axis_disables_even_spacing():
    assert all(table.axes.even for table in EVEN_TABLES.values())
    assert not make_axes([EVEN_X, X], clamp=True).even
    assert not make_axes([np.append(EVEN_X, 1.1 + 1e-9)], clamp=True).even
