"""Adaptation of the onboard model in flight: estimated increments of the aerodynamic coefficients.

The missing coefficients are the measured minus the modelled forces and moments, made dimensionless. From the missing
coefficients, recursive least squares estimate increments of constants and derivatives of CX, CY, CZ, Cl, Cm and Cn.
Derivations: docs/theory/identification.md.

In array shapes, p is the number of regressors of a coefficient: four for the motion, then one per control surface. The
first four (`anser.aircraft.corrected_airframe`) are, with body rates P, Q, R, mean chord c and span b:

- for CX, CZ and Cm: 1, alpha, Q c/2V, 0
- for CY, Cl and Cn: 1, beta, P b/2V, R b/2V
"""

import dataclasses
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.air_data import AirData, Wrench
from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.corrected_airframe import (
    CONSTANT,
    LONGITUDINAL,
    STATE_REGRESSORS,
    ReferenceLengths,
    by_coefficient,
    corrected_airframe,
    reference_lengths,
    reference_regressors,
    regressors,
)
from anser.aircraft.motion import angular_acceleration, modelled_air_data_and_forces
from anser.numerics.linear import times3
from anser.parts.perception import AbstractEstimates, AbstractEstimator, Belief, Instant, Reading
from anser.sensing.fault_detection import FaultDetection, FaultState, fault_detection, fault_effects
from anser.shapes import Integer, Scalar, ScalarLike, Vector, Vector3

Increments = Float[Array, "6 p"]
Method = Literal["least-squares", "gradient"]

_NOISE_FLOOR = np.array([0.003, 0.003, 0.01, 0.0005, 0.002, 0.0005])
"""Standard deviations of the errors in CX, CY, CZ, Cl, Cm, Cn that no linear increment explains, sensor noise apart."""
_PRIOR_SHARE = 0.35
"""Standard deviation of an increment before the flight, as a fraction of the model's derivative."""
# Added standard deviation, for derivatives near 0 in the model. Columns: constant, alpha or beta, qhat or phat, rhat,
# any surface.
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
# The same if the model has no aerodynamic coefficients: typical magnitudes of an aircraft's derivatives.
_PRIOR_WITHOUT_MODEL = np.array(
    [
        [0.1, 1.0, 5.0, 0.0, 0.2],
        [0.1, 2.0, 1.0, 2.0, 0.3],
        [1.0, 6.0, 30.0, 0.0, 1.0],
        [0.02, 0.3, 1.0, 0.5, 0.3],
        [0.1, 1.0, 15.0, 0.0, 1.5],
        [0.02, 0.5, 0.5, 1.0, 0.2],
    ]
)
_INCREMENT_MAX = 3.0
"""Greatest increment, as a multiple of its standard deviation before the flight."""
_EFFECTIVENESS_RANGE = (0.3, 2.0)
"""Least and greatest control effectiveness, as a fraction of the model's effectiveness."""
_EFFECTIVENESS_SHARE = 0.1
"""Fraction of an axis' greatest control effectiveness above which the effectiveness of a surface is bounded."""
_MOMENTS = {"roll": 3, "pitch": 4, "yaw": 5}
"""Index of each axis' moment coefficient."""
_DERIVATIVES = {"cz_alpha": (2, 1), "cm_alpha": (4, 1), "cl_beta": (3, 1), "cn_beta": (5, 1), "cm_q": (4, 2)}
"""Indices (coefficient, regressor) of the recorded derivatives."""
_MANOEUVRE = 60.0
"""Excitation above which flight counts as a manoeuvre, in units of `_NOISE_FLOOR` squared."""
_ERROR_MAX = 1.5
"""Largest deviation of a prediction error that counts as turbulence, in standard deviations of the noise."""
_LEARNING_TIME = 15.0
"""Time after which prediction errors count as turbulence if the aerodynamics are not known, s."""
_DISTURBANCE_TIME = 20.0
"""Time constant of the running variance of the turbulence in the coefficients, s."""
_GRADIENT_STEP = 0.05
"""Step of the normalised gradient method: fraction of the prediction error that one sample removes."""


