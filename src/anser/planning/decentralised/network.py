"""Communication network of a fleet: links of limited range with losses and outages, and delayed, relayed messages."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from anser.numerics.randomness import INITIAL_SAMPLE, NETWORK, AbstractRandomness
from anser.sensing.vehicle_sensors import Dropouts
from anser.shapes import Integer, Scalar
from anser.spatial.rotations import safe_norm

LinkMatrix = Bool[Array, "aircraft aircraft"]


class KnowledgeMatrix(eqx.Module):
    """Latest data that each aircraft (receiver, row) has about each aircraft (subject, column), also about itself."""

    clocks: Float[Array, "aircraft aircraft"]  # clocks by which the subjects fly, s, see `time_coordination`
    times: Float[Array, "aircraft aircraft"]  # times at which the subjects sent the data, s
    tokens: Int[Array, "aircraft aircraft"]  # tokens, which count the subjects' offers of paths, see `path_exchange`
    # (receiver, subject, owner of an offer): last token of the owner that the subject has acknowledged
    acknowledged: Int[Array, "aircraft aircraft aircraft"]
    delays: Float[Array, "aircraft aircraft"]  # delays of the fleet's arrivals that the subjects request, s


class Broadcast(eqx.Module):
    """Data that each aircraft sends about itself in one exchange, as in `KnowledgeMatrix`; leading axis aircraft."""

    clocks: Float[Array, " aircraft"]
    tokens: Int[Array, " aircraft"]
    acknowledged: Int[Array, "aircraft aircraft"]  # (aircraft, owner)
    delays: Float[Array, " aircraft"]


class NetworkState(eqx.Module):
    """State of a network between two exchanges; links are (receiver, sender)."""

    outages: LinkMatrix  # links in an outage
    hears: LinkMatrix  # links over which a message arrived in the last exchange
    messages: KnowledgeMatrix  # messages under way: ring buffer over the exchanges
    message_links: Bool[Array, "slots aircraft aircraft"]  # links that carry these messages
    knowledge: KnowledgeMatrix  # knowledge of the aircraft after the last exchange


class Network(eqx.Module):
    """Broadcast network: in each exchange, each aircraft sends its whole knowledge, data received earlier included.

    A link is up or down in both directions. A link is down if the aircraft are farther apart than `range`, during an
    outage (Gilbert-Elliott model), and if an exchange is lost at random; different links are independent. The methods
    raise ValueError if `randomness`, the source of random numbers, is None.
    """

    range: Scalar  # greatest distance between two linked aircraft, m
    dropouts: Dropouts  # losses and outages of the links
    period: Scalar  # time between two exchanges, s
    period_samples: Integer  # number of samples between two exchanges
    delay: Integer  # delay of a message, in exchanges
    slots: int = eqx.field(static=True)  # length of the ring buffer in exchanges; must be greater than `delay`

    def init(self, clocks: Float[Array, " aircraft"], randomness: AbstractRandomness | None) -> NetworkState:
        """Return the state before the first exchange: all aircraft know all clock readings `clocks` (s), no offers."""
        count = clocks.shape[0]
        pairs, zero = (count, count), jnp.zeros((count, count), dtype=jnp.int32)
        knowledge = KnowledgeMatrix(
            clocks=jnp.broadcast_to(clocks, pairs),
            times=jnp.zeros(pairs),
            tokens=zero,
            acknowledged=jnp.zeros((count, count, count), dtype=jnp.int32),
            delays=jnp.zeros(pairs),
        )
        messages = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (self.slots, *leaf.shape)), knowledge)
        links = jnp.zeros(pairs, dtype=bool)
        outages = self.dropouts.initial_outage(_link_uniforms(randomness, INITIAL_SAMPLE, count)[0])
        return NetworkState(outages, links, messages, jnp.zeros((self.slots, count, count), dtype=bool), knowledge)

    def exchange(
        self,
        state: NetworkState,
        broadcast: Broadcast,  # data that the aircraft send about themselves
        positions_n: Float[Array, "aircraft 3"],  # positions of the aircraft, NED, m
        active: Bool[Array, " aircraft"],  # mask of the aircraft that send and receive
        # index, which must be a multiple of `period_samples`, and time (s) of the present sample
        sample: Integer,
        time: Scalar,
        randomness: AbstractRandomness | None,
    ) -> NetworkState:
        """Return the state after one exchange: every aircraft sends its knowledge and merges the arrived messages."""
        knowledge = _with_broadcasts(state.knowledge, broadcast, time)
        outages, up = self.links(state.outages, positions_n, active, sample, randomness)
        exchange = sample // jnp.maximum(self.period_samples, 1)
        send_slot, receive_slot = exchange % self.slots, (exchange - self.delay) % self.slots
        messages = jax.tree.map(lambda buffer, entry: buffer.at[send_slot].set(entry), state.messages, knowledge)
        message_links = state.message_links.at[send_slot].set(up)
        hears = message_links[receive_slot] & (exchange >= self.delay)
        arrived = jax.tree.map(lambda buffer: buffer[receive_slot], messages)
        return NetworkState(outages, hears, messages, message_links, _merge_messages(knowledge, arrived, hears))

    def links(
        self,
        outages: LinkMatrix,
        positions_n: Float[Array, "aircraft 3"],
        active: Bool[Array, " aircraft"],
        sample: Integer | int,
        randomness: AbstractRandomness | None,
    ) -> tuple[LinkMatrix, LinkMatrix]:
        """Return the links in an outage, and the links that are up, in the exchange at `sample`; (receiver, sender).

        `outages` are the links in an outage in the previous exchange.
        """
        count = active.shape[0]
        uniforms = _link_uniforms(randomness, sample, count)
        outages = self.dropouts.next_outage(outages, self.period, uniforms[0])
        distances = jax.vmap(jax.vmap(safe_norm))(positions_n[:, None, :] - positions_n[None, :, :])
        up = (distances <= self.range) & ~self.dropouts.is_lost(outages, uniforms[1])
        return outages, up & active[:, None] & active[None, :] & ~np.eye(count, dtype=bool)


def _with_broadcasts(knowledge: KnowledgeMatrix, broadcast: Broadcast, time: Scalar) -> KnowledgeMatrix:
    """Write each aircraft's current data, sent at `time` (s), onto the diagonal of the knowledge matrix."""
    is_diagonal = np.eye(broadcast.clocks.shape[0], dtype=bool)
    return KnowledgeMatrix(
        clocks=jnp.where(is_diagonal, broadcast.clocks, knowledge.clocks),
        times=jnp.where(is_diagonal, time, knowledge.times),
        tokens=jnp.where(is_diagonal, broadcast.tokens, knowledge.tokens),
        acknowledged=jnp.where(is_diagonal[:, :, None], broadcast.acknowledged, knowledge.acknowledged),
        delays=jnp.where(is_diagonal, broadcast.delays, knowledge.delays),
    )


