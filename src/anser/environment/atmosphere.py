"""Atmosphere models: the interface, and the U.S. Standard Atmosphere 1976."""

import abc
import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from anser.constants import (
    AIR_HEAT_RATIO,
    AIR_MOLAR_MASS_KG_MOL,
    GAS_CONSTANT_J_MOL_K,
    GEOPOTENTIAL_RADIUS_M,
    SEA_LEVEL_PRESSURE_PA,
    SEA_LEVEL_TEMPERATURE_K,
    STANDARD_GRAVITY_M_S2,
)
from anser.shapes import Scalar, ScalarLike

AIR_GAS_CONSTANT_J_KG_K = GAS_CONSTANT_J_MOL_K / AIR_MOLAR_MASS_KG_MOL


class Air(eqx.Module):
    """Local state of the air: density kg/m^3, pressure Pa, temperature K, speed of sound m/s."""

    density: Scalar
    pressure: Scalar
    temperature: Scalar
    speed_of_sound: Scalar


class AbstractAtmosphere(eqx.Module):
    """Interface of an atmosphere whose air depends on altitude only."""

    @abc.abstractmethod
    def at(self, altitude: ScalarLike) -> Air:
        """Return the air at a geometric altitude above mean sea level (m)."""


class StandardAtmosphere(AbstractAtmosphere):
    """U.S. Standard Atmosphere 1976, geometric altitudes from -5 km to 86 km.

    Outside this range the air stays well defined: below -5 km it is the air at -5 km; above 86 km (84.852 km
    geopotential) the temperature is constant and the pressure falls exponentially. The temperature is the
    molecular-scale temperature; the kinetic temperature of the standard differs above 80 km only, by up to 0.04 %.
    """

    def at(self, altitude: ScalarLike) -> Air:
        """Return the air at a geometric altitude above mean sea level (m).

        Pressure and temperature are continuous in altitude; at the base of a layer, where the slopes are discontinuous,
        derivatives are those of the layer above. Source: theory section 3; [USSA76] eq. (23), (33a), (33b), (42), (50).
        """
        h = geopotential_from_geometric(jnp.maximum(jnp.asarray(altitude), _LOWEST_M))
        number = jnp.sum(h >= jnp.asarray(_BASES_M[1:], h.dtype), dtype=jnp.int32)
        layer = jnp.take(jnp.asarray(_LAYERS, h.dtype), number, axis=0, mode="clip")
        base, temperature_base, lapse, relative_lapse, pressure_base, power, decay = jnp.unstack(layer)
        above = h - base
        temperature = temperature_base + lapse * above
        # One law for all layers: `decay` is zero in a layer with a lapse rate, `power` in an isothermal one.
        pressure = pressure_base * jnp.exp(-power * jnp.log1p(relative_lapse * above) - decay * above)
        return Air(
            density=pressure / (AIR_GAS_CONSTANT_J_KG_K * temperature),
            pressure=pressure,
            temperature=temperature,
            speed_of_sound=jnp.sqrt(AIR_HEAT_RATIO * AIR_GAS_CONSTANT_J_KG_K * temperature),
        )


def geopotential_from_geometric(altitude: ScalarLike) -> Scalar:
    """Convert a geometric to a geopotential altitude, both in m. Source: theory section 3, [USSA76] eq. (18)."""
    z = jnp.asarray(altitude)
    return GEOPOTENTIAL_RADIUS_M * z / (GEOPOTENTIAL_RADIUS_M + z)


def geometric_from_geopotential(altitude: ScalarLike) -> Scalar:
    """Convert a geopotential to a geometric altitude, both in m. Source: [USSA76] eq. (19)."""
    h = jnp.asarray(altitude)
    return GEOPOTENTIAL_RADIUS_M * h / (GEOPOTENTIAL_RADIUS_M - h)


_LOWEST_M = -5000.0
# [USSA76] table 4: geopotential bases in m and lapse rates in K/m; the last row carries the air on above the
# standard's top.
_BASES_M = np.array([0.0, 11e3, 20e3, 32e3, 47e3, 51e3, 71e3, 84852.0])
_LAPSES_K_M = np.array([-6.5e-3, 0.0, 1e-3, 2.8e-3, 0.0, -2.8e-3, -2e-3, 0.0])


def _layers() -> np.ndarray:
    """Return the constants of the atmosphere's layers, one layer per row.

    Base pressures are computed upwards from sea level, so that the pressure is continuous.
    """
    hydrostatic = STANDARD_GRAVITY_M_S2 / AIR_GAS_CONSTANT_J_KG_K
    layers = []
    temperature, pressure = SEA_LEVEL_TEMPERATURE_K, SEA_LEVEL_PRESSURE_PA
    for base, top, lapse in zip(_BASES_M, [*_BASES_M[1:], _BASES_M[-1]], _LAPSES_K_M, strict=True):
        power, decay = (hydrostatic / lapse, 0.0) if lapse else (0.0, hydrostatic / temperature)
        layers.append([base, temperature, lapse, lapse / temperature, pressure, power, decay])
        thickness = top - base
        pressure *= math.exp(-power * math.log1p(lapse / temperature * thickness) - decay * thickness)
        temperature += lapse * thickness
    return np.array(layers)


_LAYERS = _layers()
