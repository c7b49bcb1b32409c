"""Survey flight with running summary, against the history of the same flight; and points of the trim map."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.aircraft import air_data_and_forces
from anser.aircraft_files import load_airframe
from anser.control import default_limits, published_gains
from anser.control.autopilot import velocity_control
from anser.control.onboard_model import onboard_model
from anser.environment import standard_environment, wgs84_earth
from anser.parts import PathCommand
from anser.simulation.response import exact_belief, step_metrics, trimmed_autopilot_state
from anser.simulation.survey_flight import AUTOPILOT_LIMITS, BETA_BOUND, TABLE_AXES, survey_flight
from anser.simulation.vehicle import advance
from anser.steady import TrimTarget
from anser.steady.trim import TRIM_OBSTACLES, trim_map_point

pytestmark = pytest.mark.long


DEGREE = np.pi / 180
STEP, COUNT = 0.01, 600
AIRFRAME, ENVIRONMENT, LIMITS, GAINS = load_airframe(), standard_environment(), default_limits(), published_gains()
G = float(ENVIRONMENT.gravity)
# altitude, speed, path angle, turn rate
POINTS = {
    "level": (1000.0, 150.0, 0.0, 0.0),
    "turn": (1000.0, 170.0, 0.0, G * 3**0.5 / 170.0),
    "fast descent": (9000.0, 250.0, -5 * DEGREE, 0.0),
    "too slow": (1000.0, 35.0, 0.0, 0.0),
    "too steep": (10000.0, 150.0, 30 * DEGREE, 0.0),
    "too high": (15500.0, 250.0, 0.0, 0.0),
    "supersonic": (1000.0, 360.0, 0.0, 0.0),
    "dive": (1000.0, 150.0, -20 * DEGREE, 0.0),
}
FLIGHTS = {
    "level": (12.0, 3 * DEGREE, 0.0),
    "turn": (0.0, 0.0, 15 * DEGREE),
    "fast descent": (-10.0, -2 * DEGREE, 10 * DEGREE),
}


@pytest.fixture(scope="module")
def points():
    """The points in one compiled call, by name."""
    h, V, gamma, turn = (jnp.asarray(column) for column in np.array(list(POINTS.values())).T)
    zero = jnp.zeros_like(h)
    targets = TrimTarget(V, h, gamma, zero, turn, zero, zero)
    map_points = eqx.filter_jit(jax.vmap(lambda target: trim_map_point(AIRFRAME, ENVIRONMENT, target)))(targets)
    return {name: jax.tree.map(lambda leaf, k=k: leaf[k], (map_points, targets)) for k, name in enumerate(POINTS)}


def _history(trim, target, size):
    """History of the same flight, one row per sample: time, outputs, state, deflections, ..."""

    def one(carry, k):
        state, memory = carry
        time = k * STEP
        condition = air_data_and_forces(AIRFRAME, ENVIRONMENT, time, state)
        model = onboard_model(exact_belief(AIRFRAME, ENVIRONMENT, state), LIMITS, GAINS, memory, STEP)
        course = target.course + target.turn_rate * time
        zero = jnp.zeros(())
        command = PathCommand(
            target.speed + size[0], target.path_angle + size[1], course + size[2], zero, zero, target.turn_rate
        )
        controls, signals, memory = velocity_control(model, GAINS, memory, command)
        next_state = advance(AIRFRAME, ENVIRONMENT, time, state, controls, STEP)
        sample = (time, state, condition, controls, signals, course, AIRFRAME.outside_tables(condition.air_data))
        return (next_state, memory), sample

    return jax.lax.scan(one, (trim.state, trimmed_autopilot_state(trim)), jnp.arange(COUNT))


@pytest.fixture(scope="module")
def flights(points):
    """Summary and history of each flight, by name."""
    chosen = [(points[name][0].trim, points[name][1], jnp.asarray(size)) for name, size in FLIGHTS.items()]
    batch = jax.tree.map(lambda *leaves: jnp.stack(leaves), *chosen)

    def both(trim, target, size):
        tolerance = jnp.where(size == 0.0, 0.3 * DEGREE, 0.05 * jnp.abs(size))
        summary = survey_flight(
            AIRFRAME, ENVIRONMENT, GAINS, LIMITS, trim, target, size, tolerance, jnp.asarray(STEP), COUNT
        )
        return summary, _history(trim, target, size)[1]

    results = eqx.filter_jit(jax.vmap(both))(*batch)
    return {name: jax.tree.map(lambda leaf, k=k: np.asarray(leaf[k]), results) for k, name in enumerate(FLIGHTS)}


@pytest.mark.parametrize("name", FLIGHTS)
def test_summary_errors_equal_the_history(flights, name):
    """Two programs with the same equations: rounding (1e-13), which the loops amplify a little."""
    summary, (time, state, _, _, signals, course, _) = flights[name]
    motion, size = signals.motion, np.array(FLIGHTS[name])
    # from the steady turn: what is left is the step's own course
    chi = np.unwrap(motion.chi) - course
    measured = np.stack([motion.V, motion.gamma, chi], axis=1)
    start = np.stack([motion.V[0], motion.gamma[0], chi[0]])
    stops = (AIRFRAME.actuators.lower, AIRFRAME.actuators.upper)
    figures = step_metrics(*(jnp.asarray(x) for x in (time, measured, size, state.surfaces)), stops)
    stepped = np.asarray(figures.stepped)
    share = np.where(stepped, np.asarray(summary.final_error) / np.where(stepped, size, 1.0), 0.0)
    np.testing.assert_allclose(share, figures.final_error, atol=1e-9)
    np.testing.assert_allclose(summary.overshoot, figures.overshoot, atol=1e-9)
    np.testing.assert_allclose(summary.coupling, figures.coupling, atol=1e-9)
    settled = np.asarray(figures.settling_time)[stepped]
    np.testing.assert_array_equal(np.asarray(summary.settling_time)[stepped], settled)
    late = np.abs(size + start - measured)[-COUNT // 10 :]
    np.testing.assert_allclose(summary.final_error_max, late.max(axis=0), atol=1e-9)


@pytest.mark.parametrize("name", FLIGHTS)
def test_summary_extremes_equal_the_history(flights, name):
    summary, (_, state, condition, controls, _, _, _) = flights[name]
    data, actuators = condition.air_data, jax.tree.map(np.asarray, AIRFRAME.actuators)
    load = -(condition.aerodynamic.force_b + condition.propulsive.force_b)[:, 2] / (
        float(AIRFRAME.mass_properties.mass) * G
    )
    surface_rates = (
        np.clip(controls.surfaces, actuators.lower, actuators.upper) - state.surfaces
    ) / actuators.time_constant
    rate = np.minimum(np.abs(surface_rates), actuators.rate_limit) / actuators.rate_limit
    for value, expected in (
        (summary.alpha_min, data.alpha.min()),
        (summary.alpha_max, data.alpha.max()),
        (summary.beta_max, np.abs(data.beta).max()),
        (summary.load_factor_min, load.min()),
        (summary.load_factor_max, load.max()),
        (summary.surface_share, (np.abs(state.surfaces) / actuators.upper).max(axis=0)),
        (summary.surface_rate_share, rate.max(axis=0)),
        (summary.body_rate_share, (np.abs(state.rates_b) / np.asarray(LIMITS.rates_max)).max(axis=0)),
    ):
        np.testing.assert_allclose(value, expected, atol=1e-9)


@pytest.mark.parametrize("name", FLIGHTS)
def test_summary_limit_times_equal_the_history(flights, name):
    """Sums of the sampling period in another order: 1e-12. The surface's rate limit is reached to rounding or not."""
    summary, (_, _, _, _, signals, _, outside) = flights[name]
    total = dict(zip(AUTOPILOT_LIMITS, np.asarray(summary.limited_time), strict=True))
    thrust, attitude = signals.thrust, signals.attitude
    bank, alpha, _ = attitude.angles.T
    at_alpha = (alpha <= LIMITS.alpha_min) | (alpha >= LIMITS.alpha_max)
    not_at_alpha = attitude.alpha_saturated & ~at_alpha
    for value, flag in (
        (total["thrust_max"] + total["thrust_idle"], thrust.saturated),
        (total["alpha"], (attitude.alpha_saturated & at_alpha) | attitude.lift_short),
        (total["load_factor"] + total["unloading"], not_at_alpha | attitude.load_factor_short),
        (total["bank"], np.isclose(np.abs(bank), LIMITS.bank_max, rtol=1e-12)),
        (total["body_rates"], signals.rates_limited),
        (total["surfaces"], signals.surfaces_limited),
    ):
        assert value == pytest.approx(STEP * int(np.sum(flag)), abs=1e-12)
    assert float(summary.beta_max) < BETA_BOUND
    np.testing.assert_array_equal(summary.limited_before_slip, summary.limited_time)
    assert np.all(summary.limited_late <= summary.limited_time)
    assert not np.any(outside)
    assert np.isinf(summary.left_time).all()
    assert bool(summary.finite)


