"""What can happen to an aircraft inside compiled code, as a number with a message."""

from typing import Any

import jax.numpy as jnp

from anser.planning import PLAN_MESSAGES
from anser.planning.coordination import DIRECTION_UNATTAINABLE, NO_BEND

FLYING = 0
NO_TRIM = len(PLAN_MESSAGES)
NOT_FINITE = NO_TRIM + 1
BROKE_OFF = NO_TRIM + 2
AT_GROUND = NO_TRIM + 3
TOO_NEAR = NO_TRIM + 4
PLAN_TOO_NEAR = NO_TRIM + 5
LEFT = NO_TRIM + 6
GOAL_UNSEEN = NO_TRIM + 7
GOAL_LOST = NO_TRIM + 8

STATUS_MESSAGES: tuple[str, ...] = (
    "arrived",
    *PLAN_MESSAGES[1:],
    "no steady flight exists at the start state: the aircraft was not flown",
    "the state stopped being a number: the motion diverged; what is recorded after that stands still",
    "broke off to stay above the least altitude: it pulled up, did not fly its path on and went to its hold",
    "the aircraft reached the ground; what is recorded after that stands still",
    "came nearer to its goal than a rendezvous may be (150 m to a surface goal, 100 m to an airborne one), or "
    "was about to: broke off and went to its hold",
    "the plan ended nearer to the goal than a rendezvous may be (150 m to a surface goal, 100 m to an airborne one): "
    "it was refused, and the aircraft went to its hold",
    "left the fleet and flew straight on",
    "its goal was never seen: it held where the goal was said to be",
    "the filter that follows its goal diverged: it held where the goal was last taken to be",
)
"""Message of each status; the first ones are the planner's own."""


def broken_off(status: Any) -> Any:
    """Whether a status, or which of several, means that an aircraft has left its plan for its hold."""
    away = (status == BROKE_OFF) | (status == TOO_NEAR) | (status == PLAN_TOO_NEAR)
    return away | (status == GOAL_UNSEEN) | (status == GOAL_LOST)


def is_off_plan(status: Any) -> Any:
    """Whether a status, or which of several, means that an aircraft flies no path to its rendezvous (any more).

    A path that is not as long as the fleet's longest, or whose direction of arrival was left free, still leads there.
    """
    return (status != FLYING) & (status != NO_BEND) & (status != DIRECTION_UNATTAINABLE)


def plan_status(status: Any, planned: Any) -> Any:
    """Status with what a plan says of an aircraft (index into `PLAN_MESSAGES`), where nothing else has happened."""
    return jnp.where(status == FLYING, planned.astype(status.dtype), status)
