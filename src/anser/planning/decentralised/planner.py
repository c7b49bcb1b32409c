"""Decentralised planner: each aircraft plans with its own knowledge and communicates over a network.

Before the flight, the aircraft agree on arrival times and paths (`anser.missions.consensus`). In flight, each aircraft
corrects its path to the estimated goal, within a tube around the path that the fleet knows. Larger changes need the
fleet's acknowledgement (`path_exchange`). The clocks by which the aircraft fly are coordinated, so that the fleet waits
for a delayed aircraft (`time_coordination`).
"""

import dataclasses
from collections.abc import Iterator
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from anser.compiling.options import compiled_quickly
from anser.compiling.program import PreparedProgram
from anser.numerics.arrays import any_in_batch, as_array, select_rows
from anser.numerics.randomness import AbstractRandomness
from anser.parts.paths import AbstractReference, PathPoint
from anser.parts.planners import AbstractPlanner, AircraftPlan, AircraftReport, NetworkView, Performance
from anser.planning.certified.certified_plan import Certificate, CertifiedPlan, FixedPaths, certify, plan_at
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
    next_in_turn,
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
"""Time between an aircraft's offer of a path and the start of this path, s; the fleet must acknowledge in this time."""
_CLEARANCE_RATIO_MIN = 1.0 - 1e-7  # ratio of distance to separation
_SAME_TIME_S = 1e-3
# delays as fractions of the time to go: small delays first, because the fleet follows
_DELAY_FRACTIONS = (0.0, 0.01, 0.02, 0.04, 0.08, 0.15)


class ClockedPath(AbstractReference):
    """Path of one aircraft as a function of the aircraft's clock, which may run faster or slower than flight time."""

    path: TimedPath
    next_path: TimedPath  # if `has_next_path`, this path replaces `path` as soon as it starts
    has_next_path: Flag
    # clock (s), its rate (1: as fast as flight time) and acceleration (1/s) at the flight time `time` (s)
    clock: Scalar
    rate: Scalar
    acceleration: Scalar
    time: Scalar

    def at(self, time: ScalarLike) -> PathPoint:
        """Return position, velocity and acceleration over the ground at a flight time (s); NED, m, m/s, m/s^2."""
        clock = self.clock + self.rate * (time - self.time)
        on_next_path = self.has_next_path & (clock >= self.next_path.start_time)
        point = jax.tree.map(lambda a, b: jnp.where(on_next_path, a, b), self.next_path.at(clock), self.path.at(clock))
        bend_n = self.rate**2 * point.acceleration_n + self.acceleration * point.velocity_n
        return PathPoint(point.position_n, self.rate * point.velocity_n, bend_n)

    @property
    def duration(self) -> Scalar:
        """Duration of the present path by the aircraft's clock, s."""
        return self.path.duration


class Clocks(eqx.Module):
    """Clocks (s) by which the aircraft of a fleet fly along their paths; clock rates (no unit), accelerations (1/s)."""

    clock: Float[Array, " aircraft"]
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
    """Return the acceleration of each aircraft's clock, 1/s, by the coordination law, from the received messages."""
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
    """Return the clocks after one `step` (s) that begins at `time` (s), with rates limited by `bounded_rate`.

    `knowledge` has the last clocks received from the other aircraft. `active` and `arrived` are masks: the clock of an
    aircraft that has arrived or is inactive runs at rate 1.
    """
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
    """State of the decentralised planner; leading axis aircraft. Each aircraft knows only its own entries."""

    plan: CertifiedPlan  # plan with the flown paths; times of the plan are readings of the aircraft's `clocks`
    replanning: Array  # origin of the plan: FIRST_PLAN, ... of `anser.planning.certified.replanning`
    limits: PathLimits  # flight limits of each path, including the accelerations available from the engine
    exchange: Exchange  # offered, agreed and acknowledged paths
    clocks: Clocks  # clocks by which the aircraft fly along their paths
    network: NetworkState  # links, messages under way, and knowledge of each aircraft
    time: Scalar  # flight time, s
    replan_needed: Flag  # whether an aircraft must search for another path
    waits: Bool[Array, " aircraft"]  # mask of the aircraft whose newly agreed path has not begun
    first_arrivals: Float[Array, " aircraft"]  # arrival times agreed before the flight, s
    delays: Float[Array, " aircraft"]  # greatest delay of all arrivals that an aircraft requested or heard of, s


