from .build import build_airframe
from .library import load_airframe, load_body, load_f16
from .schema import AirframeFile, DaveMlFile
from .sources import AIRFRAMES, VARIANTS, read_airframe

__all__ = [
    "AIRFRAMES",
    "VARIANTS",
    "AirframeFile",
    "DaveMlFile",
    "build_airframe",
    "load_airframe",
    "load_body",
    "load_f16",
    "read_airframe",
]
