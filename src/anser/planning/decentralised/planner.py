"""Decentralised planner: each aircraft plans with its own knowledge and communicates over a network.

Before the flight the aircraft agree on an arrival time, the latest of the requested times, and on paths
(`anser.missions.consensus`). En route each aircraft corrects its path to the estimated goal, within a tube around the
path that the fleet knows; larger changes need the fleet's acknowledgement (`path_exchange`). The clocks along the paths
are coordinated (`anser.planning.decentralised.time_coordination`), so that the fleet waits for a delayed aircraft.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.numerics.arrays import any_in_batch, select_rows
from anser.numerics.randomness import AbstractRandomness
from anser.parts.paths import AbstractReference, PathPoint
from anser.parts.planners import AbstractPlanner, AircraftPlan, AircraftReport, NetworkView, Performance
from anser.planning.certified.certified_plan import Certificate, CertifiedPlan, FixedPaths, certify, plan_fleet_at
from anser.planning.certified.planner import CertifiedPlanner, CertifiedPlanState
from anser.planning.certified.replanning import (
    AWAITING_GOAL,
    COMMITTED_S,
    CORRECTED,
    CORRECTION_FRACTIONS,
    PARTLY_CORRECTED,
    REPLANNED,
    UNCHANGED,
    AttemptLadder,
    arrival_delays,
    correct_path,
    interval_count,
    rendezvous_has_moved,
    task_from_plan,
)
from anser.planning.certified.task import AircraftTask
from anser.planning.certified.timed_profiles import MINIMAL
from anser.planning.decentralised.network import Broadcast, KnowledgeMatrix, Network, NetworkState
from anser.planning.decentralised.path_exchange import (
    Exchange,
    initial_exchange,
    open_offers,
    path_distance_max,
    process_messages,
)
from anser.planning.decentralised.time_coordination import CoordinationGains, bounded_rate, clock_acceleration
from anser.planning.holds.assignment import assign_holds
from anser.planning.holds.hold_paths import ApproachAndHold, broadcast_holds, move_with_goals, pairwise_clearance_ratios
from anser.planning.limits import PathLimits
from anser.planning.timed_path import TimedPath
from anser.shapes import Flag, Integer, Scalar, ScalarLike
from anser.spatial.rotations import safe_norm

LEAD_S = 6.0
"""Time between an offer and the start of the offered path, s: in this time the fleet must acknowledge it."""
_CLEARANCE_RATIO_MIN = 1.0 - 1e-7  # ratio of distance to separation
_SAME_TIME_S = 1e-3
# of the time to go: small delays first, because the fleet follows
_DELAY_FRACTIONS = (0.0, 0.01, 0.02, 0.04, 0.08, 0.15)


class ClockedPath(AbstractReference):
    """A path that one aircraft flies by its own clock instead of time."""

    # present path and next path, as functions of the clock
    path: TimedPath
    next_path: TimedPath
    has_next_path: Flag  # whether the next path replaces the present one from its start on
    # clock (s) at `time`, its rate (1) and acceleration (1/s)
    clock: Scalar
    rate: Scalar
    acceleration: Scalar
    time: Scalar  # time to which clock and rate belong, s

    def at(self, time: ScalarLike) -> PathPoint:
        """Position, velocity and acceleration over the ground at a time of the flight (s), NED."""
        clock = self.clock + self.rate * (time - self.time)
        on_next_path = self.has_next_path & (clock >= self.next_path.start_time)
        point = jax.tree.map(lambda a, b: jnp.where(on_next_path, a, b), self.next_path.at(clock), self.path.at(clock))
        bend_n = self.rate**2 * point.acceleration_n + self.acceleration * point.velocity_n
        return PathPoint(point.position_n, self.rate * point.velocity_n, bend_n)

    @property
    def duration(self) -> Scalar:
        """Duration of the path by the aircraft's clock, s."""
        return self.path.duration


class Clocks(eqx.Module):
    """Clocks of the fleet; leading axis aircraft."""

    clock: Float[Array, " aircraft"]  # commanded progress along the path, s
    # rate (1) and acceleration (1/s) of the clock
    rate: Float[Array, " aircraft"]
    acceleration: Float[Array, " aircraft"]


