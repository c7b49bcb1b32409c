"""Checks of the standards, and their figures compared with independent implementations of the standards."""

import numpy as np
import pymap3d
import pytest
from ambiance import Atmosphere

from anser.verification.checks import half_of_last_digit, load_published
from anser.verification.standards import USSA76, WGS84_FIGURE
from support.checks import assert_passes


def test_the_atmosphere_equals_its_tables():
    comparisons = assert_passes(USSA76, 4 * 15 - 2 + 8)
    wider = [c for c in comparisons if c.tolerance_reason]
    assert [(c.group, c.point) for c in wider] == [("pressure", f"{z} km") for z in (10, 11, 15, 60, 80)]


def test_the_printed_atmosphere_agrees_with_another_implementation():
    """Detects slips in the figures; ambiance has ICAO's molar mass, up to 1.2e-5 in pressure and density."""
    figures = load_published("ussa76")
    low = figures["last_digit_one_low"]["pressure_Pa"]
    for z, *printed_row in figures["geometric"]:
        reference = Atmosphere(float(z))
        values = (reference.temperature, reference.pressure, reference.density, reference.speed_of_sound)
        for name, printed, value in zip(figures["columns"][1:], printed_row, values, strict=True):
            if printed is None:
                continue
            half = half_of_last_digit(printed)
            difference = float(value[0]) - float(printed)
            slack = 1.2e-5 * float(printed)
            if name == "pressure_Pa" and z in low:
                # Cut: the figure lies above, by more than half a unit and less than a whole one.
                assert half - slack < difference < 2.0 * half + slack, (name, z)
            else:
                assert abs(difference) <= half + slack, (name, z)


def test_the_ellipsoid_equals_its_figures():
    groups = {c.group for c in assert_passes(WGS84_FIGURE, 43)}
    assert {"gravity", "latitude", "longitude", "height", "ECEF x", "NESC ECEF x"} <= groups


def test_the_position_of_the_check_case_agrees_with_another_implementation():
    columns = load_published("nesc_checkpoints")["cases"]["11"]["columns"]
    geodetic = [columns[name]["sim_05"][0] for name in ("latitude_deg", "longitude_deg", "altitudeMsl_ft")]
    point = [columns[f"gePosition_ft_{axis}"]["sim_05"][0] * 0.3048 for axis in "XYZ"]
    # Half a unit of the tenth digit of angles and feet: 0.6, 0.5 and 1.5 mm.
    np.testing.assert_allclose(
        pymap3d.geodetic2ecef(geodetic[0], geodetic[1], geodetic[2] * 0.3048), point, atol=2.6e-3
    )


@pytest.mark.parametrize("name", ["ussa76", "wgs84"])
def test_figures_are_stored_as_printed(name):
    """As text, with the final zeros: a number would lose the zeros and the tolerance."""
    data = load_published(name)
    printed_rows = [*data.get("geometric", []), *data.get("bases", []), *data.get("gravity", [])]
    printed = [cell for printed_row in printed_rows for cell in printed_row[1:] if cell is not None]
    printed += [cell for cell, _ in data.get("derived", {}).values()]
    assert len(printed) > 5
    assert all(isinstance(cell, str) for cell in printed)