class AdaptationSettings(eqx.Module):
    """Settings of the regression that explains responses (measured minus modelled coefficients) by increments."""

    bandwidth: Scalar  #: Bandwidth of the low-pass filter on responses and regressors, rad/s.
    forgetting_time: Scalar  #: Time constant with which recursive least squares forget earlier samples, s.
    mean_time: Scalar  #: Time constant of the running mean values of responses and regressors, s.
    #: Least excitation at which an estimate changes, as a multiple of the noise variance. The excitation is the
    #: variance of a coefficient due to the increments' prior variance, for the regressors' deviations from their means.
    excitation_min: Scalar


def default_settings() -> AdaptationSettings:
    """Return the default settings: bandwidth 5 rad/s, forgetting time 20 s, mean time 5 s, least excitation 16."""
    return AdaptationSettings(*(jnp.asarray(value) for value in (5.0, 20.0, 5.0, 16.0)))


class AdaptationState(eqx.Module):
    """State of the adaptation between two samples. Missing coefficients: measured minus modelled coefficients."""

    base: Any  #: State of the estimator of the motion.
    derivatives: Increments  #: Derivatives of the model's coefficients at the start; 0 if the model has none.
    prior_deviation: Increments  #: Standard deviations of the increments before the flight.
    increments: Increments  #: Estimated increments of the derivatives of CX, CY, CZ, Cl, Cm, Cn.
    covariance: Float[Array, "6 p p"]  #: Covariance of the increments.
    response: Float[Array, "6"]  #: Low-pass filtered missing coefficients.
    regressors: Float[Array, "2 p"]  #: Low-pass filtered regressors minus `reference`; rows: longitudinal, lateral.
    mean_response: Float[Array, "6"]  #: Running mean of `response`.
    mean: Float[Array, "2 p"]  #: Running mean of `regressors`.
    reference: Float[Array, "2 p"]  #: Regressors at the start, only alpha and deflections; the others are 0.
    mean_error: Float[Array, "6"]  #: Running mean of the prediction errors.
    disturbance: Float[Array, "6"]  #: Variance of the prediction errors due to turbulence.
    previous_missing: Vector3  #: Missing force coefficients of the previous sample.
    previous_regressors: Float[Array, "2 p"]  #: Unfiltered regressors minus `reference` at the previous sample.
    rates_b: Vector3  #: Gyro reading of the previous sample, rad/s.
    acceleration_b: Vector3  #: Modelled angular acceleration of the previous sample, rad/s^2.
    faults: FaultState  #: State of the fault detection.
    count: Integer  #: Number of samples so far.


class AerodynamicEstimates(AbstractEstimates):
    """Estimated aerodynamic derivatives with uncertainty, and the reported fault (`anser.sensing.fault_detection`)."""

    derivatives: Increments  #: Derivatives of the model's coefficients by the p regressors of this module.
    increments: Increments  #: Estimated increments of the derivatives.
    covariance: Float[Array, "6 p p"]  #: Covariance of the increments.
    fault: Integer  #: Code of the reported fault.
    fault_size: Scalar  #: Size of the reported fault.

    @property
    def effectiveness_uncertainty(self) -> Scalar:
        """Greatest relative standard deviation of the control effectiveness among roll, pitch and yaw.

        The control effectiveness is the estimated derivative of the moment coefficient by the most effective surface.
        """
        moments, deviations = self._total[3:, STATE_REGRESSORS:], self._sigma[3:, STATE_REGRESSORS:]
        surface = jnp.argmax(jnp.abs(moments), axis=1)
        axes = np.arange(len(_MOMENTS))
        effect = jnp.maximum(jnp.abs(moments[axes, surface]), jnp.finfo(moments.dtype).tiny)
        return jnp.max(deviations[axes, surface] / effect)

    def variables(self) -> dict[str, Array]:
        """Return the recorded variables: derivatives and control effectiveness with standard deviations, and the fault.

        The control effectiveness is divided by the model's effectiveness; NaN if the model's effectiveness is 0.
        """
        total, sigma = self._total, self._sigma
        values = {"effectiveness_uncertainty": self.effectiveness_uncertainty}
        for name, element in _DERIVATIVES.items():
            values[f"{name}_estimate"], values[f"{name}_sigma"] = total[element], sigma[element]
        for axis, row in _MOMENTS.items():
            size = jnp.abs(self.derivatives[row, STATE_REGRESSORS:])
            surface = STATE_REGRESSORS + jnp.argmax(size)
            model = jnp.where(jnp.max(size) > 0.0, self.derivatives[row, surface], jnp.nan)
            values[f"{axis}_effectiveness_estimate"] = total[row, surface] / model
            values[f"{axis}_effectiveness_sigma"] = jnp.abs(sigma[row, surface] / model)
        return values | {"fault": self.fault, "fault_size": self.fault_size}

    @property
    def _total(self) -> Increments:
        return self.derivatives + self.increments

    @property
    def _sigma(self) -> Increments:
        # slices: a gather of the diagonal would cost as much as the update of the covariance
        variance = jnp.stack([self.covariance[:, k, k] for k in range(self.covariance.shape[1])], axis=1)
        return jnp.sqrt(jnp.maximum(variance, 0.0))


