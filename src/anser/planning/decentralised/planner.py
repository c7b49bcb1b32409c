"""The planner without a centre: each aircraft plans with what it knows, and talks to the others over a network.

Before the flight the aircraft have agreed on an arrival time, the latest that any of them asks for, and on paths
(`anser.missions.consensus`). On the way each bends its own path to where it takes its goal to be; within a tube about
the path that all know by itself, farther only with the word of all others (`path_exchange`). The clocks along the paths
are kept together (`anser.planning.decentralised.time_coordination`): who is kept up is waited for.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.numerics.arrays import any_in_batch, select_rows
from anser.numerics.randomness import AbstractRandomness
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
    arrival_delays,
    correct_path,
    interval_count,
    rendezvous_has_moved,
    task_from_plan,
)
from anser.planning.certified.task import AircraftTask
from anser.planning.certified.timed_profiles import MINIMAL
from anser.planning.decentralised.clocks import ClockedPath, Clocks, advance_clocks, clock_accelerations
from anser.planning.decentralised.network import Broadcast, Network, NetworkState
from anser.planning.decentralised.path_exchange import (
    Exchange,
    concatenate_fleets,
    initial_exchange,
    open_offers,
    path_distance_max,
    process_messages,
)
from anser.planning.decentralised.time_coordination import CoordinationGains
from anser.planning.holds.assignment import assign_holds
from anser.planning.holds.hold_paths import ApproachAndHold, broadcast_holds, move_with_goals, pairwise_clearance_ratios
from anser.planning.limits import PathLimits
from anser.planning.timed_path import TimedPath
from anser.shapes import Count, Flag, Scalar, ScalarLike

LEAD_S = 6.0
"""For this long after it was offered a path is still the one that is flown: so long the others have to answer."""
_CLEARANCE_RATIO_MIN = 1.0 - 1e-7  # ratio of distance to separation
_SAME_TIME_S = 1e-3
_DELAY_FRACTIONS = (0.0, 0.01, 0.02, 0.04, 0.08, 0.15)  # of the time to go: no later than needed, the others follow


class DecentralisedPlanState(eqx.Module):
    """What the planner carries along: of each aircraft only what it would know itself.

    Attributes
    ----------
    plan
        The paths that are flown.
    renewal
        What became of the last renewal of each: index into `REPLANNING_MESSAGES`.
    limits
        As of `CertifiedPlanState`.
    exchange
        What is agreed on.
    clocks, network, time
        Of now; s.
    asked
        Whether a path made anew was wanted that a planner which does not replan could not make.
    waits
        Who flies its former path until the one that is agreed on begins.
    first_arrivals
        Arrivals on which all agreed before the flight, by the clocks, s.
    delays
        By how much each takes all arrivals to be put off, s: the greatest that it has asked for or heard of.
    """

    plan: CertifiedPlan
    replanning: Array
    limits: PathLimits
    exchange: Exchange
    clocks: Clocks
    network: NetworkState
    time: Scalar
    replan_needed: Flag
    waits: Bool[Array, " aircraft"]
    first_arrivals: Float[Array, " aircraft"]
    delays: Float[Array, " aircraft"]


class DecentralisedPlanner(AbstractPlanner):
    """Each aircraft for itself.

    Attributes
    ----------
    each
        Limits, airspace and numbers of the paths; its separation includes twice the tube and the greatest skew.
    network
        Who hears whom.
    gains
        Of the clocks.
    tube
        How far each may depart from the path that all know, m.
    replans
        Whether an aircraft whose path cannot be bent looks for another one on the way.
    """

    aircraft_planner: CertifiedPlanner
    network: Network
    gains: CoordinationGains
    tube: Scalar
    allow_replanning: bool = eqx.field(static=True, default=True)

    def first_plan(self, time: ScalarLike, reports: AircraftReport, performance: Performance) -> DecentralisedPlanState:
        """Not here: the aircraft agree before the flight, see `anser.missions.consensus`."""
        raise ValueError("without a centre a fleet agrees on its first plan beforehand: anser.plan makes it")

    def initial_state(
        self, first_plan: CertifiedPlanState, randomness: AbstractRandomness | None
    ) -> DecentralisedPlanState:
        """State at time 0 with paths and holds that all have agreed on."""
        assert first_plan.holds is not None, "without a centre a fleet agrees on its holds too"
        count, arrivals = first_plan.plan.arrival_times.shape[0], first_plan.plan.arrival_times
        clocks = Clocks(jnp.zeros(count), jnp.ones(count), jnp.zeros(count))
        return DecentralisedPlanState(
            plan=first_plan.plan,
            replanning=jnp.zeros(count, dtype=jnp.int32),
            limits=first_plan.limits,
            exchange=initial_exchange(ApproachAndHold(first_plan.plan.paths, broadcast_holds(first_plan.holds))),
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
        """Answer what was heard, and bend each path to where its rendezvous is now expected."""
        plan, state, clock, known = (
            planner_state.plan,
            planner_state.exchange,
            planner_state.clocks.clock,
            planner_state.network.knowledge,
        )
        tasks = self.aircraft_planner.aircraft_tasks(reports, planner_state.limits)
        to_go = plan.arrival_times - clock
        under_way = reports.active & (to_go > self.aircraft_planner.freeze)
        # A path that all have agreed on is flown from its beginning on, and until then the one before.
        begun = clock >= state.agreed_paths.path.times[:, 0]
        paths = select_rows(planner_state.waits & begun, state.agreed_paths.path, plan.paths)
        waits = planner_state.waits & ~begun
        free = under_way & ~state.offer_open & ~waits
        lead = jnp.minimum(LEAD_S, jnp.maximum(0.25 * to_go, 0.0))
        bent = jax.vmap(correct_path)(paths, tasks, clock, to_go / planner_state.clocks.rate, lead)
        bent = select_rows(free, bent, paths)
        # the latest arrival that anyone has asked for, as far as each has heard
        delays = jnp.maximum(planner_state.delays, jnp.max(known.delays, axis=1))
        behind = planner_state.first_arrivals + delays > state.agreed_paths.path.times[:, -1] + _SAME_TIME_S

        since = jnp.min(clock)
        held_to = self.aircraft_planner.aircraft_tasks(
            reports, self.aircraft_planner.correction_limits(planner_state.limits)
        )
        certificate = certify(bent, held_to, self.aircraft_planner.airspace, interval_count(bent), since)
        near = jax.vmap(path_distance_max)(bent, state.agreed_paths.path) <= self.tube
        wholly = free & certificate.satisfied_individually & near

        def with_part(part: Scalar) -> tuple[TimedPath, Certificate, Bool[Array, " aircraft"]]:
            some = eqx.tree_at(lambda p: p.air_n, paths, paths.air_n + part * (bent.air_n - paths.air_n))
            its = certify(some, held_to, self.aircraft_planner.airspace, interval_count(some), since)
            within = jax.vmap(path_distance_max)(some, state.agreed_paths.path) <= self.tube
            return some, its, free & its.satisfied_individually & within

        def in_part() -> tuple[TimedPath, Certificate, Bool[Array, " aircraft"]]:
            made = jax.lax.map(with_part, jnp.asarray(CORRECTION_FRACTIONS[1:]))
            most = jnp.argmax(made[2], axis=0), jnp.arange(clock.shape[0])
            return jax.tree.map(lambda leaf: leaf[most], made)

        partly = jax.lax.cond(
            any_in_batch(jnp.any(free & ~wholly)), in_part, lambda: (bent, certificate, jnp.zeros_like(wholly))
        )
        bends = wholly | partly[2]
        taken_up, kept = select_rows(wholly, (bent, certificate), partly[:2])
        ways = ApproachAndHold(bent, move_with_goals(state.agreed_paths.hold, tasks, clock))
        agreed, other, mine = _path_set_slices(clock.shape[0])
        clear = jax.lax.cond(
            any_in_batch(jnp.any(~state.settled | (free & ~wholly))),
            lambda: self._clear(state, ways, tasks.active, since),
            lambda: jnp.zeros((3 * clock.shape[0], 3 * clock.shape[0]), dtype=bool),
        )
        # (aircraft, whose): another way than the agreed one that it must keep clear of as well
        reckoned = ~state.settled[None, :] & (state.offer_open[None, :] == (known.tokens == state.tokens[None, :]))
        state, taken = process_messages(
            state, known, clear[other, agreed], clear[other, other], clock, reports.active, LEAD_S - 1.0
        )
        paths = select_rows(bends, taken_up, paths)
        may_offer = free & state.settled & ~behind & ~wholly & (to_go > self.aircraft_planner.freeze + 2.0 * LEAD_S)
        safe = jnp.all(clear[mine, agreed] & (clear[mine, other] | ~reckoned), axis=1)
        offers = may_offer & certificate.satisfied_individually & safe
        sure = under_way
        if reports.goal_covariance is not None:
            sure = jax.vmap(rendezvous_has_moved)(
                paths, tasks, reports.goal_covariance, to_go / planner_state.clocks.rate
            )
        due = behind | (~wholly & sure)
        wanted = free & state.settled & due & ~offers & (to_go > COMMITTED_S + 2.0 * LEAD_S)
        asked = planner_state.replan_needed
        if self.allow_replanning:
            ways, found, delays = self._anew(planner_state, state, paths, ways, tasks, wanted, reckoned, delays, time)
            offers = offers | found
        else:
            asked = asked | jnp.any(wanted)
        state = open_offers(state, ways, offers, clock)

        ahead = jax.vmap(TimedPath.air_length)(paths, clock)
        own = jax.tree.map(lambda new, old: select_rows(bends, new, old), kept, plan.certificate)
        plan = eqx.tree_at(
            lambda p: (p.paths, p.certificate, p.lengths, p.arrival_times),
            plan,
            (
                paths,
                own,
                jnp.where(under_way, ahead, plan.lengths),
                jnp.where(taken, state.agreed_paths.path.times[:, -1], plan.arrival_times),
            ),
        )
        stands = jnp.where(bends, PARTLY_CORRECTED, jnp.where(sure, UNCHANGED, AWAITING_GOAL))
        how = jnp.where(taken, REPLANNED, jnp.where(under_way & ~wholly, stands, CORRECTED)).astype(
            planner_state.replanning.dtype
        )
        return eqx.tree_at(
            lambda m: (m.plan, m.replanning, m.exchange, m.waits, m.replan_needed, m.delays),
            planner_state,
            (plan, jnp.where(reports.active, how, planner_state.replanning), state, waits | taken, asked, delays),
        )

    def _clear(
        self, state: Exchange, approaches: ApproachAndHold, active: Float[Array, " aircraft"], from_time: ScalarLike
    ) -> Bool[Array, "ways ways"]:
        """Which of agreed, other and new ways keep clear of which, one set after the other."""
        three = concatenate_fleets(state.agreed_paths, state.alternative, approaches)
        ratios = pairwise_clearance_ratios(three, jnp.tile(active, 3), self.aircraft_planner.airspace, from_time)
        return (ratios >= _CLEARANCE_RATIO_MIN) | jnp.tile(jnp.eye(active.shape[0], dtype=bool), (3, 3))

    def _anew(
        self,
        planner_state: DecentralisedPlanState,
        state: Exchange,
        paths: TimedPath,
        approaches: ApproachAndHold,
        tasks: AircraftTask,
        wanted: Bool[Array, " aircraft"],
        reckoned: Bool[Array, "aircraft aircraft"],
        delays: Float[Array, " aircraft"],
        time: ScalarLike,
    ) -> tuple[ApproachAndHold, Bool[Array, " aircraft"], Float[Array, " aircraft"]]:
        """A way of another shape for one of those whose path can't be bent, if there is one; they take turns.

        It arrives when the aircraft takes all to arrive; where there is no such way, later, which the others will hear.
        In a second round of tries it may ask for what the first spares for bends.
        """
        count, clock = wanted.shape[0], planner_state.clocks.clock
        turn = jnp.round(time).astype(jnp.int32) % count
        order = (jnp.arange(count) - turn) % count
        who = (jnp.arange(count) == jnp.argmin(jnp.where(wanted, order, count))) & wanted
        space, agreed_paths = self.aircraft_planner.airspace, state.agreed_paths.path

        def of_it(values: Array) -> Array:
            return jnp.sum(jnp.where(who, values, 0.0))

        start, delay, active = of_it(clock) + LEAD_S, of_it(delays), tasks.active > 0.0
        due = planner_state.first_arrivals + delay
        ahead_n = tasks.goal_position_n + LEAD_S * tasks.goal_velocity_n
        ahead = eqx.tree_at(lambda t: t.goal_position_n, tasks, ahead_n)
        here = jax.vmap(task_from_plan, in_axes=(0, 0, None))(paths, ahead, start)
        here = eqx.tree_at(lambda t: t.active, here, jnp.where(who, tasks.active, 0.0))
        standing = FixedPaths(active & ~who, agreed_paths, agreed_paths.times[:, -1])
        put_off, tries = arrival_delays(
            jnp.where(active, due, -jnp.inf),
            start,
            ~active | (due > start + COMMITTED_S + 3.0 * LEAD_S),
            self.aircraft_planner.arrival_is_free,
            self.aircraft_planner.latest_arrival,
            _DELAY_FRACTIONS,
        )
        bent_limits = self.aircraft_planner.correction_limits(tasks.limits)
        until, cells = jnp.max(state.agreed_paths.hold.paths.times), state.agreed_paths.hold.paths.times.shape[1] - 1
        _, _, mine = _path_set_slices(count)

        def held(path: TimedPath) -> ApproachAndHold:
            along = select_rows(who, path, agreed_paths)
            holds = assign_holds(
                along,
                ahead,
                space,
                self.aircraft_planner.guidance,
                start,
                until,
                cells,
                state.agreed_paths.hold,
                stays=~who,
            )
            return select_rows(who, ApproachAndHold(path, broadcast_holds(holds)), approaches)

        def again(carry: tuple[Count, Flag, ApproachAndHold]) -> tuple[Count, Flag, ApproachAndHold]:
            k, _, _ = carry
            durations = jnp.full(count, jnp.maximum(of_it(due) + put_off[k % tries] - start, COMMITTED_S))
            limits = jax.tree.map(lambda new, most: jnp.where(k < tries, new, most), tasks.limits, bent_limits)
            asking = eqx.tree_at(lambda t: t.limits, here, limits)
            plan = plan_fleet_at(start, asking, space, durations, interval_count(paths), MINIMAL, fixed_paths=standing)
            good = jnp.any(who & plan.feasible)
            made = jax.lax.cond(any_in_batch(good), lambda: held(plan.paths), lambda: approaches)
            clear = self._clear(state, made, tasks.active, jnp.min(clock))
            agreed, other, _ = _path_set_slices(count)
            safe = jnp.all(clear[mine, agreed] & (clear[mine, other] | ~reckoned), axis=1)
            return k + 1, good & jnp.any(who & made.hold.clear & safe), made

        def made() -> tuple[ApproachAndHold, Flag, Scalar]:
            k, found, new = jax.lax.while_loop(
                lambda c: (c[0] < 2 * tries) & ~c[1], again, (jnp.asarray(0), jnp.asarray(False), approaches)
            )
            return new, found, put_off[jnp.maximum(k - 1, 0) % tries]

        def none() -> tuple[ApproachAndHold, Flag, Scalar]:
            return approaches, jnp.asarray(False), jnp.zeros(())

        new, found, later = jax.lax.cond(any_in_batch(jnp.any(who)), made, none)
        found = found & jnp.any(who)
        chosen = select_rows(who & found, new, approaches)
        return chosen, who & found, jnp.where(who & found, delay + later, delays)

    def observe(
        self,
        planner_state: DecentralisedPlanState,
        reports: AircraftReport,
        number: Count,
        step: ScalarLike,
        randomness: AbstractRandomness | None,
    ) -> DecentralisedPlanState:
        """Talk to the others where that is due, and let the clocks go on."""
        time, due = planner_state.time, number % jnp.maximum(self.network.period_samples, 1) == 0

        def talked() -> tuple[NetworkState, Array]:
            exchange = planner_state.exchange
            own = Broadcast(planner_state.clocks.clock, exchange.tokens, exchange.acknowledged, planner_state.delays)
            network = self.network.exchange(
                planner_state.network, own, reports.position_n, reports.active, number, time, randomness
            )
            coordinated = reports.active & (
                planner_state.plan.arrival_times - planner_state.clocks.clock > self.aircraft_planner.freeze
            )
            paths, places_n = self._followed(planner_state), reports.position_n
            return network, clock_accelerations(paths, network, places_n, reports.active, coordinated, self.gains)

        network, acceleration = jax.lax.cond(
            due, talked, lambda: (planner_state.network, planner_state.clocks.acceleration)
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
        """What each follows; leading axis aircraft."""
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

    def plans(self, planner_state: DecentralisedPlanState) -> AircraftPlan:
        """The paths in force, each by its clock; arrivals and holds are as late as the clocks."""
        plan, clocks, time = planner_state.plan, planner_state.clocks, planner_state.time
        late = time - clocks.clock
        to_go = plan.arrival_times - clocks.clock
        arrival_times = jnp.where(to_go > 0.0, time + to_go / clocks.rate, plan.arrival_times + late)
        count = late.shape[0]
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
                lag=late,
                rate=clocks.rate,
                hears=planner_state.network.hears,
                offers=planner_state.exchange.offer_open,
            ),
        )


def _path_set_slices(count: int) -> tuple[slice, slice, slice]:
    """Of three sets of so many paths, one after the other."""
    return slice(0, count), slice(count, 2 * count), slice(2 * count, 3 * count)