def clock_accelerations(
    paths: ClockedPath,  # paths and clocks of the fleet
    network: NetworkState,  # state of the network after the exchange
    positions_n: Float[Array, "aircraft 3"],  # positions of the aircraft, NED, m
    # masks of the flying aircraft and of the coordinated clocks; the rate of an uncoordinated clock returns to 1
    active: Bool[Array, " aircraft"],
    coordinated: Bool[Array, " aircraft"],
    gains: CoordinationGains,
) -> Float[Array, " aircraft"]:
    """Compute the accelerations of the clocks, 1/s, by the coordination law, from received messages."""
    knowledge = network.knowledge
    estimated_clocks = knowledge.clocks + (paths.time[:, None] - knowledge.times)
    count = jnp.sum(active)

    def aircraft_acceleration(path: ClockedPath, other_clocks: Array, hears: Array, position_n: Array) -> Scalar:
        reference = path.at(path.time)
        speed = jnp.maximum(safe_norm(reference.velocity_n), 1.0)
        lag = jnp.sum(reference.velocity_n * (reference.position_n - position_n)) / speed**2
        return clock_acceleration(path.clock, path.rate, other_clocks, hears, lag, count, gains)

    accelerations = jax.vmap(aircraft_acceleration)(paths, estimated_clocks, network.hears, positions_n)
    return jnp.where(coordinated, accelerations, -gains.damping * (paths.rate - 1.0))


def advance_clocks(
    clocks: Clocks,
    knowledge: KnowledgeMatrix,
    time: ScalarLike,
    active: Bool[Array, " aircraft"],
    arrived: Bool[Array, " aircraft"],
    gains: CoordinationGains,
    step: ScalarLike,
) -> Clocks:
    """Advance the clocks from a time (s) by one step (s); after the arrival a clock continues at rate 1."""
    count = clocks.clock.shape[0]
    estimated_clocks = knowledge.clocks + (time - knowledge.times)
    clock_uncertainty = gains.rate_range * (time - knowledge.times)
    is_coordinated = active[None, :] & ~jnp.eye(count, dtype=bool)
    unlimited_rate = clocks.rate + step * clocks.acceleration
    rate = jax.vmap(bounded_rate, in_axes=(0, 0, 0, 0, 0, None))(
        unlimited_rate, clocks.clock, estimated_clocks, clock_uncertainty, is_coordinated, gains
    )
    rate = jnp.where(arrived | ~active, 1.0, rate)
    clock = clocks.clock + step * 0.5 * (clocks.rate + rate)
    return Clocks(clock, rate, jnp.where(arrived, 0.0, (rate - clocks.rate) / step))


class DecentralisedPlanState(eqx.Module):
    """State of the planner of a decentralised fleet. The row of an aircraft is known to this aircraft only."""

    plan: CertifiedPlan  # paths that the aircraft fly, as functions of their clocks
    # result of the last replanning: index into `anser.planning.certified.replanning.REPLANNING_MESSAGES`
    replanning: Array
    limits: PathLimits  # flight limits of each path, including the accelerations available from the engine
    exchange: Exchange  # state of the agreement on paths
    # present state of clocks and network, and time, s
    clocks: Clocks
    network: NetworkState
    time: Scalar
    replan_needed: Flag  # whether a new path was needed that a planner without replanning could not make
    waits: Bool[Array, " aircraft"]  # mask of the aircraft on the previous path until the agreed path begins
    first_arrivals: Float[Array, " aircraft"]  # arrival times agreed before the flight, by the clocks, s
    # delay of the fleet's arrivals known to each aircraft, s: the greatest requested or received
    delays: Float[Array, " aircraft"]


