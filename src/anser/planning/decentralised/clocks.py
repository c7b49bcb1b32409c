"""Clocks along the paths of a fleet without a centre: paths followed by them, and how they go on."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.parts.paths import AbstractReference, PathPoint
from anser.planning.decentralised.network import KnowledgeMatrix, NetworkState
from anser.planning.decentralised.time_coordination import CoordinationGains, bounded_rate, clock_acceleration
from anser.planning.timed_path import TimedPath
from anser.shapes import Flag, Scalar, ScalarLike
from anser.spatial.rotations import safe_norm


class ClockedPath(AbstractReference):
    """A path followed by a clock of its own.

    Attributes
    ----------
    path, following
        By its clock.
    follows
        Whether the second takes the place of the first from its beginning on.
    clock, rate, acceleration
        The clock at a time, s, 1 and 1/s.
    time
        s.
    """

    path: TimedPath
    next_path: TimedPath
    has_next_path: Flag
    clock: Scalar
    rate: Scalar
    acceleration: Scalar
    time: Scalar

    def at(self, time: ScalarLike) -> PathPoint:
        """Motion over the ground at a time."""
        clock = self.clock + self.rate * (time - self.time)
        second = self.has_next_path & (clock >= self.next_path.start_time)
        point = jax.tree.map(lambda a, b: jnp.where(second, a, b), self.next_path.at(clock), self.path.at(clock))
        bend_n = self.rate**2 * point.acceleration_n + self.acceleration * point.velocity_n
        return PathPoint(point.position_n, self.rate * point.velocity_n, bend_n)

    @property
    def duration(self) -> Scalar:
        """Of the path by its clock, s."""
        return self.path.duration


class Clocks(eqx.Module):
    """Clocks along the paths; leading axis aircraft.

    Attributes
    ----------
    clock
        How far along its path each is to be, s.
    rate, acceleration
        1 and 1/s.
    """

    clock: Float[Array, " aircraft"]
    rate: Float[Array, " aircraft"]
    acceleration: Float[Array, " aircraft"]


def clock_accelerations(
    paths: ClockedPath,
    network: NetworkState,
    positions_n: Float[Array, "aircraft 3"],
    active: Bool[Array, " aircraft"],
    coordinated: Bool[Array, " aircraft"],
    gains: CoordinationGains,
) -> Float[Array, " aircraft"]:
    """Second derivatives of the clocks by the law, from what was heard, 1/s.

    Parameters
    ----------
    paths
        What each follows now.
    network
        After the exchange.
    positions_n
        Where each is, NED, m.
    active, coordinated
        Who flies, and whose clock is kept together with the others'; the rate of any other returns to 1.
    gains
        Of the law.
    """
    known = network.knowledge
    heard = known.clocks + (paths.time[:, None] - known.times)
    count = jnp.sum(active)

    def one(path: ClockedPath, others: Array, hears: Array, position_n: Array) -> Scalar:
        wanted = path.at(path.time)
        speed = jnp.maximum(safe_norm(wanted.velocity_n), 1.0)
        lag = jnp.sum(wanted.velocity_n * (wanted.position_n - position_n)) / speed**2
        return clock_acceleration(path.clock, path.rate, others, hears, lag, count, gains)

    found = jax.vmap(one)(paths, heard, network.hears, positions_n)
    return jnp.where(coordinated, found, -gains.damping * (paths.rate - 1.0))


def advance_clocks(
    clocks: Clocks,
    knowledge: KnowledgeMatrix,
    time: ScalarLike,
    active: Bool[Array, " aircraft"],
    arrived: Bool[Array, " aircraft"],
    gains: CoordinationGains,
    step: ScalarLike,
) -> Clocks:
    """The clocks a step (s) after a time (s); after its arrival each goes on at the rate 1."""
    count = clocks.clock.shape[0]
    heard = knowledge.clocks + (time - knowledge.times)
    doubt = gains.rate_range * (time - knowledge.times)
    counted = active[None, :] & ~jnp.eye(count, dtype=bool)
    wanted = clocks.rate + step * clocks.acceleration
    rate = jax.vmap(bounded_rate, in_axes=(0, 0, 0, 0, 0, None))(wanted, clocks.clock, heard, doubt, counted, gains)
    rate = jnp.where(arrived | ~active, 1.0, rate)
    clock = clocks.clock + step * 0.5 * (clocks.rate + rate)
    return Clocks(clock, rate, jnp.where(arrived, 0.0, (rate - clocks.rate) / step))
