"""A scenario with aircraft and goals of arbitrary names, including names that a file may not contain."""

from pydantic import BaseModel

from anser.scenario import validate


def made_scenario(names, goals, kinds=None, name="made-up", **tables):
    """Aircraft side by side, each with its goal ahead.

    Parameters
    ----------
    names, goals
        Names of the aircraft, and the goal of each.
    kinds
        Kinds of the goals; None: surface.
    name
        Name of the scenario.
    **tables
        Further tables, as in a file.
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
    goal_tables = [
        {"name": marks[goal], "kind": kind, "north_m": 9000.0, "east_m": 5000.0 * k}
        | ({"altitude_m": 2000.0} if kind == "airborne" else {})
        for k, (goal, kind) in enumerate(kind_of.items())
    ]
    values = {"format": 1, "name": "made-up", "timing": {"duration_s": 1000.0}, "fleet": {"speed_m_s": 150.0}}
    scenario = validate(values | {"aircraft": aircraft, "goal": goal_tables} | tables)
    real = {mark: goal for goal, mark in marks.items()}
    copy_model = BaseModel.model_copy  # a scenario refuses what nothing checks
    return copy_model(
        scenario,
        update={
            "name": name,
            "aircraft": tuple(
                copy_model(model, update={"name": aircraft_name, "goal": goal})
                for model, aircraft_name, goal in zip(scenario.aircraft, names, goals, strict=True)
            ),
            "goal": tuple(copy_model(model, update={"name": real[model.name]}) for model in scenario.goal),
        },
    )
