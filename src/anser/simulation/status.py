"""What can happen to an aircraft inside compiled code, as a number with a message."""

from anser.planning import PLAN_MESSAGES

FLYING = 0
NO_TRIM = len(PLAN_MESSAGES)
NOT_FINITE = NO_TRIM + 1
BROKE_OFF = NO_TRIM + 2
AT_GROUND = NO_TRIM + 3

STATUS_MESSAGES: tuple[str, ...] = (
    "arrived",
    *PLAN_MESSAGES[1:],
    "no steady flight exists at the start state: the aircraft was not flown",
    "the state stopped being a number: the motion diverged; what is recorded after that stands still",
    "broke off to stay above the least altitude: it pulled up, did not fly its path on and went to its hold",
    "the aircraft reached the ground; what is recorded after that stands still",
)
"""Message of each status; the first ones are the planner's own."""
