"""All tables of a scenario file, without the checks between tables."""

from typing import Literal

from pydantic import Field

from anser.config.tables import Table, expects, slug, table, tables
from anser.scenario.schema_aircraft import Aircraft, Goal
from anser.scenario.schema_airspace import AIRCRAFT_CHANGES, Arrival, Event, KeepOut, Separation
from anser.scenario.schema_environment import Atmosphere, DiscreteGust, Earth, EarthField, Turbulence, Wind
from anser.scenario.schema_excitation import Excitation
from anser.scenario.schema_sensing import Estimator, GoalSensor, Navigation
from anser.scenario.schema_settings import Fleet, Guidance, Hold, Limits, Network, Parts, Requirements, Timing

FORMAT = 2
"""Newest format of scenario files; older formats are read too."""
DEFAULT_PLANNERS = {1: "published", 2: "certified"}
"""Planner of a file without `fleet.planner`, by format."""
FORMATS_EXPECTED = f"{FORMAT} or 1, the formats that this anser reads"
SEED_MAX = 2**32 - 1


class ScenarioTables(Table):
    """Tables of a scenario, each valid by itself; `anser.scenario.schema.Scenario` adds the checks between tables."""

    format: Literal[1, 2] = Field(description="version of the file format", json_schema_extra=expects(FORMATS_EXPECTED))
    name: str = slug("name of the scenario, also of its output")
    description: str = Field("", description="purpose of the scenario", json_schema_extra=expects("a text in quotes"))
    seed: int = Field(
        0,
        ge=0,
        le=SEED_MAX,
        description="seed of all random numbers",
        json_schema_extra=expects(f"a whole number from 0 to {SEED_MAX}"),
    )
    timing: Timing = table("time", "a table [timing]")
    earth: EarthField = table("the Earth and its origin", 'a table [earth], or the word "flat" or "wgs84"', Earth())
    atmosphere: Atmosphere | None = table("air off the standard", "a table [atmosphere]", None, omit_default=True)
    wind: Wind = table("wind", "a table [wind]", Wind())
    fleet: Fleet = table("settings of the whole fleet", "a table [fleet]")
    limits: Limits = table("flight envelope", "a table [limits]", Limits())
    arrival: Arrival = table("arrival times", "a table [arrival]", Arrival())
    separation: Separation = table("minimum separation", "a table [separation]", Separation())
    guidance: Guidance = table("path following", "a table [guidance]", Guidance())
    hold: Hold = table("circle after the arrival", "a table [hold]", Hold())
    requirements: Requirements = table("requirements for a pass", "a table [requirements]", Requirements())
    aircraft: tuple[Aircraft, ...] = tables(
        "the fleet", "one table [[aircraft]] or more, in double brackets", at_least=1
    )
    goal: tuple[Goal, ...] = tables(
        "goals of the aircraft", "one table [[goal]] or more, in double brackets", at_least=1
    )
    turbulence: Turbulence = table("gusts of the air", "a table [turbulence]", Turbulence())
    gust: tuple[DiscreteGust, ...] = tables(
        "single gusts", "tables [[gust]], in double brackets", at_least=0, default=()
    )
    navigation: Navigation = table("navigation of the aircraft", "a table [navigation]", Navigation())
    goal_sensor: GoalSensor = table("sensor of the goal", "a table [goal_sensor]", GoalSensor())
    estimator: Estimator = table("filter that tracks the goal", "a table [estimator]", Estimator())
    network: Network | None = table("communication in a fleet without a centre", "a table [network]", None)
    event: tuple[Event, ...] = tables(
        "events during the flight", "tables [[event]], in double brackets", at_least=0, default=()
    )
    keep_out: tuple[KeepOut, ...] = tables(
        "volumes closed to all aircraft", "tables [[keep_out]], in double brackets", at_least=0, default=()
    )
    excitation: tuple[Excitation, ...] = tables(
        "test inputs in the closed loop",
        "tables [[excitation]], in double brackets",
        at_least=0,
        default=(),
        omit_default=True,
    )

    parts: Parts | None = Field(
        None,
        description="user-defined parts of the closed loop, of all aircraft",
        json_schema_extra=expects("a table [parts]"),
        exclude_if=lambda parts: parts is None,  # scenarios without user-defined parts keep their hash
    )

    @property
    def planned_events(self) -> tuple[Event, ...]:
        """Events to which the planner responds: all except changes of an aircraft, which the planner does not know."""
        return tuple(event for event in self.event if event.kind != AIRCRAFT_CHANGES)

    @property
    def is_random(self) -> bool:
        """Whether the flight depends on the seed, by turbulence, sensors with errors, or losses in the network."""
        has_exact_sensors = self.navigation.sensors == "exact" and self.goal_sensor.preset == "exact"
        network = self.network
        has_perfect_network = network is None or not (network.loss or network.outage_share)
        return self.turbulence.intensity != "none" or not has_exact_sensors or not has_perfect_network

    @property
    def requires_separation(self) -> bool:
        """Whether the aircraft must keep a distance, by [separation] or `requirements.separation_min_m`."""
        return self.separation.required_m is not None or self.requirements.separation_min_m is not None

    @property
    def has_keep_outs(self) -> bool:
        """Whether the flight has keep-outs, at the start or after an event."""
        return bool(self.keep_out) or any(event.keep_out is not None for event in self.event)

    @property
    def is_gusty(self) -> bool:
        """Whether the air is turbulent; discrete gusts do not count."""
        return self.turbulence.intensity != "none"

    def limits_for(self, aircraft: Aircraft) -> Limits:
        """Return the limits of one aircraft, in the units of the file; see `Limits.within`."""
        return self.limits.within(aircraft.range)

    def speed_for(self, aircraft: Aircraft) -> float:
        """Return the preferred true airspeed of one aircraft, m/s; if its table has none, the airspeed of the fleet."""
        return aircraft.airspeed_m_s if aircraft.airspeed_forms else self.fleet.airspeed_m_s

    @property
    def speed_limit_m_s(self) -> float:
        """Greatest true airspeed that the limits of any aircraft allow, m/s."""
        return max(self.limits_for(aircraft).speed_max_m_s for aircraft in self.aircraft)

    def goal_of(self, aircraft: Aircraft) -> Goal:
        """Return the goal of an aircraft; the scenario must have a goal of this name."""
        return next(goal for goal in self.goal if goal.name == aircraft.goal)