def test_the_flights_reach_limits(flights):
    """Otherwise the previous test compares zeros: +12 m/s needs full thrust, -10 m/s in a descent needs idle."""
    index = AUTOPILOT_LIMITS.index
    assert flights["level"][0].limited_time[index("thrust_max")] > 0.5
    assert flights["fast descent"][0].limited_time[index("thrust_idle")] > 0.5
    assert flights["turn"][0].limited_time[index("bank")] > 0.1


@pytest.mark.parametrize(
    ("name", "stops"),
    [
        ("level", set()),
        ("turn", set()),
        ("fast descent", set()),
        ("too slow", {"alpha", "no_balance", "thrust_max"}),
        ("too steep", {"thrust_max"}),
        ("too high", {"tables"}),
        ("supersonic", {"tables"}),
        ("dive", {"thrust_idle"}),
    ],
)
def test_obstacles_of_a_trim_point_are_named(points, name, stops):
    point, _ = points[name]
    obstacles = {stop for stop, stands in zip(TRIM_OBSTACLES, np.asarray(point.obstacles), strict=True) if stands}
    assert bool(point.trimmable) == (not stops)
    assert obstacles <= stops
    assert bool(obstacles) == bool(stops)


def test_trim_reserves_match_the_load_factor(points):
    """A level turn at 60 deg of bank has 2 g along the lift: nearly the same along body z at small alpha."""
    level, turn = points["level"][0], points["turn"][0]
    assert float(level.power_margin) == pytest.approx(1 - float(level.trim.power) / 100, abs=1e-12)
    assert float(level.power_margin + level.power_above_idle) == pytest.approx(1.0, abs=1e-12)
    elevator = float(level.trim.state.surfaces[0]) / DEGREE
    assert float(level.surface_margin[0]) == pytest.approx(1 - abs(elevator) / 25.0, abs=1e-9)
    assert float(turn.load_factor) == pytest.approx(2.0 * np.cos(float(turn.trim.alpha)), rel=0.03)
    assert len(TABLE_AXES) == 4


def test_load_factors_over_a_round_earth_are_by_the_weight_at_the_aircraft():
    environment = standard_environment(earth=wgs84_earth(0.8, 0.2))
    zero = jnp.zeros(())
    target = TrimTarget(jnp.asarray(200.0), jnp.asarray(10_000.0), zero, zero, zero, zero, zero)
    point = eqx.filter_jit(trim_map_point)(AIRFRAME, environment, target)

    @eqx.filter_jit
    def survey(trim):
        size, tolerance = jnp.zeros(3), jnp.full(3, 0.1)
        return survey_flight(AIRFRAME, environment, GAINS, LIMITS, trim, target, size, tolerance, STEP, 2)

    condition = jax.jit(lambda state: air_data_and_forces(AIRFRAME, environment, 0.0, state))(point.trim.state)
    weight = float(AIRFRAME.mass_properties.mass * condition.earth.gravity)
    assert weight < 0.998 * float(AIRFRAME.mass_properties.mass * environment.gravity)
    expected = pytest.approx(-float(condition.wrench.force_b[2]) / weight, rel=1e-4)
    assert (float(point.load_factor), float(survey(point.trim).load_factor_max)) == (expected, expected)
