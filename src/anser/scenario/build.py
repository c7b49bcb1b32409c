"""From a scenario to a flight: here input units end and arrays begin."""

import functools
import math
from collections.abc import Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Array

from anser.aircraft import (
    F16_COEFFICIENTS,
    AbstractAirframe,
    AbstractF16,
    DerivativeAircraft,
    F16Dispersion,
    dispersed_f16,
)
from anser.control import (
    AutopilotGains,
    FlightLimits,
    FollowPlan,
    GuidanceSettings,
    InversionAutopilot,
    LoopGains,
    designed_gains,
    published_gains,
)
from anser.environment import (
    AbstractWind,
    Environment,
    FlatEarth,
    LayeredWind,
    StandardAtmosphere,
    SteadyWind,
    somigliana,
    wgs84_earth,
)
from anser.numerics import as_array, few_sizes, rows_of, seeded
from anser.planning import (
    GoalMotion,
    PathLimits,
    PublishedPlanner,
    Rendezvous,
    make_rendezvous,
    pad_waypoints,
    straight_goal,
    waypoint_goal,
)
from anser.planning.certified import Airspace, KeepOuts, Separation
from anser.planning.time_coordination import CoordinationGains
from anser.scenario.airframe_file.build import dispersed_airframe
from anser.scenario.build_air import build_gusts
from anser.scenario.build_events import changed_motion, faults_of
from anser.scenario.build_own import beyond_own, has_own, own_limits, own_of, with_own_gains
from anser.scenario.build_sensing import build_estimator, build_sensors
from anser.scenario.library import airframe_of_table, span_of
from anser.scenario.schema import Scenario
from anser.scenario.schema_aircraft import Aircraft, AttitudeGains, Gains, RateGains, VelocityGains
from anser.scenario.schema_deviation import Deviation
from anser.scenario.schema_event import Event
from anser.scenario.schema_goal import Goal
from anser.scenario.schema_network import Network as NetworkTable
from anser.scenario.schema_settings import Limits
from anser.sensing import Dropouts
from anser.shapes import Scalar, Vector3
from anser.simulation import (
    CertifiedPlanner,
    DecentralisedPlanner,
    Flight,
    HoldAroundGoal,
    Mission,
    Network,
    TrimTarget,
    Vehicle,
    assemble,
    trim_target,
)
from anser.units import DEG_RAD

_CORRECTION_MAX_M_S = 20.0  # what position feedback may add to the planned velocity
_CORRECTION_PART = 0.13  # the same, part of the airspeed that an aircraft prefers, where it is not the library's F-16
_HOLD_CLIMB_MAX_M_S = 20.0  # vertical speed in the hold, within the scenario's own limit
_RATES_MAX_DEG_S = (120.0, 60.0, 60.0)  # body rates that the autopilot may ask for
_ROLL_RATE_DEG_S = 20.0  # of plans, on the mean, where no limit is given
_BANK_LAG_MOST = math.radians(10.0)  # how far the bank may lag behind a plan that rolls
_FLEET = 4  # a fleet is filled up to a multiple of so many aircraft
_WAYPOINTS, _LAYERS, _KEEP_OUTS = 4, 4, 2  # least sizes of routes, shear profiles and lists of keep-outs
_ABOVE_M = 1000.0  # between the altitudes that fill up a shear profile
_BEYOND_M = 1e6  # altitude of the empty cylinders that fill up a list of keep-outs
_NO_KEEP_OUT = (0.0, 0.0, 0.0, 0.0, 0.0, _BEYOND_M, _BEYOND_M)
_SIDES = {"auto": 0, "right": 1, "left": -1}


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
    guidance = _guidance(scenario)
    return assemble(
        build_environment(scenario),
        [
            (_vehicle(scenario, a, goal), _start(a), _ned(a.start.position_m))
            for a, goal in zip(fleet, goals, strict=True)
        ],
        _PLANNERS[scenario.fleet.planner](scenario, fleet, guidance),
        timing.step_s,
        round(timing.replan_period_s / timing.step_s),
        timing.freeze_s,
        seeded(scenario.seed, flight),
        len(scenario.aircraft),
    )


