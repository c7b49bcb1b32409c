"""A small synthetic robustness study, with statistics and figures known by hand."""

import numpy as np
import xarray as xr

from anser.analysis.surveys import OUTCOMES, REASONS

REACHED, FAILED, NOT_FLOWN = (OUTCOMES.index(name) for name in ("reached", "failed", "not_flown"))


def made_up_study() -> xr.Dataset:
    """Two factors, two conditions: ten flights dispersed, eight of a sweep, eight of the first factor alone.

    Model-based inversion fails if the first factor exceeds 1.1: dispersed flights 8 and 9, half of the sweep at 20 %,
    and alone from +20 % on. Incremental inversion always succeeds. The last aircraft alone, at -20 %, has no steady
    flight.
    """
    dispersed = np.linspace(0.9, 1.13, 10)
    swept = np.array([0.95, 1.05, 0.92, 1.08, 0.9, 1.1, 0.8, 1.2])
    changes = np.array([0.1, 0.1, 0.2, 0.2, -0.1, -0.1, -0.2, -0.2])
    first_factor = np.concatenate([dispersed, swept, 1 + changes])
    count = len(first_factor)
    part = np.repeat([0, 1, 2], [10, 8, 8])
    outcome = np.full((2, count), REACHED)
    outcome[0, first_factor > 1.1 + 1e-9] = FAILED
    outcome[:, -1] = NOT_FLOWN
    reason = np.where(outcome == FAILED, REASONS.index("surfaces"), 0)
    reason[0, 9] = REASONS.index("unexplained")
    errors = {"airspeed": ("m_s", 0.5, 0.1), "path_angle": ("deg", 0.3, 0.05), "course": ("deg", 1.0, 0.2)}
    variables = {
        f"{name}_final_error_max_{unit}": (("inversion", "flight"), np.where(outcome == NOT_FLOWN, np.nan, usual))
        for name, (unit, _, usual) in errors.items()
    }
    variables["path_angle_final_error_max_deg"][1][0, 9] = 0.4
    values = np.stack([first_factor, np.cos(np.arange(count))], axis=1)
    meanings = "dispersed spread alone"
    return xr.Dataset(
        {
            "part": ("flight", part, {"flag_meanings": meanings}),
            "condition": ("flight", np.arange(count) % 2),
            "spread_percent": ("flight", np.concatenate([[20.0] * 10, [10.0] * 4, [20.0] * 4, 100 * changes])),
            "alone": ("flight", np.repeat([-1, 0], [18, 8])),
            "factor_value": (("flight", "factor"), values),
            "outcome": (("inversion", "flight"), outcome, {"flag_meanings": " ".join(OUTCOMES)}),
            "reason": (("inversion", "flight"), reason, {"flag_meanings": " ".join(REASONS)}),
            **variables,
        },
        {
            "inversion": ("inversion", ["model", "incremental"]),
            "factor": ("factor", ["CZ0", "cg_shift"]),
            "factor_unit": ("factor", ["1", "1"]),
            "factor_nominal": ("factor", [1.0, 0.0]),
            "factor_scale": ("factor", [1.0, 0.2]),
            "condition_meaning": ("place", ["150 m/s, 1000 m", "200 m/s, 6000 m"]),
        },
        {
            "aircraft": "f16",
            "variant": "textbook",
            "command": "+10 m/s",
            "spread_percent": 20.0,
            **{f"tolerance_{name}_{unit}": limit for name, (unit, limit, _) in errors.items()},
        },
    )
