"""The planner without a centre: each aircraft plans with what it knows, and talks to the others over a network.

Before the flight the aircraft have agreed on an arrival time, the latest that any of them asks for, and on paths
(`anser.execution.negotiated`). On the way each bends its own path to where it takes its goal to be; within a tube about
the path that all know by itself, farther only with the word of all others (`path_exchange`). The clocks along the paths
are kept together (`anser.planning.time_coordination`): who is kept up is waited for.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.numerics import AbstractRandomness, any_in_batch
from anser.numerics.stacking import rows_where
from anser.planning import (
    AbstractPlanner,
    AircraftPlan,
    NetworkView,
    PathLimits,
    Performance,
    Report,
)
from anser.planning.certified import REPLANNED, CertifiedPlan, Standing
from anser.planning.certified.candidate_sets import MINIMAL
from anser.planning.certified.certified_plan import Certificate, certify, plan_fleet_at
from anser.planning.certified.renewal import (
    AWAITING,
    BENT_IN_PART,
    COMMITTED_S,
    CORRECTED,
    KEPT,
    PARTS_BENT,
    corrected,
    from_plan,
    intervals_of,
    postponements,
    surely_elsewhere,
)
from anser.planning.certified.task import AircraftTask
from anser.planning.time_coordination import CoordinationGains
from anser.planning.timed_path import TimedPath
from anser.shapes import Count, Flag, Scalar, ScalarLike
from anser.simulation.certified_planner import CertifiedPlanner, CertifiedPlanState
from anser.simulation.clocks import ClockedPath, Clocks, accelerations, clocks_after
from anser.simulation.hold_assignment import assign_holds
from anser.simulation.network import Network, NetworkState, OwnWord
from anser.simulation.path_exchange import (
    Exchange,
    after_word,
    agreed_on,
    farthest_apart,
    stacked_ways,
    with_offers,
)
from anser.simulation.planned_hold import each_alone, moved_with_goals
from anser.simulation.way import Way, clearance_ratios

LEAD_S = 6.0
"""For this long after it was offered a path is still the one that is flown: so long the others have to answer."""
_ENOUGH = 1.0 - 1e-7  # ratio of distance to separation
_SAME_TIME_S = 1e-3
_LATER = (0.0, 0.01, 0.02, 0.04, 0.08, 0.15)  # of the time to go: no later than needed, the others follow


class DecentralisedPlanState(eqx.Module):
    """What the planner carries along: of each aircraft only what it would know itself.

    Attributes
    ----------
    plan
        The paths that are flown.
    renewal
        What became of the last renewal of each: index into `RENEWAL_MESSAGES`.
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
    renewal: Array
    limits: PathLimits
    exchange: Exchange
    clocks: Clocks
    network: NetworkState
    time: Scalar
    asked: Flag
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

    each: CertifiedPlanner
    network: Network
    gains: CoordinationGains
    tube: Scalar
    replans: bool = eqx.field(static=True, default=True)

    def first(self, time: ScalarLike, reports: Report, performance: Performance) -> DecentralisedPlanState:
        """Not here: the aircraft agree before the flight, see `anser.execution.negotiated`."""
        raise ValueError("without a centre a fleet agrees on its first plan beforehand: anser.plan makes it")

    def begun(self, first: CertifiedPlanState, randomness: AbstractRandomness | None) -> DecentralisedPlanState:
        """State at time 0 with paths and holds that all have agreed on."""
        assert first.holds is not None, "without a centre a fleet agrees on its holds too"
        count, arrivals = first.plan.arrival_times.shape[0], first.plan.arrival_times
        clocks = Clocks(jnp.zeros(count), jnp.ones(count), jnp.zeros(count))
        return DecentralisedPlanState(
            plan=first.plan,
            renewal=jnp.zeros(count, dtype=jnp.int32),
            limits=first.limits,
            exchange=agreed_on(Way(first.plan.paths, each_alone(first.holds))),
            clocks=clocks,
            network=self.network.init(clocks.clock, randomness),
            time=jnp.zeros(()),
            asked=jnp.asarray(False),
            waits=jnp.zeros(count, dtype=bool),
            first_arrivals=arrivals,
            delays=jnp.zeros(count),
        )

    def renew(self, memory: DecentralisedPlanState, time: ScalarLike, reports: Report) -> DecentralisedPlanState:
        """Answer what was heard, and bend each path to where its rendezvous is now expected."""
        plan, state, clock, known = memory.plan, memory.exchange, memory.clocks.clock, memory.network.known
        tasks = self.each.aircraft_tasks(reports, memory.limits)
        to_go = plan.arrival_times - clock
        under_way = reports.active & (to_go > self.each.freeze)
        # A path that all have agreed on is flown from its beginning on, and until then the one before.
        begun = clock >= state.agreed.path.times[:, 0]
        paths = rows_where(memory.waits & begun, state.agreed.path, plan.paths)
        waits = memory.waits & ~begun
        free = under_way & ~state.open & ~waits
        lead = jnp.minimum(LEAD_S, jnp.maximum(0.25 * to_go, 0.0))
        bent = jax.vmap(corrected)(paths, tasks, clock, to_go / memory.clocks.rate, lead)
        bent = rows_where(free, bent, paths)
        # the latest arrival that anyone has asked for, as far as each has heard
        delays = jnp.maximum(memory.delays, jnp.max(known.delays, axis=1))
        behind = memory.first_arrivals + delays > state.agreed.path.times[:, -1] + _SAME_TIME_S

        since = jnp.min(clock)
        held_to = self.each.aircraft_tasks(reports, self.each.when_bent(memory.limits))
        certificate = certify(bent, held_to, self.each.airspace, intervals_of(bent), since)
        near = jax.vmap(farthest_apart)(bent, state.agreed.path) <= self.tube
        wholly = free & certificate.kept_alone & near

        def with_part(part: Scalar) -> tuple[TimedPath, Certificate, Bool[Array, " aircraft"]]:
            some = eqx.tree_at(lambda p: p.air_n, paths, paths.air_n + part * (bent.air_n - paths.air_n))
            its = certify(some, held_to, self.each.airspace, intervals_of(some), since)
            within = jax.vmap(farthest_apart)(some, state.agreed.path) <= self.tube
            return some, its, free & its.kept_alone & within

        def in_part() -> tuple[TimedPath, Certificate, Bool[Array, " aircraft"]]:
            made = jax.lax.map(with_part, jnp.asarray(PARTS_BENT[1:]))
            most = jnp.argmax(made[2], axis=0), jnp.arange(clock.shape[0])
            return jax.tree.map(lambda leaf: leaf[most], made)

        partly = jax.lax.cond(
            any_in_batch(jnp.any(free & ~wholly)), in_part, lambda: (bent, certificate, jnp.zeros_like(wholly))
        )
        bends = wholly | partly[2]
        taken_up, kept = rows_where(wholly, (bent, certificate), partly[:2])
        ways = Way(bent, moved_with_goals(state.agreed.hold, tasks, clock))
        agreed, other, mine = _sets(clock.shape[0])
        clear = jax.lax.cond(
            any_in_batch(jnp.any(~state.settled | (free & ~wholly))),
            lambda: self._clear(state, ways, tasks.active, since),
            lambda: jnp.zeros((3 * clock.shape[0], 3 * clock.shape[0]), dtype=bool),
        )
        # (aircraft, whose): another way than the agreed one that it must keep clear of as well
        reckoned = ~state.settled[None, :] & (state.open[None, :] == (known.tokens == state.tokens[None, :]))
        state, taken = after_word(
            state, known, clear[other, agreed], clear[other, other], clock, reports.active, LEAD_S - 1.0
        )
        paths = rows_where(bends, taken_up, paths)
        may_offer = free & state.settled & ~behind & ~wholly & (to_go > self.each.freeze + 2.0 * LEAD_S)
        safe = jnp.all(clear[mine, agreed] & (clear[mine, other] | ~reckoned), axis=1)
        offers = may_offer & certificate.kept_alone & safe
        sure = under_way
        if reports.goal_covariance is not None:
            sure = jax.vmap(surely_elsewhere)(paths, tasks, reports.goal_covariance, to_go / memory.clocks.rate)
        due = behind | (~wholly & sure)
        wanted = free & state.settled & due & ~offers & (to_go > COMMITTED_S + 2.0 * LEAD_S)
        asked = memory.asked
        if self.replans:
            ways, found, delays = self._anew(memory, state, paths, ways, tasks, wanted, reckoned, delays, time)
            offers = offers | found
        else:
            asked = asked | jnp.any(wanted)
        state = with_offers(state, ways, offers, clock)

        ahead = jax.vmap(TimedPath.air_length)(paths, clock)
        own = jax.tree.map(lambda new, old: rows_where(bends, new, old), kept, plan.certificate)
        plan = eqx.tree_at(
            lambda p: (p.paths, p.certificate, p.lengths, p.arrival_times),
            plan,
            (
                paths,
                own,
                jnp.where(under_way, ahead, plan.lengths),
                jnp.where(taken, state.agreed.path.times[:, -1], plan.arrival_times),
            ),
        )
        stands = jnp.where(bends, BENT_IN_PART, jnp.where(sure, KEPT, AWAITING))
        how = jnp.where(taken, REPLANNED, jnp.where(under_way & ~wholly, stands, CORRECTED)).astype(
            memory.renewal.dtype
        )
        return eqx.tree_at(
            lambda m: (m.plan, m.renewal, m.exchange, m.waits, m.asked, m.delays),
            memory,
            (plan, jnp.where(reports.active, how, memory.renewal), state, waits | taken, asked, delays),
        )

    def _clear(
        self, state: Exchange, ways: Way, active: Float[Array, " aircraft"], since: ScalarLike
    ) -> Bool[Array, "ways ways"]:
        """Which of agreed, other and new ways keep clear of which, one set after the other."""
        three = stacked_ways(state.agreed, state.other, ways)
        ratios = clearance_ratios(three, jnp.tile(active, 3), self.each.airspace, since)
        return (ratios >= _ENOUGH) | jnp.tile(jnp.eye(active.shape[0], dtype=bool), (3, 3))

    def _anew(
        self,
        memory: DecentralisedPlanState,
        state: Exchange,
        paths: TimedPath,
        ways: Way,
        tasks: AircraftTask,
        wanted: Bool[Array, " aircraft"],
        reckoned: Bool[Array, "aircraft aircraft"],
        delays: Float[Array, " aircraft"],
        time: ScalarLike,
    ) -> tuple[Way, Bool[Array, " aircraft"], Float[Array, " aircraft"]]:
        """A way of another shape for one of those whose path can't be bent, if there is one; they take turns.

        It arrives when the aircraft takes all to arrive; where there is no such way, later, which the others will hear.
        In a second round of tries it may ask for what the first spares for bends.
        """
        count, clock = wanted.shape[0], memory.clocks.clock
        turn = jnp.round(time).astype(jnp.int32) % count
        order = (jnp.arange(count) - turn) % count
        who = (jnp.arange(count) == jnp.argmin(jnp.where(wanted, order, count))) & wanted
        space, agreed_paths = self.each.airspace, state.agreed.path

        def of_it(values: Array) -> Array:
            return jnp.sum(jnp.where(who, values, 0.0))

        start, delay, active = of_it(clock) + LEAD_S, of_it(delays), tasks.active > 0.0
        due = memory.first_arrivals + delay
        ahead_n = tasks.goal_position_n + LEAD_S * tasks.goal_velocity_n
        ahead = eqx.tree_at(lambda t: t.goal_position_n, tasks, ahead_n)
        here = jax.vmap(from_plan, in_axes=(0, 0, None))(paths, ahead, start)
        here = eqx.tree_at(lambda t: t.active, here, jnp.where(who, tasks.active, 0.0))
        standing = Standing(active & ~who, agreed_paths, agreed_paths.times[:, -1])
        put_off, tries = postponements(
            jnp.where(active, due, -jnp.inf),
            start,
            ~active | (due > start + COMMITTED_S + 3.0 * LEAD_S),
            self.each.movable,
            self.each.latest,
            _LATER,
        )
        bent_limits = self.each.when_bent(tasks.limits)
        until, cells = jnp.max(state.agreed.hold.paths.times), state.agreed.hold.paths.times.shape[1] - 1
        _, _, mine = _sets(count)

        def held(path: TimedPath) -> Way:
            along = rows_where(who, path, agreed_paths)
            holds = assign_holds(
                along, ahead, space, self.each.guidance, start, until, cells, state.agreed.hold, stays=~who
            )
            return rows_where(who, Way(path, each_alone(holds)), ways)

        def again(carry: tuple[Count, Flag, Way]) -> tuple[Count, Flag, Way]:
            k, _, _ = carry
            durations = jnp.full(count, jnp.maximum(of_it(due) + put_off[k % tries] - start, COMMITTED_S))
            limits = jax.tree.map(lambda new, most: jnp.where(k < tries, new, most), tasks.limits, bent_limits)
            asking = eqx.tree_at(lambda t: t.limits, here, limits)
            plan = plan_fleet_at(start, asking, space, durations, intervals_of(paths), MINIMAL, standing=standing)
            good = jnp.any(who & plan.feasible)
            made = jax.lax.cond(any_in_batch(good), lambda: held(plan.paths), lambda: ways)
            clear = self._clear(state, made, tasks.active, jnp.min(clock))
            agreed, other, _ = _sets(count)
            safe = jnp.all(clear[mine, agreed] & (clear[mine, other] | ~reckoned), axis=1)
            return k + 1, good & jnp.any(who & made.hold.clear & safe), made

        def made() -> tuple[Way, Flag, Scalar]:
            k, found, new = jax.lax.while_loop(
                lambda c: (c[0] < 2 * tries) & ~c[1], again, (jnp.asarray(0), jnp.asarray(False), ways)
            )
            return new, found, put_off[jnp.maximum(k - 1, 0) % tries]

        def none() -> tuple[Way, Flag, Scalar]:
            return ways, jnp.asarray(False), jnp.zeros(())

        new, found, later = jax.lax.cond(any_in_batch(jnp.any(who)), made, none)
        found = found & jnp.any(who)
        chosen = rows_where(who & found, new, ways)
        return chosen, who & found, jnp.where(who & found, delay + later, delays)

    def observe(
        self,
        memory: DecentralisedPlanState,
        reports: Report,
        number: Count,
        step: ScalarLike,
        randomness: AbstractRandomness | None,
    ) -> DecentralisedPlanState:
        """Talk to the others where that is due, and let the clocks go on."""
        time, due = memory.time, number % jnp.maximum(self.network.every, 1) == 0

        def talked() -> tuple[NetworkState, Array]:
            exchange = memory.exchange
            own = OwnWord(memory.clocks.clock, exchange.tokens, exchange.acknowledged, memory.delays)
            network = self.network.exchange(
                memory.network, own, reports.position_n, reports.active, number, time, randomness
            )
            coordinated = reports.active & (memory.plan.arrival_times - memory.clocks.clock > self.each.freeze)
            paths, places_n = self._followed(memory), reports.position_n
            return network, accelerations(paths, network, places_n, reports.active, coordinated, self.gains)

        network, acceleration = jax.lax.cond(due, talked, lambda: (memory.network, memory.clocks.acceleration))
        clocks = eqx.tree_at(lambda c: c.acceleration, memory.clocks, acceleration)
        arrived = clocks.clock >= memory.plan.arrival_times
        clocks = clocks_after(clocks, network.known, time, reports.active, arrived, self.gains, step)
        return eqx.tree_at(
            lambda m: (m.network, m.clocks, m.time),
            memory,
            (network, clocks, (number + 1) * jnp.asarray(step, dtype=float)),
        )

    def _followed(self, memory: DecentralisedPlanState) -> ClockedPath:
        """What each follows; leading axis aircraft."""
        clocks = memory.clocks
        return ClockedPath(
            path=memory.plan.paths,
            following=memory.exchange.agreed.path,
            follows=memory.waits,
            clock=clocks.clock,
            rate=clocks.rate,
            acceleration=clocks.acceleration,
            time=jnp.broadcast_to(memory.time, clocks.clock.shape),
        )

    def plans(self, memory: DecentralisedPlanState) -> AircraftPlan:
        """The paths in force, each by its clock; arrivals and holds are as late as the clocks."""
        plan, clocks, time = memory.plan, memory.clocks, memory.time
        late = time - clocks.clock
        to_go = plan.arrival_times - clocks.clock
        arrival_times = jnp.where(to_go > 0.0, time + to_go / clocks.rate, plan.arrival_times + late)
        count = late.shape[0]
        holds, shift = memory.exchange.agreed.hold, arrival_times - plan.arrival_times
        holds = eqx.tree_at(
            lambda h: (h.paths.times, h.foreseen_at),
            holds,
            (holds.paths.times + shift[:, None], holds.foreseen_at + shift),
        )
        return AircraftPlan(
            trajectory=self._followed(memory),
            arrival_time=arrival_times,
            status=jnp.zeros(count, dtype=jnp.int32),
            length=plan.lengths,
            lateral_bend=jnp.full_like(plan.lengths, jnp.nan),
            renewal=memory.renewal,
            hold=holds,
            hold_reach=jnp.full(count, self.tube),
            network=NetworkView(
                lag=late,
                rate=clocks.rate,
                hears=memory.network.hears,
                offers=memory.exchange.open,
            ),
        )


def _sets(count: int) -> tuple[slice, slice, slice]:
    """Of three sets of so many paths, one after the other."""
    return slice(0, count), slice(count, 2 * count), slice(2 * count, 3 * count)
