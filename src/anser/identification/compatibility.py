"""Data compatibility check: estimation of sensor biases and scale factors from the kinematics of flight.

The measured body rates and specific forces drive the kinematic equations of the centre of gravity. The sensor errors
are estimated so that the resulting airspeed, flow angles and attitude agree with the measured values. Source: V. Klein,
E. A. Morelli, *Aircraft System Identification*, AIAA 2006, chapter 10.
"""

import dataclasses
import functools
from collections.abc import Sequence
from typing import Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from anser.identification.dynamic_models import DynamicModel, Parameters, make_manoeuvre
from anser.identification.estimates import Estimate
from anser.identification.filter_error import estimate_filter_error
from anser.identification.kinematics import (
    RATES,
    SPECIFIC_FORCE,
    attitude_rates,
    flow_rates,
    gravity_in_body,
    with_specific_force,
)
from anser.identification.output_error import estimate_output_error
from anser.identification.records import FlightRecord
from anser.identification.smoothing import noise_level

_INPUTS = (*RATES, *SPECIFIC_FORCE)
_STATES: tuple[str, ...] = ("airspeed", "alpha", "beta", "roll", "pitch", "yaw")
DEFAULT_ERRORS = (*(f"bias({key})" for key in _INPUTS), "scale(alpha)", "scale(beta)")
"""Sensor errors that most manoeuvres identify: biases of gyros and accelerometers, scale factors of flow angles."""
_PROCESS_NOISE = {"airspeed": 1e-3, "alpha": 1e-7, "beta": 1e-7, "roll": 1e-6, "pitch": 1e-6}
"""Start values of the spectral densities of the process noise in the states' rates, (unit of the rate)^2 s."""


@dataclasses.dataclass(frozen=True, repr=False)
class Compatibility:
    """Estimated sensor errors with confidence intervals, and the corrected record; prints as a table.

    The parameters of `estimate` are `bias(CHANNEL)` (SI units, rad), `scale(CHANNEL)` (a fraction) and the initial
    states, with measured = (1 + scale) true + bias. `record` is corrected for these errors and refers to the centre of
    gravity.
    """

    estimate: Estimate
    record: FlightRecord

    def __repr__(self) -> str:
        return repr(self.estimate)


@functools.cache
def _kinematics(outputs: tuple[str, ...]) -> DynamicModel:
    def equations(x: Array, inputs: Array, theta: Parameters) -> tuple[Array, Array]:
        errors = jnp.stack([theta[f"bias({key})"] for key in _INPUTS])
        rates, force = jnp.split(inputs - errors, 2)
        V, alpha, beta, roll, pitch, _ = x
        flow = flow_rates(V, alpha, beta, rates, force, gravity_in_body(roll, pitch, jnp), jnp)
        true = dict(zip(_STATES, x, strict=True))
        measured = [(1.0 + theta[f"scale({key})"]) * true[key] + theta[f"bias({key})"] for key in outputs]
        return jnp.concatenate([flow, attitude_rates(roll, pitch, rates, jnp)]), jnp.stack(measured)

    return DynamicModel(equations, _STATES, _INPUTS, outputs)


def check_compatibility(
    record: FlightRecord,
    errors: Sequence[str] = DEFAULT_ERRORS,
    *,
    method: Literal["output-error", "filter-error"] = "output-error",
    accelerometer_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Compatibility:
    """Estimate biases and scale factors of sensors from a record, and return the estimates and the corrected record.

    Parameters
    ----------
    record
        Record with airspeed, flow angles, roll, pitch, body rates and accelerometers; yaw is optional. The wind must be
        constant.
    errors
        Names of the errors to estimate: `scale(CHANNEL)` or `bias(CHANNEL)` for airspeed, flow angles and attitude,
        `bias(CHANNEL)` for body rates and specific forces. The remaining errors are zero.
    method
        `output-error`: no process noise; the intervals include the accumulated noise of gyros and accelerometers.
        `filter-error`: a Kalman filter treats this noise as process noise, which is more exact for strong noise.
    accelerometer_m
        Position of the accelerometers relative to the centre of gravity, body axes, m.

    Raises
    ------
    ValueError
        If the record lacks a channel, the name of an error is unknown, an error cannot be identified from the record,
        or the search does not converge.
    """
    if not all(key in record for key in SPECIFIC_FORCE):
        raise ValueError("record: arrived without specific_force_x_m_s2, _y_, _z_; expected accelerometers")
    record = with_specific_force(record, accelerometer_m)
    outputs = tuple(key for key in _STATES if key in record or key != "yaw")
    known = [*(f"bias({key})" for key in (*_INPUTS, *outputs)), *(f"scale({key})" for key in outputs)]
    unknown = [name for name in errors if name not in known]
    if unknown or not errors:
        raise ValueError(f"errors: arrived {unknown or 'none'}; expected names among {', '.join(known)}")
    measured = record.stack(*outputs)
    inputs, first = record.stack(*_INPUTS), np.zeros(len(_STATES))
    first[: len(outputs)] = np.median(measured[:, :5], axis=1)
    model = _kinematics(outputs)
    manoeuvre = make_manoeuvre(model, record.time_s, inputs.T, measured.T, first, held=False)
    start = dict.fromkeys(errors, 0.0)
    fixed = {name: 0.0 for name in [*known, "bias(yaw)", "scale(yaw)"] if name not in start}
    options = {"fixed": fixed, "initial_states": outputs, "noise": np.maximum(noise_level(measured), 1e-6).tolist()}
    if method == "output-error":
        input_noise = noise_level(inputs).tolist()
        estimate = estimate_output_error(model, manoeuvre, start, **options, input_noise=input_noise)
    else:
        estimate = estimate_filter_error(model, manoeuvre, start, _PROCESS_NOISE, **options)
    return Compatibility(estimate, _corrected(record, estimate, errors))


def _corrected(record: FlightRecord, estimate: Estimate, errors: Sequence[str]) -> FlightRecord:
    values, channels = estimate.parameters, {}
    for key in (*_INPUTS, *_STATES):
        bias, scale = values.get(f"bias({key})", 0.0), values.get(f"scale({key})", 0.0)
        if bias or scale:
            channels[key] = (record[key] - bias) / (1.0 + scale)
    return record.with_channels((f"Errors of sensors are removed: {', '.join(errors)}.",), **channels)
