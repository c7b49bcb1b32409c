"""What the events of a scenario do to the truth: faults of aircraft, and goals that move otherwise."""

import math
from collections.abc import Sequence

import numpy as np

from anser.numerics import as_array
from anser.planning import GoalMotion, waypoint_goal
from anser.scenario.schema_aircraft import Aircraft
from anser.scenario.schema_base import Vector, velocity_on_course
from anser.scenario.schema_event import Event
from anser.scenario.schema_goal import Goal
from anser.simulation import Faults


def faults_of(aircraft: Aircraft, events: Sequence[Event]) -> Faults:
    """When an aircraft loses what, and when it leaves."""

    def first(kind: str) -> Event | None:
        own = [event for event in events if event.kind == kind and event.aircraft == aircraft.name]
        return min(own, key=lambda event: event.time_s) if own else None

    thrust, sensor, leaves = (first(kind) for kind in ("thrust-lost", "goal-sensor-lost", "aircraft-leaves"))
    times = (math.inf if one is None else one.time_s for one in (thrust, sensor, leaves))
    thrust_s, sensor_s, leaves_s = map(as_array, times)
    left = 1.0 if thrust is None or thrust.thrust_left is None else thrust.thrust_left
    return Faults(thrust_s, as_array(left), sensor_s, leaves_s)


def changed_motion(goal: Goal, motion: GoalMotion, events: Sequence[Event]) -> GoalMotion:
    """A goal's motion with what events make of it: it stops, or goes on otherwise."""
    own = sorted((e for e in events if e.goal == goal.name), key=lambda event: event.time_s)
    for event in own:
        motion = _after(motion, event)
    return motion


def _after(motion: GoalMotion, event: Event) -> GoalMotion:
    here, velocity = np.asarray(motion.position_n(event.time_s)), np.asarray(motion.velocity_n(event.time_s))
    before = np.asarray(motion.times) < event.time_s
    times = np.append(np.asarray(motion.times)[before], event.time_s)
    places = np.concatenate([np.asarray(motion.positions_n)[before], here[None]])
    if times.size == 1 or times[0] > 0.0:
        raise ValueError(f"a goal's motion begins at {times[0]:g} s, not at 0")
    return waypoint_goal(times, as_array(places), as_array(_velocity(event, velocity)))


def _velocity(event: Event, velocity_n: np.ndarray) -> Vector:
    if event.kind == "goal-stops":
        return 0.0, 0.0, 0.0
    speed_m_s = float(np.hypot(*velocity_n[:2])) if event.speed_m_s is None else event.speed_m_s
    assert event.course_deg is not None
    north, east, _ = velocity_on_course(speed_m_s, event.course_deg)
    return north, east, float(velocity_n[2])
