"""Who hears whom: links by distance, losses and outages, and messages that take their time and are passed on."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from anser.numerics.randomness import INITIAL_SAMPLE, NETWORK, AbstractRandomness
from anser.sensing.vehicle_sensors import Dropouts
from anser.shapes import Count, Scalar
from anser.spatial.rotations import safe_norm

Links = Bool[Array, "aircraft aircraft"]


class KnowledgeMatrix(eqx.Module):
    """What aircraft know of each other: (holder, about); of itself each knows what is.

    Attributes
    ----------
    clocks
        S.
    times
        Of when that is, s.
    tokens
        How far the path of each is, see `exchange`.
    acknowledged
        (holder, about, whose): whose token it has acknowledged.
    delays
        By how much each wants all arrivals put off, s.
    """

    clocks: Float[Array, "aircraft aircraft"]
    times: Float[Array, "aircraft aircraft"]
    tokens: Int[Array, "aircraft aircraft"]
    acknowledged: Int[Array, "aircraft aircraft aircraft"]
    delays: Float[Array, "aircraft aircraft"]


class Broadcast(eqx.Module):
    """What aircraft say of themselves, now; leading axis aircraft. For the meaning see `KnowledgeMatrix`."""

    clocks: Float[Array, " aircraft"]
    tokens: Int[Array, " aircraft"]
    acknowledged: Int[Array, "aircraft aircraft"]
    delays: Float[Array, " aircraft"]


class NetworkState(eqx.Module):
    """A network between two exchanges.

    Attributes
    ----------
    outages
        Which links are out.
    hears
        Who has heard whom at the last exchange: (receiver, sender).
    sent, by
        What is on its way, and by which links; leading axis exchanges, in a ring.
    known
        What each knows.
    """

    outages: Links
    hears: Links
    messages: KnowledgeMatrix
    message_links: Bool[Array, "slots aircraft aircraft"]
    knowledge: KnowledgeMatrix


class Network(eqx.Module):
    """A broadcast network: at each exchange every aircraft sends all that it knows, itself or from others.

    A link is up or down for both directions at once. It is down beyond the range, while it is out (Gilbert-Elliott,
    each link by itself), and where the exchange is lost, each by itself. What is heard was sent a delay ago.

    Attributes
    ----------
    range
        Of each link, m.
    dropouts
        Losses and outages of each link.
    period
        Between two exchanges, s.
    every
        The same in sampling periods.
    delay
        In exchanges.
    slots
        More than the delay.
    """

    range: Scalar
    dropouts: Dropouts
    period: Scalar
    period_samples: Count
    delay: Count
    slots: int = eqx.field(static=True)

    def init(self, clocks: Float[Array, " aircraft"], randomness: AbstractRandomness | None) -> NetworkState:
        """Before the first exchange of a flight: all know each other's clocks and paths, on which they have agreed."""
        count = clocks.shape[0]
        pairs, none = (count, count), jnp.zeros((count, count), dtype=jnp.int32)
        known = KnowledgeMatrix(
            clocks=jnp.broadcast_to(clocks, pairs),
            times=jnp.zeros(pairs),
            tokens=none,
            acknowledged=jnp.zeros((count, count, count), dtype=jnp.int32),
            delays=jnp.zeros(pairs),
        )
        sent = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (self.slots, *leaf.shape)), known)
        links = jnp.zeros(pairs, dtype=bool)
        outages = self.dropouts.initial_outage(_link_uniforms(randomness, INITIAL_SAMPLE, count)[0])
        return NetworkState(outages, links, sent, jnp.zeros((self.slots, count, count), dtype=bool), known)

    def exchange(
        self,
        state: NetworkState,
        broadcast: Broadcast,
        positions_n: Float[Array, "aircraft 3"],
        active: Bool[Array, " aircraft"],
        number: Count,
        time: Scalar,
        randomness: AbstractRandomness | None,
    ) -> NetworkState:
        """Send, and take in what arrives.

        Parameters
        ----------
        own
            What each says of itself.
        positions_n
            Of the aircraft, NED, m.
        active
            Who sends and hears.
        number, time
            Of the sample, and s.
        randomness
            Of the flight.
        """
        known = _with_broadcasts(state.knowledge, broadcast, time)
        outages, up = self.links(state.outages, positions_n, active, number, randomness)
        exchange = number // jnp.maximum(self.period_samples, 1)
        here, there = exchange % self.slots, (exchange - self.delay) % self.slots
        sent = jax.tree.map(lambda rows, row: rows.at[here].set(row), state.messages, known)
        by = state.message_links.at[here].set(up)
        hears = by[there] & (exchange >= self.delay)
        arrived = jax.tree.map(lambda rows: rows[there], sent)
        return NetworkState(outages, hears, sent, by, _merge_messages(known, arrived, hears))

    def links(
        self,
        outages: Links,
        positions_n: Float[Array, "aircraft 3"],
        active: Bool[Array, " aircraft"],
        number: Count | int,
        randomness: AbstractRandomness | None,
    ) -> tuple[Links, Links]:
        """Which links are out, and which are up, at an exchange."""
        count = active.shape[0]
        drawn = _link_uniforms(randomness, number, count)
        outages = self.dropouts.next_outage(outages, self.period, drawn[0])
        apart = jax.vmap(jax.vmap(safe_norm))(positions_n[:, None, :] - positions_n[None, :, :])
        up = (apart <= self.range) & ~self.dropouts.is_lost(outages, drawn[1])
        return outages, up & active[:, None] & active[None, :] & ~np.eye(count, dtype=bool)


