"""Verification of standards: the US Standard Atmosphere 1976, and WGS-84 (ellipsoid, positions, normal gravity)."""

import functools
import math
from collections.abc import Iterator

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.environment.air import geometric_altitude
from anser.environment.atmosphere import StandardAtmosphere
from anser.environment.earth import somigliana
from anser.shapes import Vector3
from anser.spatial.wgs84 import WGS84, ecef_from_geodetic, geodetic_from_ecef, radii_of_curvature
from anser.units import DEG_RAD, FOOT_M, RAD_DEG
from anser.verification.checks import (
    Comparison,
    compare_as_printed,
    half_of_last_digit,
    half_of_significant,
    load_published,
    make_check,
)

_AIR_UNITS = {"temperature": "K", "pressure": "Pa", "density": "kg/m^3", "speed_of_sound": "m/s"}
_air_at = jax.jit(jax.vmap(StandardAtmosphere().at))


def _measure_atmosphere() -> Iterator[Comparison]:
    figures = load_published("ussa76")
    published_rows, bases = figures["geometric"], figures["bases"]
    heights = jnp.array([float(published_row[0]) for published_row in published_rows])
    base_heights = jnp.array([float(base) for base, _ in bases])
    air = _air_at(jnp.concatenate([heights, geometric_altitude(base_heights)]))
    cut_heights_m = figures["last_digit_one_low"]["pressure_Pa"]
    for column, (name, unit) in enumerate(_AIR_UNITS.items(), start=1):
        for published_row, computed in zip(published_rows, getattr(air, name), strict=False):
            printed = published_row[column]
            if printed is None:
                continue
            is_cut = name == "pressure" and published_row[0] in cut_heights_m
            tolerance = half_of_last_digit(printed) * (2.0 if is_cut else 1.0)
            point, reason = f"{published_row[0] / 1000:g} km", "last digit cut, not rounded" if is_cut else ""
            yield Comparison(name, point, unit, float(printed), float(computed), tolerance, tolerance_reason=reason)
    for (base, printed), computed in zip(bases, air.pressure[len(published_rows) :], strict=True):
        yield compare_as_printed("base_pressure", f"{base / 1000:g} km geopotential", "Pa", printed, computed)


USSA76 = make_check("ussa76", _measure_atmosphere)


_ROUNDING_M = 1e-8
"""Tolerance of positions, m: rounding error, about ten units in the last place of 6.4e6 m."""
_GRAVITY_M_S2 = 1e-9
"""Tolerance of gravity, m/s^2: half a unit of the ninth printed decimal, plus 1e-10 between the formulas."""
_DIGITS = 10
"""Number of significant digits of the check-case data."""


@jax.jit
def _convert_both_ways(
    positions: Float[Array, "place 3"], points_e: Float[Array, "place 3"]
) -> tuple[Float[Array, "place 3"], Float[Array, "place 3"]]:
    """Return Earth-fixed points (m) of geodetic positions, and geodetic positions of the Earth-fixed points `points_e`.

    Geodetic positions are latitude and longitude (rad) and height (m).
    """
    return jax.vmap(ecef_from_geodetic)(*positions.T), jnp.stack(jax.vmap(geodetic_from_ecef)(points_e), axis=1)


def _ellipsoid() -> Iterator[Comparison]:
    a, b, e2 = float(WGS84.a), float(WGS84.b), float(WGS84.e2)
    pole_M, pole_N = (float(R) for R in radii_of_curvature(math.pi / 2))
    constants = {
        "semi-minor axis": [b],
        "first eccentricity": [math.sqrt(e2)],
        "first eccentricity squared": [e2],
        "second eccentricity squared": [float(WGS84.ep2)],
        "axis ratio": [b / a],
        "polar radius of curvature": [pole_M, pole_N],
    }
    for name, (printed, unit) in load_published("wgs84")["derived"].items():
        for obtained in constants[name]:
            yield compare_as_printed(name, "ellipsoid", unit, printed, obtained)
    equator_M, equator_N = (float(R) for R in radii_of_curvature(0.0))
    yield _compare_closed_form("radius of curvature", "meridian at the equator, b^2/a", "m", b * b / a, equator_M)
    yield _compare_closed_form("radius of curvature", "prime vertical at the equator, a", "m", a, equator_N)


def _compare_closed_form(group: str, point: str, unit: str, expected: float, obtained: float) -> Comparison:
    """Compare a computed value, in m or rad, with its closed form `expected`; the tolerance is the rounding error."""
    tolerance = _ROUNDING_M / float(WGS84.a) if unit == "rad" else _ROUNDING_M
    return Comparison(group, point, unit, expected, obtained, tolerance, tolerance_reason="closed form; rounding")