class AdaptiveEstimator(AbstractEstimator):
    """Estimator that corrects the onboard model by increments of CX, CY, CZ, Cl, Cm and Cn.

    Each coefficient has its own regression, and its estimates remain constant while the excitation is below the bound
    `AdaptationSettings.excitation_min`.
    """

    base: AbstractEstimator  #: Estimator of the motion; the airframe of its belief must be the onboard model.
    model: AbstractAirframe  #: Onboard model, without increments.
    settings: AdaptationSettings  #: Settings of the estimation.
    faults: FaultDetection  #: Settings of the fault detection.
    #: "least-squares": recursive least squares with directional forgetting. "gradient": normalised gradient method,
    #: which estimates the control effectiveness alone.
    method: Method = eqx.field(static=True, default="least-squares")
    #: True: the increments correct the model's coefficients. False: the increments are the whole coefficients.
    aerodynamics_known: bool = eqx.field(static=True, default=True)

    def init(self, reading: Reading, airframe: AbstractAirframe, instant: Instant) -> AdaptationState:
        """Return the state before the first sample: zero increments, and the model's derivatives at the start."""
        lengths, data, state = reference_lengths(self.model), reading.condition.air_data, reading.state
        derivatives = model_derivatives(self.model, lengths, data, state.rates_b, state.surfaces)
        count = len(self.model.actuators.names)
        floor = _PRIOR_FLOOR if self.aerodynamics_known else _PRIOR_WITHOUT_MODEL
        columns = [floor[:, :STATE_REGRESSORS], np.repeat(floor[:, STATE_REGRESSORS:], count, axis=1)]
        prior_deviation = _PRIOR_SHARE * jnp.abs(derivatives) + np.concatenate(columns, axis=1)
        deviation = jnp.zeros((2, STATE_REGRESSORS + count)).at[:, CONSTANT].set(1.0)
        return AdaptationState(
            base=self.base.init(reading, airframe, instant),
            derivatives=derivatives,
            prior_deviation=prior_deviation,
            increments=jnp.zeros_like(derivatives),
            covariance=_prior_covariance(prior_deviation),
            response=jnp.zeros(6),
            regressors=deviation,
            mean_response=jnp.zeros(6),
            mean=deviation,
            reference=reference_regressors(data.alpha, state.surfaces),
            mean_error=jnp.zeros(6),
            disturbance=jnp.zeros(6),
            previous_missing=jnp.zeros(3),
            previous_regressors=deviation,
            rates_b=state.rates_b,
            acceleration_b=jnp.zeros(3),
            faults=self.faults.init(),
            count=jnp.asarray(0, jnp.int32),
        )

    def estimate(
        self, estimator_state: AdaptationState, reading: Reading, airframe: AbstractAirframe, instant: Instant
    ) -> tuple[Belief, AdaptationState]:
        """Return the belief, with the corrected airframe and its forces, and the new state."""
        belief, base = self.base.estimate(estimator_state.base, reading, airframe, instant)
        state = eqx.tree_at(lambda s: s.base, estimator_state, base, is_leaf=lambda leaf: leaf is None)
        measured = belief
        if not self.aerodynamics_known:
            # The gust filter lags: with filtered air data the lift slope would be too small. If the aerodynamics are
            # known, filtered air data are better, because estimates drift if gusts are the only excitation.
            data = reading.air_data(instant.environment)
            condition = modelled_air_data_and_forces(self.model, belief.condition, data, belief.state)
            measured = eqx.tree_at(lambda b: b.condition, belief, condition)
        next_state = self.learn(state, measured, instant.step)
        return self.corrected_belief(next_state, belief), next_state

    def learn(self, state: AdaptationState, belief: Belief, step: ScalarLike) -> AdaptationState:
        """Return the state after one sample; `step` is the sampling period, s.

        The forces and moments in `belief.condition` must come from the model without increments.
        """
        is_first, lengths = state.count == 0, reference_lengths(self.model)
        data, surfaces, rates_b = belief.condition.air_data, belief.state.surfaces, belief.state.rates_b
        missing, acceleration_b = _missing_coefficients(lengths, state, belief, step)
        deviation = regressors(lengths, data, rates_b, surfaces) - state.reference
        # The measured angular acceleration is a mean over the period before the sample, so all other values are too.
        share = _present_share(belief)
        forces = share * missing[:3] + (1.0 - share) * state.previous_missing
        response = jnp.where(is_first, 0.0, jnp.concatenate([forces, missing[3:]]))
        middle = share * deviation + (1.0 - share) * state.previous_regressors
        middle = jnp.where(is_first, deviation, middle)
        fade = -jnp.expm1(-self.settings.bandwidth * step)
        filtered_response = state.response + fade * (response - state.response)
        filtered = state.regressors + fade * (middle - state.regressors)
        fade_mean = step / self.settings.mean_time
        mean = state.mean + fade_mean * (filtered - state.mean)
        mean_response = state.mean_response + fade_mean * (filtered_response - state.mean_response)
        phi, moving = by_coefficient(filtered), by_coefficient(filtered - mean)
        error = filtered_response - jnp.sum(state.increments * phi, axis=1)
        excitation = jnp.sum((state.prior_deviation * moving) ** 2, axis=1)
        mean_error, disturbance = self._disturbance(state, error, excitation, step)
        noise = jnp.asarray(_NOISE_FLOOR**2) + disturbance
        increments, covariance = self._update(
            state, phi, moving, error, filtered_response - mean_response, excitation, noise, step
        )
        effects = fault_effects(belief, lengths, state.derivatives)
        faults = self.faults.advance(state.faults, filtered_response, effects, jnp.sqrt(noise), fade, step)
        # Samples from the beginning of a fault are not valid: the next manoeuvre starts from the prior uncertainty.
        covariance = jnp.where(faults.code != state.faults.code, _prior_covariance(state.prior_deviation), covariance)
        return dataclasses.replace(
            state,
            increments=increments,
            covariance=covariance,
            response=filtered_response,
            regressors=filtered,
            mean_response=mean_response,
            mean=mean,
            mean_error=mean_error,
            disturbance=disturbance,
            previous_missing=missing[:3],
            previous_regressors=deviation,
            rates_b=rates_b,
            acceleration_b=acceleration_b,
            faults=faults,
            count=state.count + 1,
        )

    def corrected_belief(self, state: AdaptationState, belief: Belief) -> Belief:
        """Return the belief with the estimated increments in the airframe and in the aerodynamic forces and moments."""
        corrected = corrected_airframe(
            belief.airframe, reference_lengths(self.model), state.reference, state.increments
        )
        condition = belief.condition
        increment = corrected.increment(condition.air_data, belief.state.rates_b, belief.state.surfaces)
        condition = eqx.tree_at(lambda c: c.aerodynamic, condition, condition.aerodynamic + increment)
        estimates = AerodynamicEstimates(
            state.derivatives, state.increments, state.covariance, state.faults.code, state.faults.size
        )
        return dataclasses.replace(belief, airframe=corrected, condition=condition, estimates=estimates)

    def _disturbance(
        self, state: AdaptationState, error: Float[Array, "6"], excitation: Float[Array, "6"], step: ScalarLike
    ) -> tuple[Float[Array, "6"], Float[Array, "6"]]:
        """Return the running mean of the prediction errors and the variance about the mean, (6,) each.

        `error` is the present prediction error. The variance changes only while `excitation` is small.
        """
        is_calm = excitation < _MANOEUVRE * _NOISE_FLOOR**2
        if not self.aerodynamics_known:  # at first the errors are the coefficients themselves
            is_calm = is_calm & (state.count * step > _LEARNING_TIME)
        largest = _ERROR_MAX * jnp.sqrt(_NOISE_FLOOR**2 + state.disturbance)
        deviation = error - state.mean_error
        limited = jnp.clip(deviation, -largest, largest)
        # The part of an error that exceeds turbulence is due to a fault, and enters the mean quickly in calm flight.
        beyond = jnp.where(is_calm, self.settings.bandwidth, 1.0 / self.settings.mean_time) * (deviation - limited)
        mean_error = state.mean_error + step * (limited / self.settings.mean_time + beyond)
        # At first all samples have equal weight.
        share = jnp.maximum(step / _DISTURBANCE_TIME, 1.0 / (state.count + 1.0))
        disturbance = state.disturbance + share * (limited**2 - state.disturbance)
        return mean_error, jnp.where(is_calm, disturbance, state.disturbance)

    def _update(
        self,
        state: AdaptationState,
        phi: Increments,  # regressors of each coefficient, and their deviations from the slow mean values
        moving: Increments,
        error: Float[Array, "6"],  # prediction errors
        moving_response: Float[Array, "6"],  # missing coefficients' deviations from their slow mean values
        excitation: Float[Array, "6"],
        noise: Float[Array, "6"],  # variances
        step: ScalarLike,
    ) -> tuple[Increments, Float[Array, "6 p p"]]:
        learns = excitation > self.settings.excitation_min * noise
        if self.method == "gradient":
            increments, covariance = _gradient_step(state, moving_response, moving, noise), state.covariance
        else:
            # The filter correlates the samples within 2 / bandwidth, so each sample has only a part of the information.
            weight = 0.5 * self.settings.bandwidth * step / noise
            increments, covariance = least_squares_step(
                state.increments, state.covariance, phi, error, weight, step / self.settings.forgetting_time
            )
        increments = _bounded(state, increments)
        return (
            jnp.where(learns[:, None], increments, state.increments),
            jnp.where(learns[:, None, None], covariance, state.covariance),
        )


