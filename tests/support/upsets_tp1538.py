"""Twelve upsets of the F-16 of TP-1538, flown with the autopilot of the scenarios."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from anser.aircraft import AircraftState, Controls, air_data_and_forces
from anser.aircraft.air_data import air_data
from anser.aircraft.engines import EnginePower
from anser.aircraft_files import load_airframe
from anser.control import default_limits, published_gains
from anser.control.autopilot import velocity_control
from anser.control.autopilot_state import initial_autopilot_state
from anser.control.onboard_model import onboard_model, path_motion
from anser.environment import standard_environment
from anser.parts import PathCommand
from anser.simulation.response import exact_belief
from anser.simulation.vehicle import advance
from anser.spatial.rotations import quaternion_from_rotation
from anser.spatial.wind_axes import attitude_from_path
from anser.units import DEG_RAD

ENVIRONMENT = standard_environment()
SPEED_M_S, STEP_S, STEPS, EVERY = 160.0, 0.01, 4000, 10
AIRFRAME = load_airframe("f16", "tp1538")

# V m/s; alpha, beta, mu, gamma deg; P, Q, R rad/s; altitude m; c.g. of chord
UPSETS = {
    "alpha 40, level": (100, 40, 0, 0, 0, 0, 0, 0, 6000, 0.30),
    "alpha 55, sinking": (80, 55, 0, 0, -40, 0, 0, 0, 6000, 0.30),
    "alpha 70, falling": (65, 70, 0, 0, -65, 0, 0, 0, 6000, 0.30),
    "alpha 60, slipping and yawing": (80, 60, 10, 20, -60, 0.2, 0.0, 0.4, 6000, 0.30),
    "spin: alpha 45, yawing 1.2 rad/s": (80, 45, 5, 30, -70, 0.9, 0.2, 1.2, 8000, 0.30),
    "flat spin: alpha 65, yawing 1.5 rad/s": (65, 65, 0, 0, -85, 0.7, 0.0, 1.5, 8000, 0.30),
    "inverted": (150, 3, 0, 180, 0, 0, 0, 0, 3000, 0.30),
    "inverted, alpha 50, rotating": (90, 50, 5, 170, -40, 0.6, 0.4, 1.0, 6000, 0.30),
    "spiral dive": (200, 12, 0, 80, -50, 0.0, 0.25, 0.05, 5000, 0.30),
    "nose 70 deg up, slow": (60, 10, 0, 0, 60, 0, 0, 0, 5000, 0.30),
    "alpha -18, pushed over": (90, -18, 0, 0, -10, 0, -0.5, 0, 5000, 0.30),
    "deep stall: alpha 63, c.g. 0.40": (64, 63, 0, 0, -60, 0, 0, 0, 8000, 0.40),
}
RECOVERED_DEG = (5.0, 3.0, 2.0)
"""Greatest bank, path angle and sideslip of level flight."""


def start_of(V, alpha, beta, mu, gamma, P, Q, R, altitude, x_cg, airframe=AIRFRAME):
    """State and airframe of an upset; the flap is at its scheduled position, the engine at 20 percent."""
    airframe = eqx.tree_at(lambda a: a.x_cg, airframe, jnp.asarray(float(x_cg)))
    alpha, beta, mu, gamma = (x * DEG_RAD for x in (alpha, beta, mu, gamma))
    velocity_b = V * jnp.array([np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)])
    data = air_data(velocity_b, float(altitude), ENVIRONMENT.atmosphere.at(float(altitude)))
    state = AircraftState(
        position_n=jnp.array([0.0, 0.0, -float(altitude)]),
        velocity_b=velocity_b,
        quaternion=quaternion_from_rotation(attitude_from_path(mu, gamma, 0.0, alpha, beta)),
        rates_b=jnp.array([P, Q, R], dtype=float),
        actuators=airframe.actuators.steady_state_in_flow(jnp.zeros(len(airframe.actuators.names)), data),
        engine=EnginePower(jnp.asarray(20.0)),
    )
    return airframe, state


def recover(airframe, start, steps=STEPS):
    """Fly with level flight to the north commanded; returns a record of every tenth step."""
    gravity = ENVIRONMENT.gravity
    limits, gains, zero = default_limits(), published_gains(), jnp.zeros(())
    initial_condition = air_data_and_forces(airframe, ENVIRONMENT, 0.0, start)
    motion = path_motion(
        initial_condition, initial_condition.wrench.force_b, start.velocity_b, airframe.mass_properties.mass, gravity
    )
    attitude = jnp.stack([motion.mu, motion.alpha, motion.beta])
    command = PathCommand(jnp.asarray(SPEED_M_S), zero, zero, zero, zero, zero)

    def one(carry, _):
        state, memory = carry
        model = onboard_model(exact_belief(airframe, ENVIRONMENT, state), limits, gains, memory, STEP_S)
        controls, _, memory = velocity_control(model, gains, memory, command)
        return (advance(airframe, ENVIRONMENT, 0.0, state, controls, STEP_S), memory), None

    def record(carry, _):
        state = carry[0]
        initial_condition = air_data_and_forces(airframe, ENVIRONMENT, 0.0, state)
        motion = path_motion(
            initial_condition,
            initial_condition.wrench.force_b,
            state.velocity_b,
            airframe.mass_properties.mass,
            gravity,
        )
        values = {
            "altitude": -state.position_n[2],
            "off_deg": jnp.stack([motion.mu, motion.gamma, motion.beta]) / DEG_RAD,
            "alpha_deg": motion.alpha / DEG_RAD,
            "V": motion.V,
            "rates": state.rates_b,
            "surfaces_deg": state.surfaces / DEG_RAD,
            "pitch_acceleration": initial_condition.wrench.moment_b[1] / airframe.mass_properties.inertia_b[1, 1],
            "outside": airframe.outside_tables(initial_condition.air_data),
        }
        return jax.lax.scan(one, carry, length=EVERY)[0], values

    memory = initial_autopilot_state(attitude, start.rates_b, start.surfaces)
    return jax.lax.scan(record, (start, memory), length=steps // EVERY)[1]


def flown(upsets=UPSETS, steps=STEPS, airframe=AIRFRAME):
    """History of each upset by name."""
    airframes, starts = zip(*(start_of(*upset, airframe=airframe) for upset in upsets.values()), strict=True)
    start = jax.tree.map(lambda *leaves: jnp.stack(leaves), *starts)
    x_cg = jnp.stack([model.x_cg for model in airframes])

    @jax.jit
    @jax.vmap
    def fly(x, model):
        return recover(eqx.tree_at(lambda a: a.x_cg, airframe, x), model, steps)

    histories = jax.tree.map(np.asarray, fly(x_cg, start))
    return {name: {key: values[k] for key, values in histories.items()} for k, name in enumerate(upsets)}


def held(upset, steps=3000):
    """Angle of attack (deg) at each step with full nose-down elevator, aileron and rudder against the yaw."""
    airframe, start = start_of(*upset)
    down = airframe.actuators.upper[0]

    def one(state, _):
        lateral = jnp.clip(0.5 * state.rates_b[jnp.array([0, 2])], -0.3, 0.3)
        surfaces = jnp.stack([down, lateral[0], lateral[1], jnp.zeros(())])
        next_state = advance(airframe, ENVIRONMENT, 0.0, state, Controls(surfaces, jnp.asarray(0.0)), STEP_S)
        return next_state, jnp.arctan2(state.velocity_b[2], state.velocity_b[0]) / DEG_RAD

    return np.asarray(jax.jit(lambda state: jax.lax.scan(one, state, length=steps)[1])(start))


def recovery_s(history):
    """Time of the recovery to level flight, s; infinite unless the last 5 s are level."""
    level = np.all(np.abs(history["off_deg"]) < RECOVERED_DEG, axis=1) & (history["alpha_deg"] < 25.0)
    not_level = np.flatnonzero(~level)
    time = 0.0 if not_level.size == 0 else (not_level[-1] + 1) * EVERY * STEP_S
    return time if time < (len(level) * EVERY * STEP_S) - 5.0 else np.inf
