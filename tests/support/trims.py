"""Trim and held-control flight, compiled once for all tests of one airframe's structure."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from anser.aircraft import F16, AbstractAirframe, AircraftState, Controls
from anser.environment import Environment
from anser.simulation.vehicle import advance
from anser.spatial import flow_angles, path_angles, rotation_from_quaternion
from anser.spatial.rotations import rotate, rotate_back
from anser.spatial.wind_axes import bank_about_velocity
from anser.steady import TrimTarget, solve_trim, trim_target

SAMPLES = 10


def glider(f16: F16) -> F16:
    """F-16 with an engine without thrust: no level flight exists."""
    (cells,) = f16.engine.thrust_tables.cells
    return eqx.tree_at(lambda a: a.engine.thrust_tables.cells[0], f16, jnp.zeros_like(cells))


trim = eqx.filter_jit(solve_trim)


def target_deg(
    speed: float, altitude: float = 1000.0, path_deg: float = 0.0, course_deg: float = 0.0, turn_deg_s: float = 0.0
) -> TrimTarget:
    """Build a target from m/s, m and degrees."""
    return trim_target(speed, altitude, *np.deg2rad([path_deg, course_deg, turn_deg_s]))


@jax.jit
def fly(
    airframe: AbstractAirframe, environment: Environment, state: AircraftState, controls: Controls, step, count
) -> AircraftState:
    """Fly `SAMPLES` times `count` steps of `advance` with held controls; the states after each `count`."""

    def some(state: AircraftState, _: None) -> tuple[AircraftState, AircraftState]:
        next_state = jax.lax.fori_loop(
            0, count, lambda k, s: advance(airframe, environment, 0.0, s, controls, step), state
        )
        return next_state, next_state

    return jax.lax.scan(some, state, length=SAMPLES)[1]


@jax.jit
def flight_angles(environment: Environment, state: AircraftState):
    """V, alpha, beta, mu, gamma, chi through the air, shape (6,)."""
    R_bn = rotation_from_quaternion(state.quaternion)
    velocity_air_b = state.velocity_b - rotate(R_bn, environment.wind.at(state.position_n, 0.0))
    V, alpha, beta = flow_angles(velocity_air_b)
    gamma, chi = path_angles(rotate_back(R_bn, velocity_air_b))
    return jnp.stack([V, alpha, beta, bank_about_velocity(R_bn, alpha, beta), gamma, chi])
