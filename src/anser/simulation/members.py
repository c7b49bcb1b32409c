"""Rows of the members of each kind of aircraft, and of the fleet that they make up."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp

Members = tuple[int, ...]
"""Places in the fleet of the members of a kind."""


def in_fleet_order(kinds: Sequence[Any], members: tuple[Members, ...]) -> Any:
    """Stacked rows of each kind's members as those of the fleet, in its order."""
    if len(members) == 1 and _is_whole(members[0]):
        return kinds[0]
    places = [place for of_kind in members for place in of_kind]
    order = jnp.asarray([places.index(k) for k in range(len(places))])
    return jax.tree.map(lambda *rows: jnp.concatenate(rows)[order], *kinds)


def rows_at(rows: Any, members: Members, count: int) -> Any:
    """Rows of some members, of those of a fleet of so many aircraft."""
    if len(members) == count and _is_whole(members):
        return rows
    places = jnp.asarray(members)
    return jax.tree.map(lambda leaf: leaf[places], rows)


def _is_whole(members: Members) -> bool:
    return members == tuple(range(len(members)))
