"""KML with Google's tracks: what moves, with its time and attitude, for Google Earth."""

import html
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from datetime import datetime
from typing import Any

import numpy as np
import xarray as xr

from anser.report.exports.geography import Track, aircraft_track, goal_tracks, iso_timestamp, rendezvous_track
from anser.report.labels import printed_unit
from anser.report.style import color_of

_KML, _GX = "http://www.opengis.net/kml/2.2", "http://www.google.com/kml/ext/2.2"
_ARRAYS = ("airspeed_m_s", "roll_deg", "pitch_deg", "yaw_deg")
"""Variables that every track carries beside its place: Google Earth draws them with its profile."""
_SCHEMA = "state"
_UNPRINTABLE = re.compile(r"[^\t\n\r\x20-\uD7FF\uE000-\uFFFD\U00010000-\U0010FFFF]")
"""What XML 1.0 cannot hold, however it is written."""


def to_kml(dataset: xr.Dataset, summary: Mapping[str, Any], start: datetime) -> bytes:
    """Write a flight as KML 2.2 with `gx:Track`: folders of aircraft, of their rendezvous, of goals.

    Heights are written as absolute. `gx:angles` are heading, tilt and roll as KML counts them, each clockwise about its
    axis seen from the axis' tip: tilt and roll are minus pitch and minus roll of the flight. No model and no picture is
    referred to. Arguments as of `to_czml`.
    """
    root = ET.Element("kml", {"xmlns": _KML, "xmlns:gx": _GX})
    document = _child(root, "Document")
    _child(document, "name", str(summary["scenario"]["name"]))
    # Google Earth shows a description as HTML, out of which XML's own escaping has been taken by then.
    _child(document, "description", html.escape(str(dataset.attrs.get("description", ""))))
    rows = summary["aircraft"]
    for index in range(len(rows)):
        _style(document, f"aircraft-{index}", color_of(index), 1.0, 3.0)
        _style(document, f"rendezvous-{index}", color_of(index), 0.6, 1.0)
    _style(document, "goal", "#1b1f24", 0.8, 1.0)
    schema = _child(document, "Schema", id=_SCHEMA)
    for name in _ARRAYS:
        field = _child(schema, "gx:SimpleArrayField", name=name, type="float")
        unit = printed_unit(str(dataset[name].attrs["units"]))
        _child(field, "displayName", f"{dataset[name].attrs['long_name']} ({unit})")

    folder = _folder(document, "Aircraft")
    for index, row in enumerate(rows):
        track = aircraft_track(dataset, index)
        place = _placemark(folder, track, f"aircraft-{index}", start, f"goal {row['goal']}; {row['status']}")
        if place is not None:
            yaw, pitch, roll = (
                dataset[name].values[track.sample_index, index] for name in ("yaw_deg", "pitch_deg", "roll_deg")
            )
            for heading, tilt, turn in zip(np.mod(yaw, 360.0), -pitch, -roll, strict=True):
                _child(place, "gx:angles", f"{heading:.5f} {tilt:.5f} {turn:.5f}")
            _arrays(place, dataset, index, track)
    folder = _folder(document, "Rendezvous")
    for index in range(len(rows)):
        _placemark(folder, rendezvous_track(dataset, summary, index), f"rendezvous-{index}", start, "")
    folder = _folder(document, "Goals")
    for track in goal_tracks(dataset, summary):
        _placemark(folder, track, "goal", start, "")
    ET.indent(root, " ")
    return ET.tostring(root, encoding="utf-8", xml_declaration=True)


def _placemark(parent: ET.Element, track: Track, style: str, start: datetime, words: str) -> ET.Element | None:
    """Add a placemark with a track of times and places; returns the track's element, None where nothing is finite."""
    if not track.sample_index.size:
        return None
    mark = _child(parent, "Placemark")
    _child(mark, "name", track.name)
    if words:
        _child(mark, "description", html.escape(words))
    _child(mark, "styleUrl", f"#{style}")
    element = _child(mark, "gx:Track")
    _child(element, "altitudeMode", "absolute")
    for time in track.time_s:
        _child(element, "when", iso_timestamp(start, time))
    for longitude, latitude, height in zip(track.longitude_deg, track.latitude_deg, track.height_m, strict=True):
        _child(element, "gx:coord", f"{longitude:.9f} {latitude:.9f} {height:.4f}")
    return element


def _arrays(element: ET.Element, dataset: xr.Dataset, index: int, track: Track) -> None:
    data = _child(_child(element, "ExtendedData"), "SchemaData", schemaUrl=f"#{_SCHEMA}")
    for name in _ARRAYS:
        array = _child(data, "gx:SimpleArrayData", name=name)
        for value in dataset[name].values[track.sample_index, index]:
            _child(array, "gx:value", f"{value:.5f}")


def _style(parent: ET.Element, key: str, color: str, scale: float, width: float) -> None:
    red, green, blue = (color[k : k + 2] for k in (1, 3, 5))
    turned = f"ff{blue}{green}{red}".lower()  # KML's colours are alpha, blue, green, red
    style = _child(parent, "Style", id=key)
    for of, field, size in (("Icon", "scale", scale), ("Label", "scale", 0.8), ("Line", "width", width)):
        part = _child(style, f"{of}Style")
        _child(part, "color", turned)
        _child(part, field, f"{size:g}")


def _folder(parent: ET.Element, name: str) -> ET.Element:
    folder = _child(parent, "Folder")
    _child(folder, "name", name)
    return folder


def _child(parent: ET.Element, tag: str, text: str | None = None, **attributes: str) -> ET.Element:
    child = ET.SubElement(parent, tag, attributes)
    child.text = text if text is None else _UNPRINTABLE.sub("\N{REPLACEMENT CHARACTER}", text)
    return child
