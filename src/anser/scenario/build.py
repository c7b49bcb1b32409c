"""Construction of a flight from a scenario, before it is flown.

The flight contains the events of the scenario: thrust losses, sensor losses and departures are times in `Faults`,
changes of an aircraft are `AirframeChanges`, and stops and turns of a goal are part of the goal's motion. The planner's
actions at an event are in `anser.missions.event_replanning`.

This module and the other modules build_* convert the units of the file (degrees, altitude upwards) to SI units.
"""

import dataclasses
import math
from collections import deque
from collections.abc import Sequence
from typing import Any

import numpy as np

from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.changes import AirframeChanges
from anser.aircraft.corrected_airframe import without_aerodynamics
from anser.aircraft_files.build import build_changes, disperse_airframe
from anser.aircraft_files.deviations import Deviation
from anser.aircraft_files.library import span_of
from anser.config.tables import Vector, velocity_on_course
from anser.control.guidance import FollowPlan
from anser.control.inversion_autopilot import InversionAutopilot
from anser.control.probing import probing_controller
from anser.numerics.arrays import as_array, bucket_size, stack_rows
from anser.numerics.randomness import flight_randomness
from anser.parts.controllers import AbstractController
from anser.parts.perception import AbstractEstimator
from anser.parts.planners import Rendezvous, make_rendezvous
from anser.planning.goals import GoalMotion, pad_waypoints, straight_goal, waypoint_goal
from anser.planning.holds.hold_around_goal import HoldAroundGoal
from anser.scenario.build_aircraft import ResolvedAircraft, build_flight_limits, build_guidance, resolve_fleet
from anser.scenario.build_environment import build_environment, build_gusts, ned
from anser.scenario.build_excitation import build_aircraft_excitation
from anser.scenario.build_planner import build_planner
from anser.scenario.build_sensing import build_estimator, build_sensors
from anser.scenario.build_wind_field import check_wind_field
from anser.scenario.schema import Scenario, UnplannedScenario
from anser.scenario.schema_aircraft import Adaptation, Aircraft, Goal
from anser.scenario.schema_airspace import Event
from anser.scenario.user_parts import check_user_parts, user_parts
from anser.sensing.adaptation import adaptive_estimator
from anser.simulation.flight import Flight, assemble
from anser.simulation.vehicle import Faults, Mission, Vehicle
from anser.steady.trim import TrimTarget, trim_target
from anser.units import DEG_RAD


def build_faults(aircraft: Aircraft, events: Sequence[Event]) -> Faults:
    """Return the faults of one aircraft by the events: thrust loss, loss of the goal sensor and leaving the fleet.

    The first event of each kind counts. If there is no event of a kind, the time of the fault is infinite.
    """

    def first_event(kind: str) -> tuple[float, float]:
        """Return time (s) and remaining fraction of thrust of the aircraft's first event of a kind, or (inf, 1)."""
        matching_events = [event for event in events if event.kind == kind and event.aircraft == aircraft.name]
        if not matching_events:
            return math.inf, 1.0
        event = min(matching_events, key=lambda event: event.time_s)
        return event.time_s, 1.0 if event.thrust_left is None else event.thrust_left

    (thrust_s, thrust_left), (sensor_s, _), (leaves_s, _) = map(
        first_event, ("thrust-lost", "goal-sensor-lost", "aircraft-leaves")
    )
    return Faults(*map(as_array, (thrust_s, thrust_left, sensor_s, leaves_s)))


def motion_after_events(goal: Goal, motion: GoalMotion, events: Sequence[Event]) -> GoalMotion:
    """Return a goal's motion during the whole flight: `motion`, changed at each event that stops or turns the goal."""
    goal_events = sorted((event for event in events if event.goal == goal.name), key=lambda event: event.time_s)
    for event in goal_events:
        motion = _motion_after_event(motion, event)
    return motion


def _motion_after_event(motion: GoalMotion, event: Event) -> GoalMotion:
    position_n, velocity = np.asarray(motion.position_n(event.time_s)), np.asarray(motion.velocity_n(event.time_s))
    is_earlier = np.asarray(motion.times) < event.time_s
    times = np.append(np.asarray(motion.times)[is_earlier], event.time_s)
    positions_n = np.concatenate([np.asarray(motion.positions_n)[is_earlier], position_n[None]])
    if times.size == 1 or times[0] > 0.0:
        raise ValueError(f"a goal's motion begins at {times[0]:g} s, not at 0")
    return waypoint_goal(times, as_array(positions_n), as_array(_velocity_after_event(event, velocity)))


def _velocity_after_event(event: Event, velocity_n: np.ndarray) -> Vector:
    if event.kind == "goal-stops":
        return 0.0, 0.0, 0.0
    speed_m_s = float(np.hypot(*velocity_n[:2])) if event.speed_m_s is None else event.speed_m_s
    assert event.course_deg is not None
    north, east, _ = velocity_on_course(speed_m_s, event.course_deg)
    return north, east, float(velocity_n[2])


