"""`trim`: an airframe of the library by its name, or one's own; what it refuses."""

import pytest

from anser.aircraft_files import load_airframe
from anser.analysis import trim


def test_a_name_is_as_good_as_the_airframe():
    by_name = trim("f16", 153.0, 0.0, variant="textbook", x_cg_over_c=0.35, pitch_rate_deg_s=10.0)
    own = trim(load_airframe("f16", "textbook", 0.35), 153.0, 0.0, pitch_rate_deg_s=10.0)
    assert by_name.diagnosis is None
    assert by_name.quantities == own.quantities
    assert repr(own).splitlines()[0] == "steady flight"
    assert repr(own).splitlines()[-1].split() == ["Mach", "number", "0.449611"]
    assert "<td>angle of attack</td>" in own._repr_html_()


def test_one_that_cannot_be_flown_is_printed_with_its_reason():
    slow = trim("f16", 40.0, 0.0)
    assert slow.diagnosis is not None
    assert repr(slow) == f"no steady flight: {slow.diagnosis}"
    assert "no steady flight" in slow._repr_html_()


def test_what_defines_no_flight_is_refused():
    with pytest.raises(ValueError, match=r"pitch_rate: arrived .* expected a pitch rate alone"):
        trim("f16", 153.0, 0.0, turn_rate_deg_s=3.0, pitch_rate_deg_s=10.0)
    with pytest.raises(ValueError, match=r"x_cg_over_c: arrived 0.35 with an airframe of your own; expected None"):
        trim(load_airframe(), 153.0, 0.0, x_cg_over_c=0.35)
    with pytest.raises(ValueError, match="known are"):
        trim("f16", 153.0, 0.0, variant="best")
