"""How a planned path goes, in a word or two: the same in plan.json, summary.json and on the terminal."""

NOMINAL_BEND_M = 1.0
"""Up to this lateral bend, m, a path of the published planner is nominal.

A bend of 1 m lengthens a path of 1 km by a few millimetres; solving for a length of 10 km to 1e-6 m leaves a bend of
that size even where none is needed.
"""


def bend_words(bend_m: float) -> str:
    """A path of the published planner by its lateral bend, m, positive to the right."""
    if abs(bend_m) <= NOMINAL_BEND_M:
        return "nominal"
    return "bent right" if bend_m > 0.0 else "bent left"


def turn_words(turned_deg: float) -> str:
    """A path of the certified planner, which has no such bend, by the sum of the sizes of its turns, deg."""
    return f"turns {turned_deg:.0f} deg"
