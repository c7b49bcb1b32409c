"""Agreement on paths in a decentralised fleet with guaranteed separation: offer, acknowledgement, change.

Each aircraft has an agreed path (an approach and a hold) that the fleet has acknowledged, and flies within a tube
around that path. For another path, the aircraft makes an offer. The other aircraft acknowledge an offer that keeps the
separation from every path that they may fly. Once all of them have acknowledged the offer, the offering aircraft
changes to the new path and broadcasts the change. Until the fleet has acknowledged the change, the other aircraft avoid
both paths, and the aircraft makes no new offer. Lost or late messages never lead to a path that another aircraft has
not acknowledged.

Each aircraft has a token, a counter that is odd while an offer is open and even after acceptance or withdrawal.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from anser.numerics.arrays import select_rows
from anser.planning.certified.path_bounds import bernstein_coefficients
from anser.planning.decentralised.network import KnowledgeMatrix
from anser.planning.holds.hold_paths import ApproachAndHold
from anser.planning.timed_path import TimedPath
from anser.shapes import ScalarLike

PairMask = Bool[Array, "aircraft aircraft"]
_GOLDEN_RATIO = 0.5 + 0.5 * 5.0**0.5


class Exchange(eqx.Module):
    """State of the agreement on paths; leading axis aircraft."""

    # paths acknowledged by the fleet: each aircraft flies within a tube around its agreed path
    agreed_paths: ApproachAndHold
    # while an offer is open, the offered path; after acceptance, the former agreed path; after withdrawal, the path of
    # the withdrawn offer; if `settled`, the agreed path
    alternative: ApproachAndHold
    tokens: Int[Array, " aircraft"]  # token of each aircraft's offers; odd: an offer is open
    settled: Bool[Array, " aircraft"]  # whether the fleet has acknowledged the outcome of the last offer
    offered_at: Float[Array, " aircraft"]  # time of the aircraft's last offer, read from its clock, s
    # (aircraft, owner): last token of the owner that the aircraft has acknowledged
    acknowledged: Int[Array, "aircraft aircraft"]

    @property
    def offer_open(self) -> Bool[Array, " aircraft"]:
        """Mask of the aircraft with an open offer."""
        return self.tokens % 2 == 1


def initial_exchange(approaches: ApproachAndHold) -> Exchange:
    """Return the state at the start of the flight: `approaches` are the agreed paths, and no offer is open."""
    count = approaches.path.times.shape[0]
    zero = jnp.zeros((count, count), dtype=jnp.int32)
    return Exchange(approaches, approaches, zero[0], jnp.ones(count, dtype=bool), jnp.full(count, -jnp.inf), zero)


def process_messages(
    # state of the agreement, and knowledge of the aircraft about each other
    state: Exchange,
    knowledge: KnowledgeMatrix,
    # (aircraft, other): whether the aircraft's alternative path keeps the separation from the other's agreed path, and
    # from the other's alternative path
    clear_of_agreed: PairMask,
    clear_of_alternative: PairMask,
    clocks: Float[Array, " aircraft"],  # clocks of the aircraft, s
    participates: Bool[Array, " aircraft"],  # mask of the flying aircraft, which answer
    patience: ScalarLike,  # time after which an offer is withdrawn, s
) -> tuple[Exchange, Bool[Array, " aircraft"]]:
    """Process the messages received by each aircraft; return the new state and the mask of the accepted offers.

    An aircraft acknowledges an offer if every path that the aircraft may fly keeps the separation from the offered
    path. An offer is accepted if every participating aircraft has acknowledged the offer within `patience`. An offer is
    withdrawn if it is older than `patience`, or in conflict with the open offer of an aircraft of lower index.
    """
    count = clocks.shape[0]
    known_tokens, is_current = knowledge.tokens, knowledge.tokens == state.tokens[None, :]
    # (aircraft, owner): the owner's offer keeps clear of every path that the aircraft may fly
    is_acceptable = clear_of_agreed.T & (clear_of_alternative.T | state.settled[:, None])
    acknowledges = jnp.where(known_tokens % 2 == 1, is_current & is_acceptable, True)
    acknowledged = jnp.where(acknowledges, known_tokens, state.acknowledged)

    # (aircraft, sender): the sender has acknowledged the aircraft's present token
    is_diagonal = np.eye(count, dtype=bool)
    returned_tokens = jnp.swapaxes(knowledge.acknowledged, 1, 2)[np.arange(count), np.arange(count)]
    is_answered = jnp.all((returned_tokens == state.tokens[:, None]) | is_diagonal | ~participates[None, :], axis=1)
    in_time = clocks - state.offered_at <= patience
    accepted = state.offer_open & is_answered & in_time
    # of two conflicting offers, the offer of the aircraft with the higher index is withdrawn
    earlier = np.tri(count, k=-1, dtype=bool)
    yields = jnp.any((known_tokens % 2 == 1) & is_current & ~clear_of_alternative.T & earlier & ~is_diagonal, axis=1)
    withdrawn = state.offer_open & ~accepted & (~in_time | yields)
    settled = state.settled | (~state.offer_open & is_answered)

    agreed_paths = select_rows(accepted, state.alternative, state.agreed_paths)
    alternative = select_rows(accepted, state.agreed_paths, state.alternative)
    alternative = select_rows(settled, agreed_paths, alternative)
    tokens = state.tokens + jnp.where(accepted | withdrawn, 1, 0)
    return Exchange(agreed_paths, alternative, tokens, settled, state.offered_at, acknowledged), accepted


def open_offers(
    state: Exchange, approaches: ApproachAndHold, offers: Bool[Array, " aircraft"], clocks: Float[Array, " aircraft"]
) -> Exchange:
    """Return the state after the aircraft in the mask `offers` have offered their new paths in `approaches`.

    The offering aircraft must be settled before; `clocks` are the present clocks of the aircraft, s.
    """
    return Exchange(
        state.agreed_paths,
        select_rows(offers, approaches, state.alternative),
        state.tokens + jnp.where(offers, 1, 0),
        state.settled & ~offers,
        jnp.where(offers, clocks, state.offered_at),
        state.acknowledged,
    )


def path_distance_max(path: TimedPath, alternative: TimedPath) -> Array:
    """Return an upper bound of the distance, m, at equal times between two paths with the same knot times.

    The bound is the greatest norm of the Bernstein coefficients of the difference between the paths.
    """
    knots = (path.air_n + path.drift_n) - (alternative.air_n + alternative.drift_n)
    points = bernstein_coefficients(knots, path.times[1:] - path.times[:-1])[0]
    return jnp.sqrt(jnp.max(jnp.sum(points**2, axis=1)))


def next_in_turn(searches: Int[np.ndarray, " places"], time: float) -> int:
    """Return the index of the aircraft that may search for a new path at `time` (s), out of the indices `searches`."""
    # Multiples of an irrational number are evenly spread: every aircraft gets turns for any period of the calls.
    return int(searches[int(searches.size * (time * _GOLDEN_RATIO % 1.0))])