_FLEET = 4  # padded fleets are multiples of this number of aircraft
_WAYPOINTS = 4  # smallest bucket size of a route with waypoints


def build_flight(
    scenario: Scenario, *, pad_fleet: bool = False, flight: int = 0, mission_is_flown: bool = True
) -> Flight:
    """Build the flight (`anser.simulation.flight.Flight`) that a scenario describes, ready to be trimmed and flown.

    If only numerical values change, nothing is compiled again. Compiled programs depend on the Earth model, and on how
    many aircraft, waypoints, wind layers and keep-outs there are; the last three counts are rounded up to a few sizes.

    Parameters
    ----------
    pad_fleet
        True: the fleet is padded to a multiple of four with copies of the last aircraft that never fly, so that fewer
        fleet sizes are compiled.
    flight
        Number of the flight; together with the scenario's seed it determines all random numbers.
    mission_is_flown
        True: missions are flown; starts, rendezvous points and duration must lie within a wind field from a file.

    Raises
    ------
    ScenarioError
        If a user-defined part is invalid, an excited surface does not exist, or the wind field does not fit the flight.
    ValueError
        If `mission_is_flown` is True for an `UnplannedScenario`, whose mission was not checked.
    """
    if mission_is_flown and isinstance(scenario, UnplannedScenario):
        raise ValueError(f"scenario: arrived {scenario.name}, whose mission was not checked; expected a checked one")
    if pad_fleet and _goals_enter_by_missions_only(scenario):
        return _with_goals_of(scenario, _build_for_goals(scenario, flight))
    return _build_flight(scenario, pad_fleet, flight, mission_is_flown)


def _goals_enter_by_missions_only(scenario: Scenario) -> bool:
    """Whether moving a goal changes nothing in a built flight but the `Mission` of each aircraft."""
    is_briefed = scenario.goal_sensor.preset != "exact"
    return not (is_briefed or scenario.wind.field is not None or user_parts(scenario))


_kept_flights: "deque[tuple[list[Any], Flight]]" = deque(maxlen=2)
"""Cache of padded flights: pairs of a flight's definition without the goals, and the flight."""


def _build_for_goals(scenario: Scenario, number: int) -> Flight:
    """Return the padded flight number `number` of a scenario; a flight from the cache may have other goals."""
    # limits and gains that the file omits follow from the aircraft
    written = scenario.model_dump_json(exclude={"goal"}, exclude_unset=True)
    tables = [number, written, *(getattr(scenario, name) for name in Scenario.model_fields if name != "goal")]
    for kept_tables, flight in list(_kept_flights):
        if kept_tables == tables:  # compared, because not all tables can be hashed
            return flight
    flight = _build_flight(scenario, pad_fleet=True, number=number, mission_is_flown=True)
    _kept_flights.append((tables, flight))
    return flight


def _with_goals_of(scenario: Scenario, flight: Flight) -> Flight:
    """Return a flight of `_build_for_goals` in which the goals of `scenario` replace the goals in the missions."""
    members = [scenario.aircraft[min(k, len(scenario.aircraft) - 1)] for k in range(flight.count)]
    tables = [scenario.goal_of(aircraft) for aircraft in members]
    goals = _goals(tables, scenario.event)
    airborne = [as_array(goal.kind == "airborne", bool) for goal in tables]
    groups = []
    for group in flight.groups:
        vehicle = group.vehicles.batched
        assert vehicle.mission is not None
        goal, is_airborne = stack_rows([(goals[k], airborne[k]) for k in group.members])
        mission = dataclasses.replace(vehicle.mission, goal=goal, airborne=is_airborne)
        vehicles = dataclasses.replace(group.vehicles, batched=dataclasses.replace(vehicle, mission=mission))
        groups.append(dataclasses.replace(group, vehicles=vehicles))
    return dataclasses.replace(flight, groups=tuple(groups))


def _build_flight(scenario: Scenario, pad_fleet: bool, number: int, mission_is_flown: bool) -> Flight:
    timing = scenario.timing
    if mission_is_flown:
        check_wind_field(scenario)
    resolved = resolve_fleet(scenario)
    fleet = [*resolved, *resolved[-1:] * (-len(resolved) % _FLEET if pad_fleet else 0)]
    goals = _goals([scenario.goal_of(aircraft.table) for aircraft in fleet], scenario.event)
    own = user_parts(scenario).resolved(scenario)
    environment = build_environment(scenario)
    vehicles = [
        own.replace_in(_vehicle(scenario, aircraft, goal), aircraft.table.name)
        for aircraft, goal in zip(fleet, goals, strict=True)
    ]
    for vehicle, aircraft in zip(vehicles, resolved, strict=False):
        check_user_parts(vehicle, environment, timing.step_s, aircraft.table.name, own)
    return assemble(
        environment,
        [
            (vehicle, _start(aircraft.table), ned(aircraft.table.start.position_m))
            for vehicle, aircraft in zip(vehicles, fleet, strict=True)
        ],
        own.planner or build_planner(scenario, fleet, build_guidance(scenario, resolved)),
        timing.step_s,
        round(timing.replan_period_s / timing.step_s),
        timing.freeze_s,
        flight_randomness(scenario.seed, number),
        len(resolved),
    )


