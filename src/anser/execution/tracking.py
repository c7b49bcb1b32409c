"""The published tracking case: a climb of 1000 m with a turn of 60 degrees, on velocity commands alone."""

from importlib import resources

from anser.execution.conditions import Inversion
from anser.execution.execute import Flown, run
from anser.scenario import Scenario, loads

CLIMB_AND_TURN = "climb-and-turn.toml"
"""The case: a copy of the shipped scenario, which a test holds equal to it."""


def climb_and_turn(variant: str = "textbook", inversion: Inversion = "model") -> Scenario:
    """Scenario of the climb-and-turn (theory section 5) with a variant of the F-16 and an inversion of its autopilot.

    Raises
    ------
    ScenarioError
        No such variant or inversion.
    """
    text = resources.files("anser.execution").joinpath(f"data/{CLIMB_AND_TURN}").read_text(encoding="utf-8")
    goal = 'goal = "balloon"\n'
    chosen = text.replace(goal, f'{goal}variant = "{variant}"\ngains.inversion = "{inversion}"\n', 1)
    return loads(chosen, CLIMB_AND_TURN)


def fly_climb_and_turn(variant: str = "textbook", inversion: Inversion = "model") -> Flown:
    """Fly the climb-and-turn; see `climb_and_turn`."""
    return run(climb_and_turn(variant, inversion))
