"""Exports of a flight to the file formats of other programs.

Module `geographic` writes KML (Google Earth) and CZML (Cesium); `tables` writes CSV, Parquet and MATLAB files, and the
tables of a campaign.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
