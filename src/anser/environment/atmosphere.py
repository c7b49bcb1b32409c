"""Atmosphere models: the interface, the U.S. Standard Atmosphere 1976, and layers of off-standard air."""

import abc

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.constants import AIR_HEAT_RATIO
from anser.environment.air import AIR_GAS_CONSTANT_J_KG_K, LOWEST_M, STANDARD_LAYERS, Layers, geopotential_altitude
from anser.shapes import Scalar, ScalarLike


class Air(eqx.Module):
    """State of the air at one point."""

    density: Scalar  #: kg/m^3.
    pressure: Scalar  #: Pa.
    temperature: Scalar  #: Virtual temperature, K.
    speed_of_sound: Scalar  #: m/s.


class AbstractAtmosphere(eqx.Module):
    """Interface of an atmosphere with air that depends on altitude only."""

    @abc.abstractmethod
    def at(self, altitude: ScalarLike) -> Air:
        """Return the air at a geometric altitude above mean sea level (m)."""


class StandardAtmosphere(AbstractAtmosphere):
    """U.S. Standard Atmosphere 1976, geometric altitudes from -5 km to 86 km.

    Below -5 km the result is the air at -5 km; above 86 km the temperature is constant and the pressure falls
    exponentially. The temperature is the molecular-scale temperature. The kinetic temperature of the standard differs
    above 80 km only, by up to 0.04 %.
    """

    def at(self, altitude: ScalarLike) -> Air:
        """Return the air at a geometric altitude above mean sea level (m).

        At the base of a layer the derivatives are the derivatives in the layer above. Source: theory section 3;
        [USSA76] eq. (23), (33a), (33b), (42), (50).
        """
        h = geopotential_altitude(jnp.maximum(jnp.asarray(altitude), LOWEST_M))
        return _air_in_layers(jnp.asarray(STANDARD_LAYERS[1:, 0], h.dtype), jnp.asarray(STANDARD_LAYERS, h.dtype), h)


def atmosphere_layers(atmosphere: AbstractAtmosphere) -> Layers:
    """Return the table of layers of an atmosphere, a NumPy array (layer, 7), see `anser.environment.air`.

    Raises TypeError if the atmosphere is neither a `StandardAtmosphere` nor a `LayeredAtmosphere`.
    """
    if isinstance(atmosphere, StandardAtmosphere):
        return STANDARD_LAYERS
    if isinstance(atmosphere, LayeredAtmosphere):
        return np.asarray(atmosphere.layers, dtype=float)
    raise TypeError(f"atmosphere: arrived {type(atmosphere).__name__}; expected a standard or a layered atmosphere")


class LayeredAtmosphere(AbstractAtmosphere):
    """Atmosphere of an off-standard day or of a sounding, from a table of layers (see `anser.environment.air`)."""

    layers: Float[Array, "layer 7"]

    def at(self, altitude: ScalarLike) -> Air:
        """Return the air at a geometric altitude above mean sea level (m); below -5 km the air at -5 km.

        At the base of a layer the derivatives are the derivatives in the layer above.
        """
        h = geopotential_altitude(jnp.maximum(jnp.asarray(altitude), LOWEST_M))
        return _air_in_layers(self.layers[1:, 0], self.layers, h)


def _air_in_layers(upper_bases: Float[Array, " bases"], layers: Float[Array, "layer 7"], h: Scalar) -> Air:
    number = jnp.sum(h >= upper_bases, dtype=jnp.int32)
    layer = jnp.take(layers, number, axis=0, mode="clip")
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
