"""The WGS-84 ellipsoid, places on it and its gravity against published figures."""

import math
from collections.abc import Iterator

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.environment import somigliana
from anser.shapes import Vector3
from anser.spatial import WGS84, ecef_from_geodetic, geodetic_from_ecef, radii_of_curvature
from anser.units import DEG_RAD, FOOT_M, RAD_DEG
from anser.verification.check import Check, Comparison
from anser.verification.published import as_printed, half_of_significant, published

_ROUNDING_M = 1e-8
"""Some ten units in the last place of 6.4e6 m."""
_GRAVITY_M_S2 = 1e-9
"""Half a unit of the ninth decimal, with which gravity at 45 deg is printed, and 1e-10 by which the formulas differ."""
_NESC_WHY = "half the last digit of each"
_DIGITS = 10
"""Significant digits of the check-case data."""


@jax.jit
def _there_and_back(
    places: Float[Array, "place 3"], points_e: Float[Array, "place 3"]
) -> tuple[Float[Array, "place 3"], Float[Array, "place 3"]]:
    """Earth-fixed points of geodetic places, and geodetic places of Earth-fixed points."""
    return jax.vmap(ecef_from_geodetic)(*places.T), jnp.stack(jax.vmap(geodetic_from_ecef)(points_e), axis=1)


def _measure() -> tuple[Comparison, ...]:
    return (*_ellipsoid(), *_places(), *_gravity())


def _ellipsoid() -> Iterator[Comparison]:
    a, b, e2 = float(WGS84.a), float(WGS84.b), float(WGS84.e2)
    pole_M, pole_N = (float(R) for R in radii_of_curvature(math.pi / 2))
    found = {
        "semi-minor axis": [b],
        "first eccentricity": [math.sqrt(e2)],
        "first eccentricity squared": [e2],
        "second eccentricity squared": [float(WGS84.ep2)],
        "axis ratio": [b / a],
        "polar radius of curvature": [pole_M, pole_N],
    }
    for name, (printed, unit) in published("wgs84")["derived"].items():
        for obtained in found[name]:
            yield as_printed(name, "ellipsoid", unit, printed, obtained)
    equator_M, equator_N = (float(R) for R in radii_of_curvature(0.0))
    yield _closed("radius of curvature", "meridian at the equator, b^2/a", "m", b * b / a, equator_M)
    yield _closed("radius of curvature", "prime vertical at the equator, a", "m", a, equator_N)


def _closed(group: str, where: str, unit: str, expected: float, obtained: float) -> Comparison:
    """Compare with a closed form: nothing but rounding may differ."""
    tolerance = _ROUNDING_M / float(WGS84.a) if unit == "rad" else _ROUNDING_M
    return Comparison(group, where, unit, expected, obtained, tolerance, why="closed form; rounding")


def _places() -> Iterator[Comparison]:
    """Equator and pole in closed form, both ways, and a place of the NESC check-cases."""
    a, b = float(WGS84.a), float(WGS84.b)
    quarter = math.pi / 2
    closed = [
        ("equator, 0 deg", (0.0, 0.0, 1000.0), (a + 1000.0, 0.0, 0.0)),
        ("equator, 90 deg W", (0.0, -quarter, 10.0), (0.0, -a - 10.0, 0.0)),
        ("North Pole", (quarter, 0.0, 1000.0), (0.0, 0.0, b + 1000.0)),
        ("South Pole", (-quarter, 0.0, -10.0), (0.0, 0.0, 10.0 - b)),
    ]
    columns = published("nesc_checkpoints")["cases"]["11"]["columns"]
    case = {name: column["sim_05"][0] for name, column in columns.items()}
    degrees = (case["latitude_deg"], case["longitude_deg"])
    feet = tuple(case[f"gePosition_ft_{axis}"] for axis in "XYZ")
    given = (degrees[0] * DEG_RAD, degrees[1] * DEG_RAD, case["altitudeMsl_ft"] * FOOT_M)
    places = jnp.array([place for _, place, _ in closed] + [given])
    points_e = jnp.array([point for _, _, point in closed] + [[x * FOOT_M for x in feet]])
    forward, back = _there_and_back(places, points_e)
    for k, (where, place, point_e) in enumerate(closed):
        for axis in range(3):
            yield _closed(f"ECEF {'xyz'[axis]}", where, "m", point_e[axis], float(forward[k, axis]))
        for axis, (name, unit) in enumerate((("latitude", "rad"), ("longitude", "rad"), ("height", "m"))):
            yield _closed(name, where, unit, place[axis], float(back[k, axis]))
    yield from _nesc_place(degrees, case["altitudeMsl_ft"], feet, forward[-1], back[-1])


def _nesc_place(
    degrees: tuple[float, float], height_ft: float, feet: tuple[float, ...], forward: Vector3, back: Vector3
) -> Iterator[Comparison]:
    """The same place in both coordinates: each is known as exactly as the other is printed."""
    where = "NESC case 11, start"
    angles_ft = sum(half_of_significant(angle, _DIGITS) for angle in degrees) * DEG_RAD * float(WGS84.a) / FOOT_M
    for axis, expected in zip("xyz", feet, strict=True):
        obtained = float(forward["xyz".index(axis)]) / FOOT_M
        tolerance = half_of_significant(expected, _DIGITS) + angles_ft
        yield Comparison(f"NESC ECEF {axis}", where, "ft", expected, obtained, tolerance, why=_NESC_WHY)
    point_m = sum(half_of_significant(x, _DIGITS) for x in feet) * FOOT_M
    radius = float(WGS84.b) * math.cos(degrees[0] * DEG_RAD)
    for name, expected, angle in zip(("latitude", "longitude"), degrees, back[:2], strict=True):
        tolerance = half_of_significant(expected, _DIGITS) + point_m / radius * RAD_DEG
        yield Comparison(f"NESC {name}", where, "deg", expected, float(angle) * RAD_DEG, tolerance, why=_NESC_WHY)
    yield Comparison("NESC height", where, "ft", height_ft, float(back[2]) / FOOT_M, point_m / FOOT_M, why=_NESC_WHY)


def _gravity() -> Iterator[Comparison]:
    for latitude_deg, printed in published("wgs84")["gravity"]:
        obtained = float(somigliana(latitude_deg * DEG_RAD))
        where, why = f"{latitude_deg} deg", "half the 9th decimal, GRS 80"
        yield Comparison("gravity", where, "m/s^2", float(printed), obtained, _GRAVITY_M_S2, why=why)


WGS84_FIGURE = Check(
    key="wgs84",
    title="WGS-84: ellipsoid, geodetic and Earth-fixed coordinates, gravity",
    source="[WGS84] tab. 3.3; Moritz 2000",
    why="half the last digit",
    explanation=(
        "The derived constants as printed in TR8350.2. Equator and poles in closed form, both ways, to 1e-8 m, some "
        "ten units in the last place of the Earth's radius; the start of NESC case 11 as participant 05 logs it, to "
        "the digits of its angles and feet. Normal gravity by Somigliana's formula with the coefficients of the first "
        "WGS 84; the figures are those of GRS 80, from which it was taken: 1e-10 m/s^2 apart at the equator, and "
        "printed to nine decimals at 45 deg, hence 1e-9 m/s^2. The later WGS 84 has 1.4e-6 m/s^2 less everywhere."
    ),
    measure=_measure,
)
