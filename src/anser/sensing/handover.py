"""A goal handed over: one aircraft goes on from what another knows of its goal."""

from typing import Any

import equinox as eqx
import jax

from anser.sensing.goal_filters import Track
from anser.sensing.goal_sensors import Queue
from anser.sensing.interface import GoalState


def handed_over(mine: Any, others: Any) -> Any:
    """Memories of an aircraft's sensors and estimator after it has turned to the goal of another aircraft.

    The filter of the goal goes on from the other's; what its own sensor has on the way of the former goal is dropped;
    what it knows of itself stays.

    Parameters
    ----------
    mine, others
        Memories of parts of the same structure, NumPy or JAX arrays.
    """
    return jax.tree.map(_after, mine, others, is_leaf=_of_goal)


def _of_goal(node: Any) -> bool:
    return isinstance(node, Track | GoalState | Queue)


def _after(mine: Any, other: Any) -> Any:
    if isinstance(mine, Track):
        return eqx.tree_at(lambda track: track.own, other, mine.own, is_leaf=lambda leaf: leaf is None)
    if isinstance(mine, Queue):
        return eqx.tree_at(lambda queue: queue.waiting, mine, mine.waiting & False)
    return other if isinstance(mine, GoalState) else mine
