"""Covariance of the Dryden gusts and their rates as realised, by the Lyapunov equation, against MIL-F-8785C."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree
from scipy import integrate, linalg

from anser.environment import Turbulence
from anser.environment.gusts import AirFlow
from anser.scenario.build_environment import exceedance_table

FOOT, KNOT = 0.3048, 1852.0 / 3600.0
CASES = {
    # height (ft), wind at 20 ft (kt), airspeed (m/s), span (m)
    "low and slow, small": (200.0, 15.0, 27.0, 2.9),
    "low": (900.0, 30.0, 80.0, 9.144),
    "medium": (3750.0, 30.0, 150.0, 9.144),
}


def scales_and_intensities(height, wind):
    """Scales (m) and intensities (m/s) of u, v, w: MIL-F-8785C, 3.7.2 (probability 1e-3) and 3.7.3."""
    if height > 2000.0:
        return np.full(3, 1750.0 * FOOT), np.full(3, 10.6 * FOOT)
    shape = 0.177 + 0.000823 * height
    sigma_w = 0.1 * wind * KNOT
    return (
        np.array([height / shape**1.2, height / shape**1.2, height]) * FOOT,
        np.array([sigma_w / shape**0.4, sigma_w / shape**0.4, sigma_w]),
    )


def integral(spectrum):
    return integrate.quad(spectrum, 0.0, np.inf, epsabs=0.0, epsrel=1e-9, limit=400)[0]


def standard_covariance(height, wind, b):
    """Covariance of u, v, w, p, q, r: integrals of the spectra of MIL-F-8785C, 3.7.1.2 and 3.7.1.4, over x = L omega/V."""
    (_, Lv, Lw), (su, sv, sw) = scales_and_intensities(height, wind)

    def lateral(x, sigma):
        return sigma**2 / np.pi * (1.0 + 3.0 * x**2) / (1.0 + x**2) ** 2

    def low_passed(x, L, width):
        return 1.0 / (1.0 + (width * x / (np.pi * L)) ** 2)

    def rate(L, sigma, width):
        return integral(lambda x: (x / L) ** 2 * low_passed(x, L, width) * lateral(x, sigma))

    def with_rate(L, sigma, width):
        # real part of the transfer function (i omega / V) / (1 + i omega width / (pi V))
        return integral(lambda x: (x / L) ** 2 * width / np.pi * low_passed(x, L, width) * lateral(x, sigma))

    roll = sw**2 / Lw**2 * 0.8 * (np.pi * Lw / (4.0 * b)) ** (1.0 / 3.0)
    covariance = np.diag(
        [
            integral(lambda x: 2.0 * su**2 / np.pi / (1.0 + x**2)),
            integral(lambda x: lateral(x, sv)),
            integral(lambda x: lateral(x, sw)),
            integral(lambda x: roll * low_passed(x, Lw, 4.0 * b)),
            rate(Lw, sw, 4.0 * b),
            rate(Lv, sv, 3.0 * b),
        ]
    )
    covariance[2, 4] = covariance[4, 2] = -with_rate(Lw, sw, 4.0 * b)  # rate of the air: q = -dw/dx
    covariance[1, 5] = covariance[5, 1] = with_rate(Lv, sv, 3.0 * b)  # r = dv/dx
    return covariance


@jax.jit
def filter_matrices(gusts, flow, step):
    """A, B, C of the realised filters: x(k+1) = A x(k) + B n(k), gust = C x."""
    zero = jnp.zeros(gusts.normals)
    x, state_of = ravel_pytree(gusts.init(zero, flow))

    def advanced(x, normals):
        return ravel_pytree(gusts.advance(state_of(x), normals, flow, step))[0]

    def output(x):
        gust = gusts.at(state_of(x), flow)
        return jnp.concatenate([gust.velocity_b, gust.rates_b])

    return *jax.jacfwd(advanced, argnums=(0, 1))(x, zero), jax.jacfwd(output)(x)


def realised_covariance(height, wind, V, b, step):
    gusts = Turbulence(jnp.asarray(wind * KNOT), jnp.asarray(-3.0), exceedance_table(), jnp.asarray(b))
    flow = AirFlow(jnp.asarray(V), jnp.asarray(height * FOOT), jnp.eye(3), jnp.zeros(3), jnp.asarray(0.0))
    A, B, C = (np.asarray(matrix) for matrix in filter_matrices(gusts, flow, jnp.asarray(step)))
    return C @ linalg.solve_discrete_lyapunov(A, B @ B.T) @ C.T


@pytest.mark.parametrize("name", CASES)
def test_covariance_is_that_of_the_standard(name):
    height, wind, V, b = CASES[name]
    expected = standard_covariance(height, wind, b)
    sigmas = np.sqrt(np.diag(expected))
    for step, of_rates in ((0.5, np.inf), (0.01, 3e-3), (0.001, 3e-5)):
        # velocities and roll rate are exact at any step; pitch and yaw rate take gusts as straight between samples
        tolerance = np.full((6, 6), of_rates)
        tolerance[:4, :4] = 1e-9
        realised = realised_covariance(height, wind, V, b, step)
        departure = np.abs(realised - expected) / np.outer(sigmas, sigmas)
        assert (departure < tolerance).all(), departure