def _vehicle(scenario: Scenario, resolved: ResolvedAircraft, goal: GoalMotion) -> Vehicle:
    aircraft, nominal_airframe, gains = resolved.table, resolved.airframe, resolved.gains
    guidance, limits = build_guidance(scenario, [resolved]), build_flight_limits(resolved.limits)
    is_dispersed = aircraft.deviation != Deviation()
    airframe = disperse_airframe(nominal_airframe, aircraft.deviation) if is_dispersed else nominal_airframe
    changes = _build_changes(scenario, aircraft, airframe)
    is_adaptive = aircraft.gains.inversion == "adaptive"
    adaptation = aircraft.adaptation if is_adaptive else Adaptation()  # without effect on another inversion
    model = nominal_airframe if adaptation.aerodynamics_known else without_aerodynamics(nominal_airframe)
    is_nominal = not is_dispersed and changes is None and not is_adaptive
    estimator = build_estimator(scenario, goal, None if is_nominal else model)
    return Vehicle(
        airframe=airframe,
        gusts=build_gusts(scenario, aircraft, span_of(airframe) if scenario.is_gusty else 0.0),
        sensors=build_sensors(scenario),
        estimator=_adaptive(adaptation, estimator, model) if is_adaptive else estimator,
        guidance=FollowPlan(guidance),
        controller=_controller(adaptation, InversionAutopilot(gains, limits), airframe),
        mission=Mission(
            goal=goal,
            airborne=as_array(scenario.goal_of(aircraft).kind == "airborne", bool),
            rendezvous=_rendezvous(aircraft),
            hold=HoldAroundGoal(guidance, limits, gains.velocity, as_array(scenario.speed_for(aircraft))),
        ),
        faults=build_faults(aircraft, scenario.event),
        changes=changes,
        excitation=build_aircraft_excitation(scenario, aircraft, airframe.actuators.names),
    )


def _adaptive(table: Adaptation, estimator: AbstractEstimator, model: AbstractAirframe) -> AbstractEstimator:
    return adaptive_estimator(estimator, model, method=table.method, aerodynamics_known=table.aerodynamics_known)


def _controller(table: Adaptation, autopilot: AbstractController, airframe: AbstractAirframe) -> AbstractController:
    """Return the autopilot, with test inputs added to the surface commands if [aircraft.adaptation] has test inputs."""
    if table.probing == 0.0:
        return autopilot
    amplitude = as_array(table.probing * DEG_RAD)
    return probing_controller(
        autopilot, len(airframe.actuators.names), amplitude, learning_time=as_array(table.learning)
    )


def _build_changes(scenario: Scenario, aircraft: Aircraft, airframe: AbstractAirframe) -> AirframeChanges | None:
    """Build the changes of one aircraft during the flight, by the events with a deviation; None if there are none."""
    deviations = [
        (event.time_s, event.deviation)
        for event in scenario.event
        if event.deviation is not None and event.aircraft == aircraft.name
    ]
    if not deviations:
        return None
    return build_changes(airframe, deviations, f"{scenario.name}, changes of {aircraft.label}")


def _start(aircraft: Aircraft) -> TrimTarget:
    start = aircraft.start
    return trim_target(start.airspeed_m_s, start.altitude_m, start.path_angle_deg * DEG_RAD, start.course_deg * DEG_RAD)


def _goals(goals: Sequence[Goal], events: Sequence[Event]) -> list[GoalMotion]:
    motions = [motion_after_events(goal, _motion(goal), events) for goal in goals]
    count = max(motion.times.shape[0] for motion in motions)
    if count > 1:
        count = bucket_size(count, _WAYPOINTS)
    return [pad_waypoints(motion, count) for motion in motions]


def _motion(goal: Goal) -> GoalMotion:
    if goal.waypoints is None:
        return straight_goal(ned(goal.position_m(0.0)), ned(goal.velocity_m_s()))
    positions_n = stack_rows([ned(waypoint.position_m) for waypoint in goal.waypoints])
    return waypoint_goal([waypoint.time_s for waypoint in goal.waypoints], positions_n)


def _rendezvous(aircraft: Aircraft) -> Rendezvous:
    rendezvous = aircraft.rendezvous
    return make_rendezvous(
        ned(rendezvous.stand_off_m),
        course=None if rendezvous.course_deg is None else rendezvous.course_deg * DEG_RAD,
        path_angle=None if rendezvous.path_angle_deg is None else rendezvous.path_angle_deg * DEG_RAD,
    )
