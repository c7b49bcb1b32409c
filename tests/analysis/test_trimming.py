"""`trim`: an airframe by name, or passed as an object; refused conditions."""

import pytest

from anser.aircraft_files import load_airframe
from anser.analysis import trim


def test_a_name_and_the_airframe_have_the_same_trim():
    by_name = trim("f16", 153.0, 0.0, variant="textbook", x_cg_over_c=0.35, pitch_rate_deg_s=10.0)
    by_airframe = trim(load_airframe("f16", "textbook", 0.35), 153.0, 0.0, pitch_rate_deg_s=10.0)
    assert by_name.diagnosis is None
    assert by_name.quantities == by_airframe.quantities
    assert repr(by_airframe).splitlines()[0] == "steady flight"
    assert repr(by_airframe).splitlines()[-1].split() == ["Mach", "number", "0.449611"]
    assert "<td>angle of attack</td>" in by_airframe._repr_html_()


@pytest.mark.long
def test_a_missing_trim_is_printed_with_its_reason():
    slow = trim("f16", 40.0, 0.0)
    assert slow.diagnosis is not None
    assert repr(slow) == f"no steady flight: {slow.diagnosis}"
    assert "no steady flight" in slow._repr_html_()


def test_contradictory_conditions_are_refused():
    with pytest.raises(ValueError, match=r"pitch_rate: arrived .* expected a pitch rate alone"):
        trim("f16", 153.0, 0.0, turn_rate_deg_s=3.0, pitch_rate_deg_s=10.0)
    with pytest.raises(ValueError, match=r"x_cg_over_c: arrived 0.35 with an airframe of your own; expected None"):
        trim(load_airframe(), 153.0, 0.0, x_cg_over_c=0.35)
    with pytest.raises(ValueError, match=r"variant: arrived 'tp1538' with an airframe of your own; expected none"):
        trim(load_airframe(), 153.0, 0.0, variant="tp1538")
    with pytest.raises(ValueError, match="known are"):
        trim("f16", 153.0, 0.0, variant="best")
