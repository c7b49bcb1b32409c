"""What flies: the numbers of a whole flight, and its state between steps. All are arrays: other values, same code."""

import equinox as eqx
from jaxtyping import Array, Bool, Float, Int

from anser.aircraft import AbstractAirframe, MotionState
from anser.control import AutopilotGains, AutopilotState, FlightLimits, GuidanceSettings
from anser.environment import Environment
from anser.planning import FleetPlan, GoalMotion, PathLimits, Rendezvous
from anser.planning.certified import Airspace, CertifiedPlan
from anser.shapes import Count, Flag, Scalar
from anser.simulation.planned_hold import PlannedHolds
from anser.simulation.trim import TrimTarget


class Timing(eqx.Module):
    """Periods of a flight, s.

    Attributes
    ----------
    step
        Sampling period of the autopilots and step of the integrator.
    replan_steps
        Number of steps between plans; 0 plans once, at the start.
    freeze
        The plan stands still for this long before the arrival.
    """

    step: Scalar
    replan_steps: Count
    freeze: Scalar


class Fleet(eqx.Module):
    """The aircraft that share one arrival time; every field but the last three has a leading axis aircraft.

    Attributes
    ----------
    airframes, gains, limits
        What flies and how it is controlled.
    starts
        Steady flight from which each starts.
    start_positions_n
        Where, m.
    goals
        The truth about the goals: read by the sensors, never by the planner.
    rendezvous
        How each meets its goal.
    sides
        Side of the detour: +1 right, -1 left, 0 toward more separation.
    speed
        Mean airspeed that the plan gives to all, m/s.
    even_speed
        Whether paths are flown at an even speed rather than with the published time law.
    guidance
        Numbers of the guidance.
    """

    airframes: AbstractAirframe
    gains: AutopilotGains
    limits: FlightLimits
    starts: TrimTarget
    start_positions_n: Float[Array, "aircraft 3"]
    goals: GoalMotion
    rendezvous: Rendezvous
    sides: Int[Array, " aircraft"]
    speed: Scalar
    even_speed: Flag
    guidance: GuidanceSettings
    certified: "CertifiedFleet | None" = None
    """What the certified planner needs besides; without it the published one plans."""


class CertifiedFleet(eqx.Module):
    """What the certified planner needs to know of a fleet besides its states.

    Attributes
    ----------
    limits
        What each path may ask; leading axis aircraft.
    roll_rates_max
        How fast a path may change the bank angle, rad/s.
    airspace
        Wind, distances, closed volumes.
    movable
        Whether arrival times may be put off on the way.
    latest
        But not beyond this, s.
    """

    limits: PathLimits
    roll_rates_max: Float[Array, " aircraft"]
    airspace: Airspace
    movable: Flag
    latest: Scalar


class Flight(eqx.Module):
    """Everything that determines a flight."""

    environment: Environment
    fleet: Fleet
    timing: Timing


class FlightState(eqx.Module):
    """A flight between two steps; the aircraft's fields have a leading axis aircraft.

    Attributes
    ----------
    step_index
        Steps flown.
    aircraft
        Their states, as they are integrated over the environment's Earth.
    autopilots
        Memory of their autopilots.
    plan
        The plan in force.
    renewal
        How the certified planner came to it: index into `RENEWAL_MESSAGES`; 0 with the published one.
    sides
        Side of each detour, chosen with the first plan and kept.
    deceleration
        What each can hold with the engine idle in level flight at its start, m/s^2.
    flown
        Length of the path through the air flown so far, m.
    status
        Index into `STATUS_MESSAGES`; 0 while all is well. An aircraft whose status is terminal stands still.
    stopped
        Whether the status is terminal. The others are planned without such an aircraft; it keeps its last plan, whose
        arrival time its record goes on to show: the status says that it is not kept.
    holds
        What the certified planner's aircraft fly after their arrival; None: the guidance's hold.
    """

    step_index: Count
    aircraft: MotionState
    autopilots: AutopilotState
    plan: FleetPlan | CertifiedPlan
    renewal: Count
    sides: Float[Array, " aircraft"]
    deceleration: Float[Array, " aircraft"]
    flown: Float[Array, " aircraft"]
    status: Int[Array, " aircraft"]
    stopped: Bool[Array, " aircraft"]
    holds: PlannedHolds | None = None