def _prior_covariance(prior_deviation: Increments) -> Float[Array, "6 p p"]:
    return jax.vmap(jnp.diag)(prior_deviation**2)


def _present_share(belief: Belief) -> float:
    """Return the weight of the present sample in a mean over the sampling period; the previous one has the rest."""
    # held surfaces: the present deflections acted over the whole period
    return 1.0 if belief.airframe.actuators.is_held else 0.5


def _missing_coefficients(
    lengths: ReferenceLengths, state: AdaptationState, belief: Belief, step: ScalarLike
) -> tuple[Float[Array, "6"], Vector3]:
    """Return measured minus modelled CX, CY, CZ, Cl, Cm, Cn, (6,), and the modelled angular acceleration (rad/s^2)."""
    properties, condition, rates_b = belief.airframe.mass_properties, belief.condition, belief.state.rates_b
    acceleration_b = angular_acceleration(properties, rates_b, condition.wrench.moment_b)
    share = _present_share(belief)
    modelled_b = share * acceleration_b + (1.0 - share) * state.acceleration_b
    measured_b = (rates_b - state.rates_b) / step - modelled_b
    missing = Wrench(
        properties.mass * belief.specific_force_b - condition.wrench.force_b,
        times3(properties.inertia_b, measured_b),
    )
    return lengths.coefficients(condition.air_data.qbar, missing), acceleration_b


