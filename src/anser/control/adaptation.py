"""Adaptation of the onboard model: increments of the aerodynamic coefficients, estimated in flight."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from anser.aircraft.air_data import AirData, Wrench
from anser.aircraft.airframe import AbstractAirframe, AircraftState
from anser.aircraft.corrected_airframe import (
    STATE_REGRESSORS,
    CorrectedAirframe,
    ReferenceLengths,
    by_coefficient,
    reference_lengths,
    regressors,
)
from anser.aircraft.motion import FlightCondition, angular_acceleration
from anser.numerics.linear import times3
from anser.parts.perception import Belief
from anser.shapes import Count, Scalar, ScalarLike, Vector3

_PRIOR_SHARE = 0.35
"""Standard deviation of an increment before the flight, as a part of the model's own derivative."""
# Standard deviations of increments where the model's derivative is near 0. Rows: CX, CY, CZ, Cl, Cm, Cn; columns: the
# constant, alpha or beta, qhat or phat, rhat, and any surface.
_PRIOR_FLOOR = np.array(
    [
        [0.01, 0.2, 3.0, 0.0, 0.05],
        [0.01, 0.2, 0.1, 0.3, 0.05],
        [0.05, 1.0, 8.0, 0.0, 0.2],
        [0.003, 0.03, 0.1, 0.05, 0.01],
        [0.03, 0.25, 2.0, 0.0, 0.05],
        [0.003, 0.05, 0.05, 0.1, 0.01],
    ]
)
_NOISE_FLOOR = np.array([0.003, 0.003, 0.01, 0.0005, 0.002, 0.0005])
"""Least standard deviation of a measured coefficient: what a linear increment cannot express."""


class AdaptationSettings(eqx.Module):
    """Settings of the estimation.

    Attributes
    ----------
    bandwidth
        Bandwidth of the low-pass filter on responses and regressors, rad/s.
    forgetting_time
        Time constant of the directional forgetting, s.
    slow_time
        Time constant of the mean values from which the excitation counts, s.
    excitation_min
        Least excitation at which the estimates change: effect of the regressors' changes over the noise, squared.
    """

    bandwidth: Scalar
    forgetting_time: Scalar
    slow_time: Scalar
    excitation_min: Scalar


def default_settings() -> AdaptationSettings:
    """Return the settings of the library."""
    return AdaptationSettings(*(jnp.asarray(x) for x in (10.0, 20.0, 5.0, 1.0)))


class AdaptationState(eqx.Module):
    """State of the estimation between samples."""

    increments: Float[Array, "6 p"]
    covariance: Float[Array, "6 p p"]
    noise: Float[Array, "6"]
    response: Float[Array, "6"]
    regressors: Float[Array, "2 p"]
    slow: Float[Array, "2 p"]
    reference: Float[Array, "2 p"]
    previous: Float[Array, "2 p"]
    rates_b: Vector3
    acceleration_b: Vector3
    count: Count


