"""A scenario of aircraft and goals of any names, such as no file may have, too."""

from pydantic import BaseModel

from anser.scenario import validate


def made_scenario(names, goals, kinds=None, name="made-up", **tables):
    """Aircraft side by side, each with its goal ahead.

    Parameters
    ----------
    names, goals
        Of the aircraft, and of the goal of each.
    kinds
        Of these goals; surface where None is given.
    name
        Of the scenario.
    **tables
        As a file holds them.
    """
    kinds = ["surface"] * len(names) if kinds is None else kinds
    kind_of = dict(zip(goals, kinds, strict=True))
    marks = {goal: f"goal-{k}" for k, goal in enumerate(kind_of)}
    start = {"altitude_m": 1000.0, "speed_m_s": 150.0, "course_deg": 0.0, "east_m": 0.0}
    aircraft = [
        {
            "name": f"aircraft-{k}",
            "goal": marks[goal],
            "start": start | {"north_m": -3000.0 * k},
            "rendezvous": {"stand_off_up_m": 300.0 + 20.0 * k},
        }
        for k, goal in enumerate(goals)
    ]
    places = [
        {"name": marks[goal], "kind": kind, "north_m": 9000.0, "east_m": 5000.0 * k}
        | ({"altitude_m": 2000.0} if kind == "airborne" else {})
        for k, (goal, kind) in enumerate(kind_of.items())
    ]
    values = {"format": 1, "name": "made-up", "timing": {"duration_s": 1000.0}, "fleet": {"speed_m_s": 150.0}}
    made = validate(values | {"aircraft": aircraft, "goal": places} | tables)
    real = {mark: goal for goal, mark in marks.items()}
    named = BaseModel.model_copy  # a scenario refuses what nothing checks
    return named(
        made,
        update={
            "name": name,
            "aircraft": tuple(
                named(one, update={"name": own, "goal": goal})
                for one, own, goal in zip(made.aircraft, names, goals, strict=True)
            ),
            "goal": tuple(named(one, update={"name": real[one.name]}) for one in made.goal),
        },
    )
