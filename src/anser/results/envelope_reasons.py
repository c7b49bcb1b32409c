"""Why a flight of an envelope survey did not do as it was told: which limit stood in its way."""

from dataclasses import dataclass

import numpy as np

from anser.simulation import AUTOPILOT_LIMITS, BETA_BOUND, TABLE_AXES, FlightSummary

OUTCOMES = ("not_flown", "reached", "limited", "failed")
"""Limited: in controlled flight the command was missed at a limit of thrust, alpha, load factor or bank, or the data
ended in altitude or Mach number, or the steady flight that is left lies beyond the autopilot's limits. Failed: alpha or
beta left the data, sideslip passed its bound (both whatever the reason, such a start included), the surfaces or the
body rates did not suffice, or no limit explains what was missed."""

REASONS = ("none", *AUTOPILOT_LIMITS, *(f"tables_{axis}" for axis in TABLE_AXES), "start_beyond_limits", "unexplained")
"""None: not flown, or reached."""

_LONG = 0.1
"""Part of the flight from which on the time at a limit explains an error at its end."""
_BEFORE_SLIP = 0.1
"""Time at a limit that explains a sideslip after it, s: twice the lag of the actuators."""

_INNER = ("body_rates", "surfaces", "surface_rates")
_EXPLAINS = {
    "V": ("thrust_max", "thrust_idle"),
    "gamma": ("alpha", "load_factor", "unloading", "bank"),
    "chi": ("bank", "alpha", "load_factor", "unloading"),
}
"""Limits that can keep a channel from its command; those of the inner loops stand in the way of all."""


@dataclass(frozen=True)
class Verdicts:
    """One number for each flight: index into `OUTCOMES`, and into `REASONS`."""

    outcome: np.ndarray
    reason: np.ndarray


def judge(
    summaries: FlightSummary, tolerance: np.ndarray, duration: float, start_beyond: np.ndarray | bool = False
) -> Verdicts:
    """Judge a batch of flights.

    A command is reached if every channel ends within its tolerance, commanded or not, sideslip stayed within
    `BETA_BOUND` and the aircraft inside its data. The reason of all else is the first of these that applies: a start
    beyond the autopilot's limits, which it must leave whatever is commanded; alpha or beta beyond the data, whichever
    was first; for sideslip, the limit of the inner loops at which the autopilot stood longest before; altitude or Mach
    number beyond the data; for a channel that was missed, the limit bearing on it at which it stood longest, of those
    that stood during most of the last tenth, over which the error is taken, or for a tenth of the flight.

    Parameters
    ----------
    summaries
        Of the flights; leaves of shape (flights, ...).
    tolerance
        Of (V, gamma, chi), shape (flights, 3), m/s and rad.
    duration
        Of each flight, s.
    start_beyond
        Whether the steady flight that is left lies beyond the autopilot's limits, shape (flights,).
    """
    missed = ~(np.asarray(summaries.final_error_max) <= tolerance)  # true where there is no number
    slipped = ~(np.asarray(summaries.beta_max) <= BETA_BOUND)
    finite = np.asarray(summaries.finite)
    left_time = np.asarray(summaries.left_time)
    left = np.isfinite(left_time).any(axis=1)
    reached = ~missed.any(axis=1) & ~slipped & ~left & finite

    total, late = np.asarray(summaries.limited_time), np.asarray(summaries.limited_late)
    before_slip = np.asarray(summaries.limited_before_slip)
    inner = np.isin(AUTOPILOT_LIMITS, _INNER)
    bearing = np.array([np.isin(AUTOPILOT_LIMITS, (*outer, *_INNER)) for outer in _EXPLAINS.values()])
    stood = (missed @ bearing > 0) & ((late > 0.5 * _LONG * duration) | (total > _LONG * duration))
    of_missed = np.where(stood, total, 0.0)
    of_slip = np.where(inner & (before_slip >= _BEFORE_SLIP), before_slip, 0.0)
    standing = np.where(slipped[:, None], of_slip, of_missed)

    unexplained = REASONS.index("unexplained")
    reason = np.where(standing.any(axis=1) & finite, 1 + standing.argmax(axis=1), unexplained)
    flow = np.array([axis in ("alpha", "beta") for axis in TABLE_AXES])
    departed = np.asarray(np.isfinite(left_time[:, flow]).any(axis=1))
    of_tables = np.where(departed[:, None] & ~flow, np.inf, left_time).argmin(axis=1)
    reason = np.where(departed | (left & ~slipped), 1 + len(AUTOPILOT_LIMITS) + of_tables, reason)
    reason = np.where(start_beyond & finite, REASONS.index("start_beyond_limits"), reason)
    reason = np.where(reached, 0, reason)
    uncontrolled = [REASONS.index(name) for name in (*_INNER, "tables_alpha", "tables_beta", "unexplained")]
    failed = ~reached & (np.isin(reason, uncontrolled) | slipped | departed | ~finite)
    outcome = np.select(
        [reached, failed], [OUTCOMES.index("reached"), OUTCOMES.index("failed")], OUTCOMES.index("limited")
    )
    return Verdicts(outcome.astype(np.int32), reason.astype(np.int32))
