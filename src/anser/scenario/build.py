"""From a scenario to a flight: here input units end and arrays begin."""

from collections.abc import Sequence

from anser.control import FollowPlan, InversionAutopilot
from anser.numerics import as_array, few_sizes, rows_of, seeded
from anser.planning import GoalMotion, Rendezvous, make_rendezvous, pad_waypoints, straight_goal, waypoint_goal
from anser.scenario.build_air import build_environment, build_gusts, ned
from anser.scenario.build_aircraft import build_airframe_of, dispersed
from anser.scenario.build_events import changed_motion, faults_of
from anser.scenario.build_gains import gains_of
from anser.scenario.build_limits import build_flight_limits, build_guidance, limits_of
from anser.scenario.build_planner import build_planner
from anser.scenario.build_sensing import build_estimator, build_sensors
from anser.scenario.library import span_of
from anser.scenario.schema import Scenario
from anser.scenario.schema_aircraft import Aircraft
from anser.scenario.schema_deviation import Deviation
from anser.scenario.schema_event import Event
from anser.scenario.schema_goal import Goal
from anser.simulation import Flight, HoldAroundGoal, Mission, TrimTarget, Vehicle, assemble, trim_target
from anser.units import DEG_RAD

_FLEET = 4  # a fleet is filled up to a multiple of so many aircraft
_WAYPOINTS = 4  # least size of a route


def build_flight(scenario: Scenario, *, filled_up: bool = False, flight: int = 0) -> Flight:
    """Build the arrays that a flight is computed from.

    Every number of the scenario becomes an array, so that another value of the same shape does not compile again. Shape
    are the numbers of aircraft, of waypoints, of wind layers and of keep-outs, and which Earth it is; numbers of
    waypoints, layers and keep-outs are brought to few sizes.

    Parameters
    ----------
    scenario
        Validated.
    filled_up
        Whether the fleet is filled up to a multiple of four aircraft, with copies of the last that never fly: then
        another number of aircraft seldom compiles anew.
    flight
        Number of the flight, which with the scenario's seed rules all that is random.
    """
    timing = scenario.timing
    fleet = [*scenario.aircraft, *[scenario.aircraft[-1]] * (-len(scenario.aircraft) % _FLEET if filled_up else 0)]
    goals = _goals([scenario.goal_of(a) for a in fleet], scenario.event)
    guidance = build_guidance(scenario)
    return assemble(
        build_environment(scenario),
        [
            (_vehicle(scenario, a, goal), _start(a), ned(a.start.position_m))
            for a, goal in zip(fleet, goals, strict=True)
        ],
        build_planner(scenario, fleet, guidance),
        timing.step_s,
        round(timing.replan_period_s / timing.step_s),
        timing.freeze_s,
        seeded(scenario.seed, flight),
        len(scenario.aircraft),
    )


def _vehicle(scenario: Scenario, aircraft: Aircraft, goal: GoalMotion) -> Vehicle:
    known, speed_m_s = build_airframe_of(aircraft), scenario.speed_for(aircraft)
    guidance, limits = build_guidance(scenario, aircraft), build_flight_limits(limits_of(scenario, aircraft))
    gains = gains_of(scenario, aircraft)
    differs = aircraft.deviation != Deviation()
    airframe = dispersed(known, aircraft.deviation) if differs else known
    return Vehicle(
        airframe=airframe,
        gusts=build_gusts(scenario, aircraft, span_of(airframe) if scenario.is_gusty else 0.0),
        sensors=build_sensors(scenario),
        estimator=build_estimator(scenario, goal, known if differs else None),
        guidance=FollowPlan(guidance),
        controller=InversionAutopilot(gains, limits),
        mission=Mission(
            goal=goal,
            airborne=as_array(scenario.goal_of(aircraft).kind == "airborne", bool),
            rendezvous=_rendezvous(aircraft),
            hold=HoldAroundGoal(guidance, limits, gains.velocity, as_array(speed_m_s)),
        ),
        faults=faults_of(aircraft, scenario.event),
    )


def _start(aircraft: Aircraft) -> TrimTarget:
    start = aircraft.start
    return trim_target(start.speed_m_s, start.altitude_m, start.path_angle_deg * DEG_RAD, start.course_deg * DEG_RAD)


def _goals(goals: Sequence[Goal], events: Sequence[Event]) -> list[GoalMotion]:
    motions = [changed_motion(goal, _motion(goal), events) for goal in goals]
    count = max(motion.times.shape[0] for motion in motions)
    if count > 1:
        count = few_sizes(count, _WAYPOINTS)
    return [pad_waypoints(motion, count) for motion in motions]


def _motion(goal: Goal) -> GoalMotion:
    if goal.waypoints is None:
        return straight_goal(ned(goal.position_m(0.0)), ned(goal.velocity_m_s()))
    places = rows_of([ned((p.north_m, p.east_m, p.altitude_m)) for p in goal.waypoints])
    return waypoint_goal([p.time_s for p in goal.waypoints], places)


def _rendezvous(aircraft: Aircraft) -> Rendezvous:
    wanted = aircraft.rendezvous
    return make_rendezvous(
        ned(wanted.stand_off_m),
        course=None if wanted.course_deg is None else wanted.course_deg * DEG_RAD,
        path_angle=None if wanted.path_angle_deg is None else wanted.path_angle_deg * DEG_RAD,
    )
