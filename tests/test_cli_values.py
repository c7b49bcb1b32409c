"""Invalid option values are reported like invalid values in files: option, value, expected value."""

import pytest

BY_RATES = ("step", "--loop", "rates", "--at", "150,1000")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (
            ("trim", "--speed-m-s", "fast", "--altitude-m", "0"),
            "--speed-m-s: arrived 'fast'; expected a number, in m/s",
        ),
        (
            ("trim", "--speed-m-s", "300 kt", "--altitude-m", "0"),
            "--speed-m-s: arrived '300 kt'; expected a number, in m/s; 300 kt is 154.333 m/s: write 154.333",
        ),
        (
            ("trim", "--speed-m-s", "150", "--altitude-m", "0", "--turn-rate-deg-s", "x"),
            "--turn-rate-deg-s: arrived 'x'; expected a number, in deg/s",
        ),
        ((*BY_RATES, "--channel", "q", "--size", "big"), "--size: arrived 'big'; expected a number"),
        (("step", "--loop", "foo"), "--loop: arrived 'foo'; expected one of 'rates', 'attitude', 'velocity'"),
        (("campaign", "report", "x", "--worst", "two"), "--worst: arrived 'two'; expected a whole number"),
        (("campaign", "x", "--out", "y", "--processes", "0"), "--processes: arrived '0'; expected 1 or more"),
        (("campaign", "report", "x", "--worst", "5000"), "--worst: arrived '5000'; expected 1000 or less"),
    ],
)
def test_an_invalid_value_is_reported_with_option_and_expected_value(anser, arguments, said):
    assert anser(*arguments) == (2, "", said + "\n")