def _vehicle(scenario: Scenario, aircraft: Aircraft, goal: GoalMotion) -> Vehicle:
    known, speed_m_s = build_airframe_of(aircraft), scenario.speed_for(aircraft)
    guidance, limits = _guidance(scenario, aircraft), _flight_limits(limits_of(scenario, aircraft))
    gains = gains_of(scenario, aircraft)
    dispersed = aircraft.deviation != Deviation()
    airframe = _dispersed(known, aircraft.deviation) if dispersed else known
    return Vehicle(
        airframe=airframe,
        gusts=build_gusts(scenario, aircraft, span_of(airframe) if scenario.is_gusty else 0.0),
        sensors=build_sensors(scenario),
        estimator=build_estimator(scenario, goal, known if dispersed else None),
        guidance=FollowPlan(guidance),
        controller=InversionAutopilot(gains, limits),
        mission=Mission(
            goal=goal,
            airborne=as_array(scenario.goal_of(aircraft).kind == "airborne", bool),
            rendezvous=_rendezvous(aircraft),
            hold=HoldAroundGoal(guidance, limits, gains.velocity, _scalar(speed_m_s)),
        ),
        faults=faults_of(aircraft, scenario.event),
    )


def build_airframe_of(aircraft: Aircraft) -> AbstractAirframe:
    """Airframe of one aircraft as its autopilot and planner know it."""
    return airframe_of_table(aircraft.type, aircraft.variant, aircraft.x_cg_over_c, aircraft.airframe)


def _dispersed(known: AbstractAirframe, deviation: Deviation) -> AbstractAirframe:
    if isinstance(known, AbstractF16):
        return dispersed_f16(known, _dispersion(deviation))
    if isinstance(known, DerivativeAircraft):
        return dispersed_airframe(known, deviation)
    raise TypeError(f"a deviation of {type(known).__name__}, of which no coefficients are known")


def gains_of(scenario: Scenario, aircraft: Aircraft) -> AutopilotGains:
    """Gains of one aircraft's autopilot: given, published (of the F-16), or the aircraft's own."""
    given = build_gains(aircraft)
    if not has_own(aircraft):
        return given
    return with_own_gains(given, aircraft, own_of(scenario, aircraft, build_airframe_of(aircraft)))


def limits_of(scenario: Scenario, aircraft: Aircraft) -> Limits:
    """Limits of one aircraft: what the scenario leaves out follows from its file and its trim map."""
    limits = scenario.limits_for(aircraft)
    if not has_own(aircraft):
        return limits
    return own_limits(limits, own_of(scenario, aircraft, build_airframe_of(aircraft)).able)


def asked_beyond(scenario: Scenario) -> tuple[str, ...]:
    """What the scenario asks of its aircraft that they cannot do by their trim maps, one sentence each."""
    found = []
    for index, one in enumerate(scenario.aircraft):
        if has_own(one):
            able = own_of(scenario, one, build_airframe_of(one)).able
            found += beyond_own(scenario, scenario.limits_for(one), index, able)
    return tuple(found)


def _guidance(scenario: Scenario, aircraft: Aircraft | None = None) -> GuidanceSettings:
    """How one aircraft follows its plan; of the whole fleet, for its holds, where None."""
    guidance, hold = scenario.guidance, scenario.hold
    of = scenario.aircraft if aircraft is None else (aircraft,)
    climb_rates = [limits_of(scenario, one).climb_rate_max_m_s for one in of]
    corrections = [_CORRECTION_PART * scenario.speed_for(one) for one in of if has_own(one)]
    return GuidanceSettings(
        position_gain=_scalar(guidance.position_gain_per_s),
        correction_max=_scalar(min([_CORRECTION_MAX_M_S, *corrections])),
        hold_radius=_scalar(hold.radius_m),
        hold_turn=_scalar(1.0 if hold.direction == "right" else -1.0),
        climb_rate_max=_scalar(min([_HOLD_CLIMB_MAX_M_S, *climb_rates])),
    )


def _published(scenario: Scenario, fleet: Sequence[Aircraft], guidance: GuidanceSettings) -> PublishedPlanner:
    return PublishedPlanner(
        start_positions_n=rows_of([_ned(a.start.position_m) for a in fleet]),
        sides=_sides(fleet),
        speed=_scalar(scenario.fleet.speed_m_s),
        even_speed=as_array(scenario.fleet.speed_profile == "even", bool),
    )


