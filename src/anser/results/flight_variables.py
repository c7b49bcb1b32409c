"""Variables of a dataset that hold the summaries of flights."""

from typing import Any

import numpy as np

from anser.simulation import FlightSummary
from anser.units import RAD_DEG

_CHANNELS = (
    ("airspeed", "m_s", "m s-1", 1.0),
    ("path_angle", "deg", "degree", RAD_DEG),
    ("course", "deg", "degree", RAD_DEG),
)


def attributes_of(unit: str, words: str) -> dict[str, Any]:
    """Unit and long name as attributes; no unit where it is empty."""
    return {"units": unit, "long_name": words} if unit else {"long_name": words}


def add_flights(add: Any, flights: FlightSummary) -> None:
    """Call `add(name, values, unit, words, over)` for every variable; values have the flights as their first axis."""
    for k, (name, suffix, unit, factor) in enumerate(_CHANNELS):
        words = name.replace("_", " ")
        add(
            f"{name}_final_error_{suffix}",
            np.asarray(flights.final_error)[:, k] * factor,
            unit,
            f"Command minus {words}, mean of the last tenth",
        )
        add(
            f"{name}_final_error_max_{suffix}",
            np.asarray(flights.final_error_max)[:, k] * factor,
            unit,
            f"Largest error of the {words} in the last tenth",
        )
        add(
            f"{name}_settling_s",
            np.asarray(flights.settling_time)[:, k],
            "s",
            f"Until the {words} stays within its tolerance; inf: not before the end",
        )
        add(
            f"{name}_overshoot", np.asarray(flights.overshoot)[:, k], "1", f"Overshoot of the {words}, part of the step"
        )
        add(
            f"{name}_coupling_{suffix}",
            np.asarray(flights.coupling)[:, k] * factor,
            unit,
            f"Largest error of the {words} where it is not stepped",
        )
    add("beta_max_deg", np.asarray(flights.beta_max) * RAD_DEG, "degree", "Largest sideslip, either way")
    add("alpha_min_deg", np.asarray(flights.alpha_min) * RAD_DEG, "degree", "Least angle of attack")
    add("alpha_max_deg", np.asarray(flights.alpha_max) * RAD_DEG, "degree", "Greatest angle of attack")
    add("load_factor_min", flights.load_factor_min, "1", "Least normal load factor")
    add("load_factor_max", flights.load_factor_max, "1", "Greatest normal load factor")
    add("surface_share", flights.surface_share, "1", "Largest deflection, part of the way to the stop", "surface")
    add("surface_rate_share", flights.surface_rate_share, "1", "Largest rate of the surface over its limit", "surface")
    add("body_rate_share", flights.body_rate_share, "1", "Largest body rate over the autopilot's limit", "axis")
    add("limited_s", flights.limited_time, "s", "Time at each limit of the autopilot", "limit")
    add("limited_late_s", flights.limited_late, "s", "Time at each limit in the last tenth of the flight", "limit")
    add(
        "limited_before_slip_s",
        flights.limited_before_slip,
        "s",
        "Time at each limit until sideslip first passes its bound",
        "limit",
    )
    add("left_s", flights.left_time, "s", "First time outside the data; inf: never", "table")
    add("finite", np.asarray(flights.finite).astype(np.int32), "1", "Whether the state stayed finite; 0 if not flown")
