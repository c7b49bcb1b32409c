"""Ways agreed on without a centre: offered, acknowledged by all, then flown; so that the separation is never lost.

Each aircraft has a way, a path to its arrival and a hold after it, that all others have acknowledged, and flies within
a tube about it. To fly another one it offers it; the others acknowledge it if it keeps the separation from all that
they themselves may fly; with the word of all others it changes over, and tells so. Until all have acknowledged that
too, they keep clear of both ways, and it makes no other offer. Whatever is lost or late on the way, no one ever flies
a way that another has not agreed to.

Each aircraft has a token that counts its steps: odd while an offer is open, even after it was taken up or withdrawn.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from anser.numerics.arrays import select_rows
from anser.planning.decentralised.network import KnowledgeMatrix
from anser.planning.holds.hold_paths import ApproachAndHold
from anser.planning.timed_path import TimedPath
from anser.shapes import ScalarLike

Pairs = Bool[Array, "aircraft aircraft"]


class Exchange(eqx.Module):
    """Where the agreement on paths stands; leading axis aircraft.

    Attributes
    ----------
    agreed
        Ways that all have acknowledged: each flies within a tube about its own.
    other
        The one that each offers, or has just left or withdrawn; the agreed one where that is settled.
    tokens
        See above.
    settled
        Whether all know which one each flies.
    offered_at
        When the last offer was made, on the path's clock, s.
    acknowledged
        (aircraft, whose): the last token of each other that it has acknowledged.
    """

    agreed_paths: ApproachAndHold
    alternative: ApproachAndHold
    tokens: Int[Array, " aircraft"]
    settled: Bool[Array, " aircraft"]
    offered_at: Float[Array, " aircraft"]
    acknowledged: Int[Array, "aircraft aircraft"]

    @property
    def offer_open(self) -> Bool[Array, " aircraft"]:
        """Who has an offer open."""
        return self.tokens % 2 == 1


def initial_exchange(approaches: ApproachAndHold) -> Exchange:
    """After the agreement before the flight."""
    count = approaches.path.times.shape[0]
    none = jnp.zeros((count, count), dtype=jnp.int32)
    return Exchange(approaches, approaches, none[0], jnp.ones(count, dtype=bool), jnp.full(count, -jnp.inf), none)


def process_messages(
    state: Exchange,
    knowledge: KnowledgeMatrix,
    clear_of_agreed: Pairs,
    clear_of_other: Pairs,
    clocks: Float[Array, " aircraft"],
    participates: Bool[Array, " aircraft"],
    patience: ScalarLike,
) -> tuple[Exchange, Bool[Array, " aircraft"]]:
    """Acknowledge what was heard, and take up, withdraw or settle what was answered.

    Parameters
    ----------
    state, known
        The agreement, and what each knows of the others.
    clear_of_agreed, clear_of_other
        Whether the other way of a row's aircraft keeps the separation from the agreed way, and from the other way,
        of a column's.
    clocks
        Of the aircraft, s.
    taking_part
        Who is in the air, and answers.
    patience
        An offer is withdrawn after this long, s.

    Returns
    -------
    The agreement after it, and who takes up the way that it offered.
    """
    count = clocks.shape[0]
    heard, current = knowledge.tokens, knowledge.tokens == state.tokens[None, :]
    # (aircraft, whose): an offer that was heard of keeps clear of all that the aircraft itself may fly
    fits = clear_of_agreed.T & (clear_of_other.T | state.settled[:, None])
    answers = jnp.where(heard % 2 == 1, current & fits, True)
    acknowledged = jnp.where(answers, heard, state.acknowledged)

    # (aircraft, by whom): its token of now has come back
    itself = np.eye(count, dtype=bool)
    back = jnp.swapaxes(knowledge.acknowledged, 1, 2)[np.arange(count), np.arange(count)]
    answered = jnp.all((back == state.tokens[:, None]) | itself | ~participates[None, :], axis=1)
    in_time = clocks - state.offered_at <= patience
    taken = state.offer_open & answered & in_time
    # of two offers in each other's way that of the aircraft further behind is withdrawn
    earlier = np.tri(count, k=-1, dtype=bool)
    yields = jnp.any((heard % 2 == 1) & current & ~clear_of_other.T & earlier & ~itself, axis=1)
    withdrawn = state.offer_open & ~taken & (~in_time | yields)
    settled = state.settled | (~state.offer_open & answered)

    agreed = select_rows(taken, state.alternative, state.agreed_paths)
    other = select_rows(taken, state.agreed_paths, state.alternative)
    other = select_rows(settled, agreed, other)
    tokens = state.tokens + jnp.where(taken | withdrawn, 1, 0)
    return Exchange(agreed, other, tokens, settled, state.offered_at, acknowledged), taken


def open_offers(
    state: Exchange, approaches: ApproachAndHold, offers: Bool[Array, " aircraft"], clocks: Float[Array, " aircraft"]
) -> Exchange:
    """Open offers of ways by some; these must be settled."""
    return Exchange(
        state.agreed_paths,
        select_rows(offers, approaches, state.alternative),
        state.tokens + jnp.where(offers, 1, 0),
        state.settled & ~offers,
        jnp.where(offers, clocks, state.offered_at),
        state.acknowledged,
    )


def path_distance_max(path: TimedPath, alternative: TimedPath) -> Array:
    """Bound of the distance between two paths of the same knots at any time, m.

    In each cell the difference is a quintic: it lies within the convex hull of its Bernstein coefficients.
    """
    knots = (path.air_n + path.drift_n) - (alternative.air_n + alternative.drift_n)
    h = (path.times[1:] - path.times[:-1])[:, None]
    begin, end = knots[:-1], knots[1:]
    points = jnp.stack(
        [
            begin[:, 0],
            begin[:, 0] + h * begin[:, 1] / 5,
            begin[:, 0] + 2 * h * begin[:, 1] / 5 + h**2 * begin[:, 2] / 20,
            end[:, 0] - 2 * h * end[:, 1] / 5 + h**2 * end[:, 2] / 20,
            end[:, 0] - h * end[:, 1] / 5,
            end[:, 0],
        ]
    )
    return jnp.sqrt(jnp.max(jnp.sum(points**2, axis=-1)))


def concatenate_fleets(*sets: ApproachAndHold) -> ApproachAndHold:
    """Ways of one fleet several times over, one set after the other."""
    return jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *sets)
