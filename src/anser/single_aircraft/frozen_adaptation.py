"""Increments of coefficients that an adaptive autopilot estimates: history, and margins with frozen estimates."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array

from anser.aircraft.changes import changed_airframe
from anser.aircraft.corrected_airframe import corrected_airframe, reference_lengths
from anser.analysis.margins import margins_at
from anser.analysis.step_flights import step_case
from anser.analysis.trim_points import resolve_airframe
from anser.parts.perception import Instant
from anser.simulation.recorders import AbstractRecorder, AircraftSample, record
from anser.single_aircraft.changes import read_changes

_INCREMENTS, _REFERENCE = "coefficient_increment", "regressor_reference"
_COEFFICIENTS = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")
_STATE_REGRESSORS = ("constant", "alpha_or_beta", "pitch_or_roll_rate", "yaw_rate")


class AdaptationHistory(AbstractRecorder):
    """Recorder of one aircraft with an adaptive autopilot: all variables, and the estimated coefficient increments."""

    stride: int = eqx.field(static=True, default=1)

    def output(self, sample: AircraftSample, instant: Instant) -> dict[str, Array]:
        """Return the variables of a sample by key (SI, rad), with coefficient increments and reference regressors."""
        corrected: Any = sample.belief.airframe
        return {**record(sample), _INCREMENTS: corrected.increments, _REFERENCE: corrected.reference}


def increment_variables(history: Mapping[str, np.ndarray], rows: int, surfaces: Sequence[str]) -> dict[str, Any]:
    """Return the increments of the first `rows` samples as dataset variables; empty if the flight has no increments.

    The variables are the increments of CX, CY, CZ, Cl, Cm, Cn per unit of each regressor (1, alpha or beta,
    dimensionless rates, surfaces; angles in rad), and the values from which deviations of regressors count.
    """
    if _INCREMENTS not in history:
        return {}
    regressors = (*_STATE_REGRESSORS, *surfaces)
    increments = {"long_name": "Increment of a coefficient by a regressor, estimated", "units": "1"}
    reference = {"long_name": "Regressor from which deviations count", "units": "1"}
    return {
        "coefficient": ("coefficient", np.array(_COEFFICIENTS)),
        "motion": ("motion", np.array(("longitudinal", "lateral"))),
        "regressor": ("regressor", np.array(regressors)),
        _INCREMENTS: (("time", "coefficient", "regressor"), history[_INCREMENTS][:rows], increments),
        _REFERENCE: (("motion", "regressor"), history[_REFERENCE][0], reference),
    }


def frozen_margins(dataset: xr.Dataset, time_s: float | None = None) -> xr.Dataset:
    """Compute the stability margins of an adaptive autopilot with its estimates frozen at a time of a flight.

    The autopilot inverts the onboard model with the estimates of that time. The aircraft has all changes up to that
    time except a loss of thrust. The margins are for level flight at the airspeed and altitude of that time, in still
    standard air.

    Raises ValueError if the flight has no estimates or does not contain the time, if actuators or engine had no lag, or
    if the aircraft has no name or file. ConditionError: see `anser.analysis.margins_at`.

    Parameters
    ----------
    dataset
        Flight of `anser.simulate` with `controller="adaptive"`.
    time_s
        Time of the flight, s; None: the end.

    Returns
    -------
    xr.Dataset
        Dataset of `anser.analysis.margins_at`, with the time as attribute `time_s`.
    """
    if _INCREMENTS not in dataset:
        raise ValueError(
            'flight: arrived without estimates; expected one of anser.simulate(..., controller="adaptive")'
        )
    if dataset.attrs["aircraft"] == "custom":
        raise ValueError("flight: arrived with an aircraft of an own class; expected one by name or by file")
    for lag in ("actuator_lag", "engine_lag"):
        if lag in dataset.attrs:
            raise ValueError(f"flight: arrived one with {lag}=False; expected one of the aircraft with its lags")
    last = float(dataset.time[-1])
    time_s = last if time_s is None else time_s
    if not 0.0 <= time_s <= last:
        raise ValueError(f"time_s: arrived {time_s:g}; expected 0 to {last:g}, a time of the flight")
    first, row = dataset.isel(time=0), dataset.sel(time=time_s, method="nearest")
    variant, x_cg_over_c = dataset.attrs.get("variant", "textbook"), dataset.attrs.get("x_cg_over_c")
    nominal, identity = resolve_airframe(dataset.attrs["aircraft"], variant, x_cg_over_c)
    increments, reference = jnp.asarray(row[_INCREMENTS].values), jnp.asarray(row[_REFERENCE].values)
    model = corrected_airframe(nominal, reference_lengths(nominal), reference, increments)
    # `simulate` has compared the times with the duration
    changes = read_changes(nominal, json.loads(dataset.attrs.get("change", "[]")), np.inf)
    aircraft = nominal if changes is None else changed_airframe(nominal, changes.at(float(row.time)))
    step_s, start = float(dataset.attrs["step_s"]), (float(first["airspeed_m_s"]), float(first["altitude_m"]))
    case = step_case(nominal, *start, "incremental", step_s)
    margins = margins_at(
        aircraft,
        speed_m_s=float(row["airspeed_m_s"]),
        altitude_m=float(row["altitude_m"]),
        inversion="incremental",
        step_s=step_s,
        gains=case.gains,
        model=model,
    )
    return margins.assign_attrs({**identity, "inversion": "adaptive", "time_s": float(row.time)})
