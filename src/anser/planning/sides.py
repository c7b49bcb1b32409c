"""The choice of the sides on which the aircraft of a fleet make their detours."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int, Real

from anser.planning.coordination import FleetPlan
from anser.planning.shape import solve_lateral_bend
from anser.planning.trajectory import Trajectory, bend_trajectory, with_even_speed
from anser.planning.vectors import root

# Least distances that differ by less than this (m) count as equal: often the rendezvous points decide for both sides.
_SAME_DISTANCE = 1.0


def choose_sides(plan: FleetPlan, requested: Real[Array, " aircraft"], count: int = 65) -> Float[Array, " aircraft"]:
    """Side of each aircraft's detour: as requested, else the one that keeps it farther from the others.

    Parameters
    ----------
    plan
        A plan of the fleet with any sides.
    requested
        Positive: right; negative: left; zero: choose.
    count
        Number of instants at which distances are compared.

    Returns
    -------
    +1 or -1 per aircraft. The aircraft are placed one after the other, the longest nominal path first; each free one
    takes the side with the greater least distance to those placed already; where that is the same within 1 m, the side
    with the smaller bend. Those that do not fly are kept clear of by none.
    """
    straightened = jax.vmap(lambda path, kappa: bend_trajectory(path, -kappa))(plan.trajectories, plan.lateral_bends)
    nominal = eqx.tree_at(lambda path: path.law, straightened, plan.trajectories.law)
    fleet = plan.nominal_lengths.shape[0]

    def options(path: Trajectory) -> tuple[Float[Array, "2 count 3"], Float[Array, "2"]]:
        def one(side: Float[Array, ""]) -> tuple[Float[Array, "count 3"], Float[Array, ""]]:
            kappa = solve_lateral_bend(path, plan.reference_length, side).kappa
            bent = with_even_speed(
                bend_trajectory(path, kappa), path.law.speeds[0], exchange=path.law.exchange, even=path.law.even
            )
            return positions_along(bent, count), jnp.abs(kappa)

        return jax.vmap(one)(jnp.array([1.0, -1.0]))

    paths, bends = jax.vmap(options)(nominal)
    order = jnp.argsort(-plan.nominal_lengths)

    def place(
        turn: Int[Array, ""],
        carry: tuple[Float[Array, " aircraft"], Float[Array, "aircraft count 3"], Bool[Array, " aircraft"]],
    ) -> tuple[Array, Array, Array]:
        sides, chosen, placed = carry
        who = order[turn]
        apart = paths[who][:, None, :, :] - chosen[None, :, :, :]
        square = jnp.min(jnp.sum(apart * apart, axis=3), axis=2)
        right, left = jnp.sqrt(jnp.min(jnp.where(placed[None, :], square, jnp.inf), axis=1))
        milder = (bends[who][1] < bends[who][0]) & (left + _SAME_DISTANCE >= right)
        free = jnp.where((left > right + _SAME_DISTANCE) | milder, -1.0, 1.0)
        side = jnp.where(requested[who] == 0, free, jnp.where(requested[who] < 0, -1.0, 1.0))
        path = jnp.where(side > 0.0, paths[who][0], paths[who][1])
        return sides.at[who].set(side), chosen.at[who].set(path), placed.at[who].set(plan.active[who])

    start = (jnp.ones(fleet), jnp.zeros((fleet, count, 3)), jnp.zeros(fleet, dtype=bool))
    return lax.fori_loop(0, fleet, place, start)[0]


def positions_along(trajectory: Trajectory, count: int) -> Float[Array, "count 3"]:
    """Positions over the ground at equal intervals from start to rendezvous, NED, m."""
    times = trajectory.start_time + trajectory.duration * jnp.linspace(0.0, 1.0, count)
    return jax.vmap(trajectory.position_n)(times)


def separation_min(
    trajectories: Trajectory, count: int = 65, active: Bool[Array, " aircraft"] | None = None
) -> Float[Array, "aircraft aircraft"]:
    """Least distance between any two aircraft during their common flight, m; infinite on the diagonal.

    Parameters
    ----------
    trajectories
        Stacked, leading axis aircraft; of those that are active, all with one start time and duration.
    count
        Number of instants looked at, ends included. Between them the distance may be less by no more than half
        the relative speed times the interval.
    active
        Which aircraft fly; infinite from and to one that does not. None: all fly.
    """
    positions = jnp.swapaxes(jax.vmap(lambda trajectory: positions_along(trajectory, count))(trajectories), 0, 1)
    fleet = positions.shape[1]

    def closer(least: Float[Array, "aircraft aircraft"], now: Float[Array, "aircraft 3"]) -> tuple[Array, None]:
        apart = now[:, None, :] - now[None, :, :]
        return jnp.minimum(least, jnp.sum(apart * apart, axis=2)), None

    # Instant by instant: memory stays quadratic in the fleet.
    square, _ = lax.scan(closer, jnp.full((fleet, fleet), jnp.inf), positions)
    unlike = ~jnp.eye(fleet, dtype=bool)
    if active is not None:
        unlike = unlike & active[:, None] & active[None, :]
    return jnp.where(unlike, root(square), jnp.inf)
