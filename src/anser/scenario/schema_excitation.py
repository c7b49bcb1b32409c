"""Scenario table for excitation: test inputs in the closed loop, as in a flight test."""

import math
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, WithJsonSchema

from anser.config.errors import Problem, format_number, format_value, quoted_list
from anser.config.tables import NAME_PATTERN, Table, expects, identifier, number
from anser.scenario.schema_settings import DURATION_MAX_S

LOOP_INPUTS = ("bank", "alpha", "beta", "roll_rate", "pitch_rate", "yaw_rate")
"""Commands between the loops of the autopilot that test inputs may excite: attitude (deg) and body rates (deg/s)."""
EXCITED_INPUTS = ("throttle", "airspeed", "path_angle", "course", *LOOP_INPUTS)
"""Excitable inputs of any aircraft besides surfaces: throttle (0..1), airspeed (m/s), angles (deg), rates (deg/s)."""
_KEYS_OF_SIGNAL: dict[str, tuple[str, ...]] = {
    "step": (),
    "doublet": ("width_s",),
    "3-2-1-1": ("width_s",),
    "sweep": ("duration_s", "frequencies_hz"),
    "multisine": ("duration_s", "frequencies_hz", "power_exponent"),
}
_OPTIONAL_KEYS = ("width_s", "power_exponent")
_AMPLITUDE_MAX, _FREQUENCY_MAX_HZ = 1000.0, 1000.0
_Amplitude = Annotated[float, Field(ge=-_AMPLITUDE_MAX, le=_AMPLITUDE_MAX)]
_Frequency = Annotated[float, Field(gt=0, le=_FREQUENCY_MAX_HZ)]
_AMPLITUDE_SCHEMA = {"type": "number", "minimum": -_AMPLITUDE_MAX, "maximum": _AMPLITUDE_MAX}


def _number_as_list(value: object) -> object:
    return (value,) if isinstance(value, int | float) and not isinstance(value, bool) else value


_Amplitudes = Annotated[
    tuple[_Amplitude, ...],
    BeforeValidator(_number_as_list),
    Field(strict=False, min_length=1),
    WithJsonSchema({"anyOf": [_AMPLITUDE_SCHEMA, {"type": "array", "items": _AMPLITUDE_SCHEMA, "minItems": 1}]}),
]


class Excitation(Table):
    """Test input in the closed loop: a signal added to controls after the control law, or to commands before it."""

    aircraft: str | None = identifier("excited aircraft; left out: all", "the name of an aircraft", None)
    inputs: tuple[Annotated[str, Field(pattern=NAME_PATTERN)], ...] = Field(
        min_length=1,
        strict=False,
        description="excited inputs: surfaces, throttle, or commands; a multisine has other harmonics for each",
        json_schema_extra=expects(f"a list of surfaces, {quoted_list(EXCITED_INPUTS)}"),
    )
    signal: Literal["step", "doublet", "3-2-1-1", "sweep", "multisine"] = Field(description="signal over time")
    amplitude: _Amplitudes = Field(
        description="greatest magnitude, in deg, deg/s, m/s or the throttle's 0..1, of all inputs or by input",
        json_schema_extra=expects("a number, or a list with a number for each of the inputs", ""),
    )
    start_s: float = number("start of the signal", 0, DURATION_MAX_S, "s", 1.0)
    width_s: float | None = number(
        "width of a pulse (doublet: 1 s if left out; 3-2-1-1: of its unit, 0.7 s)", 0.001, 1000, "s", None
    )
    duration_s: float | None = number("duration of a sweep, period of a multisine", 0.01, DURATION_MAX_S, "s", None)
    frequencies_hz: tuple[_Frequency, _Frequency] | None = Field(
        None,
        strict=False,
        description="least and greatest frequency of a sweep or multisine",
        json_schema_extra=expects("a list of two numbers above 0 (Hz) that do not fall", "Hz"),
    )
    power_exponent: float | None = number(
        "power of a multisine's harmonics over their frequency: 0: equal (left out), -1: equal by octave",
        *(-4, 4, "", None),
    )

    def amplitude_of(self, index: int) -> float:
        """Return the amplitude of the input with an index in `inputs`, in the unit of this input."""
        return self.amplitude[index if len(self.amplitude) > 1 else 0]

    def consistency_problems(self) -> list[Problem]:
        """List keys that the signal lacks or does not use, repeated inputs, and unfit amplitudes or frequencies."""
        problems, keys = [], _KEYS_OF_SIGNAL[self.signal]
        for key in dict.fromkeys(name for names in _KEYS_OF_SIGNAL.values() for name in names):
            value = getattr(self, key)
            if value is None and key in keys and key not in _OPTIONAL_KEYS:
                problems.append(Problem(key, "nothing", f'what signal "{self.signal}" needs: {", ".join(keys)}'))
            if value is not None and key not in keys:
                known = ", ".join(keys) or "amplitude and start_s alone"
                arrived = f'{format_value(value)} with signal "{self.signal}"'
                problems.append(Problem(key, arrived, f"no {key}; that signal knows {known}"))
        repeated = [name for k, name in enumerate(self.inputs) if name in self.inputs[:k]]
        problems += [Problem("inputs", f'"{name}" twice', "every input once") for name in repeated]
        if len(self.amplitude) not in (1, len(self.inputs)):
            expected = f"a number, or a list of {len(self.inputs)}, one for each input"
            problems.append(Problem("amplitude", f"a list of {len(self.amplitude)}", expected))
        return problems or self._frequency_problems()

    def _frequency_problems(self) -> list[Problem]:
        if self.frequencies_hz is None or self.duration_s is None:
            return []
        low, high = self.frequencies_hz
        arrived = f"[{format_number(low)}, {format_number(high)}]"
        if low > high:
            return [Problem("frequencies_hz", arrived, "a list of two numbers (Hz), the first not above the second")]
        first, last = max(math.ceil(low * self.duration_s - 1e-9), 1), math.floor(high * self.duration_s + 1e-9)
        if self.signal == "multisine" and last - first + 1 < len(self.inputs):
            expected = (
                f"a range with at least {len(self.inputs)} multiples of 1 / duration_s = "
                f"{format_number(1.0 / self.duration_s)} Hz, one for each input"
            )
            return [Problem("frequencies_hz", arrived, expected)]
        return []
