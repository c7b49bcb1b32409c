"""The tables of a scenario that hold for the whole flight: time, fleet, limits, guidance, hold."""

import math
from typing import Literal

from anser.aircraft_files.sources import ALTITUDE_MAX_M, SPEED_MAX_M_S
from anser.config.errors import Problem, format_number
from anser.config.tables import Table, choice, number, ordering_problems

DURATION_MAX_S = 7200.0


def is_multiple(period_s: float, step_s: float) -> bool:
    """Say whether a period is a whole number of steps, to the rounding of decimal input."""
    steps = period_s / step_s
    return round(steps) >= 1 and math.isclose(steps, round(steps), rel_tol=1e-9)


def multiple_message(period_s: float, key: str, step_s: float) -> str:
    """Say that a time must be a whole number of steps, and which are the nearest that are."""
    below = math.floor(period_s / step_s)
    nearest = " or ".join(format_number(round(steps * step_s, 9)) for steps in (below, below + 1) if steps >= 1)
    return f"a whole multiple of {key}, which is {format_number(step_s)} s, such as {nearest}"


class Timing(Table):
    """How long to fly, and how often to step, to record and to plan."""

    duration_s: float = number("time that the flight lasts", 1, DURATION_MAX_S, "s")
    step_s: float = number("step of the integration", 0.001, 0.05, "s", 0.01)
    record_period_s: float = number("time between two recorded states", 0.001, 60, "s", 0.1)
    replan_period_s: float = number("time between two plans; 0 plans once, at the start", 0, 600, "s", 1.0)
    freeze_s: float = number("how long before arrival the plan stays as it is", 0, 600, "s", 4.0)

    @property
    def latest_arrival_s(self) -> float:
        """Latest arrival that a certified plan may have: the flight goes on for a second after it."""
        return self.duration_s - 1.0

    def consistency_problems(self) -> list[Problem]:
        """Find a duration and periods that are no whole number of steps, and a plan that stays from the start."""
        found = []
        for key in ("duration_s", "record_period_s", "replan_period_s"):
            period_s = getattr(self, key)
            allowed_zero = key == "replan_period_s" and period_s == 0
            if not allowed_zero and not is_multiple(period_s, self.step_s):
                found.append(Problem(key, format_number(period_s), multiple_message(period_s, "step_s", self.step_s)))
        return [*found, *ordering_problems(self, "freeze_s", "duration_s", "s")]


class Fleet(Table):
    """What the whole fleet has in common."""

    speed_m_s: float = number(
        "mean airspeed of the plan, the same for all; more where the farthest cannot come down so slowly (certified: "
        "the one preferred)",
        1,
        SPEED_MAX_M_S,
        "m/s",
    )
    speed_profile: Literal["even", "published"] = choice(
        "how the airspeed runs along a path: evenly, or as the published polynomials in time have it",
        ("even", "published"),
        "even",
    )
    planner: Literal["published", "certified", "decentralised"] = choice(
        "how the paths are found: as published, so that limits and separation are proven to be kept, or so by each "
        "aircraft for itself, without a centre",
        ("published", "certified", "decentralised"),
        "certified",
    )
    reserve: float = number(
        "part of each limit that the plan leaves to the autopilot; of the speed window, of each side of speed_m_s",
        0,
        0.5,
        "",
        0.1,
    )

    @property
    def is_certified(self) -> bool:
        """Whether its paths have certificates."""
        return self.planner != "published"


class Limits(Table):
    """The envelope that plans and autopilot keep to."""

    speed_min_m_s: float = number("lowest airspeed", 1, SPEED_MAX_M_S, "m/s", 90.0)
    speed_max_m_s: float = number("highest airspeed", 1, SPEED_MAX_M_S, "m/s", 240.0)
    bank_max_deg: float = number("largest bank angle", 5, 85, "deg", 60.0)
    climb_rate_max_m_s: float = number("largest rate of climb or descent", 1, 300, "m/s", 80.0)
    altitude_min_m: float = number("lowest altitude", 0, ALTITUDE_MAX_M, "m", 100.0)
    altitude_max_m: float = number("highest altitude", 0, ALTITUDE_MAX_M, "m", ALTITUDE_MAX_M)
    load_factor_min: float = number("lowest load factor", -3, 0.9, "", -1.0)
    load_factor_max: float = number("highest load factor", 1.1, 9, "", 5.0)
    alpha_min_deg: float = number("lowest angle of attack", -10, 45, "deg", -5.0)
    alpha_max_deg: float = number("highest angle of attack", -10, 45, "deg", 25.0)
    roll_rate_max_deg_s: float | None = number(
        "greatest rate of the bank angle, in a plan and in the autopilot's commands, which the aircraft passes by up "
        "to a third while it catches up; left out: plans roll at 20 deg/s on the mean, the autopilot as fast as it can",
        1,
        90,
        "deg/s",
        None,
    )
    acceleration_max_m_s2: float | None = number(
        "greatest surplus of thrust over drag, per mass, that a plan asks for; left out: that of its start",
        0,
        50,
        "m/s^2",
        None,
        exclusive_minimum=True,
    )
    deceleration_max_m_s2: float | None = number(
        "greatest surplus of drag over thrust, per mass, that a plan asks for; left out: its own at each airspeed",
        0,
        50,
        "m/s^2",
        None,
        exclusive_minimum=True,
    )

    def consistency_problems(self) -> list[Problem]:
        """Find altitudes without a width; those of the load factors do not meet, so they need no such check.

        Speeds and angles of attack that are left out are those of the aircraft: see `schema_ranges`.
        """
        return ordering_problems(self, "altitude_min_m", "altitude_max_m", "m")


class Guidance(Table):
    """How the plan is followed."""

    position_gain_per_s: float = number(
        "correction of the commanded velocity per metre of error; 0 = velocity commands alone", 0, 5, "1/s", 0.3
    )


class Hold(Table):
    """The circle that every aircraft flies after its arrival."""

    radius_m: float = number("radius of the circle", 20, 100_000, "m", 4000.0)
    direction: Literal["right", "left"] = choice("sense of the turn", ("right", "left"), "right")


class Requirements(Table):
    """What the flight has to achieve to count as met."""

    miss_max_m: float = number(
        "largest distance from the rendezvous point at arrival", 0, 10_000, "m", 3.0, exclusive_minimum=True
    )
    arrival_spread_max_s: float = number(
        "largest time between the first arrival and the last", 0, 3600, "s", 0.05, exclusive_minimum=True
    )
    position_error_max_m: float | None = number(
        "largest distance from the planned point up to the arrival; left out: any",
        0,
        10_000,
        "m",
        None,
        exclusive_minimum=True,
    )
    separation_min_m: float | None = number(
        "least distance between two aircraft; left out: any", 0, 10_000, "m", None, exclusive_minimum=True
    )
