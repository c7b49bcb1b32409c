"""Layers fitted to a wind field: the bound of the difference holds everywhere, and is close."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.environment.gridded_wind import GriddedWind
from anser.numerics.arrays import as_array
from anser.numerics.tables import make_axes
from anser.planning.certified.fitted_wind import BEYOND_FIELD_M_S, FieldSamples, Way, fit_layers

WAY = Way(np.array([-5e3, -4e3, 800.0]), np.array([9e3, 6e3, 2600.0]), reach_m=8e3, end_s=600.0)


def pressure_like_field(*, is_geopotential: bool = True, is_held: bool = False) -> tuple[FieldSamples, GriddedWind]:
    """Return a rough field whose levels undulate, and the wind that an aircraft meets in it."""
    rng = np.random.default_rng(2)
    times, north, east = np.array([-200.0, 250.0, 900.0]), np.linspace(-11e3, 12e3, 9), np.linspace(-9e3, 1.2e4, 11)
    levels = np.array([-100.0, 700.0, 1500.0, 2400.0, 3600.0, 5200.0])
    columns = rng.normal(0.0, [1.0, 1.0, 0.3, 30.0], (3, 9, 11, 6, 4))
    columns[..., 3] += levels
    columns[..., 0] += 0.02 * np.minimum(levels, 1500.0)
    lowest, highest = columns[..., 3].min(axis=(0, 1, 2)), columns[..., 3].max(axis=(0, 1, 2))
    samples = FieldSamples(times, north, east, columns, None, is_geopotential, is_held)
    wind = GriddedWind(
        columns=as_array(columns.reshape(-1, 6, 4)),
        member=as_array(0, np.int32),
        axes=make_axes([times, north, east], clamp=True),
        level_tops=as_array(highest[1:-1]),
        altitude_min=as_array(highest[0]),
        altitude_max=as_array(lowest[-1]),
        radii=None,
        is_geopotential=is_geopotential,
        interval_count=2,
        is_held=is_held,
    )
    return samples, wind


@pytest.mark.parametrize(("is_geopotential", "is_held"), [(False, False), (True, False), (True, True)])
def test_the_bound_holds_at_random_points_of_random_boxes_and_is_close(is_geopotential: bool, is_held: bool) -> None:
    samples, wind = pressure_like_field(is_geopotential=is_geopotential, is_held=is_held)
    fitted = fit_layers(samples, WAY)
    rng, boxes, points = np.random.default_rng(5), 300, 400
    low, high = [-1e4, -8e3, -4900.0], [1e4, 1e4, 0.0]
    if is_held:
        low, high = [-1.3e4, -1.2e4, -7000.0], [1.7e4, 1.4e4, 200.0]
    centers = rng.uniform(low, high, (boxes, 3))
    half = rng.uniform(0.0, [2e3, 2e3, 400.0], (boxes, 3))
    least, greatest = (np.clip(centers + sign * half, low, high) for sign in (-1.0, 1.0))
    bounds = np.asarray(jax.jit(lambda a, b: fitted.residual_max(a, b))(jnp.asarray(least), jnp.asarray(greatest)))
    at = rng.uniform(least[:, None], greatest[:, None], (boxes, points, 3))
    times = rng.uniform(0.0, 600.0, (boxes, points))
    difference = jax.jit(jax.vmap(jax.vmap(lambda p, t: wind.at(p, t) - fitted.at(p, t))))
    differences = np.linalg.norm(np.asarray(difference(jnp.asarray(at), jnp.asarray(times))), axis=-1).max(axis=1)
    assert np.all(differences <= bounds + 1e-9)
    assert np.median(bounds / differences) < 3.0
    assert np.all(bounds < BEYOND_FIELD_M_S)


def test_boxes_beyond_the_field_are_bounded_by_no_path_s_limits() -> None:
    fitted = fit_layers(pressure_like_field()[0], WAY)
    inside = np.array([0.0, 0.0, -1000.0])
    assert fitted.residual_max(inside[None], inside[None])[0] < 10.0
    for beyond in ([-1.2e4, 0.0, -1000.0], [0.0, 1.3e4, -1000.0], [0.0, 0.0, -5400.0], [0.0, 0.0, 200.0]):
        bound = fitted.residual_max(np.minimum(inside, beyond)[None], np.maximum(inside, beyond)[None])
        assert bound[0] == BEYOND_FIELD_M_S


def test_horizontally_uniform_steady_fields_are_fitted_exactly() -> None:
    samples, _ = pressure_like_field(is_geopotential=False)
    columns = np.broadcast_to(samples.columns[:1, :1, :1], samples.columns.shape)
    fitted = fit_layers(samples._replace(columns=columns), WAY)
    assert np.max(np.asarray(fitted.residuals)[1:-1, 1:-1, 1:-1]) < 1e-9
    for k, altitude in enumerate(np.linspace(800.0, 2600.0, 7)):
        expected = [np.interp(altitude, columns[0, 0, 0, :, 3], columns[0, 0, 0, :, axis]) for axis in range(3)]
        np.testing.assert_allclose(fitted.at(jnp.array([k * 100.0, 0.0, -altitude]), 0.0), expected, atol=1e-12)
