"""Distances within a fleet, and the sides of the detours."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.planning.published.planner import choose_sides, separation_min
from anser.planning.published.trajectory import fit_trajectory
from anser.planning.separation import separation_ratio
from support.planning_cases import fleet, plan_at, published_fleet, random_fleet, velocity

choose = jax.jit(choose_sides)
fit = jax.jit(fit_trajectory)
pair_distances = jax.jit(separation_min, static_argnums=1)


def straight(start, speed_n, duration=40.0):
    start, speed_n = jnp.array(start), jnp.array(speed_n)
    return fit(5.0, duration, start, speed_n, start + duration * speed_n, speed_n)


def stack(paths):
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *paths)


def crossing():
    """Two crossing lines with a closest approach of 300 sqrt(2) m in the middle; a third line far above."""
    return stack(
        [
            straight((-3000.0, 0.0, -1000.0), (150.0, 0.0, 0.0)),
            straight((0.0, -3600.0, -1000.0), (0.0, 150.0, 0.0)),
            straight((-3000.0, 0.0, -2000.0), (150.0, 0.0, 0.0)),
        ]
    )


def test_the_closest_approach_of_two_lines_is_exact():
    distance = pair_distances(crossing())
    # Both axes differ by 600 m in passage: relative motion along (1, -1), offset 600/sqrt 2.
    exact = 600.0 / np.sqrt(2.0)
    # Sampled every 0.625 s at 212 m/s: at the nearest sample no farther than 66 m along the line of relative motion.
    assert exact <= distance[0, 1] <= np.hypot(exact, 66.4)
    np.testing.assert_allclose(distance[0, 2], 1000.0, rtol=1e-12)
    np.testing.assert_array_equal(distance, distance.T)
    assert np.all(np.isinf(np.diag(distance)))
    # Finer sampling converges to it.
    np.testing.assert_allclose(pair_distances(crossing(), 4001)[0, 1], exact, atol=1e-2)


@pytest.mark.long
def test_the_gradient_is_finite_for_coincident_aircraft():
    def closest(coefficients, paths):
        distance = separation_min(eqx.tree_at(lambda p: p.coefficients_n, paths, coefficients))
        return jnp.sum(jnp.where(jnp.isfinite(distance), distance, 0.0))

    slopes, paths = jax.jit(jax.grad(closest)), crossing()
    doubled = jax.tree.map(lambda leaf: leaf[jnp.array([0, 0, 1])], paths)
    for case in (paths, doubled):
        assert jnp.all(jnp.isfinite(slopes(case.coefficients_n, case)))
    # Lifting the third aircraft by 1 m widens 1000 m by 1 m, seen from both.
    shift = slopes(paths.coefficients_n, paths)[2, 2, 0]
    np.testing.assert_allclose(shift, -2.0 - 2.0 * 1000.0 / pair_distances(paths)[1, 2], rtol=1e-9)


@pytest.mark.long
def test_a_batch_of_fleets_equals_single_fleets():
    batch = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf[::-1]]), crossing())
    distance = jax.jit(jax.vmap(separation_min))(batch)
    np.testing.assert_allclose(distance[1], distance[0][::-1, ::-1])


@pytest.mark.long
def test_requested_sides_are_used():
    case = published_fleet()
    plan = plan_at(0.0, case, jnp.ones(3))
    for requested in ([1, -1, 1], [-1, 1, -1]):
        assert choose(plan, jnp.array(requested)).tolist() == requested
    mixed = choose(plan, jnp.array([0, -1, 0]))
    assert mixed[1] == -1.0
    assert set(np.abs(mixed).tolist()) == {1.0}


def test_the_published_fleet_takes_the_smaller_bends():
    # Here the rendezvous points decide the least distances, whatever the sides.
    case = published_fleet()
    plan = plan_at(0.0, case, jnp.ones(3))
    sides = choose(plan, jnp.zeros(3))
    opposite = plan_at(0.0, case, -sides)
    chosen = plan_at(0.0, case, sides)
    np.testing.assert_allclose(pair_distances(chosen.trajectories), pair_distances(opposite.trajectories), atol=1.0)
    assert jnp.all(jnp.abs(chosen.lateral_bends) <= jnp.abs(opposite.lateral_bends))


@pytest.mark.long
@pytest.mark.parametrize("seed", range(6))
def test_two_aircraft_take_the_wider_side(seed):
    # With two aircraft the greedy choice is the best of all.
    case = random_fleet(seed, 50.0, count=2)
    sides = choose(plan_at(0.0, case, jnp.ones(2)), jnp.zeros(2))

    def gap(sides):
        return float(pair_distances(plan_at(0.0, case, sides).trajectories)[0, 1])

    # Choices within 1 m count as equal.
    assert gap(sides) >= max(gap(jnp.array([a, b])) for a in (1.0, -1.0) for b in (1.0, -1.0)) - 1.0


@pytest.mark.long
def test_an_abreast_pair_detours_away_from_its_neighbour():
    # The second has the shorter way, on the first one's right: it must bend right. Mirrored: left.
    for mirror in (1.0, -1.0):
        case = fleet(
            jnp.array([[0.0, 0.0, -1000.0], [1500.0, mirror * 800.0, -1000.0]]),
            jnp.tile(velocity(150.0, 0.0), (2, 1)),
            jnp.array([[9000.0, 0.0, -700.0], [9000.0, mirror * 800.0, -700.0]]),
            jnp.zeros((2, 3)),
        )
        sides = choose(plan_at(0.0, case, jnp.ones(2)), jnp.zeros(2))
        assert sides[1] == mirror


@pytest.mark.parametrize(
    ("required", "ratios"),
    [
        ((500.0, 150.0), [0.8, 2.0, 1.5]),
        ((500.0, 0.0), [0.8, 0.2, 1.5]),
        ((0.0, 0.0), [np.inf, np.inf, np.inf]),
    ],
)
def test_the_ratio_is_the_larger_of_both_directions_in_numpy_and_jax(required, ratios):
    level, height = np.array([400.0, 100.0, 750.0]), np.array([60.0, 300.0, 0.0])
    np.testing.assert_allclose(separation_ratio(level, height, *required), ratios, rtol=1e-15)
    ratio = jax.jit(separation_ratio)(*(jnp.asarray(x) for x in (level, height, *required)))
    np.testing.assert_allclose(ratio, ratios, rtol=1e-15)
