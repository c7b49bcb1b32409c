"""Removal of time delays between the channels of a record, and detection of wrong units, by flight kinematics."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from anser.identification.kinematics import RATES, implied_rates, with_specific_force
from anser.identification.records import FlightRecord
from anser.identification.smoothing import integrate, noise_level, smooth
from anser.units import FOOT_M, KNOT_M_S, RAD_DEG
from anser.variables import catalogue

DELAY_MAX_S = 0.5
"""Greatest lag or lead of a channel that is searched, s."""
_SURFACE_FIT_MIN = 0.8
"""Least fit to an angular acceleration at which a surface is checked for a delay."""
_FIT_MIN: dict[str, float] = {
    **dict.fromkeys(("pitch", "roll", "alpha", "beta", "airspeed"), 0.8),
    "altitude": 0.98,
}
"""Share of a channel's variation that kinematics must explain for a check of unit and delay."""
_SIGNIFICANCE = 5.0
"""Least delay that is corrected, in standard errors of the delay."""
_UNIT_TOLERANCE = 0.2
"""Greatest relative deviation from a factor in `_FACTORS` at which the unit is refused."""
_SIGN = {"the opposite sign": -1.0}
_ANGLES = _SIGN | {
    "radians that are declared as degrees": RAD_DEG,
    "degrees that are declared as radians": 1.0 / RAD_DEG,
}
_SPEED_UNITS = {"ft/s": FOOT_M, "knots": KNOT_M_S, "km/h": 1.0 / 3.6}
_SPEEDS = {f"{unit} that are declared as m/s": factor for unit, factor in _SPEED_UNITS.items()} | {
    f"m/s that are declared as {unit}": 1.0 / factor for unit, factor in _SPEED_UNITS.items()
}
_FACTORS: dict[str, dict[str, float]] = {
    **dict.fromkeys(("pitch", "roll", "alpha", "beta"), _ANGLES),
    "airspeed": _SIGN | _SPEEDS,
    # the altitude rate is proportional to the airspeed: the factor of a wrong airspeed is the inverse
    "altitude": _SIGN
    | {"feet that are declared as metres": FOOT_M, "metres that are declared as feet": 1.0 / FOOT_M}
    | {text: 1.0 / factor for text, factor in _SPEEDS.items()},
}
"""Ratio of the kinematic values to the values of a channel, for each kind of wrong unit or sign."""


class ChannelMatch(NamedTuple):
    """Comparison of a channel with a reference computed from other channels: scale factor, delay and fit.

    The reference is the integral of the channel's rate; for a surface, the reference is the angular acceleration.
    `factor` is reference / channel, which is 1 for consistent units and has no meaning for a surface. `delay_s` is
    positive if the channel lags. `delay_error_s` is the standard error of the delay; infinite if the fit has no maximum
    within the searched delays. `fit` is the explained share of the variation, 0 to 1.
    """

    factor: float
    delay_s: float
    delay_error_s: float
    fit: float


def match_channel(
    measured: Float[np.ndarray, " sample"],
    integral: Float[np.ndarray, " sample"],
    step_s: float,
    delay_max_s: float = DELAY_MAX_S,
) -> ChannelMatch:
    """Fit a channel by least squares: measured(t) = c0 + c1 t + c2 t^2 + integral(t - delay) / factor.

    `integral` is the integral of the channel's rate, computed from other channels; the polynomial absorbs the drift
    from sensor biases. Positive and negative delays are searched, up to `delay_max_s` (at least one sample) and up to a
    quarter of the record.
    """
    shift_max = min(max(1, round(delay_max_s / step_s)), (measured.size - 1) // 4)
    count = measured.size - 2 * shift_max
    windows = np.lib.stride_tricks.sliding_window_view(integral, count)[::-1]  # rows: delay -max .. max
    basis = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, count), 3))[0]
    return _match_windows(measured[shift_max : shift_max + count], windows, basis, step_s)


def _match_windows(
    values: Float[np.ndarray, " sample"],
    windows: Float[np.ndarray, "delay sample"],
    basis: Float[np.ndarray, "sample column"],
    step_s: float,
) -> ChannelMatch:
    """Fit `values` by the best row of `windows` plus a combination of the orthonormal columns of `basis`.

    The rows of `windows` are another series with delays that rise by `step_s` from row to row; the middle row has the
    delay 0. `factor` of the result is window / values.
    """
    y = values - basis @ (basis.T @ values)
    Y = windows - (windows @ basis) @ basis.T
    products, powers = Y @ y, np.sum(Y**2, axis=1)
    total = max(float(y @ y), 1e-300)
    # Windows that the basis reproduces explain nothing.
    usable = powers > 1e-6 * np.sum((windows - windows.mean(axis=1, keepdims=True)) ** 2, axis=1)
    explained = np.where(usable, products**2 / np.maximum(powers, 1e-300), 0.0)
    best = int(np.argmax(explained))
    centre = (len(windows) - 1) // 2
    factor = float(powers[best] / products[best]) if products[best] != 0.0 else np.inf
    fit = float(explained[best]) / total
    if not 0 < best < len(windows) - 1:
        return ChannelMatch(factor, (best - centre) * step_s, np.inf, fit)
    before, at, after = explained[best - 1 : best + 2]
    curvature = before - 2.0 * at + after
    if curvature >= 0.0:
        return ChannelMatch(factor, (best - centre) * step_s, np.inf, fit)
    peak = at - 0.125 * (before - after) ** 2 / curvature
    variance = max(total - float(peak), 0.0) / (values.size - basis.shape[1] - 2)
    delay = (best - centre + 0.5 * (before - after) / curvature) * step_s
    return ChannelMatch(factor, float(delay), float(np.sqrt(2.0 * variance / -curvature)) * step_s, fit)