class Adaptation(eqx.Module):
    """Recursive least squares with directional forgetting for the increments of the six coefficients."""

    settings: AdaptationSettings
    lengths: ReferenceLengths
    derivatives: Float[Array, "6 p"]

    def init(self, state: AircraftState, attitude: Vector3) -> AdaptationState:
        """Return the state in steady flight."""
        p = self.derivatives.shape[1]
        zero = jnp.zeros(())
        constant = jnp.stack([zero, attitude[1], zero, zero])
        lateral = jnp.stack([zero, zero, zero, zero])
        reference = jnp.stack([jnp.concatenate([constant, state.surfaces]), jnp.concatenate([lateral, state.surfaces])])
        deviation = jnp.zeros((2, p)).at[:, 0].set(1.0)
        return AdaptationState(
            increments=jnp.zeros((6, p)),
            covariance=jax.vmap(jnp.diag)(self.prior_deviation**2),
            noise=jnp.asarray(_NOISE_FLOOR**2),
            response=jnp.zeros(6),
            regressors=deviation,
            slow=deviation,
            reference=reference,
            previous=deviation,
            rates_b=state.rates_b,
            acceleration_b=jnp.zeros(3),
            count=jnp.asarray(0, jnp.int32),
        )

    @property
    def prior_deviation(self) -> Float[Array, "6 p"]:
        """Standard deviations of the increments before the flight."""
        surfaces = self.derivatives.shape[1] - STATE_REGRESSORS
        floor = np.concatenate([_PRIOR_FLOOR[:, :-1], np.repeat(_PRIOR_FLOOR[:, -1:], surfaces, axis=1)], axis=1)
        return _PRIOR_SHARE * jnp.abs(self.derivatives) + floor

    def correct(self, state: AdaptationState, belief: Belief, step: ScalarLike) -> tuple[Belief, AdaptationState]:
        """Update the estimates with a sample, and return the belief with the corrected airframe."""
        airframe, condition = belief.airframe, belief.condition
        properties, data = airframe.mass_properties, condition.air_data
        rows = regressors(self.lengths, data, belief.state.rates_b, belief.state.surfaces) - state.reference
        acceleration_b = angular_acceleration(properties, belief.state.rates_b, condition.wrench.moment_b)
        measured_b = (belief.state.rates_b - state.rates_b) / step
        missing = Wrench(
            properties.mass * belief.specific_force_b - condition.wrench.force_b,
            times3(properties.inertia_b, measured_b - 0.5 * (acceleration_b + state.acceleration_b)),
        )
        is_first = state.count == 0
        response = self.lengths.coefficients(data.qbar, missing)
        response = jnp.where(is_first & (jnp.arange(6) >= 3), 0.0, response)
        force_rows = rows
        moment_rows = jnp.where(is_first, rows, 0.5 * (rows + state.previous))
        fade = -jnp.expm1(-self.settings.bandwidth * step)
        # one filter for both: the moments' regressors lag by half a period, which is left out for the forces
        rows_f = state.regressors + fade * (moment_rows - state.regressors)
        response_f = state.response + fade * (response - state.response)
        slow = state.slow + step / self.settings.slow_time * (rows_f - state.slow)
        del force_rows
        phi = by_coefficient(rows_f)
        change = by_coefficient(rows_f - slow)
        prior = self.prior_deviation
        excitation = jnp.sum((prior * change) ** 2, axis=1) / state.noise
        increments, covariance, noise = self._update(state, phi, response_f, excitation, step)
        state = AdaptationState(
            increments,
            covariance,
            noise,
            response_f,
            rows_f,
            slow,
            state.reference,
            rows,
            belief.state.rates_b,
            acceleration_b,
            state.count + 1,
        )
        corrected = CorrectedAirframe(airframe, self.lengths, state.reference, increments)
        wrench = corrected.increment(data, belief.state.rates_b, belief.state.surfaces)
        condition = eqx.tree_at(lambda c: c.aerodynamic, condition, condition.aerodynamic + wrench)
        belief = eqx.tree_at(lambda b: (b.airframe, b.condition), belief, (corrected, condition))
        return belief, state

    def _update(self, state, phi, response, excitation, step):
        settings, P, theta = self.settings, state.covariance, state.increments
        weight = 0.5 * settings.bandwidth * step
        error = response - jnp.sum(theta * phi, axis=1)
        P_phi = jnp.sum(P * phi[:, None, :], axis=2)
        xi = weight * jnp.sum(phi * P_phi, axis=1) / state.noise
        gain = weight * P_phi / (state.noise * (1.0 + xi))[:, None]
        learns = excitation > settings.excitation_min
        theta_new = theta + gain * error[:, None]
        forgetting = step / settings.forgetting_time
        eps = (1.0 - forgetting) - forgetting / jnp.maximum(xi, 1e-9)
        # P - w P phi phi' P / (noise (1/eps + xi))
        factor = weight / state.noise * eps / (1.0 + eps * xi)
        factor = jnp.maximum(factor, 0.0)
        P_new = P - factor[:, None, None] * P_phi[:, :, None] * P_phi[:, None, :]
        limit = 3.0 * self.prior_deviation
        theta_new = jnp.clip(theta_new, -limit, limit)
        n = self.derivatives.shape[1] - STATE_REGRESSORS
        D = self.derivatives[:, STATE_REGRESSORS:]
        surf = theta_new[:, STATE_REGRESSORS:]
        low, high = jnp.minimum(-0.7 * D, 1.0 * D), jnp.maximum(-0.7 * D, 1.0 * D)
        main = jnp.abs(D) > 0.02
        surf = jnp.where(main, jnp.clip(surf, low, high), surf)
        theta_new = jnp.concatenate([theta_new[:, :STATE_REGRESSORS], surf], axis=1)
        theta = jnp.where(learns[:, None], theta_new, theta)
        P = jnp.where(learns[:, None, None], P_new, P)
        return theta, P, state.noise


def model_derivatives(
    airframe: AbstractAirframe, lengths: ReferenceLengths, data: AirData, rates_b: Vector3, surfaces
) -> Float[Array, "6 p"]:
    """Return the derivatives of CX, CY, CZ, Cl, Cm, Cn by the regressors, (6, 4 + surfaces); 0 for the constant."""

    def coefficients(values):
        alpha, beta = values[0], values[1]
        d = eqx.tree_at(lambda d: (d.alpha, d.beta), data, (alpha, beta))
        V2 = 2.0 * jnp.maximum(data.V, 1.0)
        rates = jnp.stack([values[2] * V2 / lengths.span, values[3] * V2 / lengths.mean_chord, values[4] * V2 / lengths.span])
        return lengths.coefficients(data.qbar, airframe.aerodynamics(d, rates, values[5:]))

    V2 = 2.0 * jnp.maximum(data.V, 1.0)
    hats = rates_b * jnp.stack([lengths.span, lengths.mean_chord, lengths.span]) / V2
    J = jax.jacfwd(coefficients)(jnp.concatenate([jnp.stack([data.alpha, data.beta, *hats]), surfaces]))
    zero = jnp.zeros(())
    out = []
    for k, lon in enumerate((True, False, True, False, True, False)):
        a = [zero, J[k, 0], J[k, 3], zero] if lon else [zero, J[k, 1], J[k, 2], J[k, 4]]
        out.append(jnp.concatenate([jnp.stack(a), J[k, 5:]]))
    return jnp.stack(out)


def build_adaptation(airframe: AbstractAirframe, condition: FlightCondition, state: AircraftState) -> Adaptation:
    """Build the adaptation for an airframe around a flight condition."""
    lengths = reference_lengths(airframe)
    D = model_derivatives(airframe, lengths, condition.air_data, state.rates_b, state.surfaces)
    return Adaptation(default_settings(), lengths, D)
