"""Data compatibility: biases and scale factors of sensors, from the kinematics that connect the channels of a record.

The measured body rates and specific forces drive the kinematic equations of the centre of gravity; the estimated errors
are those with which airspeed, flow angles and attitude agree. Source: V. Klein, E. A. Morelli, *Aircraft System
Identification*, AIAA 2006, chapter 10.
"""

import dataclasses
import functools
from collections.abc import Sequence
from typing import Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.constants import STANDARD_GRAVITY_M_S2
from anser.identification.dynamic_models import DynamicModel, Parameters, make_manoeuvre
from anser.identification.estimates import Estimate
from anser.identification.filter_error import estimate_filter_error
from anser.identification.kinematics import RATES, SPECIFIC_FORCE, with_specific_force
from anser.identification.output_error import estimate_output_error
from anser.identification.records import FlightRecord
from anser.identification.smoothing import noise_level

_INPUTS = (*RATES, *SPECIFIC_FORCE)
_OUTPUTS = ("airspeed", "alpha", "beta", "roll", "pitch", "yaw")
_STATES = ("u", "v", "w", "roll", "pitch", "yaw")
DEFAULT_ERRORS = (*(f"bias({key})" for key in _INPUTS), "scale(alpha)", "scale(beta)")
"""Errors that most records tell: biases of the inertial sensors, and scale factors of the flow angles."""
_PROCESS_NOISE = 1e-6


@dataclasses.dataclass(frozen=True, repr=False)
class Compatibility:
    """Estimated errors of sensors, with intervals, and the record without them; printed as a table.

    Attributes
    ----------
    estimate
        `bias(CHANNEL)` in SI units and radians, `scale(CHANNEL)` as a fraction; measured = (1 + scale) true + bias.
    record
        Record with the errors removed.
    """

    estimate: Estimate
    record: FlightRecord

    def __repr__(self) -> str:
        return repr(self.estimate)


@functools.cache
def _kinematics(outputs: tuple[str, ...]) -> DynamicModel:
    def equations(x: Array, inputs: Array, theta: Parameters) -> tuple[Array, Array]:
        errors = jnp.stack([theta[f"bias({key})"] for key in _INPUTS])
        P, Q, R, fx, fy, fz = inputs - errors
        u, v, w, roll, pitch, _ = x
        sr, cr, sp, cp = jnp.sin(roll), jnp.cos(roll), jnp.sin(pitch), jnp.cos(pitch)
        g = STANDARD_GRAVITY_M_S2
        turning = Q * sr + R * cr
        rates = jnp.stack(
            [
                R * v - Q * w - g * sp + fx,
                P * w - R * u + g * sr * cp + fy,
                Q * u - P * v + g * cr * cp + fz,
                P + sp / cp * turning,
                Q * cr - R * sr,
                turning / cp,
            ]
        )
        V = jnp.sqrt(u**2 + v**2 + w**2)
        true: dict[str, Array] = dict(
            zip(_OUTPUTS, (V, jnp.arctan2(w, u), jnp.arcsin(v / V), roll, pitch, x[5]), strict=True)
        )
        measured = [(1.0 + theta[f"scale({key})"]) * true[key] + theta[f"bias({key})"] for key in outputs]
        return rates, jnp.stack(measured)

    return DynamicModel(equations, _STATES, _INPUTS, outputs)


def check_compatibility(
    record: FlightRecord,
    errors: Sequence[str] = DEFAULT_ERRORS,
    *,
    method: Literal["output-error", "filter-error"] = "output-error",
    accelerometer_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Compatibility:
    """Estimate errors of sensors from a record, and remove them.

    Parameters
    ----------
    record
        Record with airspeed, alpha, beta, roll and pitch, body rates and specific forces; air at rest or moving
        steadily. Without accelerometers the specific force would follow from the velocity, and tell nothing.
    errors
        Names of the errors to estimate: `bias(CHANNEL)`, `scale(CHANNEL)`.
    method
        `output-error`: errors by regression on the integrated motion; `filter-error`: by a kinematic filter, for noise
        of the inertial sensors that matters over the record.
    accelerometer_m
        Position of the accelerometers relative to the centre of gravity, body axes, m.

    Raises
    ------
    ValueError
        The record lacks a channel, an error is unknown, or the record does not tell an error.
    """
    if not all(key in record for key in SPECIFIC_FORCE):
        raise ValueError("record: arrived without specific_force_x_m_s2, _y_, _z_; expected accelerometers")
    record = with_specific_force(record, accelerometer_m)
    outputs = tuple(key for key in _OUTPUTS if key in record or key != "yaw")
    known = [*(f"bias({key})" for key in (*_INPUTS, *outputs)), *(f"scale({key})" for key in outputs)]
    unknown = [name for name in errors if name not in known]
    if unknown or not errors:
        raise ValueError(f"errors: arrived {unknown or 'none'}; expected names among {', '.join(known)}")
    measured = record.stack(*outputs)
    model = _kinematics(outputs)
    manoeuvre = make_manoeuvre(model, record.time_s, record.stack(*_INPUTS).T, measured.T, _start(record), held=False)
    start = dict.fromkeys(errors, 0.0)
    fixed = {name: 0.0 for name in [*known, "bias(yaw)", "scale(yaw)"] if name not in start}
    states = _STATES if "yaw" in outputs else _STATES[:-1]
    noise = np.maximum(noise_level(measured), 1e-6)
    if method == "output-error":
        estimate = estimate_output_error(
            model, manoeuvre, start, fixed=fixed, initial_states=states, noise=noise.tolist()
        )
    else:
        process = dict.fromkeys(states[3:5], _PROCESS_NOISE) | dict.fromkeys("uvw", 1e3 * _PROCESS_NOISE)
        estimate = estimate_filter_error(
            model, manoeuvre, start, process, fixed=fixed, initial_states=states, noise=noise.tolist()
        )
    return Compatibility(estimate, _corrected(record, estimate, errors))


def _start(record: FlightRecord) -> Float[np.ndarray, " state"]:
    V, alpha, beta, roll, pitch = (float(np.median(record[key][:5])) for key in _OUTPUTS[:5])
    velocity = [V * np.cos(alpha) * np.cos(beta), V * np.sin(beta), V * np.sin(alpha) * np.cos(beta)]
    return np.array([*velocity, roll, pitch, float(record.channels.get("yaw", np.zeros(1))[0])])


def _corrected(record: FlightRecord, estimate: Estimate, errors: Sequence[str]) -> FlightRecord:
    values, channels = estimate.parameters, {}
    for key in (*_INPUTS, *_OUTPUTS):
        bias, scale = values.get(f"bias({key})", 0.0), values.get(f"scale({key})", 0.0)
        if bias or scale:
            channels[key] = (record[key] - bias) / (1.0 + scale)
    return record.with_channels((f"Errors of sensors are removed: {', '.join(errors)}.",), **channels)