def _merge_messages(knowledge: KnowledgeMatrix, arrived: KnowledgeMatrix, hears: LinkMatrix) -> KnowledgeMatrix:
    """Update the knowledge of each receiver: newer received data about a subject replace older data."""
    count = hears.shape[0]
    # (receiver, sender, subject)
    times = jnp.where(hears[:, :, None], arrived.times[None], -jnp.inf)
    latest_sender = jnp.argmax(times, axis=1)
    is_newer = jnp.max(times, axis=1) > knowledge.times
    subjects = np.arange(count)[None, :]

    def merged(new: Array, old: Array) -> Array:
        received = new[latest_sender, subjects]
        return jnp.where(is_newer.reshape(*is_newer.shape, *[1] * (old.ndim - 2)), received, old)

    return jax.tree.map(merged, arrived, knowledge)


def _link_uniforms(
    randomness: AbstractRandomness | None, sample: Integer | int, count: int
) -> Float[Array, "2 aircraft aircraft"]:
    """Draw two uniform random numbers (0..1) per link at sample number `sample`, equal for both directions."""
    if randomness is None:
        raise ValueError("a network draws random numbers: the flight has no seed")
    indices = np.arange(count)
    # The random numbers of a pair do not depend on the size of the fleet.
    later, earlier = np.maximum.outer(indices, indices), np.minimum.outer(indices, indices)
    pair = np.where(later > earlier, later * (later - 1) // 2 + earlier, 0)
    uniforms = randomness.uniforms(NETWORK, sample, max(count * (count - 1), 2))
    return jnp.stack([uniforms[2 * pair], uniforms[2 * pair + 1]])
