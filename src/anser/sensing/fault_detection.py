"""Detection of the single fault that explains the difference between the aircraft and its onboard model.

The missing coefficients are the measured minus the modelled CX, CY, CZ, Cl, Cm and Cn. Each hypothesis about the fault
predicts the missing coefficients up to a factor, the size of the fault. Weighted least squares over an exponential
window estimate the size. The reported hypothesis has the greatest likelihood ratio and passes the tests in
`FaultDetection`. Source: A. S. Willsky, H. L. Jones, "A generalized likelihood ratio approach to the detection and
estimation of jumps in linear systems", IEEE Trans. Automatic Control 21(1), 1976.
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
"""Codes of faults; `SURFACE` + k is a loss of effectiveness of surface k of the airframe, counted from 0."""
FAULT_SIZES = (0.05, 1.0, 0.2, 0.5)
"""Faults of size 1, in the order of the codes. Only the shift of the centre of gravity can have a negative size.

- shift of the centre of gravity aft, as a fraction of the mean chord
- ice, see `ICE_DRAG`
- loss of thrust, as a fraction
- loss of a surface's effectiveness, as a fraction
"""
ICE_DRAG, ICE_LIFT = 0.2, 0.1
"""Increase of the drag and loss of the lift by ice of size 1, fractions."""


class FaultDetection(eqx.Module):
    """Settings of the fault detection.

    The missing coefficients are the measured minus the modelled aerodynamic coefficients. Their energy is the integral
    of (missing coefficient / standard deviation of its noise)^2 over an exponential window, s. A fault is reported when
    it has met every least value below for the time `confirmation`.
    """

    window: Scalar  #: Time constant of the exponential window, s.
    mean_time: Scalar  #: Time constant of the running mean values, s.
    size_min: Scalar  #: Least magnitude of the fault's size, as a fraction of `FAULT_SIZES`.
    #: Least energy that each fault must explain, s. The bound excludes the small deflections by which the loops
    #: respond to sensor noise, and which correlate with the missing coefficients.
    ratio_min: Float[Array, " fault"]
    share_min: Scalar  #: Least fraction of the energy that the fault must explain.
    lead_min: Scalar  #: Least ratio of the explained energy to the energy that the next best fault explains.
    confirmation: Scalar  #: Time for which the fault must meet the least values without interruption, s.
    surfaces: int = eqx.field(static=True)  #: Number of control surfaces.

    def init(self) -> "FaultState":
        """Return the state before the first sample."""
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
        response: Float[Array, "6"],  # low-pass filtered measured minus modelled coefficients
        effects: Float[Array, "fault 6"],  # effects of the faults on the coefficients, see `fault_effects`
        noise: Float[Array, "6"],  # standard deviations of the missing coefficients of a healthy aircraft
        fade: ScalarLike,  # weight of a new value in the low-pass filter
        step: ScalarLike,
    ) -> "FaultState":
        """Return the state after one more sample, `step` seconds later.

        The code of the first confirmed fault remains for the rest of the flight; the estimate of its size continues.
        """
        prediction = state.prediction + fade * (effects - state.prediction)
        # Sensor biases look like constant lateral coefficients, so only changes of lateral coefficients count.
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

    In the integrals, coefficients are divided by the noise deviations, and lateral coefficients are deviations from the
    running means. The integrals forget exponentially, with the time constant `FaultDetection.window`.
    """

    prediction: Float[Array, "fault 6"]  #: Low-pass filtered effect of each fault of size 1 on CX, CY, CZ, Cl, Cm, Cn.
    mean_prediction: Float[Array, "fault 6"]  #: Running mean of `prediction`.
    mean_response: Float[Array, "6"]  #: Running mean of the missing (measured minus modelled) coefficients.
    information: Float[Array, " fault"]  #: Integral of prediction^2, s.
    correlation: Float[Array, " fault"]  #: Integral of prediction * missing coefficients, s.
    energy: Scalar  #: Integral of missing coefficients^2, s.
    duration: Scalar  #: Time for which the candidate has met the least values without interruption, s.
    candidate: Integer  #: Code of the fault that meets the least values of `FaultDetection`, or `NO_FAULT`.
    code: Integer  #: Code of the reported fault; `NO_FAULT` before a report.
    size: Scalar  #: Present estimate of the size of the reported fault, in the unit of `FAULT_SIZES`.


def fault_detection(surfaces: int) -> FaultDetection:
    """Return the fault detection with the package's settings; `surfaces` is the number of control surfaces."""
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

    `derivatives` are the model's derivatives by the p regressors (see `anser.sensing.adaptation`).
    """
    condition, data = belief.condition, belief.condition.air_data
    zero = jnp.zeros_like(data.alpha)
    _, Y, Z = jnp.unstack(condition.wrench.force_b)
    forward = FAULT_SIZES[0] * lengths.mean_chord  # former centre of gravity minus new centre of gravity
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