def _sides(fleet: Sequence[Aircraft]) -> Array:
    return as_array([_SIDES[a.bend] for a in fleet], np.int32)


def build_environment(scenario: Scenario) -> Environment:
    """Standard atmosphere; the flat Earth with normal gravity at the scenario's latitude, or WGS-84; the wind."""
    latitude, longitude = (_scalar(x * DEG_RAD) for x in (scenario.earth.latitude_deg, scenario.earth.longitude_deg))
    earth = wgs84_earth(latitude, longitude) if scenario.earth.model == "wgs84" else FlatEarth(somigliana(latitude))
    return Environment(StandardAtmosphere(), _wind(scenario), earth)


def _wind(scenario: Scenario) -> AbstractWind:
    profile = scenario.wind.profile_m_s
    if scenario.wind.layers is None:
        return SteadyWind(_ned(profile[0][1]))
    altitudes, velocities = zip(*profile, strict=True)
    more = few_sizes(len(altitudes), _LAYERS) - len(altitudes)
    above = [altitudes[-1] + k * _ABOVE_M for k in range(1, more + 1)]  # where the wind is that of the last layer
    return LayeredWind(
        as_array([*altitudes, *above]),
        rows_of([_ned(velocity) for velocity in [*velocities, *[velocities[-1]] * more]]),
    )


def build_path_limits(scenario: Scenario) -> PathLimits:
    """What a trajectory may ask of every aircraft of this scenario."""
    each = [limits_of(scenario, one) for one in scenario.aircraft]
    slowest, fastest = max(one.speed_min_m_s for one in each), min(one.speed_max_m_s for one in each)
    least = [_path_limits(one, slowest, fastest, 1.0) for one in each]
    return eqx.tree_at(
        lambda own: (own.bank_max, own.climb_rate_max, own.load_factor_max),
        least[0],
        tuple(
            min(values)
            for values in zip(*((o.bank_max, o.climb_rate_max, o.load_factor_max) for o in least), strict=True)
        ),
    )


def _path_limits(limits: Limits, speed_min_m_s: float, speed_max_m_s: float, part: float) -> PathLimits:
    """Part of the limits of bank, climb rate and load factor beyond 1; all of the altitudes."""
    return PathLimits(
        speed_min=_scalar(speed_min_m_s),
        speed_max=_scalar(speed_max_m_s),
        bank_max=_scalar(part * limits.bank_max_deg * DEG_RAD),
        climb_rate_max=_scalar(part * limits.climb_rate_max_m_s),
        altitude_min=_scalar(limits.altitude_min_m),
        altitude_max=_scalar(limits.altitude_max_m),
        load_factor_max=_scalar(1.0 + part * (limits.load_factor_max - 1.0)),
        bank_rate_max=_bank_rate(limits, part),
    )


def _bank_rate(limits: Limits, part: float = 1.0) -> Scalar | None:
    """Part of the limit of the bank angle's rate, rad/s; None where none is asked."""
    asked = limits.roll_rate_max_deg_s
    return None if asked is None else _scalar(part * asked * DEG_RAD)


def _certified(scenario: Scenario, fleet: Sequence[Aircraft], guidance: GuidanceSettings) -> CertifiedPlanner:
    """The certified planner; accelerations that the scenario leaves to the aircraft stay infinite."""
    apart = scenario.separation
    asked = apart.horizontal_m > 0.0
    return CertifiedPlanner(
        sides=_sides(fleet),
        speed=as_array([scenario.speed_for(one) for one in fleet]),
        limits=rows_of([_planned_limits(scenario, a) for a in fleet]),
        roll_rates_max=as_array([_roll_rate(scenario, one) for one in fleet]),
        airspace=Airspace(
            wind=_wind(scenario),
            gravity=build_environment(scenario).gravity,
            separation=Separation(
                _scalar(apart.horizontal_m + apart.reserve_m if asked else 0.0),
                _scalar(apart.vertical_m + apart.reserve_m if asked and apart.vertical_m > 0.0 else 0.0),
            ),
            keep_outs=_keep_outs(scenario),
        ),
        movable=as_array(scenario.arrival.rule in ("together", "earliest", "sequence"), bool),
        latest=_scalar(scenario.timing.latest_arrival_s),
        freeze=_scalar(scenario.timing.freeze_s),
        guidance=guidance,
        spared=_scalar(scenario.fleet.reserve),
    )


