"""From a scenario to the planner of its fleet."""

from collections.abc import Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Array

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
from anser.scenario.build_aircraft import planned_limits, planned_roll_rate
from anser.scenario.build_environment import build_environment, build_wind, ned
from anser.scenario.schema import Scenario
from anser.scenario.schema_aircraft import Aircraft
from anser.scenario.schema_network import Network as NetworkTable
from anser.sensing.vehicle_sensors import Dropouts

_KEEP_OUTS = 2  # least size of lists of keep-outs
_BEYOND_M = 1e6  # altitude of the empty cylinders that fill up a list of keep-outs
_NO_KEEP_OUT = (0.0, 0.0, 0.0, 0.0, 0.0, _BEYOND_M, _BEYOND_M)
_SIDES = {"auto": 0, "right": 1, "left": -1}


def build_planner(scenario: Scenario, fleet: Sequence[Aircraft], guidance: GuidanceSettings) -> AbstractPlanner:
    """Planner of a fleet, which may hold more aircraft than the scenario."""
    return _PLANNERS[scenario.fleet.planner](scenario, fleet, guidance)


def _published(scenario: Scenario, fleet: Sequence[Aircraft], guidance: GuidanceSettings) -> PublishedPlanner:
    return PublishedPlanner(
        start_positions_n=stack_rows([ned(a.start.position_m) for a in fleet]),
        sides=_sides(fleet),
        speed=as_array(scenario.fleet.speed_m_s),
        even_speed=as_array(scenario.fleet.speed_profile == "even", bool),
    )


def _sides(fleet: Sequence[Aircraft]) -> Array:
    return as_array([_SIDES[a.bend] for a in fleet], np.int32)


def _certified(scenario: Scenario, fleet: Sequence[Aircraft], guidance: GuidanceSettings) -> CertifiedPlanner:
    """The certified planner; accelerations that the scenario leaves to the aircraft stay infinite."""
    apart = scenario.separation
    asked = apart.horizontal_m > 0.0
    return CertifiedPlanner(
        sides=_sides(fleet),
        speed=as_array([scenario.speed_for(one) for one in fleet]),
        limits=stack_rows([planned_limits(scenario, a) for a in fleet]),
        roll_rates_max=as_array([planned_roll_rate(scenario, one) for one in fleet]),
        airspace=Airspace(
            wind=build_wind(scenario),
            gravity=build_environment(scenario).gravity,
            separation=Separation(
                as_array(apart.horizontal_m + apart.reserve_m if asked else 0.0),
                as_array(apart.vertical_m + apart.reserve_m if asked and apart.vertical_m > 0.0 else 0.0),
            ),
            keep_outs=_keep_outs(scenario),
        ),
        arrival_is_free=as_array(scenario.arrival.rule in ("together", "earliest", "sequence"), bool),
        latest_arrival=as_array(scenario.timing.latest_arrival_s),
        freeze=as_array(scenario.timing.freeze_s),
        guidance=guidance,
        acceleration_reserve=as_array(scenario.fleet.reserve),
    )


def _decentralised(scenario: Scenario, fleet: Sequence[Aircraft], guidance: GuidanceSettings) -> DecentralisedPlanner:
    """Each for itself; the separation is widened by what the others may do without being heard of."""
    each, network = _certified(scenario, fleet, guidance), build_network(scenario)
    numbers = scenario.network or NetworkTable()
    apart, fastest = each.airspace.separation, float(np.max(each.limits.speed_max)) + scenario.wind.speed_max_m_s
    more = 2.0 * numbers.tube_m + numbers.skew_max_s * fastest
    climbed = 2.0 * numbers.tube_m + numbers.skew_max_s * float(np.max(each.limits.climb_rate_max))
    widened = Separation(
        as_array(float(apart.horizontal) + (more if float(apart.horizontal) > 0.0 else 0.0)),
        as_array(float(apart.vertical) + (climbed if float(apart.vertical) > 0.0 else 0.0)),
    )
    each = eqx.tree_at(lambda p: p.airspace.separation, each, widened)
    gains = CoordinationGains(
        coupling=as_array(numbers.coupling_per_s),
        damping=as_array(numbers.damping_per_s),
        waiting=as_array(numbers.waiting_per_s2),
        rate_range=as_array(numbers.rate_range),
        skew_max=as_array(numbers.skew_max_s),
    )
    return DecentralisedPlanner(each, network, gains, as_array(numbers.tube_m))


def build_network(scenario: Scenario) -> Network:
    """Who hears whom in a fleet without a centre."""
    numbers = scenario.network or NetworkTable()
    delay = round(numbers.delay_s / numbers.period_s)
    return Network(
        range=as_array(numbers.range_m),
        dropouts=Dropouts(as_array(numbers.loss), as_array(numbers.outage_share), as_array(numbers.outage_mean_s)),
        period=as_array(numbers.period_s),
        period_samples=as_array(round(numbers.period_s / scenario.timing.step_s), np.int32),
        delay=as_array(delay, np.int32),
        slots=bucket_size(delay + 1, 2),
    )


def _keep_outs(scenario: Scenario) -> KeepOuts:
    rows = [(v.north_m, v.east_m, *v.velocity_m_s()[:2], v.radius_m, v.bottom_m, v.top_m) for v in scenario.keep_out]
    rows += [_NO_KEEP_OUT for event in scenario.event if event.kind == "keep-out-appears"]
    if rows:
        rows += [_NO_KEEP_OUT] * (bucket_size(len(rows), _KEEP_OUTS) - len(rows))
    table = np.reshape(rows, (-1, 7))
    return KeepOuts(*map(as_array, (table[:, :2], table[:, 2:4], table[:, 4], table[:, 5], table[:, 6])))


_PLANNERS = {"published": _published, "certified": _certified, "decentralised": _decentralised}
