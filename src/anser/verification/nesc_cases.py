"""Definitions of the NASA NESC atmospheric check-cases 1 to 13, 15 and 16, in published units.

Source: [NESC] NASA/TM-2015-218675 and the published check-case data. Altitudes are above the ellipsoid or sphere;
velocities are relative to the rotating Earth, in NED axes. The cases are in `data/nesc_cases.toml`.
"""

from dataclasses import dataclass
from typing import Any, Literal, TypeVar

from anser.verification.checks import load_definitions

_UNITS = {
    "_ft_s2": "ft/s^2",
    "_ft_s": "ft/s",
    "_ft_min": "ft/min",
    "_ftlbf": "ft lbf",
    "_lbf_ft2": "lbf/ft^2",
    "_lbf": "lbf",
    "_slug_ft3": "slug/ft^3",
    "_deg_s": "deg/s",
    "_dgR": "deg R",
    "_nmi_h": "nmi/h",
    "_deg": "deg",
    "_ft": "ft",
}
"""Units by the suffix in the names of the published columns; the first match counts."""


def column_unit(name: str) -> str:
    """Return the unit of a published column; "1" for a pure number."""
    return next((unit for suffix, unit in _UNITS.items() if suffix in name), "1")


EarthName = Literal["wgs84", "sphere", "rotating-sphere"]
LawName = Literal["F16_control", "F16_gnc"]
SPHERE_RADIUS_M = 6371007.1809
"""Radius of the spherical Earth of cases 4 and 5, m: the authalic radius."""
_AT_REST = (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class FreeFlight:
    """NESC check-case of a body without controls, which starts at latitude 0, longitude 0.

    Attributes
    ----------
    body, earth
        Name in the library of bodies, and model of the Earth.
    altitude_ft, velocity_ft_s
        Initial altitude (ft), and velocity relative to the Earth (NED, ft/s).
    yaw_deg, rates_deg_s
        Initial heading (deg; pitch and roll are 0), and inertial body rates (deg/s).
    wind_east_ft_s
        East velocity of the air (ft/s) at altitudes 0 and 30,000 ft, linear in between.
    times_s
        Times of the listed results, s.
    """

    number: int
    title: str
    note: str = ""
    body: str
    earth: EarthName = "wgs84"
    altitude_ft: float = 30_000.0
    velocity_ft_s: tuple[float, float, float] = _AT_REST
    yaw_deg: float = 0.0
    rates_deg_s: tuple[float, float, float] = _AT_REST
    wind_east_ft_s: tuple[float, float] = (0.0, 0.0)
    times_s: tuple[float, ...] = (0.0, 0.1, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0)


@dataclass(frozen=True, kw_only=True)
class TrimmedStart:
    """NESC check-case of the F-16 that starts trimmed with wings level and no sideslip.

    Attributes
    ----------
    number
        Number of the check-case; with a suffix for a case flown in two ways.
    latitude_deg, longitude_deg, altitude_ft
        Initial geodetic position.
    velocity_ft_s
        Initial velocity relative to the Earth, NED, ft/s; the heading is its direction.
    times_s
        Times of the listed results, s.
    """

    number: int | str
    title: str
    note: str = ""
    latitude_deg: float
    longitude_deg: float
    altitude_ft: float
    velocity_ft_s: tuple[float, float, float]
    times_s: tuple[float, ...] = (0.0, 1.0, 10.0, 30.0, 60.0, 90.0, 120.0, 180.0)


@dataclass(frozen=True, kw_only=True)
class TrimmedFlight(TrimmedStart):
    """NESC check-case of the F-16 with the controls fixed at their trim values."""


@dataclass(frozen=True, kw_only=True)
class LawFlight(TrimmedStart):
    """Check-case of the F-16 under a published control law; the first commands are altitude and airspeed of the start.

    Attributes
    ----------
    law
        Name of the control law's DAVE-ML file.
    change, change_time_s
        Step of one command: name of the law's input and increment (kt, ft, deg); time of the step, s.
    follows_line
        True: the law gets the lateral deviation from the straight ground track through the position at `change_time_s`.
    circles_pole
        True: the law F16_gnc circles the North Pole. False: the law circles the point where date line and equator meet.
    settled_keas
        Settled equivalent airspeeds (kt, to two decimals) by simulation, if nothing else is published.
    """

    law: LawName
    change: tuple[str, float] = ("altitudeMslCommand", 0.0)
    change_time_s: float = 0.0
    follows_line: bool = False
    circles_pole: bool = False
    settled_keas: tuple[tuple[str, float], ...] = ()


_Case = TypeVar("_Case", FreeFlight, TrimmedFlight, LawFlight)


def _load_cases(case_class: type[_Case], key: str) -> tuple[_Case, ...]:
    return tuple(case_class(**_case_fields(case)) for case in load_definitions("nesc_cases")[key])


def _case_fields(case: dict[str, Any]) -> dict[str, Any]:
    """Return the fields of a case from its TOML table; the key `log_s` stands for times every 5 s until `log_s`."""
    fields = {key: _to_tuple(value) for key, value in case.items()}
    if "log_s" in fields:
        fields["times_s"] = tuple(5.0 * k for k in range(round(fields.pop("log_s") / 5.0) + 1))
    return fields


def _to_tuple(value: Any) -> Any:
    return tuple(map(_to_tuple, value)) if isinstance(value, list) else value


FREE_FLIGHTS = _load_cases(FreeFlight, "free")
TRIMMED_FLIGHTS = _load_cases(TrimmedFlight, "trimmed")
LAW_FLIGHTS = _load_cases(LawFlight, "law")