def _decentralised(scenario: Scenario, fleet: Sequence[Aircraft], guidance: GuidanceSettings) -> DecentralisedPlanner:
    """Each for itself; the separation is widened by what the others may do without being heard of."""
    each, network = _certified(scenario, fleet, guidance), build_network(scenario)
    numbers = scenario.network or NetworkTable()
    apart, fastest = each.airspace.separation, float(np.max(each.limits.speed_max)) + scenario.wind.greatest_m_s
    more = 2.0 * numbers.tube_m + numbers.skew_max_s * fastest
    climbed = 2.0 * numbers.tube_m + numbers.skew_max_s * float(np.max(each.limits.climb_rate_max))
    widened = Separation(
        _scalar(float(apart.horizontal) + (more if float(apart.horizontal) > 0.0 else 0.0)),
        _scalar(float(apart.vertical) + (climbed if float(apart.vertical) > 0.0 else 0.0)),
    )
    each = eqx.tree_at(lambda p: p.airspace.separation, each, widened)
    gains = CoordinationGains(
        coupling=_scalar(numbers.coupling_per_s),
        damping=_scalar(numbers.damping_per_s),
        waiting=_scalar(numbers.waiting_per_s2),
        rate_range=_scalar(numbers.rate_range),
        skew_max=_scalar(numbers.skew_max_s),
    )
    return DecentralisedPlanner(each, network, gains, _scalar(numbers.tube_m))


def build_network(scenario: Scenario) -> Network:
    """Who hears whom in a fleet without a centre."""
    numbers = scenario.network or NetworkTable()
    delay = round(numbers.delay_s / numbers.period_s)
    return Network(
        range=_scalar(numbers.range_m),
        dropouts=Dropouts(_scalar(numbers.loss), _scalar(numbers.outage_share), _scalar(numbers.outage_mean_s)),
        period=_scalar(numbers.period_s),
        every=as_array(round(numbers.period_s / scenario.timing.step_s), np.int32),
        delay=as_array(delay, np.int32),
        slots=few_sizes(delay + 1, 2),
    )


def _keep_outs(scenario: Scenario) -> KeepOuts:
    rows = [(v.north_m, v.east_m, *v.velocity_m_s()[:2], v.radius_m, v.bottom_m, v.top_m) for v in scenario.keep_out]
    rows += [_NO_KEEP_OUT for event in scenario.event if event.kind == "keep-out-appears"]
    if rows:
        rows += [_NO_KEEP_OUT] * (few_sizes(len(rows), _KEEP_OUTS) - len(rows))
    table = np.reshape(rows, (-1, 7))
    return KeepOuts(*map(as_array, (table[:, :2], table[:, 2:4], table[:, 4], table[:, 5], table[:, 6])))


_PLANNERS = {"published": _published, "certified": _certified, "decentralised": _decentralised}


def _roll_rate(scenario: Scenario, aircraft: Aircraft) -> float:
    """How fast a plan rolls one aircraft on the mean, rad/s: as usual, or as its bank loop can follow."""
    usual = _ROLL_RATE_DEG_S * DEG_RAD
    if not has_own(aircraft) or scenario.limits.roll_rate_max_deg_s is not None:
        return usual
    bandwidth = float(own_of(scenario, aircraft, build_airframe_of(aircraft)).bandwidths.attitude[0])
    return min(usual, bandwidth * _BANK_LAG_MOST)