def _gradient_step(
    state: AdaptationState, response: Float[Array, "6"], moving: Increments, noise: Float[Array, "6"]
) -> Increments:
    """Return the increments after one step of normalised least mean squares; only derivatives by surfaces change.

    `response` (missing coefficients) and `moving` (regressors) must be deviations from running mean values; `noise` is
    the noise variance of `response`. Source: Smeur et al., J. Guidance 39(3), 2016.
    """
    error = response - jnp.sum(state.increments * moving, axis=1)
    # in units of the prior deviations: one step size suits all surfaces
    is_surface = np.arange(moving.shape[1]) >= STATE_REGRESSORS
    scaled = jnp.where(is_surface[None, :], state.prior_deviation * moving, 0.0)
    energy = jnp.sum(scaled**2, axis=1) + noise
    return state.increments + state.prior_deviation * scaled * (_GRADIENT_STEP * error / energy)[:, None]


def _bounded(state: AdaptationState, increments: Increments) -> Increments:
    """Limit increments to 3 prior deviations, and derivatives by effective surfaces to 0.3..2 times the model's."""
    limit = _INCREMENT_MAX * state.prior_deviation
    bounded = jnp.clip(increments, -limit, limit)
    low, high = (state.derivatives * (factor - 1.0) for factor in _EFFECTIVENESS_RANGE)
    in_model = jnp.clip(bounded, jnp.minimum(low, high), jnp.maximum(low, high))
    return jnp.where(_is_effective(state.derivatives), in_model, bounded)