class _Correction(eqx.Module):
    """Corrected paths of a fleet, and the aircraft that offer or must search for another path."""

    planner_state: DecentralisedPlanState  # state with corrected paths and processed messages
    tasks: AircraftTask  # tasks to the goals measured now
    proposals: ApproachAndHold  # path that each aircraft may offer
    offers: Bool[Array, " aircraft"]  # mask of the aircraft that offer their proposal
    searches: Bool[Array, " aircraft"]  # mask of the aircraft that need another path than the proposed one
    # (aircraft, owner): whether the aircraft must keep clear of the owner's alternative path too
    avoids_alternative: Bool[Array, "aircraft aircraft"]

    def with_offers(self, offers: Bool[Array, " aircraft"]) -> Exchange:
        """Return the state of the agreement after the aircraft in the mask `offers` have offered their proposals."""
        state = self.planner_state
        return open_offers(state.exchange, self.proposals, offers, state.clocks.clock)


class _CorrectionLoop(eqx.Module):
    """State of the loop that finds the largest fraction by which each aircraft's path can be corrected."""

    attempt: Integer  # index of the next fraction in (*CORRECTION_FRACTIONS, 0)
    # paths corrected by the largest fraction that fits: the corrected path keeps limits, keep-outs and tube
    paths: TimedPath
    certificate: Certificate  # certificate of these paths
    is_changed: Bool[Array, " aircraft"]  # mask of the aircraft with a fraction that fits
    corrected: Bool[Array, " aircraft"]  # mask of the aircraft whose whole correction fits
    within_limits: Bool[Array, " aircraft"]  # mask of the aircraft whose whole correction keeps the limits
    # mask of the aircraft with a fraction that fits, or whose uncorrected path keeps the limits
    keeps_limits: Bool[Array, " aircraft"]


class _PathSearch(eqx.Module):
    """Problem of finding a new path for one aircraft; times by the aircraft's clock."""

    start: Scalar  # start of the path, s
    arrival: Scalar  # arrival time known to the aircraft, s
    tasks: AircraftTask  # tasks from the planned states at the start, with this aircraft active
    fixed_paths: FixedPaths  # agreed paths of the other aircraft
    ladder: AttemptLadder  # arrival delays and limits to try, in order


