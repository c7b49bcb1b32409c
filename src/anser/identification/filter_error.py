"""Filter-error method: maximum likelihood for a model with process noise, by the innovations of a Kalman filter.

The gain varies in time; for nonlinear models the filter is an extended Kalman filter. Source: R. V. Jategaonkar,
*Flight Vehicle System Identification*, 2nd edition, AIAA 2015, chapter 5.
"""

from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from anser.compiling.options import compiled_quickly
from anser.identification.dynamic_models import Case, DynamicModel, Manoeuvre, prepare_parameters
from anser.identification.estimates import Estimate, collinearity, coloured_covariance
from anser.identification.likelihood import LikelihoodPoint, Values, maximize_likelihood
from anser.identification.output_error import noise_floor, start_levels


def estimate_filter_error(
    model: DynamicModel,
    manoeuvre: Manoeuvre,
    start: Mapping[str, float],
    process_noise: Mapping[str, float],
    *,
    fixed: Mapping[str, float] | None = None,
    initial_states: Sequence[str] = (),
    noise: Sequence[float] | None = None,
) -> Estimate:
    """Estimate parameters and process noise by maximum likelihood of the innovations, with exact derivatives.

    Parameters
    ----------
    model, manoeuvre, start, fixed, initial_states
        See `estimate_output_error`.
    process_noise
        Start values of the spectral density of white noise in the rates of states, by state, in (unit of the rate)^2 s.
        The estimate is the parameter `noise(STATE)`, at least 0.
    noise
        Standard deviations of the measurement noise, in the order and units of the model's outputs; None: estimated
        with the parameters.

    Raises
    ------
    ValueError
        If an argument is not valid, the filter diverges, the search does not converge, or the outputs do not determine
        the parameters; the message names the parameters.
    """
    parameters, values = prepare_parameters(model, manoeuvre, start, fixed, initial_states)
    if (
        not process_noise
        or not set(process_noise) <= set(model.states)
        or not all(0.0 <= q < np.inf for q in process_noise.values())
    ):
        raise ValueError(
            f"process_noise: arrived {dict(process_noise)}; expected spectral densities for some of {model.states}"
        )
    noisy = tuple(model.states.index(name) for name in process_noise)
    levels = start_levels(model, manoeuvre, noise)
    count, names = values.size, (*parameters.names, *(f"noise({name})" for name in process_noise))
    first = 2.0 * np.log(levels)
    unknown = np.concatenate([values, list(process_noise.values()), first if noise is None else []])
    lower = np.full(unknown.size, -np.inf)
    lower[count : len(names)] = 0.0
    if noise is None:
        lower[len(names) :] = 2.0 * np.log(noise_floor(manoeuvre))

    case = parameters.case(manoeuvre)

    def evaluate(unknown: Values) -> LikelihoodPoint:
        logs = unknown[len(names) :] if noise is None else first
        parts = (jnp.asarray(part) for part in (unknown[:count], unknown[count : len(names)], logs))
        cost, gradient, information, *rest = map(np.asarray, _likelihood(case, noisy, *parts))
        finite = np.isfinite(cost) and np.all(np.isfinite(information))
        selected = slice(None) if noise is None else slice(len(names))
        return LikelihoodPoint(
            float(cost) if finite else np.inf, gradient[selected], information[selected, selected], rest
        )

    values, point = maximize_likelihood(evaluate, unknown, lower)
    innovations, whitened, sensitivities = point.prediction
    inside = slice(len(names))
    covariance = np.linalg.inv(point.information)[inside, inside]
    errors = coloured_covariance(sensitivities[..., :count], whitened, covariance[:count, :count])
    widened = covariance.copy()  # innovations that are not white widen the intervals of the model's parameters
    widened[:count, :count] = errors.covariance
    return Estimate(
        method="filter error",
        names=names,
        values=values[inside],
        covariance=widened,
        white_covariance=covariance,
        degrees_of_freedom=errors.degrees_of_freedom,
        **collinearity(point.information[inside, inside], names, "parameters")._asdict(),
        responses=model.outputs,
        measured=manoeuvre.outputs,
        fitted=manoeuvre.outputs - innovations,
        sample_points=manoeuvre.time_s,
    )


@compiled_quickly
def _likelihood(case: Case, noisy: tuple[int, ...], values: Array, densities: Array, logs: Array) -> tuple[Array, ...]:
    """Return negative log-likelihood, gradient, Fisher information, innovations, whitened innovations, sensitivities.

    `noisy` are the indices of the states with process noise, `densities` the spectral densities, `logs` the logarithms
    of the variances of the measurement noise. Derivatives are with respect to (values, densities, logs).

    The outputs of a sample correct the state one after the other. The whitened innovations and the sensitivities (minus
    the derivatives of the innovations) belong to these single corrections; both are divided by the standard deviations
    of the innovations. The returned innovations are the measured outputs minus the outputs predicted before the
    corrections.
    """
    indices = np.asarray(noisy, dtype=int)

    def innovate(unknown: tuple[Array, Array, Array]) -> tuple[tuple[Array, Array], tuple[Array, Array, Array]]:
        """Run the filter; return (innovations, variances), to be differentiated, and the auxiliary data of `jacfwd`."""
        values, densities, logs = unknown
        theta, start = case.start(values)
        R, size = jnp.exp(logs), start.size
        Q = jnp.zeros((size, size)).at[indices, indices].set(densities)
        C = jax.jacfwd(lambda x: case.equations(x, case.inputs[0], theta)[1])(start)
        # covariance of a state computed from one sample of the outputs
        P = jnp.linalg.inv(C.T @ (C / R[:, None]) + 1e-6 * jnp.eye(size))

        def proceed(carry: tuple[Array, Array], sample: tuple[Array, Array, Array]) -> tuple[tuple, tuple]:
            (x, P), (u, u_next, z) = carry, sample
            C, y = jax.jacfwd(lambda x: 2 * (case.equations(x, u, theta)[1],), has_aux=True)(x)
            errors, predicted, innovations, variances = z - y, x, [], []
            for k in range(R.size):
                cross = P @ C[k]
                variance = C[k] @ cross + R[k]
                innovation = errors[k] - C[k] @ (x - predicted)
                x, P = x + cross * (innovation / variance), P - jnp.outer(cross, cross) / variance
                innovations.append(innovation)
                variances.append(variance)
            transition, next_state = jax.jacfwd(lambda x: 2 * (case.advance(x, u, u_next, theta),), has_aux=True)(x)
            P = transition @ (P + 0.5 * case.step_s * Q) @ transition.T + 0.5 * case.step_s * Q
            return (next_state, P), (jnp.stack(innovations), jnp.stack(variances), errors)

        innovations, variances, errors = jax.lax.scan(proceed, (start, P), case.samples)[1]
        return (innovations, variances), (innovations, variances, errors)

    (v_by, s_by), (v, s, errors) = jax.jacfwd(innovate, has_aux=True)((values, densities, logs))
    v_by, s_by = (jnp.concatenate(parts, axis=-1) for parts in (v_by, s_by))
    whitened, v_by = v / jnp.sqrt(s), v_by / jnp.sqrt(s)[..., None]
    s_by = s_by / s[..., None]
    cost = 0.5 * jnp.sum(whitened**2 + jnp.log(s))
    gradient = jnp.einsum("ia,iap->p", whitened, v_by) + 0.5 * jnp.einsum("ia,iap->p", 1.0 - whitened**2, s_by)
    information = jnp.einsum("iap,iaq->pq", v_by, v_by) + 0.5 * jnp.einsum("iap,iaq->pq", s_by, s_by)
    return cost, gradient, information, errors, whitened, -v_by