def _planned_limits(scenario: Scenario, aircraft: Aircraft) -> PathLimits:
    """The scenario's limits less the reserve; the speed window contains the aircraft's first airspeed all the same."""
    limits, speed, reserve = limits_of(scenario, aircraft), scenario.speed_for(aircraft), scenario.fleet.reserve
    slowest = limits.speed_min_m_s + reserve * (speed - limits.speed_min_m_s)
    fastest = limits.speed_max_m_s - reserve * (limits.speed_max_m_s - speed)
    own = aircraft.start.speed_m_s
    slowest = max(min(slowest, own - 1.0), limits.speed_min_m_s)
    fastest = min(max(fastest, own + 1.0), limits.speed_max_m_s)
    return eqx.tree_at(
        lambda planned: (planned.acceleration_max, planned.deceleration_max),
        _path_limits(limits, slowest, fastest, 1.0 - reserve),
        tuple(
            _scalar(math.inf if value is None else value)
            for value in (limits.acceleration_max_m_s2, limits.deceleration_max_m_s2)
        ),
    )


def _scalar(value: float) -> Scalar:
    return as_array(value)


def _ned(position_up_m: Sequence[float]) -> Vector3:
    """(north, east, up) as (north, east, down)."""
    north, east, up = position_up_m
    return as_array([north, east, -up])


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
        return straight_goal(_ned(goal.position_m(0.0)), _ned(goal.velocity_m_s()))
    places = rows_of([_ned((p.north_m, p.east_m, p.altitude_m)) for p in goal.waypoints])
    return waypoint_goal([p.time_s for p in goal.waypoints], places)


def _rendezvous(aircraft: Aircraft) -> Rendezvous:
    wanted = aircraft.rendezvous
    return make_rendezvous(
        _ned(wanted.stand_off_m),
        course=None if wanted.course_deg is None else wanted.course_deg * DEG_RAD,
        path_angle=None if wanted.path_angle_deg is None else wanted.path_angle_deg * DEG_RAD,
    )


def build_gains(aircraft: Aircraft) -> AutopilotGains:
    """Gains of one aircraft's autopilot."""
    return _built_gains(aircraft.gains)  # pyright: ignore[reportArgumentType] - frozen, so it has a hash


@functools.lru_cache(maxsize=256)
def _built_gains(gains: Gains) -> AutopilotGains:
    bandwidth = gains.sensor_bandwidth_rad_s if gains.inversion == "incremental" else 0.0
    return eqx.tree_at(
        lambda g: (g.rates, g.attitude, g.velocity, g.sensor_bandwidth),
        published_gains(),
        (_loop(gains.rates), _loop(gains.attitude), _loop(gains.velocity), _scalar(bandwidth)),
    )


def _dispersion(deviation: Deviation) -> F16Dispersion:
    d = deviation
    return F16Dispersion(
        coefficients=as_array([getattr(d.coefficients, name) for name in F16_COEFFICIENTS]),
        thrust=_scalar(d.thrust),
        mass=_scalar(d.mass),
        inertia=as_array([d.roll_inertia, d.pitch_inertia, d.yaw_inertia]),
        actuator_bandwidth=_scalar(d.actuator_bandwidth),
        cg_shift=_scalar(d.cg_shift),
    )


def _loop(gains: RateGains | AttitudeGains | VelocityGains) -> LoopGains:
    def channels(values: Sequence[float]) -> Array:
        return as_array(values)

    others = channels(gains.derivative), channels(gains.feed_forward)
    if gains.bandwidth_rad_s is not None:
        damping = (math.inf,) * 3 if gains.damping is None else gains.damping
        return designed_gains(channels(gains.bandwidth_rad_s), channels(damping), *others)
    return LoopGains(channels(gains.proportional), channels(gains.integral), *others)


def _flight_limits(limits: Limits) -> FlightLimits:
    return FlightLimits(
        speed_min=_scalar(limits.speed_min_m_s),
        speed_max=_scalar(limits.speed_max_m_s),
        bank_max=_scalar(math.radians(limits.bank_max_deg)),
        alpha_min=_scalar(math.radians(limits.alpha_min_deg)),
        alpha_max=_scalar(math.radians(limits.alpha_max_deg)),
        load_factor_min=_scalar(limits.load_factor_min),
        load_factor_max=_scalar(limits.load_factor_max),
        rates_max=as_array([math.radians(x) for x in _RATES_MAX_DEG_S]),
        altitude_min=_scalar(limits.altitude_min_m),
        bank_rate_max=_bank_rate(limits),
    )
