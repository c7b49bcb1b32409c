from .build import build_airframe
from .library import load_airframe, load_body, load_f16
from .schema import AirframeFile
from .sources import AIRFRAMES, read_airframe

__all__ = [
    "AIRFRAMES",
    "AirframeFile",
    "build_airframe",
    "load_airframe",
    "load_body",
    "load_f16",
    "read_airframe",
]
