"""Verification of the integrator: its observed order, and conserved quantities of a body without air forces."""

import functools
import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from anser.aircraft.actuators import Deflections
from anser.aircraft.airframe import AircraftState, Controls
from anser.aircraft.engines import EnginePower
from anser.aircraft.motion import EarthFixedState, earth_fixed_state, require_round_earth
from anser.aircraft.simple_body import SimpleBody
from anser.aircraft_files.library import load_body
from anser.environment.earth import wgs84_earth
from anser.environment.environment import Environment, standard_environment
from anser.numerics.linear import cross
from anser.shapes import Integer, Scalar, ScalarLike
from anser.simulation.vehicle import advance
from anser.spatial.frames import eci_from_ecef, rotation_ecef_from_eci, velocity_eci_from_ecef
from anser.spatial.rotations import quaternion_from_euler, rotate_back, rotation_from_quaternion, safe_norm
from anser.units import DEG_RAD, FOOT_M
from anser.verification.checks import Check, Comparison, make_check

_STEPS_S = (0.08, 0.04, 0.02, 0.01)
_DURATION_S = 8.0
_CONTROLS = Controls(jnp.zeros(3), jnp.zeros(()))


@eqx.filter_jit
def _fly(
    body: SimpleBody, environment: Environment, start: EarthFixedState, step: ScalarLike, count: Integer
) -> EarthFixedState:
    def advance_step(k: Integer, state: EarthFixedState) -> EarthFixedState:
        return advance(body, environment, k * step, state, _CONTROLS, step)

    return jax.lax.fori_loop(0, count, advance_step, start)


def _fly_for(name: str, start: EarthFixedState, step_s: float, duration_s: float) -> EarthFixedState:
    body, environment = load_body(name), _environment()
    return _fly(body, environment, start, jnp.asarray(step_s), jnp.asarray(round(duration_s / step_s)))


@functools.cache
def _environment() -> Environment:
    return standard_environment(earth=wgs84_earth(0.5, 1.0))


def _start() -> EarthFixedState:
    """Return the initial state: a brick thrown at 199 m/s, tumbling as in [NESC] cases 2 and 3, at 30,000 ft."""
    local_start = AircraftState(
        position_n=jnp.array([0.0, 0.0, -30_000.0 * FOOT_M]),
        velocity_b=jnp.array([180.0, 60.0, 60.0]),
        quaternion=quaternion_from_euler(jnp.asarray(0.3), jnp.asarray(-0.2), jnp.asarray(1.0)),
        rates_b=jnp.array([10.0, 20.0, 30.0]) * DEG_RAD,
        actuators=Deflections(jnp.zeros(3)),
        engine=EnginePower(jnp.zeros(())),
    )
    return earth_fixed_state(require_round_earth(_environment()), local_start)


def order() -> tuple[Comparison, ...]:
    """Compare the observed order of convergence with 4, for each three successive step sizes.

    The observed order is log2(|x_1 - x_0| / |x_2 - x_1|), where x_0, x_1 and x_2 are the final body rates, quaternions
    or body velocities of flights with the steps h, h / 2 and h / 4.
    """
    final_states = [_fly_for("brick", _start(), step_s, _DURATION_S) for step_s in _STEPS_S]
    comparisons = []
    for name, label in {"rates_b": "rates", "quaternion": "attitude", "velocity_b": "velocity"}.items():
        values = [np.asarray(getattr(final_state, name)) for final_state in final_states]
        changes = [np.linalg.norm(b - a) for a, b in itertools.pairwise(values)]
        for k in range(len(_STEPS_S) - 2):
            point = f"{label}, steps {_STEPS_S[k]:g}, {_STEPS_S[k + 1]:g}, {_STEPS_S[k + 2]:g} s"
            comparisons.append(Comparison("order", point, "", 4.0, float(np.log2(changes[k] / changes[k + 1])), 0.2))
    return tuple(comparisons)


def invariants() -> tuple[Comparison, ...]:
    """Compare with 0 the relative changes of energy and angular momentum in 30 s of flight without air forces.

    The angular momenta are the orbital component along the Earth's axis, and the vector of the body's rotation in
    inertial axes. The length of the attitude quaternion is compared with 1.
    """
    start = _start()
    end = _fly_for("undamped-brick", start, 0.01, 30.0)
    start_values, end_values = _conserved(start, jnp.asarray(0.0)), _conserved(end, jnp.asarray(30.0))
    names = ("energy per mass", "polar angular momentum per mass", "rotational angular momentum")
    comparisons = [
        Comparison(name, "relative change in 30 s", "", 0.0, float(jnp.linalg.norm(b - a) / jnp.linalg.norm(a)), 3e-10)
        for name, a, b in zip(names, start_values, end_values, strict=True)
    ]
    length = float(safe_norm(end.quaternion[1:]) ** 2 + end.quaternion[0] ** 2) - 1.0
    return (*comparisons, Comparison("length of the quaternion", "squared, less 1", "", 0.0, length, 1e-15))


@jax.jit
def _conserved(state: EarthFixedState, time: Scalar) -> tuple[jax.Array, jax.Array, jax.Array]:
    earth, body = require_round_earth(_environment()), load_body("undamped-brick")
    position_i = eci_from_ecef(state.position_e, time, 0.0)
    velocity_e = rotate_back(rotation_from_quaternion(state.quaternion), state.velocity_b)
    velocity_i = velocity_eci_from_ecef(state.position_e, velocity_e, time, 0.0)
    r = safe_norm(position_i)
    gm, j2, a = earth.gravitational_parameter, earth.oblateness_j2, earth.ellipsoid.a
    legendre = 0.5 * (3.0 * (position_i[2] / r) ** 2 - 1.0)
    energy = 0.5 * jnp.sum(velocity_i**2) - gm / r * (1.0 - j2 * (a / r) ** 2 * legendre)
    spin_e = rotate_back(rotation_from_quaternion(state.quaternion), body.mass_properties.inertia_b @ state.rates_b)
    spin_i = rotate_back(rotation_ecef_from_eci(time, 0.0), spin_e)
    return energy[None], cross(position_i, velocity_i)[2:], spin_i


INTEGRATION_CHECKS: tuple[Check, ...] = (
    make_check("integrator-order", order),
    make_check("invariants", invariants),
)
