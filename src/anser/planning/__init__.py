"""Planning: 4-D trajectories, moving goals, simultaneous arrival, separation and limits."""

from anser.planning.arc_length import arc_length, arc_length_estimate
from anser.planning.commands import PathCommand, polar, rescaled
from anser.planning.coordination import PLAN_MESSAGES, FleetPlan, PlanningTask, coordinate
from anser.planning.goals import GoalMotion, pad_waypoints, straight_goal, waypoint_goal
from anser.planning.idle_deceleration import IdleDeceleration
from anser.planning.interface import (
    AbstractPlanner,
    AircraftPlan,
    NetworkView,
    Performance,
    Report,
)
from anser.planning.limit_check import LimitReport, check_limits
from anser.planning.limits import CERTIFIED_LIMITS, LIMIT_MESSAGES, LIMITS, PathLimits
from anser.planning.line_of_sight import LineOfSight, measure, recover
from anser.planning.path_words import bend_words, turn_words
from anser.planning.published_planner import PublishedPlanner
from anser.planning.reference import AbstractReference, PathPoint
from anser.planning.rendezvous import Rendezvous, final_air_velocity, make_rendezvous, time_to_go
from anser.planning.renewal import renew
from anser.planning.separation import nearest_fraction, separation_ratio
from anser.planning.shape import solve_lateral_bend
from anser.planning.sides import choose_sides, separation_min
from anser.planning.trajectory import Trajectory, bend_trajectory, fit_trajectory, lateral_direction_n, with_even_speed

__all__ = [
    "CERTIFIED_LIMITS",
    "LIMITS",
    "LIMIT_MESSAGES",
    "PLAN_MESSAGES",
    "AbstractPlanner",
    "AbstractReference",
    "AircraftPlan",
    "FleetPlan",
    "GoalMotion",
    "IdleDeceleration",
    "LimitReport",
    "LineOfSight",
    "NetworkView",
    "PathCommand",
    "PathLimits",
    "PathPoint",
    "Performance",
    "PlanningTask",
    "PublishedPlanner",
    "Rendezvous",
    "Report",
    "Trajectory",
    "arc_length",
    "arc_length_estimate",
    "bend_trajectory",
    "bend_words",
    "check_limits",
    "choose_sides",
    "coordinate",
    "final_air_velocity",
    "fit_trajectory",
    "lateral_direction_n",
    "make_rendezvous",
    "measure",
    "nearest_fraction",
    "pad_waypoints",
    "polar",
    "recover",
    "renew",
    "rescaled",
    "separation_min",
    "separation_ratio",
    "solve_lateral_bend",
    "straight_goal",
    "time_to_go",
    "turn_words",
    "waypoint_goal",
    "with_even_speed",
]
