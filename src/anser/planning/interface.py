"""Interface of a planner: from what the aircraft of a fleet report to a path and an arrival time for each."""

import abc
from typing import Any

import equinox as eqx
from jaxtyping import Array, Bool, Float

from anser.numerics import AbstractRandomness
from anser.planning.idle_deceleration import IdleDeceleration
from anser.planning.reference import AbstractReference
from anser.planning.rendezvous import Rendezvous
from anser.shapes import Count, Flag, Scalar, ScalarLike, Vector3


class Report(eqx.Module):
    """What one aircraft reports to the planner; stacked, a fleet. Velocities are rates in the Earth's chart.

    Attributes
    ----------
    position_n
        Its own, NED, m.
    air_velocity_n, wind_n
        Its velocity relative to the air and that of the air, as it measures them, NED, m/s.
    airspeed
        m/s.
    goal_position_n, goal_velocity_n
        Its goal as it takes it to be, NED, m and m/s over the ground.
    rendezvous
        How it is to meet the goal.
    active
        Whether it flies its plan. One that has stopped or has broken off does not: the others are planned without it.
    goal_covariance
        Of the goal's position and velocity as it takes them to be, NED, m and m/s; None: they are exact.
    """

    position_n: Vector3
    air_velocity_n: Vector3
    wind_n: Vector3
    airspeed: Scalar
    goal_position_n: Vector3
    goal_velocity_n: Vector3
    rendezvous: Rendezvous
    active: Flag
    goal_covariance: Float[Array, "*aircraft 6 6"] | None = None


class Performance(eqx.Module):
    """What one aircraft can do along its path from steady flight at its start; stacked, a fleet.

    Attributes
    ----------
    deceleration, acceleration
        With the engine idle, and with all its thrust, in level flight, m/s^2.
    idle
        What of that deceleration there is at other airspeeds and load factors.
    """

    deceleration: Float[Array, "..."]
    acceleration: Float[Array, "..."]
    idle: IdleDeceleration


class NetworkView(eqx.Module):
    """What one aircraft of a fleet without a centre shares with the others; stacked, for a fleet.

    Attributes
    ----------
    lag
        By how much its clock is behind the time, s.
    rate
        Of its clock.
    hears
        Whom it heard at the last exchange.
    offers
        Whether it offers another path.
    """

    lag: Scalar
    rate: Scalar
    hears: Bool[Array, " aircraft"]
    offers: Flag


class AircraftPlan(eqx.Module):
    """What the closed loop takes of a plan for one aircraft; stacked, for a fleet.

    Attributes
    ----------
    trajectory
        Where to be at which time up to the arrival.
    arrival_time
        When it is to be at its rendezvous, s.
    status
        Index into `PLAN_MESSAGES`, 0 where all is well.
    length
        Of its path, m.
    lateral_bend
        Parameter of the published paths, m; NaN where paths have none.
    renewal
        How the plan in force came about: index into `RENEWAL_MESSAGES`.
    hold
        What it flies after the arrival; None: what its own hold says.
    hold_reach
        How far its hold may go with a goal that moves otherwise than foreseen, m; None: as `hold_reference` has it.
    network
        Where nobody plans for all; else None.
    """

    trajectory: AbstractReference
    arrival_time: Scalar
    status: Count
    length: Scalar
    lateral_bend: Scalar
    renewal: Count
    hold: Any = None
    hold_reach: Scalar | None = None
    network: NetworkView | None = None


class AbstractPlanner(eqx.Module):
    """Planner of a fleet; concrete ones are final. Its state (`memory`) is a pytree of arrays of its own.

    Aircraft that are not active are planned for as nobody: the others go on without them.
    """

    @abc.abstractmethod
    def first(self, time: ScalarLike, reports: Report, performance: Performance) -> Any:
        """State of the planner with a first plan, made from stacked reports at a time (s)."""

    @abc.abstractmethod
    def renew(self, memory: Any, time: ScalarLike, reports: Report) -> Any:
        """State of the planner with a plan renewed from stacked reports at a time (s)."""

    @abc.abstractmethod
    def observe(
        self,
        memory: Any,
        reports: Report,
        number: Count,
        step: ScalarLike,
        randomness: AbstractRandomness | None,
    ) -> Any:
        """State of the planner after one more step of flight, at whose start the fleet reported.

        Parameters
        ----------
        memory, reports
            Of the sample at the start of the step.
        number, step
            Of that sample, and s.
        randomness
            Of the flight; None: it may draw no random numbers.
        """

    @abc.abstractmethod
    def plans(self, memory: Any) -> AircraftPlan:
        """The plan in force; leading axis aircraft."""
