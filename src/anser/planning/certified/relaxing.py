"""The same task with one kind of limit loosened: to find out which one stands in the way of a plan."""

import equinox as eqx
import jax.numpy as jnp

from anser.planning.certified.request import Airspace, Traveller


def relaxed(travellers: Traveller, airspace: Airspace, what: str, factor: float) -> tuple[Traveller, Airspace]:
    """The same task with one kind of limit loosened by a factor (1 is as asked)."""
    limits = travellers.limits
    if what == "separation":
        apart = airspace.separation
        return travellers, eqx.tree_at(
            lambda a: a.separation,
            airspace,
            type(apart)(apart.horizontal / factor, apart.vertical / factor),
        )
    if what == "keep-outs":
        return travellers, eqx.tree_at(lambda a: a.keep_outs.radius, airspace, airspace.keep_outs.radius / factor)
    wider = {
        "speed window": lambda: (
            ("speed_min", limits.speed_min / factor),
            ("speed_max", limits.speed_max * factor),
        ),
        "bank angle": lambda: (
            ("bank_max", jnp.arctan(jnp.tan(limits.bank_max) * factor)),
            ("load_factor_max", limits.load_factor_max * factor),
        ),
        "rate of climb or descent": lambda: (("climb_rate_max", limits.climb_rate_max * factor),),
        "floor and ceiling": lambda: (
            ("altitude_min", limits.altitude_min - 1000.0 * (factor - 1.0)),
            ("altitude_max", limits.altitude_max + 1000.0 * (factor - 1.0)),
        ),
        "acceleration along the path": lambda: (
            ("acceleration_max", limits.acceleration_max * factor),
            ("deceleration_max", limits.deceleration_max * factor),
        ),
    }[what]()
    for name, value in wider:
        limits = eqx.tree_at(lambda x, name=name: getattr(x, name), limits, value)
    return eqx.tree_at(lambda t: t.limits, travellers, limits), airspace


RELAXED = (
    "speed window",
    "rate of climb or descent",
    "acceleration along the path",
    "bank angle",
    "floor and ceiling",
    "keep-outs",
)
"""What `relaxed` knows of one aircraft by itself."""
