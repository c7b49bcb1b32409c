"""Construction of the fleet's planner from a scenario."""

from collections.abc import Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Array

from anser.config.errors import ScenarioError
from anser.control.guidance import GuidanceSettings
from anser.numerics.arrays import as_array, bucket_size, stack_rows
from anser.parts.planners import AbstractPlanner
from anser.planning.certified.planner import CertifiedPlanner
from anser.planning.certified.task import Airspace, KeepOuts
from anser.planning.decentralised.network import Network
from anser.planning.decentralised.planner import DecentralisedPlanner
from anser.planning.decentralised.time_coordination import CoordinationGains
from anser.planning.published.planner import PublishedPlanner
from anser.planning.separation import Separation
from anser.scenario.build_aircraft import ResolvedAircraft, planned_limits
from anser.scenario.build_environment import build_environment, build_wind, ned
from anser.scenario.build_wind_field import build_fitted_wind
from anser.scenario.schema import Scenario
from anser.scenario.schema_settings import Network as NetworkTable
from anser.scenario.schema_settings import greatest_rate_range, rate_range_problems
from anser.sensing.vehicle_sensors import Dropouts

_KEEP_OUTS = 2  # smallest bucket size of the list of keep-outs
_BEYOND_M = 1e6  # altitude, m, of the cylinders without height that pad the list of keep-outs
_NO_KEEP_OUT = (0.0, 0.0, 0.0, 0.0, 0.0, _BEYOND_M, _BEYOND_M)
_SIDES = {"auto": 0, "right": 1, "left": -1}


def build_planner(scenario: Scenario, fleet: Sequence[ResolvedAircraft], guidance: GuidanceSettings) -> AbstractPlanner:
    """Build the planner that `fleet.planner` selects.

    `fleet` has the scenario's aircraft, then any padding aircraft; `guidance` has the settings common to the fleet.
    """
    return _PLANNERS[scenario.fleet.planner](scenario, fleet, guidance)


def _published(scenario: Scenario, fleet: Sequence[ResolvedAircraft], guidance: GuidanceSettings) -> PublishedPlanner:
    return PublishedPlanner(
        start_positions_n=stack_rows([ned(aircraft.table.start.position_m) for aircraft in fleet]),
        sides=_sides(fleet),
        speed=as_array(scenario.fleet.airspeed_m_s),
        even_speed=as_array(scenario.fleet.speed_profile == "even", bool),
    )


def _sides(fleet: Sequence[ResolvedAircraft]) -> Array:
    return as_array([_SIDES[aircraft.table.bend] for aircraft in fleet], np.int32)


def _certified(scenario: Scenario, fleet: Sequence[ResolvedAircraft], guidance: GuidanceSettings) -> CertifiedPlanner:
    separation, reserve_m = scenario.separation, scenario.separation.reserve_m
    is_separated = separation.horizontal_m > 0.0
    is_stacked = is_separated and separation.vertical_m > 0.0
    return CertifiedPlanner(
        sides=_sides(fleet),
        speed=as_array([scenario.speed_for(aircraft.table) for aircraft in fleet]),
        limits=stack_rows([planned_limits(scenario, aircraft) for aircraft in fleet]),
        roll_rates_max=as_array([aircraft.plan_roll_rate for aircraft in fleet]),
        airspace=Airspace(
            wind=build_wind(scenario) if scenario.wind.field is None else build_fitted_wind(scenario),
            gravity=build_environment(scenario).gravity,
            separation=Separation(
                as_array(separation.horizontal_m + reserve_m if is_separated else 0.0),
                as_array(separation.vertical_m + reserve_m if is_stacked else 0.0),
            ),
            keep_outs=_as_keep_outs(np.reshape(_keep_out_rows(scenario), (-1, 7))),
        ),
        arrival_is_free=as_array(scenario.arrival.rule in ("together", "earliest", "sequence"), bool),
        latest_arrival=as_array(scenario.timing.latest_arrival_s),
        freeze=as_array(scenario.timing.freeze_s),
        guidance=guidance,
        acceleration_reserve=as_array(scenario.fleet.reserve),
    )