def _is_effective(derivatives: Increments) -> Any:
    """Return flags (6, p) of the derivatives of Cl, Cm and Cn by effective surfaces.

    A surface is effective if the derivative's magnitude exceeds a tenth of the greatest magnitude for the same moment.
    """
    size = jnp.abs(derivatives)
    is_moment_by_surface = (np.arange(6)[:, None] >= 3) & (np.arange(size.shape[1]) >= STATE_REGRESSORS)
    greatest = jnp.max(size[:, STATE_REGRESSORS:], axis=1, keepdims=True)
    return is_moment_by_surface & (size > _EFFECTIVENESS_SHARE * greatest) & (greatest > 0.0)


def least_squares_step(
    coefficients: Float[Array, "m p"],
    covariance: Float[Array, "m p p"],
    phi: Float[Array, "m p"],  # regressors
    error: Float[Array, " m"],  # response minus prediction
    weight: Float[Array, " m"] | ScalarLike,  # reciprocal of the noise variance
    forgetting: ScalarLike,  # fraction of the information that a sample replaces
) -> tuple[Float[Array, "m p"], Float[Array, "m p p"]]:
    """Advance m regressions by one sample of recursive least squares with directional forgetting.

    Returns the new coefficients (m, p) and the new covariance (m, p, p). Information is forgotten only along the
    regressors, so the covariance stays bounded without excitation. Sources: R. Kulhavy, M. Karny, "Tracking of slowly
    varying parameters by directional forgetting", IFAC World Congress 1984; S. Bittanti, P. Bolzern, M. Campi,
    Automatica 26(3), 1990.
    """
    spread = jnp.sum(covariance * phi[:, None, :], axis=2)  # P phi
    information = weight * jnp.sum(phi * spread, axis=1)
    gain = spread * (weight / (1.0 + information))[:, None]
    memory = 1.0 - forgetting
    tiny = jnp.finfo(information.dtype).tiny
    # remaining information along phi; at least 0, or the covariance would grow beyond the prior covariance
    kept = jnp.maximum(memory - forgetting / jnp.maximum(information, tiny), 0.0)
    reduction = weight * kept / (1.0 + kept * information)
    covariance = covariance - reduction[:, None, None] * spread[:, :, None] * spread[:, None, :]
    return coefficients + gain * error[:, None], covariance


def model_derivatives(
    airframe: AbstractAirframe, lengths: ReferenceLengths, data: AirData, rates_b: Vector3, surfaces: Vector
) -> Increments:
    """Return the derivatives of CX, CY, CZ, Cl, Cm, Cn by the regressors, (6, p), in the present flight condition.

    For the p regressors see the module. The derivatives by the regressors 1 and 0 are 0.
    """
    double_V = 2.0 * jnp.maximum(data.V, 1.0)
    scale = double_V / jnp.stack([lengths.span, lengths.mean_chord, lengths.span])

    def coefficients(alpha: Scalar, beta: Scalar, rates: Vector3, deflections: Vector) -> Float[Array, "6"]:
        turned = eqx.tree_at(lambda d: (d.alpha, d.beta), data, (alpha, beta))
        return lengths.coefficients(data.qbar, airframe.aerodynamics(turned, rates * scale, deflections))

    slopes = jax.jacfwd(coefficients, argnums=(0, 1, 2, 3))(data.alpha, data.beta, rates_b / scale, surfaces)
    by_alpha, by_beta, by_rates, by_surfaces = slopes
    zero = jnp.zeros(6)
    longitudinal = jnp.stack([zero, by_alpha, by_rates[:, 1], zero], axis=1)
    lateral = jnp.stack([zero, by_beta, by_rates[:, 0], by_rates[:, 2]], axis=1)
    states = jnp.where(np.array(LONGITUDINAL)[:, None], longitudinal, lateral)
    return jnp.concatenate([states, by_surfaces], axis=1)


def adaptive_estimator(
    base: AbstractEstimator,
    model: AbstractAirframe,
    *,
    method: Method = "least-squares",
    aerodynamics_known: bool = True,
) -> AdaptiveEstimator:
    """Build an `AdaptiveEstimator` that corrects `model`, with the default settings.

    Raises ValueError if the airframe has no reference lengths.
    """
    reference_lengths(model)
    faults = fault_detection(len(model.actuators.names))
    return AdaptiveEstimator(base, model, default_settings(), faults, method, aerodynamics_known)
