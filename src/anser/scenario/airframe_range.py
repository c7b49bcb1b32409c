"""Where the data of a scenario's aircraft hold: what bounds its airspeed, altitude and angle of attack."""

from dataclasses import dataclass

from anser.scenario.airframe_file import AirframeFile, DaveMlFile, library_file
from anser.scenario.airframe_names import FILES

ALTITUDE_MAX_M = 15240.0  # the end of the F-16's thrust tables (50,000 ft), [SL] appendix A
SPEED_MAX_M_S = 340.0  # those end at Mach 1
_F16_SPEED_MIN_M_S = 30.0
_F16_ALPHA_DEG = (-10.0, 45.0)


@dataclass(frozen=True)
class AirframeRange:
    """Ranges of one airframe; None: nothing known of it before it is built.

    Parameters
    ----------
    name
        Of the airframe.
    airspeed_m_s, altitude_m, alpha_deg
        Least and greatest.
    by_file
        Whether it is an aircraft file, whose ranges the limits of a scenario follow where it gives none.
    """

    name: str
    airspeed_m_s: tuple[float, float] | None
    altitude_m: tuple[float, float] | None
    alpha_deg: tuple[float, float] | None
    by_file: bool


def airframe_range(kind: str, file: AirframeFile | DaveMlFile | None) -> AirframeRange:
    """Ranges of an airframe by its type, or by its file where it has one."""
    if file is None and kind in FILES:
        file = library_file(kind)
    if file is not None:
        valid = file.validity
        return AirframeRange(file.name, valid.airspeed_m_s, valid.altitude_m, valid.alpha_deg, by_file=True)
    if kind == "f16":
        speeds, altitudes = (_F16_SPEED_MIN_M_S, SPEED_MAX_M_S), (0.0, ALTITUDE_MAX_M)
        return AirframeRange(kind, speeds, altitudes, _F16_ALPHA_DEG, by_file=False)
    return AirframeRange(kind, None, None, None, by_file=False)
