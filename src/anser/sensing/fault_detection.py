"""Detection of the single fault that explains the difference between the aircraft and its onboard model.

The missing coefficients are the measured minus the modelled CX, CY, CZ, Cl, Cm and Cn. Each hypothesis (a surface with
half its effect, a shifted centre of gravity, ice, a weak engine) predicts them up to a factor, the size of the fault.
The size is estimated by weighted least squares over an exponential window. The hypothesis with the greatest likelihood
ratio is reported if it explains most of the missing coefficients, clearly better than the next hypothesis.
Source of the test: A. S. Willsky, H. L. Jones, "A generalized likelihood ratio approach to the detection and estimation
of jumps in linear systems", IEEE Trans. Automatic Control 21(1), 1976.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.air_data import Wrench
from anser.aircraft.corrected_airframe import LONGITUDINAL, STATE_REGRESSORS, ReferenceLengths
from anser.parts.perception import Belief
from anser.shapes import Integer, Scalar, ScalarLike

NO_FAULT, CENTRE_OF_GRAVITY, ICE, ENGINE, SURFACE = range(5)
"""Codes of faults; `SURFACE` + k is a loss of effectiveness of surface k of the airframe, from 0."""
FAULT_SIZES = (0.05, 1.0, 0.2, 0.5)
"""Fault that counts as size 1, in the order of the codes: shift of the centre of gravity aft, fraction of the mean
chord; ice, see `ICE_DRAG`; loss of thrust, fraction; loss of a surface's effectiveness, fraction. A shift of the centre
of gravity forward is negative; the other faults have no negative size."""
ICE_DRAG, ICE_LIFT = 0.2, 0.1
"""Rise of the drag and loss of the lift by ice of size 1, fractions."""


class FaultDetection(eqx.Module):
    """Settings of the fault detection.

    The energy of the missing coefficients is the time integral, over the exponential window, of the squared
    coefficients over the noise variance, s; a hypothesis explains a part of the energy.

    Attributes
    ----------
    window, mean_time
        Time constants of the exponential window and of the running mean values, s.
    size_min
        Least magnitude of the size of a reported fault, as a fraction of `FAULT_SIZES`.
    ratio_min
        Least energy, s, that the hypothesis of each fault must explain for a report, (fault,). The bound excludes small
        deflections with which the loops answer sensor noise, and which correlate with the missing coefficients.
    share_min, lead_min
        Least fraction of the energy that a reported hypothesis explains, and least ratio of this energy to the energy
        that the next best hypothesis explains.
    confirmation
        Time for which the conditions must hold without interruption, s.
    surfaces
        Number of control surfaces.
    """

    window: Scalar
    mean_time: Scalar
    size_min: Scalar
    ratio_min: Float[Array, " fault"]
    share_min: Scalar
    lead_min: Scalar
    confirmation: Scalar
    surfaces: int = eqx.field(static=True)

    def init(self) -> "FaultState":
        """Return the state before the first sample: no fault, and all integrals 0."""
        count = SURFACE - 1 + self.surfaces
        zero = jnp.zeros(())
        return FaultState(
            prediction=jnp.zeros((count, 6)),
            mean_prediction=jnp.zeros((count, 6)),
            mean_response=jnp.zeros(6),
            information=jnp.zeros(count),
            correlation=jnp.zeros(count),
            energy=zero,
            duration=zero,
            candidate=jnp.asarray(NO_FAULT, jnp.int32),
            code=jnp.asarray(NO_FAULT, jnp.int32),
            size=zero,
        )

    def advance(
        self,
        state: "FaultState",
        response: Float[Array, "6"],  # low-pass filtered missing coefficients
        effects: Float[Array, "fault 6"],  # see `fault_effects`
        noise: Float[Array, "6"],  # standard deviations of the missing coefficients of a healthy aircraft
        fade: ScalarLike,  # part of a new value in the low-pass filter
        step: ScalarLike,
    ) -> "FaultState":
        """Return the state after one more sample, `step` seconds later.

        The code of the first confirmed fault remains for the rest of the flight; the estimate of its size continues.
        """
        prediction = state.prediction + fade * (effects - state.prediction)
        # biases of sensors look like a constant lateral coefficient: only changes count there
        fade_mean = step / self.mean_time
        mean_prediction = state.mean_prediction + fade_mean * (prediction - state.mean_prediction)
        mean_response = state.mean_response + fade_mean * (response - state.mean_response)
        is_lateral = ~np.array(LONGITUDINAL)
        weighted = (prediction - jnp.where(is_lateral[None, :], mean_prediction, 0.0)) / noise[None, :]
        normal = (response - jnp.where(is_lateral, mean_response, 0.0)) / noise
        memory = jnp.exp(-step / self.window)
        information = memory * state.information + step * jnp.sum(weighted**2, axis=1)
        correlation = memory * state.correlation + step * jnp.sum(weighted * normal[None, :], axis=1)
        energy = memory * state.energy + step * jnp.sum(normal**2)
        size = correlation / jnp.maximum(information, jnp.finfo(energy.dtype).tiny)
        is_of_both_signs = np.arange(size.shape[0]) == CENTRE_OF_GRAVITY - 1
        size = jnp.where(is_of_both_signs, size, jnp.maximum(size, 0.0))
        explained = size * correlation
        best = jnp.argmax(explained)
        next_best = jnp.max(jnp.where(jnp.arange(explained.shape[0]) == best, 0.0, explained))
        is_found = (
            (jnp.abs(size[best]) > self.size_min)
            & (explained[best] > self.ratio_min[best])
            & (explained[best] > self.share_min * energy)
            & (explained[best] > self.lead_min * next_best)
        )
        candidate = jnp.where(is_found, best + 1, NO_FAULT).astype(jnp.int32)
        duration = jnp.where(is_found & (candidate == state.candidate), state.duration + step, 0.0)
        is_new = (state.code == NO_FAULT) & (duration > self.confirmation)
        code = jnp.where(is_new, candidate, state.code)
        units = np.array([*FAULT_SIZES[:-1], *[FAULT_SIZES[-1]] * self.surfaces])
        reported = jnp.where(code == NO_FAULT, 0.0, (size * units)[jnp.maximum(code - 1, 0)])
        return FaultState(
            prediction=prediction,
            mean_prediction=mean_prediction,
            mean_response=mean_response,
            information=information,
            correlation=correlation,
            energy=energy,
            duration=duration,
            candidate=candidate,
            code=code,
            size=reported,
        )


class FaultState(eqx.Module):
    """State of the fault detection between samples.

    Attributes
    ----------
    prediction
        Low-pass filtered effect of each fault of size 1 on CX, CY, CZ, Cl, Cm, Cn, (fault, 6).
    mean_prediction, mean_response
        Running mean values of the predictions (fault, 6), and of the missing coefficients (6,).
    information, correlation, energy
        Time integrals with exponential forgetting, s: of squared predictions, of predictions times missing
        coefficients, and of squared missing coefficients, with every coefficient divided by the standard deviation of
        the noise. Lateral coefficients count as deviations from the running mean values.
    duration, candidate
        Time for which one hypothesis has met the conditions without interruption, s, and the code of this hypothesis;
        0 and `NO_FAULT` while the conditions are not met.
    code, size
        Code of the reported fault, `NO_FAULT` before a report, and the present estimate of the size, in the unit of
        `FAULT_SIZES`.
    """

    prediction: Float[Array, "fault 6"]
    mean_prediction: Float[Array, "fault 6"]
    mean_response: Float[Array, "6"]
    information: Float[Array, " fault"]
    correlation: Float[Array, " fault"]
    energy: Scalar
    duration: Scalar
    candidate: Integer
    code: Integer
    size: Scalar


def fault_detection(surfaces: int) -> FaultDetection:
    """Return the fault detection with the package's settings, for an airframe with a number of control surfaces."""
    return FaultDetection(
        window=jnp.asarray(8.0),
        mean_time=jnp.asarray(5.0),
        size_min=jnp.asarray(0.4),
        ratio_min=jnp.asarray([20.0, 12.0, 3.0, *[20.0] * surfaces]),
        share_min=jnp.asarray(0.5),
        lead_min=jnp.asarray(1.5),
        confirmation=jnp.asarray(1.0),
        surfaces=surfaces,
    )


