"""An airframe looked at from all sides: coefficients against the flow angles, thrust, steady flights over airspeed."""

from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft import AbstractAirframe, DaveMlAircraft, DerivativeAircraft, air_data
from anser.compiling import compiled, enable_compilation_cache
from anser.environment import Environment, standard_environment
from anser.execution.conditions import airframe_of, map_points
from anser.numerics import as_array
from anser.shapes import Scalar
from anser.simulation import trim_target
from anser.units import DEG_RAD, RAD_DEG

if TYPE_CHECKING:
    import xarray as xr

_ANGLES, _SPEEDS = 61, 28
_ALPHA = 2.0 * DEG_RAD
"""Angle of attack at which the coefficients are drawn against the sideslip."""
_F16_SPEEDS_M_S = (60.0, 320.0)
POWERS = (0.0, 25.0, 50.0, 75.0, 100.0)
"""Percent, at which thrust is drawn."""


def survey_airframe(
    aircraft: str | AbstractAirframe,
    variant: str = "textbook",
    *,
    altitude_m: float = 0.0,
    airspeeds_m_s: tuple[float, float] | None = None,
) -> "xr.Dataset":
    """Compute what a picture of an airframe shows.

    Parameters
    ----------
    aircraft, variant
        See `airframe_of`.
    altitude_m
        Of the thrust and the steady flights.
    airspeeds_m_s
        Least and greatest; None: those of its data, of an airframe that tells none 60 to 320 m/s.

    Returns
    -------
    xr.Dataset
        Coefficients over `alpha` and over `beta`, thrust over `airspeed` and `power`, and over `airspeed` steady level
        flights: angle of attack, power, deflections, and whether they are within the limits.

    Raises
    ------
    ValueError
        No such airframe.
    ScenarioError
        No valid aircraft file.
    """
    enable_compilation_cache()
    airframe, of = airframe_of(aircraft, variant)
    environment = standard_environment()
    speeds = np.linspace(*(airspeeds_m_s or flown_airspeeds(airframe)), _SPEEDS)
    middle = as_array(float(np.mean(speeds)))
    alphas, betas = (
        np.linspace(float(low), float(high), _ANGLES) for low, high in (airframe.alpha_range, airframe.beta_range)
    )
    still = np.zeros(_ANGLES)
    over_alpha = _coefficients(airframe, environment, middle, as_array(alphas), as_array(still))
    over_beta = _coefficients(airframe, environment, middle, as_array(still + _ALPHA), as_array(betas))
    targets = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(trim_target(V, altitude_m) for V in speeds))
    points = map_points(airframe, environment, targets)
    from anser.results import airframe_dataset

    trimmed = np.asarray(points.trim.converged)[:, None]
    return airframe_dataset(
        alphas * RAD_DEG,
        betas * RAD_DEG,
        speeds,
        np.asarray(POWERS),
        airframe.actuators.names,
        {
            "over_alpha": np.asarray(over_alpha),
            "over_beta": np.asarray(over_beta),
            "thrust": np.asarray(
                _thrusts(airframe, environment, as_array(speeds), as_array(POWERS), as_array(altitude_m))
            ),
            "trimmable": np.asarray(points.trimmable),
            "alpha": np.where(trimmed[:, 0], np.asarray(points.trim.alpha) * RAD_DEG, np.nan),
            "power": np.where(trimmed[:, 0], np.asarray(points.trim.power), np.nan),
            "surfaces": np.where(trimmed, np.asarray(points.trim.state.surfaces) * RAD_DEG, np.nan),
        },
        {**of, "altitude_m": altitude_m, "dimensionless": int(_sizes(airframe) is not None)},
    )


def flown_airspeeds(airframe: AbstractAirframe) -> tuple[float, float]:
    """Least and greatest airspeed of an airframe's data, m/s."""
    if isinstance(airframe, DerivativeAircraft | DaveMlAircraft):
        low, high = (float(end) for end in airframe.validity.airspeed)
        if low > 0.0 and high < np.inf:
            return low, high
    return _F16_SPEEDS_M_S


def _sizes(airframe: AbstractAirframe) -> tuple[Scalar, Scalar, Scalar] | None:
    """Wing area, span and mean chord of an airframe that has them."""
    sizes = tuple(getattr(airframe, name, None) for name in ("wing_area", "span", "mean_chord"))
    return None if None in sizes else sizes  # pyright: ignore[reportReturnType]


@compiled
def _coefficients(
    airframe: AbstractAirframe, environment: Environment, V: Scalar, alphas: Array, betas: Array
) -> Float[Array, "angle 6"]:
    """Lift, drag, side force; moments of roll, pitch and yaw: over qbar, and over the sizes of an airframe with any."""
    sizes = _sizes(airframe)
    S, b, c = (jnp.ones(()),) * 3 if sizes is None else sizes
    air = environment.atmosphere.at(0.0)

    def one(alpha: Scalar, beta: Scalar) -> Float[Array, "6"]:
        ca, sa, cb, sb = jnp.cos(alpha), jnp.sin(alpha), jnp.cos(beta), jnp.sin(beta)
        data = air_data(V * jnp.stack([ca * cb, sb, sa * cb]), 0.0, air)
        neutral = airframe.actuators.scheduled(jnp.zeros(len(airframe.actuators.names)), data)
        wrench = airframe.aerodynamics(data, jnp.zeros(3), neutral)
        X, Y, Z = wrench.force_b / (data.qbar * S)
        moments = wrench.moment_b / (data.qbar * S * jnp.stack([b, c, b]))
        return jnp.concatenate([jnp.stack([X * sa - Z * ca, -X * ca - Z * sa, Y]), moments])

    return jax.vmap(one)(alphas, betas)


@compiled
def _thrusts(
    airframe: AbstractAirframe, environment: Environment, speeds: Array, powers: Array, altitude: Scalar
) -> Float[Array, "speed power"]:
    air = environment.atmosphere.at(altitude)

    def one(V: Scalar, power: Scalar) -> Scalar:
        data = air_data(jnp.stack([V, 0.0 * V, 0.0 * V]), altitude, air)
        return airframe.engine.propulsion(power, data).force_b[0]

    return jax.vmap(jax.vmap(one, in_axes=(None, 0)), in_axes=(0, None))(speeds, powers)