class DecentralisedPlanner(AbstractPlanner):
    """Planner of a fleet without a central planner: each aircraft plans for itself and communicates over a network."""

    searches_often: ClassVar[bool] = True
    # planner by which each aircraft plans. Its separation must exceed the required separation by twice the `tube`, plus
    # the distance flown in the greatest time by which two aircraft's `Clocks` differ
    aircraft_planner: CertifiedPlanner
    network: Network  # communication network
    gains: CoordinationGains  # gains by which an aircraft adjusts its clock to the other clocks
    tube: Scalar  # greatest distance of a flown path from the agreed path, m

    def first_plan(self, time: ScalarLike, reports: AircraftReport, performance: Performance) -> DecentralisedPlanState:
        """Raise ValueError: `anser.missions.consensus` makes the first plan of a decentralised fleet, by messages."""
        raise ValueError("without a centre a fleet agrees on its first plan beforehand: anser.plan makes it")

    def initial_state(
        self, plan_state: CertifiedPlanState, randomness: AbstractRandomness | None
    ) -> DecentralisedPlanState:
        """Return the planner state at time 0, with the paths and holds agreed before the flight (`plan_state`)."""
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
        """Let each aircraft process messages, correct its path to the predicted rendezvous, and offer another path.

        `replan_needed` is set in the returned state if an aircraft must search for another path.
        """
        correction = self._correct(planner_state, reports)
        state, is_missing = correction.planner_state, jnp.any(correction.searches)
        return dataclasses.replace(
            state, exchange=correction.with_offers(correction.offers), replan_needed=state.replan_needed | is_missing
        )

    def replan_between_steps(
        self, planner_state: DecentralisedPlanState, time: float, reports: AircraftReport
    ) -> DecentralisedPlanState:
        """Return the planner state after corrections as by `replan`, and after the search for one aircraft's new path.

        The aircraft that need a new path take turns, one per call. The search tries the arrival time known to the
        aircraft first, then later times. The aircraft offers the first path that is clear of the fleet; if this path
        arrives later, the aircraft requests the delay for all arrivals of the fleet.
        """
        correction = _correct(self, planner_state, reports)
        searches = np.flatnonzero(correction.searches)
        if not searches.size:
            return _open_offers(correction)
        count = len(correction.searches)
        aircraft = next_in_turn(searches, time)
        is_selected = as_array(np.arange(count) == aircraft, bool)
        search = _path_search(self, correction, is_selected)
        for delay, limits in search.ladder.attempts():
            duration = max(float(search.arrival) + delay - float(search.start), COMMITTED_S)
            plan = plan_at(
                search.start,
                eqx.tree_at(lambda t: t.limits, search.tasks, limits),
                self.aircraft_planner.airspace,
                as_array(np.full(count, duration)),
                interval_count(planner_state.plan.paths),
                MINIMAL,
                search.fixed_paths,
            )
            if plan.feasible[aircraft]:
                is_clear, proposals = _propose(self, correction, search, plan.paths, is_selected)
                if is_clear:
                    return _open_offers(correction, proposals, is_selected, as_array(delay))
        return _open_offers(correction)

    def prepare_replanning(
        self, planner_state: DecentralisedPlanState, reports: AircraftReport
    ) -> Iterator[PreparedProgram]:
        """Yield the programs of `replan_between_steps`, but not of `plan_at`, for the shapes of the arguments."""
        program = _correct.prepare(self, planner_state, reports)
        yield program
        correction, selected = program.shapes, reports.active
        search = _path_search.prepare(self, correction, selected)
        yield search
        yield _propose.prepare(self, correction, search.shapes, planner_state.plan.paths, selected)

    def _correct(self, planner_state: DecentralisedPlanState, reports: AircraftReport) -> _Correction:
        """Process received messages, and correct each path as far as its limits, the keep-outs and its tube allow."""
        plan, state, planner = planner_state.plan, planner_state.exchange, self.aircraft_planner
        clocks, knowledge = planner_state.clocks, planner_state.network.knowledge
        clock = clocks.clock
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
        delays = jnp.maximum(planner_state.delays, jnp.max(knowledge.delays, axis=1))  # greatest delay known to each
        is_late = planner_state.first_arrivals + delays > state.agreed_paths.path.times[:, -1] + _SAME_TIME_S

        from_time = jnp.min(clock)
        correction_tasks = planner.aircraft_tasks(reports, planner.correction_limits(planner_state.limits))

        def correct_by(share: Scalar) -> tuple[TimedPath, Certificate, Bool[Array, " aircraft"]]:
            candidate = eqx.tree_at(lambda p: p.air_n, paths, paths.air_n + share * (bent.air_n - paths.air_n))
            certificate = certify(candidate, correction_tasks, planner.airspace, interval_count(candidate), from_time)
            in_tube = jax.vmap(path_distance_max)(candidate, state.agreed_paths.path) <= self.tube
            return candidate, certificate, may_change & certificate.satisfied_individually & in_tube

        def correct_further(carry: _CorrectionLoop) -> _CorrectionLoop:
            candidate, certificate, fits = correct_by(jnp.asarray((*CORRECTION_FRACTIONS, 0.0))[carry.attempt])
            is_whole, is_none = carry.attempt == 0, carry.attempt == len(CORRECTION_FRACTIONS)
            fits = fits & ~is_none
            chosen = fits & ~carry.is_changed
            return _CorrectionLoop(
                carry.attempt + 1,
                select_rows(chosen, candidate, carry.paths),
                select_rows(chosen, certificate, carry.certificate),
                carry.is_changed | fits,
                jnp.where(is_whole, fits, carry.corrected),
                jnp.where(is_whole, certificate.satisfied_individually, carry.within_limits),
                jnp.where(is_none, carry.is_changed | certificate.satisfied_individually, carry.keeps_limits),
            )

        def is_incomplete(carry: _CorrectionLoop) -> Flag:
            return (carry.attempt <= len(CORRECTION_FRACTIONS)) & jnp.any(may_change & ~carry.is_changed)

        none = jnp.zeros_like(may_change)
        begin = _CorrectionLoop(jnp.asarray(0), paths, plan.certificate, none, none, none, ~none)
        loop = jax.lax.while_loop(is_incomplete, correct_further, begin)
        corrected, is_changed = loop.corrected, loop.is_changed
        proposals = ApproachAndHold(bent, move_with_goals(state.agreed_paths.hold, tasks, clock))
        agreed, alternative, _ = _set_slices(clock.shape[0])
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
            lead - 1.0,
        )
        paths = loop.paths
        may_offer = may_change & state.settled & ~is_late & ~corrected & (to_go > planner.freeze + 2.0 * LEAD_S)
        keeps_clear = _keeps_clear(is_clear, avoids_alternative)
        offers = may_offer & loop.within_limits & keeps_clear
        goal_has_moved = under_way
        if reports.goal_covariance is not None:
            goal_has_moved = jax.vmap(rendezvous_has_moved)(paths, tasks, reports.goal_covariance, time_to_go)
        needs_path = is_late | (~corrected & (goal_has_moved | ~loop.keeps_limits))
        searches = may_change & state.settled & needs_path & ~offers & (to_go > COMMITTED_S + 2.0 * LEAD_S)
        remaining_lengths = jax.vmap(TimedPath.air_length)(paths, clock)
        plan = dataclasses.replace(
            plan,
            paths=paths,
            certificate=loop.certificate,
            lengths=jnp.where(under_way, remaining_lengths, plan.lengths),
            arrival_times=jnp.where(accepted, state.agreed_paths.path.times[:, -1], plan.arrival_times),
        )
        result = jnp.where(is_changed, PARTLY_CORRECTED, jnp.where(goal_has_moved, UNCHANGED, AWAITING_GOAL))
        result = jnp.where(accepted, REPLANNED, jnp.where(under_way & ~corrected, result, CORRECTED))
        result = jnp.where(reports.active, result.astype(planner_state.replanning.dtype), planner_state.replanning)
        planner_state = dataclasses.replace(
            planner_state, plan=plan, replanning=result, exchange=state, waits=waits | accepted, delays=delays
        )
        return _Correction(planner_state, tasks, proposals, offers, searches, avoids_alternative)

    def _clearance(
        self, state: Exchange, approaches: ApproachAndHold, active: Float[Array, " aircraft"], from_time: ScalarLike
    ) -> Bool[Array, "paths paths"]:
        """Return the mask of the pairs of paths that keep the separation from `from_time` (s) on; (path, path).

        The paths with their holds are, in this order: agreed paths, alternative paths, proposed paths (`approaches`).
        Two paths of one aircraft count as separated, as do paths of inactive aircraft.
        """
        path_sets = jax.tree.map(
            lambda *leaves: jnp.concatenate(leaves), state.agreed_paths, state.alternative, approaches
        )
        ratios = pairwise_clearance_ratios(path_sets, jnp.tile(active, 3), self.aircraft_planner.airspace, from_time)
        return (ratios >= _CLEARANCE_RATIO_MIN) | jnp.tile(jnp.eye(active.shape[0], dtype=bool), (3, 3))

    def _path_search(self, correction: _Correction, selected: Bool[Array, " aircraft"]) -> _PathSearch:
        """Return the search problem for the aircraft in the mask `selected`; its new path starts after `LEAD_S`."""
        planner_state, tasks, planner = correction.planner_state, correction.tasks, self.aircraft_planner
        agreed_paths, clock = planner_state.exchange.agreed_paths.path, planner_state.clocks.clock

        def selected_value(values: Array) -> Array:
            return jnp.sum(jnp.where(selected, values, 0.0))

        start, active = selected_value(clock) + LEAD_S, tasks.active > 0.0
        arrivals = planner_state.first_arrivals + selected_value(planner_state.delays)
        delays, delay_count = arrival_delays(
            jnp.where(active, arrivals, -jnp.inf),
            start,
            ~active | (arrivals > start + COMMITTED_S + 3.0 * LEAD_S),
            self.arrival_is_free,
            planner.latest_arrival,
            _DELAY_FRACTIONS,
        )
        start_tasks = jax.vmap(task_from_plan, in_axes=(0, 0, None))(
            planner_state.plan.paths, _tasks_at_start(tasks), start
        )
        return _PathSearch(
            start,
            selected_value(arrivals),
            eqx.tree_at(lambda t: t.active, start_tasks, jnp.where(selected, tasks.active, 0.0)),
            FixedPaths(active & ~selected, agreed_paths, agreed_paths.times[:, -1]),
            AttemptLadder(delays, delay_count, tasks.limits, planner.correction_limits(tasks.limits)),
        )

    def _propose(
        self,
        correction: _Correction,
        search: _PathSearch,
        paths: TimedPath,  # paths of a plan
        selected: Bool[Array, " aircraft"],  # mask that selects the aircraft with the new path
    ) -> tuple[Flag, ApproachAndHold]:
        """Return whether a new path with a hold is clear of the fleet, and the proposals with the new path and hold."""
        planner, exchange = self.aircraft_planner, correction.planner_state.exchange
        former = exchange.agreed_paths.hold
        holds = assign_holds(
            select_rows(selected, paths, exchange.agreed_paths.path),
            _tasks_at_start(correction.tasks),
            planner.airspace,
            planner.guidance,
            search.start,
            jnp.max(former.paths.times),
            former.paths.times.shape[1] - 1,
            former,
            stays=~selected,
        )
        proposals = select_rows(selected, ApproachAndHold(paths, broadcast_holds(holds)), correction.proposals)
        clocks, active = correction.planner_state.clocks.clock, correction.tasks.active
        is_clear = self._clearance(exchange, proposals, active, jnp.min(clocks))
        keeps_clear = _keeps_clear(is_clear, correction.avoids_alternative)
        return jnp.any(selected & proposals.hold.clear & keeps_clear), proposals

    def observe(
        self,
        planner_state: DecentralisedPlanState,
        reports: AircraftReport,
        number: Integer,
        step: ScalarLike,
        randomness: AbstractRandomness | None,
    ) -> DecentralisedPlanState:
        """Advance the clocks by `step` (s), exchange messages if due at sample `number`; return the state."""
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
        return dataclasses.replace(
            planner_state, network=network, clocks=clocks, time=(number + 1) * jnp.asarray(step, dtype=float)
        )

    def _followed(self, planner_state: DecentralisedPlanState) -> ClockedPath:
        """Return the path that each aircraft flies now, its next path and its clock; leading axis aircraft."""
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
        """Whether an aircraft must search for a new path: the flight then stops for `replan_between_steps`."""
        return planner_state.replan_needed

    def plans(self, planner_state: DecentralisedPlanState) -> AircraftPlan:
        """Return the plan of each aircraft, with arrival time and hold converted from the clock to flight time."""
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
    """Return the slices of agreed, alternative and proposed paths, `count` each, in their concatenation."""
    return slice(0, count), slice(count, 2 * count), slice(2 * count, 3 * count)


