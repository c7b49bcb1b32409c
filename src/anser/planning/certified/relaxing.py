"""The same task with one kind of limit loosened: to find out which one stands in the way of a plan."""

import equinox as eqx

from anser.planning.certified.request import Airspace, Traveller
from anser.planning.limits import LOOSENED_TOGETHER


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
    for limit in LOOSENED_TOGETHER[what]:
        wider = limit.loosened(getattr(limits, limit.field), factor)
        limits = eqx.tree_at(lambda x, field=limit.field: getattr(x, field), limits, wider)
    return eqx.tree_at(lambda t: t.limits, travellers, limits), airspace


RELAXED = (*LOOSENED_TOGETHER, "keep-outs")
"""What `relaxed` knows of one aircraft by itself."""
