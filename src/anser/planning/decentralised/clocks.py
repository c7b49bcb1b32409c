"""Clocks of a decentralised fleet: each aircraft flies its path by its own clock.

A clock may run slower or faster than time.
"""

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
        """Motion over the ground at a time."""
        clock = self.clock + self.rate * (time - self.time)
        on_next_path = self.has_next_path & (clock >= self.next_path.start_time)
        point = jax.tree.map(lambda a, b: jnp.where(on_next_path, a, b), self.next_path.at(clock), self.path.at(clock))
        bend_n = self.rate**2 * point.acceleration_n + self.acceleration * point.velocity_n
        return PathPoint(point.position_n, self.rate * point.velocity_n, bend_n)

    @property
    def duration(self) -> Scalar:
        """Duration of the path by its clock, s."""
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
