"""Models of the cases in `identification_cases`, for output error and filter error."""

import jax.numpy as jnp

from anser.identification.dynamic_models import DynamicModel
from support.identification_cases import UNSTABLE_U0


def short_period_equations(x, u, theta):
    alpha, q = x
    elevator = u[0]
    alpha_dot = theta["Z_alpha"] * alpha + theta["Z_q"] * q + theta["Z_elevator"] * elevator
    q_dot = theta["M_alpha"] * alpha + theta["M_q"] * q + theta["M_elevator"] * elevator
    return jnp.stack([alpha_dot, q_dot]), x


SHORT_PERIOD = DynamicModel(short_period_equations, ("alpha", "q"), ("elevator",), ("alpha", "q"))
SHORT_PERIOD_NAMES = ("Z_alpha", "Z_q", "Z_elevator", "M_alpha", "M_q", "M_elevator")


def unstable_equations(x, u, theta):
    w, q = x
    a_z = theta["Z_w"] * w + theta["Z_q"] * q + theta["Z_d"] * u[0]
    q_dot = theta["M_w"] * w + theta["M_q"] * q + theta["M_d"] * u[0]
    return jnp.stack([a_z + UNSTABLE_U0 * q, q_dot]), jnp.stack([w, q, a_z])


UNSTABLE = DynamicModel(unstable_equations, ("w", "q"), ("delta",), ("w", "q", "a_z"))
