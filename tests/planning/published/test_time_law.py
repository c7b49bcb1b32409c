"""Time law of a trajectory: the published law and the even law."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from anser.constants import STANDARD_GRAVITY_M_S2 as g
from anser.numerics.arrays import cast_to_precision
from anser.planning.published.time_law import BRAKING_RESERVE_M_S2, CELLS
from anser.planning.published.trajectory import arc_length, bend_trajectory, with_even_speed
from support.planning_cases import fit, flyable, published_path, trajectories, velocity

exchanges = st.sampled_from([0.0, 0.4, 1.0])
# First speed over the mean speed.
ratios = st.floats(0.6, 1.5)


@jax.jit
def even_path(path, ratio, exchange):
    """Path with the even law, from an initial speed given by its ratio to the mean speed."""
    return with_even_speed(path, ratio * arc_length(path) / path.duration, exchange=exchange)


bend_path = jax.jit(bend_trajectory)
bounded = jax.jit(lambda path, speed_0, deceleration: with_even_speed(path, speed_0, deceleration))


@jax.jit
def motion(path, elapsed):
    """Phase, position, velocity over the ground and through the air, acceleration, at a time after the start."""
    t = path.start_time + elapsed
    return path.clock(t).s, path.position_n(t), path.velocity_n(t), path.air_velocity_n(t), path.acceleration_n(t)


@jax.jit
def differentiated_motion(path, elapsed):
    t = path.start_time + elapsed
    return jax.jacfwd(path.position_n)(t), jax.jacfwd(path.velocity_n)(t)


clock = jax.jit(lambda path, t: path.clock(t))
motions = jax.jit(jax.vmap(lambda path, elapsed: motion(path, elapsed), in_axes=(None, 0)))
FRACTIONS = np.linspace(0.0, 1.0, 257)


def sampled_speeds(path):
    """Airspeed at equal time intervals, and the times since the start."""
    elapsed = FRACTIONS * float(path.duration)
    return elapsed, np.linalg.norm(motions(path, jnp.asarray(elapsed))[3], axis=1)


def exact_length(path):
    derivative = np.polynomial.polynomial.polyder(np.asarray(path.coefficients_n), axis=1)
    return quad(lambda s: np.linalg.norm(derivative @ s ** np.arange(4)), 0.0, 1.0, epsrel=1e-13, limit=200)[0]


def lengths_to(path, phases):
    """Lengths up to given phases: eight nodes between two phases."""
    derivative = np.polynomial.polynomial.polyder(np.asarray(path.coefficients_n), axis=1)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    widths = np.diff(phases)
    points = phases[:-1, None] + 0.5 * widths[:, None] * (nodes[None, :] + 1.0)
    slopes = np.linalg.norm(np.polynomial.polynomial.polyval(points, derivative.T), axis=0)
    return np.concatenate([[0.0], np.cumsum(0.5 * widths * (slopes @ weights))])


@settings(deadline=None, max_examples=30)
@given(path=trajectories(), bend=st.floats(-3e4, 3e4), ratio=ratios, exchange=exchanges)
def test_both_laws_arrive_at_the_same_instant(path, bend, ratio, exchange):
    path = bend_path(path, bend)
    even = even_path(path, ratio, exchange)
    # Also down and up slopes of 0.6 rad over kilometres, where the traded speed is several times the mean.
    np.testing.assert_allclose(even.law.times[-1], path.duration, rtol=1e-12)
    for fraction, phase in ((0.0, 0.0), (1.0, 1.0)):
        by_even, by_published = (motion(p, fraction * path.duration) for p in (even, path))
        np.testing.assert_allclose(by_published[0], phase, atol=1e-12)
        # The even one's last cell ends to rounding of the time, at speeds of up to some 500 m/s.
        np.testing.assert_allclose(by_even[1], by_published[1], atol=1e-7)
        # Both leave and arrive in the same direction.
        np.testing.assert_allclose(
            by_even[3] / np.linalg.norm(by_even[3]), by_published[3] / np.linalg.norm(by_published[3]), atol=1e-9
        )


# Duration and coefficients of paths that climb by 1 to 3 km before they fall by 4 to 6: two plans of 4,500 random ones.
HUMPS = [
    (
        150.0,
        [
            [0.0, 21520.0, -228700.0, 393420.0, -186380.0],
            [0.0, -5840.0, -33600.0, 82170.0, -42100.0],
            [-2990.0, 0.0, -13600.0, 16300.0, 0.0],
        ],
    ),
    (
        170.0,
        [
            [0.0, 15600.0, 42700.0, -136300.0, 78400.0],
            [0.0, 19800.0, 71000.0, -198400.0, 107300.0],
            [-2100.0, 0.0, -18800.0, 20600.0, 0.0],
        ],
    ),
]


@pytest.mark.long
@pytest.mark.parametrize(("duration", "coefficients"), HUMPS)
@pytest.mark.parametrize("speed_0", [140.0, 150.0, 170.0])
def test_the_time_is_met_where_plain_newton_diverges(duration, coefficients, speed_0):
    # All height traded: from these first speeds plain Newton ends at half a millisecond or at 550 s.
    path = eqx.tree_at(
        lambda p: (p.duration, p.coefficients_n),
        published_path(-30.0),
        (jnp.asarray(duration), jnp.asarray(coefficients)),
    )
    even = even_path(path, speed_0 * duration / arc_length(path), 1.0)
    np.testing.assert_allclose(even.law.times[-1], duration, rtol=1e-12)
    # Never below 0.3 of the mean, as promised.
    assert np.min(sampled_speeds(even)[1]) >= 0.3 * exact_length(path) / duration * (1.0 - 1e-6)


@settings(deadline=None, max_examples=30)
@given(path=flyable(), ratio=ratios)
def test_the_even_law_without_exchange_has_constant_acceleration(path, ratio):
    even = even_path(path, ratio, 0.0)
    elapsed, speeds = sampled_speeds(even)
    mean = exact_length(path) / float(path.duration)
    # The mean speed is the length over the duration: so the last speed is as far from it as the first.
    initial_speed = ratio * float(arc_length(path)) / float(path.duration)
    expected = initial_speed + (2.0 * (mean - initial_speed)) * elapsed / float(path.duration)
    # Four nodes in each of 32 cells leave 1e-9 of the length of such paths at worst.
    np.testing.assert_allclose(speeds, expected, rtol=1e-7)
    np.testing.assert_allclose(np.trapezoid(speeds, elapsed), exact_length(path), rtol=1e-7)


@settings(deadline=None, max_examples=30)
@given(path=flyable(), ratio=ratios, exchange=exchanges)
def test_the_even_law_satisfies_the_energy_balance(path, ratio, exchange):
    # The law itself, V^2/2 = V_0^2/2 + exchange g (drop) - e l, from what a user of the trajectory sees.
    even = even_path(path, ratio, exchange)
    assume(jnp.all(even.law.squares > even.law.slowest**2))
    elapsed = jnp.asarray(FRACTIONS * float(path.duration))
    phases, positions, _, air, _ = motions(even, elapsed)
    speeds, flown = np.linalg.norm(air, axis=1), lengths_to(path, np.asarray(phases))
    drop = np.asarray(positions)[:, 2] - float(positions[0, 2])
    spent = 0.5 * speeds[0] ** 2 + exchange * g * drop - 0.5 * speeds**2
    # Four nodes in each of 32 cells leave 1e-7 m of such lengths, times some m/s^2; 1e4 m^2/s^2 cancel.
    np.testing.assert_allclose(spent, spent[-1] * flown / flown[-1], atol=1e-4)


@settings(deadline=None, max_examples=30)
@given(path=flyable(), ratio=ratios, exchange=exchanges, cell=st.integers(1, CELLS - 1))
def test_the_speed_equals_the_law_and_is_continuous(path, ratio, exchange, cell):
    even = even_path(path, ratio, exchange)
    moment = even.law.times[cell]
    earlier, at, later = (
        np.linalg.norm(motion(even, moment + shift)[3]) for shift in (-1e-9 * path.duration, 0.0, 1e-9 * path.duration)
    )
    np.testing.assert_allclose(motion(even, moment)[0], cell / CELLS, atol=1e-12)
    np.testing.assert_allclose(at, even.law.speeds[cell], rtol=1e-12)
    # 1e-9 of the duration at a few m/s^2.
    np.testing.assert_allclose([earlier, later], at, atol=1e-6)


@settings(deadline=None, max_examples=30)
@given(path=flyable(), ratio=ratios, exchange=exchanges, fraction=st.floats(0.001, 0.999), wind=st.floats(-30.0, 30.0))
def test_derivatives_equal_automatic_differentiation(path, ratio, exchange, fraction, wind):
    windy = eqx.tree_at(lambda p: p.wind_n, path, jnp.array([wind, 10.0, -1.0]))
    for timed in (windy, even_path(windy, ratio, exchange)):
        # Where the law holds the speed at its floor the acceleration jumps within a cell.
        assume(jnp.all(timed.law.squares > timed.law.slowest**2) | ~timed.law.even)
        _, _, velocity_n, air_n, acceleration_n = motion(timed, fraction * path.duration)
        rates = differentiated_motion(timed, fraction * path.duration)
        np.testing.assert_allclose(velocity_n, air_n + timed.wind_n, atol=1e-12)
        # The phase solves the time of four nodes per cell, the velocity is the exact path's: 1e-8 at worst here.
        np.testing.assert_allclose(rates[0], velocity_n, atol=1e-6)
        np.testing.assert_allclose(rates[1], acceleration_n, atol=1e-6)


@pytest.mark.parametrize("exchange", [0.0, 1.0])
def test_the_position_is_the_integral_of_the_velocity(exchange):
    # scipy's adaptive rule over the whole path of theory section 6, bent; both kinds of integrals.
    path = even_path(published_path(-30.0, 0.01), 1.1, exchange)
    for axis in range(3):
        displacement, _ = quad(lambda t, a=axis: float(motion(path, t)[2][a]), 0.0, 36.0, epsabs=1e-6, limit=200)
        gain, _ = quad(lambda t, a=axis: float(motion(path, t)[4][a]), 0.0, 36.0, epsabs=1e-6, limit=200)
        start, end = motion(path, 0.0), motion(path, 36.0)
        # Four nodes per cell on a strongly bent path.
        np.testing.assert_allclose(displacement, end[1][axis] - start[1][axis], atol=1e-4)
        np.testing.assert_allclose(gain, end[2][axis] - start[2][axis], atol=1e-5)


@settings(deadline=None, max_examples=20)
@given(
    course=st.floats(-3.1, 3.1), turn=st.floats(-1.2, 1.2), bend=st.floats(-2e4, 2e4), deceleration=st.floats(0.3, 2)
)
def test_a_level_path_of_fitting_length_is_flown_at_constant_speed(course, turn, bend, deceleration):
    start, line = jnp.array([0.0, 0.0, -1500.0]), velocity(9e3, course)
    path = _level(60.0, start, velocity(150.0, course + turn), start + line, velocity(150.0, course), bend)
    speed = exact_length(path) / 60.0
    timed = bounded(path, speed, deceleration)
    # Rounding, and 1e-9 of the length by quadrature.
    np.testing.assert_allclose(sampled_speeds(timed)[1], speed, rtol=1e-7)


def _level(*args):
    return fit(0.0, *args)


def braking(path):
    """Greatest braking along the path: g times the slope of descent minus the speed gain, m/s^2."""
    _, _, _, air, acceleration = (np.asarray(part) for part in motions(path, jnp.asarray(FRACTIONS * path.duration)))
    speed = np.linalg.norm(air, axis=1)
    return np.max(g * air[:, 2] / speed - np.sum(acceleration * air, axis=1) / speed)


@settings(deadline=None, max_examples=60)
@given(path=flyable(), ratio=st.floats(0.85, 1.15), deceleration=st.floats(0.4, 2.0))
def test_the_braking_stays_within_the_bound(path, ratio, deceleration):
    speed_0 = ratio * arc_length(path) / path.duration
    timed = bounded(path, speed_0, deceleration)
    exchange = float(timed.law.exchange)
    assert 0.0 <= exchange <= 1.0
    assume(exchange < 1.0)
    # The exchange is a closed form, to first order in the changes of speed, with the fall looked at between the cells:
    # half of the reserve covers that.
    assert braking(timed) <= deceleration - 0.5 * BRAKING_RESERVE_M_S2


@settings(deadline=None, max_examples=20)
@given(path=flyable(), deceleration=st.floats(0.4, 2.0))
def test_the_exchange_is_as_small_as_possible(path, deceleration):
    speed_0 = arc_length(path) / path.duration
    untraded = even_path(path, 1.0, 0.0)
    timed = bounded(path, speed_0, deceleration)
    # 0.02: the steepest place may lie between two cells.
    if braking(untraded) < deceleration - BRAKING_RESERVE_M_S2 - 0.02:
        assert timed.law.exchange == 0.0
    if braking(untraded) > deceleration - BRAKING_RESERVE_M_S2 + 0.02:
        assert timed.law.exchange > 0.0


def test_full_exchange_keeps_the_throttle():
    # Down a straight line steeper than the glide: the speed stays, whatever the exchange; on a bend downwards all of the
    # height may become speed, and the braking is the same everywhere.
    start, end = jnp.array([0.0, 0.0, -2000.0]), jnp.array([6e3, 0.0, -500.0])
    down = velocity(150.0, 0.0, -np.arctan2(1500.0, 6000.0))
    straight = bounded(_level(float(jnp.linalg.norm(end - start)) / 150.0, start, down, end, down, 0.0), 150.0, 0.5)
    assert straight.law.exchange == 1.0
    np.testing.assert_allclose(sampled_speeds(straight)[1], 150.0, rtol=1e-9)
    level = velocity(150.0, 0.0)
    curved = even_path(_level(42.0, start, level, end, level, 3000.0), 1.0, 1.0)
    _, _, _, air, acceleration = (np.asarray(part) for part in motions(curved, jnp.asarray(FRACTIONS * 42.0)))
    speed = np.linalg.norm(air, axis=1)
    np.testing.assert_allclose(g * air[:, 2] / speed - np.sum(acceleration * air, axis=1) / speed, curved.law.braking)


def test_the_published_law_is_linear_in_s():
    path = published_path(-30.0, 0.005)
    for t in np.linspace(-5.0, 45.0, 11):
        reading = clock(path, t)
        np.testing.assert_allclose([reading.s, reading.s_dot, reading.s_ddot], [t / 36.0, 1.0 / 36.0, 0.0], atol=1e-15)
    # The switch gives just that, with the numbers of the even law left aside.
    switched = jax.jit(lambda p: with_even_speed(p, 170.0, even=False))(path)
    np.testing.assert_array_equal(motion(switched, 11.0)[1], motion(path, 11.0)[1])


def test_a_start_time_rounded_in_float32_gives_the_start():
    path = even_path(published_path(-30.0, 0.005), 1.1, 0.3)
    rounded, begin = cast_to_precision(path, np.float32), clock(path, 0.0).s_ddot
    assert begin != 0.0
    assert float(clock(rounded, jnp.asarray(-4e-6, jnp.float32)).s_ddot) == pytest.approx(float(begin), rel=1e-3)
    assert clock(rounded, jnp.asarray(-0.01, jnp.float32)).s_ddot == 0.0
    assert clock(path, -4e-6).s_ddot == 0.0


def test_the_speed_beyond_the_ends_is_constant():
    path = even_path(published_path(-30.0, 0.005), 1.1, 0.3)
    for elapsed, cell in ((-3.0, 0), (36.0 + 20.0, CELLS)):
        phase, _, _, _, acceleration = motion(path, elapsed)
        assert (phase < 0.0) if elapsed < 0.0 else (phase > 1.0)
        assert clock(path, elapsed).s_ddot == 0.0
        # s_dot is that of the end, so that position goes on from there smoothly.
        np.testing.assert_allclose(clock(path, elapsed).s_dot, path.law.speeds[cell] / path.law.slopes[cell], rtol=1e-9)
        assert jnp.all(jnp.isfinite(acceleration))


def _outputs(numbers, path, elapsed, weight):
    """Sum of sample outputs, as a function of the inputs of a path and its law."""
    coefficients, duration, speed_0, deceleration, even = numbers
    path = eqx.tree_at(lambda p: (p.coefficients_n, p.duration), path, (coefficients, duration))
    timed = with_even_speed(path, speed_0, deceleration, even=even > 0.5)
    t = path.start_time + elapsed
    total = timed.position_n(t) + timed.velocity_n(t) + timed.acceleration_n(t)
    return jnp.sum(total * jnp.array([1.0, 2.0, -3.0])) + weight * timed.law.exchange


see, slopes_of = jax.jit(_outputs), jax.jit(jax.grad(_outputs))


@pytest.mark.long
@pytest.mark.parametrize("even", [0.0, 1.0])
@pytest.mark.parametrize("elapsed", [-1e3, 0.0, 18.0, 36.0, 50.0, 1e5])
def test_values_and_gradients_are_finite_within_and_beyond_the_path(even, elapsed):
    for coefficients in (published_path(-30.0, 0.01).coefficients_n, jnp.zeros((3, 5))):
        for speed_0 in (150.0, 0.0):
            numbers = (coefficients, jnp.asarray(36.0), jnp.asarray(speed_0), jnp.asarray(0.8), jnp.asarray(even))
            slopes = slopes_of(numbers, published_path(-30.0), elapsed, 1.0)
            assert all(jnp.all(jnp.isfinite(leaf)) for leaf in slopes)
            path = eqx.tree_at(lambda p: p.coefficients_n, published_path(-30.0), coefficients)
            for leaf in motion(bounded(path, speed_0, 0.8), elapsed):
                assert jnp.all(jnp.isfinite(leaf))


@pytest.mark.long
@pytest.mark.parametrize("even", [0.0, 1.0])
def test_the_gradient_equals_finite_differences(even):
    path, rng = published_path(-21.8, 0.005), np.random.default_rng(2)
    numbers = (path.coefficients_n, jnp.asarray(36.0), jnp.asarray(155.0), jnp.asarray(4.0), jnp.asarray(even))
    assert 0.0 < bounded(path, 155.0, 4.0).law.exchange < 1.0
    slope = slopes_of(numbers, path, 14.0, 100.0)
    for _ in range(4):
        displacement = [jnp.asarray(rng.normal(size=shape)) for shape in ((3, 5), (), (), ())] + [jnp.zeros(())]
        forward, backward = (
            see(tuple(n + step * w for n, w in zip(numbers, displacement, strict=True)), path, 14.0, 100.0)
            for step in (1e-4, -1e-4)
        )
        analytic = sum(jnp.sum(s * w) for s, w in zip(slope, displacement, strict=True))
        # Central differences: 1e-8 of truncation, 1e-9/1e-4 of rounding, on slopes of 10 to 1e3.
        np.testing.assert_allclose(analytic, (forward - backward) / 2e-4, rtol=1e-5, atol=1e-4)


@pytest.mark.long
def test_a_batch_equals_single_paths():
    paths = [published_path(-30.0, b_4) for b_4 in (0.0, 0.005, 0.01)]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *paths)
    ratios, exchanges = jnp.array([0.9, 1.0, 1.2]), jnp.array([0.0, 0.5, 1.0])
    batch = jax.jit(jax.vmap(lambda p, r, k: even_path(p, r, k).position_n(20.0)))(stacked, ratios, exchanges)
    for path, ratio, exchange, position in zip(paths, ratios, exchanges, batch, strict=True):
        np.testing.assert_allclose(motion(even_path(path, ratio, exchange), 20.0)[1], position, atol=1e-9)


def test_changed_numbers_do_not_recompile():
    traces = []

    @jax.jit
    def timed(path, speed_0, deceleration, even):
        traces.append(1)
        return with_even_speed(path, speed_0, deceleration, even=even).law.exchange

    for speed_0, even in ((150.0, True), (140.0, False)):
        timed(published_path(-30.0), jnp.asarray(speed_0), jnp.asarray(0.01 * speed_0), jnp.asarray(even))
    assert len(traces) == 1