def align_record(
    record: FlightRecord,
    delay_max_s: float = DELAY_MAX_S,
    accelerometer_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> FlightRecord:
    """Return the record with the constant delays of channels removed, and a note for each removed delay.

    The delays of flow angles, airspeed and attitude follow from the kinematics; the delays of surfaces follow from the
    angular acceleration. A delay is removed if the channel fits well and the delay exceeds a quarter of a step
    (surfaces: one step) and 5 standard errors. The ends of the record are cut. A record without body rates is returned
    unchanged. `accelerometer_m` is the position of the accelerometers relative to the centre of gravity, body axes, m.

    Raises ValueError if a channel has a wrong unit or sign, a delay is `delay_max_s` or more, or fewer than 50 samples
    remain.
    """
    if not all(key in record for key in RATES):
        return record
    names = {variable.key: variable.name for variable in catalogue(record.surfaces)}
    try:
        inertial = with_specific_force(record, accelerometer_m)
    except ValueError:
        inertial = record  # without forces, attitude alone is compared
    matches = {}
    for key, rate in implied_rates(inertial).items():
        if key not in _FIT_MIN:
            continue
        match = match_channel(record[key], integrate(rate, record.step_s), record.step_s, delay_max_s)
        if match.fit >= _FIT_MIN[key]:
            name = f"{names[key]} or {names['airspeed']}" if key == "altitude" else names[key]
            _refuse_unit(name, match.factor, _FACTORS[key])
            matches[key] = match
    matches.pop("altitude", None)  # errors of the path angle add up in the altitude: no delay follows from it
    matches |= _surface_matches(record, delay_max_s)
    delays = {}
    for key, match in matches.items():
        if np.isinf(match.delay_error_s):
            raise ValueError(
                f"record: arrived {names[key]} with a delay of {delay_max_s:g} s or more; expected less, or "
                "the channel shifted before"
            )
        threshold = record.step_s if key in record.surfaces else 0.25 * record.step_s
        if abs(match.delay_s) > max(threshold, _SIGNIFICANCE * match.delay_error_s):
            delays[key] = match.delay_s
    return _shifted(record, delays, names)


def _refuse_unit(name: str, factor: float, factors: dict[str, float]) -> None:
    errors = {text: abs(factor / expected - 1.0) for text, expected in factors.items()}
    texts = [text for text in sorted(errors, key=lambda text: errors[text]) if errors[text] < _UNIT_TOLERANCE]
    if texts:
        raise ValueError(
            f"record: arrived {name} with values that kinematics multiplies by {factor:.3g}: {' or '.join(texts)}; "
            'expected the unit of the name, or a map with the unit, such as { column = "AOA", unit = "rad" }'
        )


def _surface_matches(record: FlightRecord, delay_max_s: float) -> dict[str, ChannelMatch]:
    """Return for each moving surface the best match with an angular acceleration, unless the surface fits badly."""
    present = [key for key in ("alpha", "beta", *RATES) if key in record]
    moving = [
        name for name in record.surfaces if name in record and np.ptp(record[name]) > 20.0 * noise_level(record[name])
    ]
    accelerations = smooth(record.stack(*RATES), record.step_s).rate
    matches = {}
    for name in moving:
        remaining = [record[other] for other in moving if other != name]
        basis = _basis(np.stack([np.ones(record.time_s.size), *(record[key] for key in present), *remaining]))
        candidates = [_match_surface(record[name], row, basis, record.step_s, delay_max_s) for row in accelerations]
        match = max(candidates, key=lambda candidate: candidate.fit)
        if match.fit >= _SURFACE_FIT_MIN:
            matches[name] = match
    return matches


def _basis(rows: Float[np.ndarray, "row sample"]) -> Float[np.ndarray, "sample row"]:
    return np.linalg.qr(rows.T)[0]


def _match_surface(
    surface: np.ndarray, acceleration: np.ndarray, basis: np.ndarray, step_s: float, delay_max_s: float
) -> ChannelMatch:
    """Fit acceleration(t) by surface(t + delay) plus a combination of the columns of `basis`."""
    shift_max = min(max(1, round(delay_max_s / step_s)), (surface.size - 1) // 4)
    count = surface.size - 2 * shift_max
    inner = slice(shift_max, shift_max + count)
    windows = np.lib.stride_tricks.sliding_window_view(surface, count)  # rows: delay -max .. max
    return _match_windows(acceleration[inner], windows, _basis(basis[inner].T), step_s)


def _shifted(record: FlightRecord, delays: dict[str, float], names: dict[str, str]) -> FlightRecord:
    if not delays:
        return record
    time_s = record.time_s
    channels = {key: np.interp(time_s + delay, time_s, record[key]) for key, delay in delays.items()}
    notes = [
        f"{names[key]} {'lags' if delay > 0.0 else 'leads'} by {abs(delay):.3f} s and is shifted."
        for key, delay in delays.items()
    ]
    start = time_s[0] + max(0.0, *(-delay for delay in delays.values()))
    end = time_s[-1] - max(0.0, *delays.values())
    return record.with_channels(notes, **channels).window(start, end)