def _keeps_clear(
    is_clear: Bool[Array, "paths paths"], avoids_alternative: Bool[Array, "aircraft aircraft"]
) -> Bool[Array, " aircraft"]:
    """Return the mask of the proposed paths that are separated from every path that the other aircraft may fly.

    `is_clear`: see `_clearance`; `avoids_alternative`: see `_Correction`.
    """
    agreed, alternative, proposed = _set_slices(avoids_alternative.shape[0])
    return jnp.all(is_clear[proposed, agreed] & (is_clear[proposed, alternative] | ~avoids_alternative), axis=1)


def _tasks_at_start(tasks: AircraftTask) -> AircraftTask:
    """Return the tasks with the goals at their positions `LEAD_S` later, when an offered path starts."""
    return eqx.tree_at(lambda t: t.goal_position_n, tasks, tasks.goal_position_n + LEAD_S * tasks.goal_velocity_n)


_correct = compiled_quickly(DecentralisedPlanner._correct)
_path_search = compiled_quickly(DecentralisedPlanner._path_search)
_propose = compiled_quickly(DecentralisedPlanner._propose)


@compiled_quickly
def _open_offers(
    correction: _Correction,
    proposals: ApproachAndHold | None = None,  # proposals with a new path; None: no aircraft has found one
    selected: Bool[Array, " aircraft"] | None = None,  # mask of the aircraft with the new path
    extra_delay: Scalar | None = None,  # additional delay of all arrivals of the fleet that the new path requires, s
) -> DecentralisedPlanState:
    """Return the planner state after the offers of the correction and the offer of a newly found path, if any."""
    state, offers = correction.planner_state, correction.offers
    if proposals is None or selected is None or extra_delay is None:
        return eqx.tree_at(lambda s: s.exchange, state, correction.with_offers(offers))
    correction = eqx.tree_at(lambda c: c.proposals, correction, proposals)
    delay = jnp.sum(jnp.where(selected, state.delays, 0.0)) + extra_delay
    delays = jnp.where(selected, delay, state.delays)
    exchange = correction.with_offers(offers | selected)
    return eqx.tree_at(lambda s: (s.exchange, s.delays), state, (exchange, delays))
