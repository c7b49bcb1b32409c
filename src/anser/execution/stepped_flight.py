"""A step test that was flown: its record, its figures, and what it must keep to."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from anser.execution.step_tests import CHANNEL_KEYS, STEP_S, StepTest, unit_of_channel
from anser.results import finite_or_none, surfaces_of
from anser.simulation.step_metrics import StepMetrics
from anser.variables import CATALOGUE

STEP_FORMAT_VERSION = 1
"""Version of the document that `step_document` makes; it changes when a field changes its meaning or goes."""

_OVERSHOOT_MAX = 0.10
_FINAL_ERROR_MAX = 0.01
_SIDESLIP_MAX_DEG = 1.0
"""What the published responses must keep to; the last in steps of the velocity loop."""

_FACTORS = {variable.key: variable.factor for variable in CATALOGUE}


@dataclass(frozen=True)
class SteppedFlight:
    """A step test that was flown.

    Attributes
    ----------
    test
        What was commanded.
    dataset
        Outputs of all three loops, commands of the stepped one, surfaces, throttle and power over time, named and
        labelled as in `anser.variables.catalogue`; the attributes say what flew where.
    metrics
        Figures up to the reading, SI units and radians.
    """

    test: StepTest
    dataset: xr.Dataset
    metrics: StepMetrics

    @property
    def sideslip_max_deg(self) -> float:
        """Greatest sideslip up to the reading."""
        return float(np.abs(self._read("beta_deg")).max())

    @property
    def left_tables(self) -> bool:
        """Whether it left the aerodynamic tables before the reading."""
        return bool(self._read("outside_tables").any())

    @property
    def shortfalls(self) -> tuple[str, ...]:
        """What the published responses must keep to and this one does not; empty where it keeps to all."""
        found, m = [], self.metrics
        for k, channel in enumerate(CHANNEL_KEYS[self.test.loop]):
            overshoot, error = float(m.overshoot[k]), float(m.final_error[k])
            # "not <=": a response that ends in no number at all falls short too.
            if not overshoot <= _OVERSHOOT_MAX:
                found.append(f"{channel} overshoots by {100 * overshoot:.1f} %, more than {100 * _OVERSHOOT_MAX:g} %")
            if not abs(error) <= _FINAL_ERROR_MAX:
                found.append(f"{channel} ends {100 * error:.2f} % off, more than {100 * _FINAL_ERROR_MAX:g} %")
        if self.test.loop == "velocity" and not self.sideslip_max_deg <= _SIDESLIP_MAX_DEG:
            found.append(f"sideslip reaches {self.sideslip_max_deg:.2f} deg, more than {_SIDESLIP_MAX_DEG:g} deg")
        if self.left_tables:
            found.append("it leaves the aerodynamic tables")
        return tuple(found)

    def _read(self, name: str) -> np.ndarray:
        return self.dataset[name].values[: round(self.test.read_at_s / STEP_S) + 1]

    def document(self) -> dict[str, Any]:
        """Figures in plain data, with units in the names; None for a time that never came."""
        m, channels = self.metrics, list(CHANNEL_KEYS[self.test.loop])
        stepped = {
            channel: {
                "unit": unit_of_channel(channel),
                "size": self.test.size[k],
                "rise_time_s": finite_or_none(m.rise_time[k]),
                "settling_time_s": finite_or_none(m.settling_time[k]),
                "overshoot_percent": finite_or_none(100 * m.overshoot[k]),
                "final_error_percent": finite_or_none(100 * m.final_error[k]),
            }
            for k, channel in enumerate(channels)
            if self.test.size[k] != 0.0
        }
        factors = [_FACTORS[key] for key in CHANNEL_KEYS[self.test.loop].values()]
        coupling = {
            channel: {"unit": unit_of_channel(channel), "greatest": finite_or_none(factors[k] * m.coupling[k])}
            for k, channel in enumerate(channels)
            if channel not in stepped
        }
        return {
            "key": self.test.key,
            "loop": self.test.loop,
            "duration_s": self.test.duration_s,
            "read_at_s": self.test.read_at_s,
            "channels": stepped,
            "coupling": coupling,
            "sideslip_max_deg": finite_or_none(self.sideslip_max_deg),
            "surface_use_percent": {
                name: finite_or_none(100 * m.surface_use[k]) for k, name in enumerate(surfaces_of(self.dataset))
            },
            "shortfalls": list(self.shortfalls),
        }


def step_document(flights: Sequence[SteppedFlight]) -> dict[str, Any]:
    """Figures of several flights from one trim point in plain data, for JSON."""
    about = ("aircraft", "variant", "speed_m_s", "altitude_m", "inversion")
    return {
        "format_version": STEP_FORMAT_VERSION,
        **{name: flights[0].dataset.attrs[name] for name in about if name in flights[0].dataset.attrs},
        "limits": {
            "overshoot_percent": 100 * _OVERSHOOT_MAX,
            "final_error_percent": 100 * _FINAL_ERROR_MAX,
            "sideslip_in_velocity_steps_deg": _SIDESLIP_MAX_DEG,
        },
        "steps": [flight.document() for flight in flights],
    }