def fault_effects(
    belief: Belief, lengths: ReferenceLengths, derivatives: Float[Array, "6 p"]
) -> Float[Array, "fault 6"]:
    """Return the changes of CX, CY, CZ, Cl, Cm, Cn by each fault of size 1, (fault, 6), in the order of the codes.

    `derivatives` are those of the model's coefficients by the regressors, (6, p).
    """
    condition, data = belief.condition, belief.condition.air_data
    zero = jnp.zeros_like(data.alpha)
    _, Y, Z = jnp.unstack(condition.wrench.force_b)
    forward = FAULT_SIZES[0] * lengths.mean_chord  # the former centre of gravity from the new one
    shift = Wrench(jnp.zeros(3), jnp.stack([zero, -forward * Z, forward * Y]))
    sine, cosine = jnp.sin(data.alpha), jnp.cos(data.alpha)
    air_X, _, air_Z = jnp.unstack(condition.aerodynamic.force_b)
    drag = -(air_X * cosine + air_Z * sine)
    lift = air_X * sine - air_Z * cosine
    ice_X = -ICE_DRAG * drag * cosine - ICE_LIFT * lift * sine
    ice_Z = -ICE_DRAG * drag * sine + ICE_LIFT * lift * cosine
    ice = Wrench(jnp.stack([ice_X, zero, ice_Z]), jnp.zeros(3))
    engine = Wrench(-FAULT_SIZES[2] * condition.propulsive.force_b, -FAULT_SIZES[2] * condition.propulsive.moment_b)
    surfaces = -FAULT_SIZES[3] * derivatives[:, STATE_REGRESSORS:] * belief.state.surfaces[None, :]
    return jnp.concatenate(
        [jnp.stack([lengths.coefficients(data.qbar, wrench) for wrench in (shift, ice, engine)]), surfaces.T]
    )
