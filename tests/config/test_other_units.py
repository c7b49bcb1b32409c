"""Numbers written with a unit, as text."""

import pytest

from anser.config.validation_messages import conversion_hint


@pytest.mark.parametrize(
    ("text", "unit", "hint"),
    [
        ("9 kt", "m/s", "; 9 kt is 4.63 m/s: write 4.63"),
        ("9kts", "m/s", "; 9 kts is 4.63 m/s: write 4.63"),
        ("360 km/h", "m/s", "; 360 km/h is 100 m/s: write 100"),
        ("-600 fpm", "m/s", "; -600 fpm is -3.048 m/s: write -3.048"),
        ("30000 ft", "m", "; 30000 ft is 9144 m: write 9144"),
        ("2 min", "s", "; 2 min is 120 s: write 120"),
        ("3.141592653589793 rad", "deg", "; 3.141592653589793 rad is 180 deg: write 180"),
        ("2 g", "m/s^2", "; 2 g is 19.6133 m/s^2: write 19.6133"),
        ("150", "m/s", "; write 150, without quotes"),
        ("150 m/s", "m/s", "; write 150, without quotes"),
        ("1000 hPa", "hPa", "; write 1000, without quotes"),
        ("20 deg C", "deg C", "; write 20, without quotes"),
        ("0.3", "", "; write 0.3, without quotes"),
        ("9 kt", "m", ""),
        ("9 furlongs", "m", ""),
        ("fast", "m/s", ""),
        ("1.2.3 m", "m", ""),
        ("NW", "deg", "; NW is 315 deg clockwise from north: write 315"),
        ("sse", "deg", "; sse is 157.5 deg clockwise from north: write 157.5"),
        ("NW", "m/s", ""),
    ],
)
def test_a_number_with_a_unit_gets_a_conversion_hint(text, unit, hint):
    assert conversion_hint(text, unit) == hint
