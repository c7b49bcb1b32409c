"""Definitions of the NASA NESC atmospheric check-cases 1 to 13, 15 and 16, in published units.

Source: [NESC] NASA/TM-2015-218675 and the published check-case data. Altitudes are above the ellipsoid or sphere,
velocities relative to the rotating Earth in NED.
"""

from dataclasses import dataclass
from typing import Literal

_UNITS = (
    ("_ft_s2", "ft/s^2"),
    ("_ft_s", "ft/s"),
    ("_ft_min", "ft/min"),
    ("_ftlbf", "ft lbf"),
    ("_lbf_ft2", "lbf/ft^2"),
    ("_lbf", "lbf"),
    ("_slug_ft3", "slug/ft^3"),
    ("_deg_s", "deg/s"),
    ("_dgR", "deg R"),
    ("_nmi_h", "nmi/h"),
    ("_deg", "deg"),
    ("_ft", "ft"),
)
"""Units in the names of the published columns."""


def column_unit(name: str) -> str:
    """Return the unit of a published column; 1 for a pure number."""
    return next((unit for suffix, unit in _UNITS if suffix in name), "1")


EarthName = Literal["wgs84", "sphere", "rotating-sphere"]

EARTH_RATE_DEG_S = 0.00417807413
"""7.292115e-5 rad/s, as logged by the participants."""
SPHERE_RADIUS_M = 6371007.1809
"""Radius of the sphere of cases 4 and 5: the authalic radius."""

_TUMBLING_DEG_S = (10.0, 20.0, 30.0)
_AT_REST = (0.0, 0.0, 0.0)
_FALL_S = (0.0, 0.1, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0)
_CRUISE_S = (0.0, 1.0, 10.0, 30.0, 60.0, 90.0, 120.0, 180.0)


@dataclass(frozen=True)
class FreeFlight:
    """NESC check-case of a body without controls.

    Attributes
    ----------
    number, title
        Number and title of the check-case.
    body
        Name in the library of bodies.
    earth
        Model of the Earth.
    altitude_ft, velocity_ft_s
        Initial altitude at latitude 0, longitude 0, and velocity NED.
    yaw_deg
        Initial heading; pitch and roll are 0.
    rates_deg_s
        Initial inertial body rates.
    wind_east_ft_s
        East velocity of the air at altitudes 0 and 30,000 ft, linear in between.
    times_s
        Times of the listed results.
    """

    number: int
    title: str
    body: str
    earth: EarthName = "wgs84"
    altitude_ft: float = 30_000.0
    velocity_ft_s: tuple[float, float, float] = _AT_REST
    yaw_deg: float = 0.0
    rates_deg_s: tuple[float, float, float] = _AT_REST
    wind_east_ft_s: tuple[float, float] = (0.0, 0.0)
    times_s: tuple[float, ...] = _FALL_S


@dataclass(frozen=True)
class TrimmedFlight:
    """NESC check-case of the F-16 with fixed controls, trimmed with wings level and no sideslip.

    Attributes
    ----------
    number, title
        Number and title of the check-case.
    latitude_deg, longitude_deg, altitude_ft
        Initial geodetic position.
    velocity_ft_s
        Initial velocity NED; the heading is its direction.
    times_s
        Times of the listed results.
    """

    number: int
    title: str
    latitude_deg: float
    longitude_deg: float
    altitude_ft: float
    velocity_ft_s: tuple[float, float, float]
    times_s: tuple[float, ...] = _CRUISE_S


LawName = Literal["F16_control", "F16_gnc"]


@dataclass(frozen=True)
class LawFlight:
    """Check-case of the F-16 under a published control law, starting in trim.

    Attributes
    ----------
    number
        Number of the check-case, 13.1; with a suffix for a case flown in two ways.
    title
        Title of the check-case.
    latitude_deg, longitude_deg, altitude_ft, velocity_ft_s
        Start as in a `TrimmedFlight`; altitude and airspeed are also the law's first commands.
    law
        File of the control law.
    change, change_time_s
        Input of the law, change of its command (kt, ft, deg), and time of the change.
    follows_line
        True: the law's input is the deviation from the ground track through the position at `change_time_s`.
    circles_pole
        True: the law circles the North Pole; False: the date line at the equator. F16_gnc only.
    times_s
        Times of the listed results of a case without checkpoints.
    settled_keas
        Participants and their settled equivalent airspeeds, kt, to two decimals, if no other figures are published.
    """

    number: str
    title: str
    latitude_deg: float
    longitude_deg: float
    altitude_ft: float
    velocity_ft_s: tuple[float, float, float]
    law: LawName
    change: tuple[str, float] = ("altitudeMslCommand", 0.0)
    change_time_s: float = 0.0
    follows_line: bool = False
    circles_pole: bool = False
    times_s: tuple[float, ...] = ()
    settled_keas: tuple[tuple[str, float], ...] = ()