class DecentralisedPlanner(AbstractPlanner):
    """Planner of a fleet without a centre: each aircraft plans for itself."""

    # limits, airspace and settings of the paths; the separation includes twice the tube and the greatest skew
    aircraft_planner: CertifiedPlanner
    network: Network  # communication network
    gains: CoordinationGains  # gains of the clocks' coordination
    tube: Scalar  # greatest distance of an aircraft's path from its agreed path, m

    def first_plan(self, time: ScalarLike, reports: AircraftReport, performance: Performance) -> DecentralisedPlanState:
        """Raises ValueError: the aircraft agree on a plan before the flight (`anser.missions.consensus`)."""
        raise ValueError("without a centre a fleet agrees on its first plan beforehand: anser.plan makes it")

    def initial_state(
        self, plan_state: CertifiedPlanState, randomness: AbstractRandomness | None
    ) -> DecentralisedPlanState:
        """State at time 0, with the paths and holds agreed before the flight."""
        assert plan_state.holds is not None, "without a centre a fleet agrees on its holds too"
        count, arrivals = plan_state.plan.arrival_times.shape[0], plan_state.plan.arrival_times
        clocks = Clocks(jnp.zeros(count), jnp.ones(count), jnp.zeros(count))
        return DecentralisedPlanState(
            plan=plan_state.plan,
            replanning=jnp.zeros(count, dtype=jnp.int32),
            limits=plan_state.limits,
            exchange=initial_exchange(ApproachAndHold(plan_state.plan.paths, broadcast_holds(plan_state.holds))),
            clocks=clocks,
            network=self.network.init(clocks.clock, randomness),
            time=jnp.zeros(()),
            replan_needed=jnp.asarray(False),
            waits=jnp.zeros(count, dtype=bool),
            first_arrivals=arrivals,
            delays=jnp.zeros(count),
        )

    def replan(
        self, planner_state: DecentralisedPlanState, time: ScalarLike, reports: AircraftReport
    ) -> DecentralisedPlanState:
        """Let each aircraft process received messages, and correct its path to the rendezvous predicted now."""
        plan = planner_state.plan
        state = planner_state.exchange
        clocks = planner_state.clocks
        planner = self.aircraft_planner
        clock, knowledge = clocks.clock, planner_state.network.knowledge
        tasks = planner.aircraft_tasks(reports, planner_state.limits)
        to_go = plan.arrival_times - clock
        time_to_go = to_go / clocks.rate
        under_way = reports.active & (to_go > planner.freeze)
        # The agreed path is flown from its start on; before, the previous path.
        has_begun = clock >= state.agreed_paths.path.times[:, 0]
        paths = select_rows(planner_state.waits & has_begun, state.agreed_paths.path, plan.paths)
        waits = planner_state.waits & ~has_begun
        may_change = under_way & ~state.offer_open & ~waits
        lead = jnp.minimum(LEAD_S, jnp.maximum(0.25 * to_go, 0.0))
        bent = select_rows(may_change, jax.vmap(correct_path)(paths, tasks, clock, time_to_go, lead), paths)
        # latest requested arrival known to each aircraft
        delays = jnp.maximum(planner_state.delays, jnp.max(knowledge.delays, axis=1))
        is_late = planner_state.first_arrivals + delays > state.agreed_paths.path.times[:, -1] + _SAME_TIME_S

        from_time = jnp.min(clock)
        correction_tasks = planner.aircraft_tasks(reports, planner.correction_limits(planner_state.limits))

        def certified(candidate: TimedPath) -> tuple[TimedPath, Certificate, Bool[Array, " aircraft"]]:
            certificate = certify(candidate, correction_tasks, planner.airspace, interval_count(candidate), from_time)
            in_tube = jax.vmap(path_distance_max)(candidate, state.agreed_paths.path) <= self.tube
            return candidate, certificate, may_change & certificate.satisfied_individually & in_tube

        def correct_partly() -> tuple[TimedPath, Certificate, Bool[Array, " aircraft"]]:
            candidates = jax.lax.map(
                lambda share: certified(
                    eqx.tree_at(lambda p: p.air_n, paths, paths.air_n + share * (bent.air_n - paths.air_n))
                ),
                jnp.asarray(CORRECTION_FRACTIONS[1:]),
            )
            largest = jnp.argmax(candidates[2], axis=0), jnp.arange(clock.shape[0])
            return jax.tree.map(lambda leaf: leaf[largest], candidates)

        _, certificate, corrected = certified(bent)
        partial = jax.lax.cond(
            any_in_batch(jnp.any(may_change & ~corrected)),
            correct_partly,
            lambda: (bent, certificate, jnp.zeros_like(corrected)),
        )
        is_changed = corrected | partial[2]
        changed_paths, certificates = select_rows(corrected, (bent, certificate), partial[:2])
        proposals = ApproachAndHold(bent, move_with_goals(state.agreed_paths.hold, tasks, clock))
        agreed, alternative, proposed = _set_slices(clock.shape[0])
        is_clear = jax.lax.cond(
            any_in_batch(jnp.any(~state.settled | (may_change & ~corrected))),
            lambda: self._clearance(state, proposals, tasks.active, from_time),
            lambda: jnp.zeros((3 * clock.shape[0], 3 * clock.shape[0]), dtype=bool),
        )
        # (aircraft, owner): the owner may fly its alternative path as well
        is_known = knowledge.tokens == state.tokens[None, :]
        avoids_alternative = ~state.settled[None, :] & (state.offer_open[None, :] == is_known)
        state, accepted = process_messages(
            state,
            knowledge,
            is_clear[alternative, agreed],
            is_clear[alternative, alternative],
            clock,
            reports.active,
            LEAD_S - 1.0,
        )
        paths = select_rows(is_changed, changed_paths, paths)
        may_offer = may_change & state.settled & ~is_late & ~corrected & (to_go > planner.freeze + 2.0 * LEAD_S)
        keeps_clear = jnp.all(
            is_clear[proposed, agreed] & (is_clear[proposed, alternative] | ~avoids_alternative), axis=1
        )
        offers = may_offer & certificate.satisfied_individually & keeps_clear
        goal_has_moved = under_way
        if reports.goal_covariance is not None:
            goal_has_moved = jax.vmap(rendezvous_has_moved)(paths, tasks, reports.goal_covariance, time_to_go)
        needs_path = is_late | (~corrected & goal_has_moved)
        searches = may_change & state.settled & needs_path & ~offers & (to_go > COMMITTED_S + 2.0 * LEAD_S)
        replan_needed = planner_state.replan_needed
        if self.allow_replanning:
            proposals, has_proposal, delays = self._search_path(
                planner_state, state, paths, proposals, tasks, searches, avoids_alternative, delays, time
            )
            offers = offers | has_proposal
        else:
            replan_needed = replan_needed | jnp.any(searches)
        state = open_offers(state, proposals, offers, clock)

        remaining_lengths = jax.vmap(TimedPath.air_length)(paths, clock)
        plan = eqx.tree_at(
            lambda p: (p.paths, p.certificate, p.lengths, p.arrival_times),
            plan,
            (
                paths,
                jax.tree.map(lambda new, old: select_rows(is_changed, new, old), certificates, plan.certificate),
                jnp.where(under_way, remaining_lengths, plan.lengths),
                jnp.where(accepted, state.agreed_paths.path.times[:, -1], plan.arrival_times),
            ),
        )
        result = jnp.where(is_changed, PARTLY_CORRECTED, jnp.where(goal_has_moved, UNCHANGED, AWAITING_GOAL))
        result = jnp.where(accepted, REPLANNED, jnp.where(under_way & ~corrected, result, CORRECTED))
        result = jnp.where(reports.active, result.astype(planner_state.replanning.dtype), planner_state.replanning)
        return eqx.tree_at(
            lambda m: (m.plan, m.replanning, m.exchange, m.waits, m.replan_needed, m.delays),
            planner_state,
            (plan, result, state, waits | accepted, replan_needed, delays),
        )

    def _clearance(
        self, state: Exchange, approaches: ApproachAndHold, active: Float[Array, " aircraft"], from_time: ScalarLike
    ) -> Bool[Array, "paths paths"]:
        """Mask of the separated pairs of paths, concatenated: agreed, alternative and proposed paths."""
        path_sets = jax.tree.map(
            lambda *leaves: jnp.concatenate(leaves), state.agreed_paths, state.alternative, approaches
        )
        ratios = pairwise_clearance_ratios(path_sets, jnp.tile(active, 3), self.aircraft_planner.airspace, from_time)
        return (ratios >= _CLEARANCE_RATIO_MIN) | jnp.tile(jnp.eye(active.shape[0], dtype=bool), (3, 3))

    def _search_path(
        self,
        planner_state: DecentralisedPlanState,
        state: Exchange,
        paths: TimedPath,
        approaches: ApproachAndHold,
        tasks: AircraftTask,
        searches: Bool[Array, " aircraft"],
        avoids_alternative: Bool[Array, "aircraft aircraft"],
        delays: Float[Array, " aircraft"],
        time: ScalarLike,
    ) -> tuple[ApproachAndHold, Bool[Array, " aircraft"], Float[Array, " aircraft"]]:
        """Search a new path for one aircraft whose path cannot be corrected; the aircraft take turns.

        The path arrives at the arrival time known to the aircraft. Without such a path, the aircraft tries later times,
        and the fleet adopts the delay. A second round of trials may use the acceleration reserve that the first round
        leaves for corrections. Returns the proposed paths, the mask of aircraft with an offer, and the delays, s.
        """
        count, clock = searches.shape[0], planner_state.clocks.clock
        turn = jnp.round(time).astype(jnp.int32) % count
        order = (jnp.arange(count) - turn) % count
        selected = (jnp.arange(count) == jnp.argmin(jnp.where(searches, order, count))) & searches
        planner, agreed_paths, former = self.aircraft_planner, state.agreed_paths.path, state.agreed_paths.hold

        def selected_value(values: Array) -> Array:
            return jnp.sum(jnp.where(selected, values, 0.0))

        start, delay, active = selected_value(clock) + LEAD_S, selected_value(delays), tasks.active > 0.0
        arrivals = planner_state.first_arrivals + delay
        future_goals_n = tasks.goal_position_n + LEAD_S * tasks.goal_velocity_n
        future_tasks = eqx.tree_at(lambda t: t.goal_position_n, tasks, future_goals_n)
        start_tasks = jax.vmap(task_from_plan, in_axes=(0, 0, None))(paths, future_tasks, start)
        start_tasks = eqx.tree_at(lambda t: t.active, start_tasks, jnp.where(selected, tasks.active, 0.0))
        fixed_paths = FixedPaths(active & ~selected, agreed_paths, agreed_paths.times[:, -1])
        extra_delays, try_count = arrival_delays(
            jnp.where(active, arrivals, -jnp.inf),
            start,
            ~active | (arrivals > start + COMMITTED_S + 3.0 * LEAD_S),
            self.arrival_is_free,
            planner.latest_arrival,
            _DELAY_FRACTIONS,
        )
        ladder = AttemptLadder(extra_delays, try_count, tasks.limits, planner.correction_limits(tasks.limits))
        end_time, cells = jnp.max(former.paths.times), former.paths.times.shape[1] - 1
        agreed, alternative, proposed = _set_slices(count)

        def with_holds(path: TimedPath) -> ApproachAndHold:
            fleet_paths = select_rows(selected, path, agreed_paths)
            holds = assign_holds(
                fleet_paths,
                future_tasks,
                planner.airspace,
                planner.guidance,
                start,
                end_time,
                cells,
                former,
                stays=~selected,
            )
            return select_rows(selected, ApproachAndHold(path, broadcast_holds(holds)), approaches)

        def try_arrival(extra_delay: Scalar, limits: PathLimits) -> tuple[Flag, ApproachAndHold]:
            durations = jnp.full(count, jnp.maximum(selected_value(arrivals) + extra_delay - start, COMMITTED_S))
            trial_tasks = eqx.tree_at(lambda t: t.limits, start_tasks, limits)
            plan = plan_fleet_at(
                start, trial_tasks, planner.airspace, durations, interval_count(paths), MINIMAL, fixed_paths=fixed_paths
            )
            is_feasible = jnp.any(selected & plan.feasible)
            proposals = jax.lax.cond(any_in_batch(is_feasible), lambda: with_holds(plan.paths), lambda: approaches)
            is_clear = self._clearance(state, proposals, tasks.active, jnp.min(clock))
            keeps_clear = jnp.all(
                is_clear[proposed, agreed] & (is_clear[proposed, alternative] | ~avoids_alternative), axis=1
            )
            return is_feasible & jnp.any(selected & proposals.hold.clear & keeps_clear), proposals

        def search() -> tuple[ApproachAndHold, Flag, Scalar]:
            has_path, proposals, extra_delay = ladder.first_success(try_arrival, approaches)
            return proposals, has_path, extra_delay

        def keep_proposals() -> tuple[ApproachAndHold, Flag, Scalar]:
            return approaches, jnp.asarray(False), jnp.zeros(())

        proposals, has_path, extra_delay = jax.lax.cond(any_in_batch(jnp.any(selected)), search, keep_proposals)
        offers = selected & (has_path & jnp.any(selected))
        return select_rows(offers, proposals, approaches), offers, jnp.where(offers, delay + extra_delay, delays)

    def observe(
        self,
        planner_state: DecentralisedPlanState,
        reports: AircraftReport,
        number: Integer,
        step: ScalarLike,
        randomness: AbstractRandomness | None,
    ) -> DecentralisedPlanState:
        """Exchange messages if sample `number` is one of an exchange, and advance the clocks by one step (s)."""
        time, is_due = planner_state.time, number % jnp.maximum(self.network.period_samples, 1) == 0

        def communicate() -> tuple[NetworkState, Array]:
            exchange = planner_state.exchange
            broadcast = Broadcast(
                planner_state.clocks.clock, exchange.tokens, exchange.acknowledged, planner_state.delays
            )
            network = self.network.exchange(
                planner_state.network, broadcast, reports.position_n, reports.active, number, time, randomness
            )
            coordinated = reports.active & (
                planner_state.plan.arrival_times - planner_state.clocks.clock > self.aircraft_planner.freeze
            )
            paths, positions_n = self._followed(planner_state), reports.position_n
            return network, clock_accelerations(paths, network, positions_n, reports.active, coordinated, self.gains)

        network, acceleration = jax.lax.cond(
            is_due, communicate, lambda: (planner_state.network, planner_state.clocks.acceleration)
        )
        clocks = eqx.tree_at(lambda c: c.acceleration, planner_state.clocks, acceleration)
        arrived = clocks.clock >= planner_state.plan.arrival_times
        clocks = advance_clocks(clocks, network.knowledge, time, reports.active, arrived, self.gains, step)
        return eqx.tree_at(
            lambda m: (m.network, m.clocks, m.time),
            planner_state,
            (network, clocks, (number + 1) * jnp.asarray(step, dtype=float)),
        )

    def _followed(self, planner_state: DecentralisedPlanState) -> ClockedPath:
        """Return the path that each aircraft flies now, with its clock; leading axis aircraft."""
        clocks = planner_state.clocks
        return ClockedPath(
            path=planner_state.plan.paths,
            next_path=planner_state.exchange.agreed_paths.path,
            has_next_path=planner_state.waits,
            clock=clocks.clock,
            rate=clocks.rate,
            acceleration=clocks.acceleration,
            time=jnp.broadcast_to(planner_state.time, clocks.clock.shape),
        )

    def replan_needed(self, planner_state: DecentralisedPlanState) -> Flag:
        """Whether an aircraft must search a new path but may not (`allow_replanning`): the flight then stops for it."""
        return planner_state.replan_needed

    def plans(self, planner_state: DecentralisedPlanState) -> AircraftPlan:
        """Present paths, arrivals and holds in flight time: the clock of each aircraft delays or advances them."""
        plan, clocks, time = planner_state.plan, planner_state.clocks, planner_state.time
        lag = time - clocks.clock
        to_go = plan.arrival_times - clocks.clock
        arrival_times = jnp.where(to_go > 0.0, time + to_go / clocks.rate, plan.arrival_times + lag)
        count = lag.shape[0]
        holds, shift = planner_state.exchange.agreed_paths.hold, arrival_times - plan.arrival_times
        holds = eqx.tree_at(
            lambda h: (h.paths.times, h.forecast_time),
            holds,
            (holds.paths.times + shift[:, None], holds.forecast_time + shift),
        )
        return AircraftPlan(
            trajectory=self._followed(planner_state),
            arrival_time=arrival_times,
            status=jnp.zeros(count, dtype=jnp.int32),
            length=plan.lengths,
            lateral_bend=jnp.full_like(plan.lengths, jnp.nan),
            replanning=planner_state.replanning,
            hold=holds,
            hold_reach=jnp.full(count, self.tube),
            network=NetworkView(
                lag=lag, rate=clocks.rate, hears=planner_state.network.hears, offers=planner_state.exchange.offer_open
            ),
        )


def _set_slices(count: int) -> tuple[slice, slice, slice]:
    """Slices of agreed, alternative and proposed paths in their concatenation, `count` paths each."""
    return slice(0, count), slice(count, 2 * count), slice(2 * count, 3 * count)