def _decentralised(
    scenario: Scenario, fleet: Sequence[ResolvedAircraft], guidance: GuidanceSettings
) -> DecentralisedPlanner:
    planner, network = _certified(scenario, fleet, guidance), build_network(scenario)
    settings = scenario.network or NetworkTable()
    reserve, wind_m_s = scenario.fleet.reserve, scenario.wind.speed_max_m_s
    # The check of the file knows no limits that follow from the performance of an aircraft.
    greatest = min(
        greatest_rate_range(reserve, scenario.speed_for(aircraft.table), aircraft.limits, wind_m_s)
        for aircraft in fleet
    )
    if problems := rate_range_problems(settings.rate_range, reserve, greatest):
        raise ScenarioError(scenario.name, problems)
    separation = planner.airspace.separation
    fastest, climb_rate_max = (
        float(np.max(np.asarray(limit))) for limit in (planner.limits.speed_max, planner.limits.climb_rate_max)
    )
    fastest += scenario.wind.speed_max_m_s
    # twice the greatest deviation from a broadcast path, and the flight in the greatest difference of two clocks
    horizontal_margin = 2.0 * settings.tube_m + settings.skew_max_s * fastest
    vertical_margin = 2.0 * settings.tube_m + settings.skew_max_s * climb_rate_max
    widened = Separation(
        as_array(float(separation.horizontal) + (horizontal_margin if float(separation.horizontal) > 0.0 else 0.0)),
        as_array(float(separation.vertical) + (vertical_margin if float(separation.vertical) > 0.0 else 0.0)),
    )
    planner = eqx.tree_at(lambda p: p.airspace.separation, planner, widened)
    gains = CoordinationGains(
        coupling=as_array(settings.coupling_per_s),
        damping=as_array(settings.damping_per_s),
        waiting=as_array(settings.waiting_per_s2),
        rate_range=as_array(settings.rate_range),
        skew_max=as_array(settings.skew_max_s),
    )
    tube = as_array(settings.tube_m)
    return DecentralisedPlanner(planner, network, gains, tube, arrival_is_free=planner.arrival_is_free)


def build_network(scenario: Scenario) -> Network:
    """Build the communication network of a decentralised fleet from the table [network], or from its defaults."""
    settings = scenario.network or NetworkTable()
    delay = round(settings.delay_s / settings.period_s)
    return Network(
        range=as_array(settings.range_m),
        dropouts=Dropouts(as_array(settings.loss), as_array(settings.outage_share), as_array(settings.outage_mean_s)),
        period=as_array(settings.period_s),
        period_samples=as_array(round(settings.period_s / scenario.timing.step_s), np.int32),
        delay=as_array(delay, np.int32),
        slots=bucket_size(delay + 1, 2),
    )


def keep_outs_of(*scenarios: Scenario) -> KeepOuts:
    """Return the keep-outs that exist at the start of each scenario, as arrays with axes (scenario, keep-out, ...).

    Shorter lists are padded with cylinders that no aircraft reaches. Such a cylinder also stands for a keep-out that
    appears in an event.
    """
    lists = [_keep_out_rows(scenario) for scenario in scenarios]
    longest = max(map(len, lists))
    filled_up = [rows + [_NO_KEEP_OUT] * (longest - len(rows)) for rows in lists]
    return _as_keep_outs(np.reshape(filled_up, (len(lists), longest, 7)))


def _as_keep_outs(table: np.ndarray) -> KeepOuts:
    columns = table[..., :2], table[..., 2:4], table[..., 4], table[..., 5], table[..., 6]
    return KeepOuts(*map(as_array, columns))


def _keep_out_rows(scenario: Scenario) -> list[tuple[float, ...]]:
    volumes = [
        (volume.north_m, volume.east_m, *volume.velocity_m_s()[:2], volume.radius_m, volume.bottom_m, volume.top_m)
        for volume in scenario.keep_out
    ]
    volumes += [_NO_KEEP_OUT for event in scenario.event if event.kind == "keep-out-appears"]
    if volumes:
        volumes += [_NO_KEEP_OUT] * (bucket_size(len(volumes), _KEEP_OUTS) - len(volumes))
    return volumes


_PLANNERS = {"published": _published, "certified": _certified, "decentralised": _decentralised}