FREE_FLIGHTS: tuple[FreeFlight, ...] = (
    FreeFlight(1, "dropped dragless sphere", "dragless-sphere"),
    FreeFlight(2, "tumbling brick, no damping, no drag", "undamped-brick", rates_deg_s=_TUMBLING_DEG_S),
    FreeFlight(3, "tumbling brick with damping, no drag", "brick", rates_deg_s=_TUMBLING_DEG_S),
    FreeFlight(4, "sphere, round non-rotating Earth", "sphere", earth="sphere", rates_deg_s=_TUMBLING_DEG_S),
    FreeFlight(5, "sphere, round rotating Earth", "sphere", earth="rotating-sphere", rates_deg_s=_TUMBLING_DEG_S),
    FreeFlight(6, "sphere, ellipsoidal Earth", "sphere"),
    FreeFlight(7, "sphere in a steady wind", "sphere", wind_east_ft_s=(20.0, 20.0)),
    FreeFlight(8, "sphere in a wind shear", "sphere", wind_east_ft_s=(-20.0, 70.0)),
    FreeFlight(
        9, "eastward cannonball", "sphere", "wgs84", 0.0, (0.0, 1000.0, -1000.0), 90.0, (0.0, -EARTH_RATE_DEG_S, 0.0)
    ),
    FreeFlight(
        10, "northward cannonball", "sphere", "wgs84", 0.0, (1000.0, 0.0, -1000.0), 0.0, (EARTH_RATE_DEG_S, 0.0, 0.0)
    ),
)

_KITTY_HAWK_DEG = (36.01916667, -75.67444444)

TRIMMED_FLIGHTS: tuple[TrimmedFlight, ...] = (
    TrimmedFlight(11, "subsonic F-16 trim", *_KITTY_HAWK_DEG, 10_013.0, (400.0, 400.0, 0.0)),
    TrimmedFlight(12, "supersonic F-16 trim", *_KITTY_HAWK_DEG, 30_013.0, (1414.2136, 1414.2136, 0.0)),
)

_SUBSONIC = (*_KITTY_HAWK_DEG, 10_013.0, (400.0, 400.0, 0.0))
_MINUTE_S = tuple(5.0 * k for k in range(13))
_THREE_MINUTES_S = tuple(5.0 * k for k in range(37))
_CIRCLING_FT_S = 563.643

LAW_FLIGHTS: tuple[LawFlight, ...] = (
    LawFlight(
        "13.1",
        "F-16, altitude change",
        *_SUBSONIC,
        "F16_control",
        ("altitudeMslCommand", 100.0),
        5.0,
        times_s=_MINUTE_S,
    ),
    LawFlight(
        "13.2-5kt",
        "F-16, airspeed change by -5 KEAS",
        *_SUBSONIC,
        "F16_control",
        ("equivalentAirspeedCommand", -5.0),
        5.0,
        times_s=_MINUTE_S,
        settled_keas=(("sim_04", 282.93), ("sim_05", 282.99)),
    ),
    LawFlight(
        "13.2-10kt",
        "F-16, airspeed change by -10 KEAS",
        *_SUBSONIC,
        "F16_control",
        ("equivalentAirspeedCommand", -10.0),
        5.0,
        times_s=_MINUTE_S,
    ),
    LawFlight(
        "13.3",
        "F-16, heading change",
        *_SUBSONIC,
        "F16_control",
        ("trueBaseCourseCommand", 15.0),
        15.0,
        times_s=_MINUTE_S,
    ),
    LawFlight(
        "13.4",
        "F-16, lateral side-step",
        *_SUBSONIC,
        "F16_control",
        ("lateralDeviationError", -2000.0),
        20.0,
        follows_line=True,
        times_s=_MINUTE_S,
    ),
    LawFlight(
        "15",
        "F-16 circling the North Pole",
        89.95,
        -45.0,
        10_000.0,
        (0.0, _CIRCLING_FT_S, 0.0),
        "F16_gnc",
        circles_pole=True,
        times_s=_THREE_MINUTES_S,
    ),
    LawFlight(
        "16",
        "F-16 circling the date line at the equator",
        0.0,
        -179.95,
        10_000.0,
        (_CIRCLING_FT_S, 0.0, 0.0),
        "F16_gnc",
        times_s=_THREE_MINUTES_S,
    ),
)