def _with_broadcasts(knowledge: KnowledgeMatrix, broadcast: Broadcast, time: Scalar) -> KnowledgeMatrix:
    """What all know, with what each knows of itself as it is now."""
    itself = np.eye(broadcast.clocks.shape[0], dtype=bool)
    return KnowledgeMatrix(
        clocks=jnp.where(itself, broadcast.clocks, knowledge.clocks),
        times=jnp.where(itself, time, knowledge.times),
        tokens=jnp.where(itself, broadcast.tokens, knowledge.tokens),
        acknowledged=jnp.where(itself[:, :, None], broadcast.acknowledged, knowledge.acknowledged),
        delays=jnp.where(itself, broadcast.delays, knowledge.delays),
    )


def _merge_messages(knowledge: KnowledgeMatrix, arrived: KnowledgeMatrix, hears: Links) -> KnowledgeMatrix:
    """What each knows of each other after messages: the latest of what it knew and of what came in."""
    count = hears.shape[0]
    # (receiver, sender, about)
    times = jnp.where(hears[:, :, None], arrived.times[None], -jnp.inf)
    best = jnp.argmax(times, axis=1)
    newer = jnp.max(times, axis=1) > knowledge.times
    about = np.arange(count)[None, :]

    def merged(new: Array, old: Array) -> Array:
        taken = new[best, about]
        return jnp.where(newer.reshape(*newer.shape, *[1] * (old.ndim - 2)), taken, old)

    return jax.tree.map(merged, arrived, knowledge)


def _link_uniforms(
    randomness: AbstractRandomness | None, number: Count | int, count: int
) -> Float[Array, "2 aircraft aircraft"]:
    """Two numbers between 0 and 1 for each link; those of a link are the same in a fleet of any size."""
    if randomness is None:
        raise ValueError("a network draws random numbers: the flight has no seed")
    places = np.arange(count)
    later, earlier = np.maximum.outer(places, places), np.minimum.outer(places, places)
    pair = np.where(later > earlier, later * (later - 1) // 2 + earlier, 0)
    drawn = randomness.uniforms(NETWORK, number, max(count * (count - 1), 2))
    return jnp.stack([drawn[2 * pair], drawn[2 * pair + 1]])
