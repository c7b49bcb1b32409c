"""How an aircraft with its engine idle slows down, by airspeed and load factor."""

from types import ModuleType
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from anser.numerics import namespace

_LEAST = 0.05  # of the deceleration at the start: there is always some


class IdleDeceleration(eqx.Module):
    """Drag less idle thrust per mass, as a share of a deceleration that it is told with; stacked, a fleet.

    Linear in airspeed between the entries, and beyond them that of the first and of the last. The drag due to lift goes
    with the square of the load factor. Each method takes one airspeed (m/s) and load factor, or equally many of each.

    Attributes
    ----------
    speeds
        Airspeeds, rising, m/s.
    level
        Share in level flight, load factor 1, at each of them.
    by_lift
        The part of it that is due to lift, not negative.
    """

    speeds: Float[Array, "*aircraft entries"]
    level: Float[Array, "*aircraft entries"]
    by_lift: Float[Array, "*aircraft entries"]

    def share(self, speed: Any, load_factor: Any) -> Any:
        """Share that can be counted upon: what a load factor above 1 adds is not."""
        xp = namespace(self, speed, load_factor)
        return self._between(xp, self._unloaded(xp, load_factor), speed)

    def least_share(self, slow: Any, fast: Any, load_factor: Any) -> Any:
        """The least `share` between two airspeeds, at a load factor or any greater one."""
        xp = namespace(self, slow, fast, load_factor)
        return -self._most(xp, -self._unloaded(xp, load_factor), slow, fast)

    def rise(self, speed: Any, load_factor: Any) -> Any:
        """By how much the share rises above that of level flight with a load factor above 1."""
        xp = namespace(self, speed, load_factor)
        return self._between(xp, self._loaded(xp, load_factor), speed)

    def greatest_rise(self, slow: Any, fast: Any, load_factor: Any) -> Any:
        """The greatest `rise` between two airspeeds, at a load factor or any smaller one."""
        xp = namespace(self, slow, fast, load_factor)
        return self._most(xp, self._loaded(xp, load_factor), slow, fast)

    def _unloaded(self, xp: ModuleType, load_factor: Any) -> Any:
        """Shares at a load factor, those of 1 above it, along another axis, the last."""
        level, by_lift = (_beside(load_factor, entries) for entries in (self.level, self.by_lift))
        unloaded = 1.0 - xp.clip(load_factor, 0.0, 1.0) ** 2
        return xp.maximum(level - xp.expand_dims(unloaded, -1) * by_lift, _LEAST)

    def _loaded(self, xp: ModuleType, load_factor: Any) -> Any:
        """What load factors above 1 add, along another axis, the last."""
        loaded = xp.maximum(load_factor, 1.0) ** 2 - 1.0
        return xp.expand_dims(loaded, -1) * _beside(load_factor, self.by_lift)

    def _between(self, xp: ModuleType, entries: Any, speed: Any) -> Any:
        speeds = _beside(speed, self.speeds)
        low, high = speeds[..., :-1], speeds[..., 1:]
        parts = xp.clip((xp.expand_dims(speed, -1) - low) / (high - low), 0.0, 1.0)
        return entries[..., 0] + xp.sum(parts * (entries[..., 1:] - entries[..., :-1]), axis=-1)

    def _most(self, xp: ModuleType, entries: Any, slow: Any, fast: Any) -> Any:
        """The greatest between two airspeeds: at either, or at an entry between them."""
        speeds = _beside(slow, self.speeds)
        inside = (speeds > xp.expand_dims(slow, -1)) & (speeds < xp.expand_dims(fast, -1))
        ends = xp.maximum(self._between(xp, entries, slow), self._between(xp, entries, fast))
        return xp.maximum(ends, xp.max(xp.where(inside, entries, -xp.inf), axis=-1))


def _beside(values: Any, entries: Any) -> Any:
    """Entries along another axis than those of some values, the last."""
    return entries.reshape((1,) * np.ndim(values) + entries.shape)