def _positions() -> Iterator[Comparison]:
    """Compare conversions between geodetic and Earth-fixed coordinates, in both directions.

    The positions lie on the equator and at the poles (expected: closed form), and at a start of the NESC check-cases.
    """
    a, b = float(WGS84.a), float(WGS84.b)
    quarter = math.pi / 2
    closed = [
        ("equator, 0 deg", (0.0, 0.0, 1000.0), (a + 1000.0, 0.0, 0.0)),
        ("equator, 90 deg W", (0.0, -quarter, 10.0), (0.0, -a - 10.0, 0.0)),
        ("North Pole", (quarter, 0.0, 1000.0), (0.0, 0.0, b + 1000.0)),
        ("South Pole", (-quarter, 0.0, -10.0), (0.0, 0.0, 10.0 - b)),
    ]
    columns = load_published("nesc_checkpoints")["cases"]["11"]["columns"]
    case = {name: column["sim_05"][0] for name, column in columns.items()}
    degrees = (case["latitude_deg"], case["longitude_deg"])
    feet = tuple(case[f"gePosition_ft_{axis}"] for axis in "XYZ")
    case_position = (degrees[0] * DEG_RAD, degrees[1] * DEG_RAD, case["altitudeMsl_ft"] * FOOT_M)
    positions = jnp.array([position for _, position, _ in closed] + [case_position])
    points_e = jnp.array([point for _, _, point in closed] + [[x * FOOT_M for x in feet]])
    forward, back = _convert_both_ways(positions, points_e)
    for k, (label, position, point_e) in enumerate(closed):
        for axis in range(3):
            yield _compare_closed_form(f"ECEF {'xyz'[axis]}", label, "m", point_e[axis], float(forward[k, axis]))
        for axis, (name, unit) in enumerate((("latitude", "rad"), ("longitude", "rad"), ("height", "m"))):
            yield _compare_closed_form(name, label, unit, position[axis], float(back[k, axis]))
    yield from _nesc_position(degrees, case["altitudeMsl_ft"], feet, forward[-1], back[-1])


def _nesc_position(
    degrees: tuple[float, float], height_ft: float, feet: tuple[float, ...], forward: Vector3, back: Vector3
) -> Iterator[Comparison]:
    """Compare a published position given in geodetic and in Earth-fixed coordinates, converted both ways.

    `degrees` are latitude and longitude, `feet` the Earth-fixed coordinates; `forward` (m) and `back` (rad, rad, m) are
    the computed conversions.
    """
    compare = functools.partial(Comparison, point="NESC case 11, start", tolerance_reason="half the last digit of each")
    angles_ft = sum(half_of_significant(angle, _DIGITS) for angle in degrees) * DEG_RAD * float(WGS84.a) / FOOT_M
    for axis, expected, coordinate in zip("xyz", feet, forward, strict=True):
        tolerance, obtained = half_of_significant(expected, _DIGITS) + angles_ft, float(coordinate) / FOOT_M
        yield compare(f"NESC ECEF {axis}", unit="ft", expected=expected, obtained=obtained, tolerance=tolerance)
    point_m = sum(half_of_significant(x, _DIGITS) for x in feet) * FOOT_M
    angle_deg = point_m / (float(WGS84.b) * math.cos(degrees[0] * DEG_RAD)) * RAD_DEG
    for name, expected, angle in zip(("latitude", "longitude"), degrees, back[:2], strict=True):
        tolerance, obtained = half_of_significant(expected, _DIGITS) + angle_deg, float(angle) * RAD_DEG
        yield compare(f"NESC {name}", unit="deg", expected=expected, obtained=obtained, tolerance=tolerance)
    obtained = float(back[2]) / FOOT_M
    yield compare("NESC height", unit="ft", expected=height_ft, obtained=obtained, tolerance=point_m / FOOT_M)


def _gravity() -> Iterator[Comparison]:
    for latitude_deg, printed in load_published("wgs84")["gravity"]:
        figures, reason = (float(printed), float(somigliana(latitude_deg * DEG_RAD))), "half the 9th decimal, GRS 80"
        yield Comparison("gravity", f"{latitude_deg} deg", "m/s^2", *figures, _GRAVITY_M_S2, tolerance_reason=reason)


WGS84_FIGURE = make_check("wgs84", lambda: (*_ellipsoid(), *_positions(), *_gravity()))
