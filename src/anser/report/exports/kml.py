"""Export to KML with Google's tracks: positions and attitudes over time, for Google Earth."""

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
_TRACK_VARIABLES = ("airspeed_m_s", "roll_deg", "pitch_deg", "yaw_deg")
"""Variables attached to each aircraft track; Google Earth plots them with the elevation profile."""
_SCHEMA = "state"
_NOT_IN_XML = re.compile(r"[^\t\n\r\x20-\uD7FF\uE000-\uFFFD\U00010000-\U0010FFFF]")
"""Characters that XML 1.0 cannot contain, not even escaped."""


def to_kml(dataset: xr.Dataset, summary: Mapping[str, Any], start: datetime) -> bytes:
    """Return a flight as a KML 2.2 file with `gx:Track`: folders of aircraft, rendezvous and goals.

    Heights are absolute. `gx:angles` are heading, tilt and roll as KML defines them, each clockwise about its axis seen
    from the tip of the axis: tilt and roll are minus the flight's pitch and roll. The file refers to no external model
    or image.

    Parameters
    ----------
    dataset, summary
        A flight: the contents of `flight.nc` and `summary.json`.
    start
        Date and time of the flight's time 0.
    """
    root = ET.Element("kml", {"xmlns": _KML, "xmlns:gx": _GX})
    document = _child(root, "Document")
    _child(document, "name", str(summary["scenario"]["name"]))
    # Google Earth renders the description as HTML after the XML escaping is decoded: it needs HTML escaping too
    _child(document, "description", html.escape(str(dataset.attrs.get("description", ""))))
    fleet = summary["aircraft"]
    for index in range(len(fleet)):
        _style(document, f"aircraft-{index}", color_of(index), 1.0, 3.0)
        _style(document, f"rendezvous-{index}", color_of(index), 0.6, 1.0)
    _style(document, "goal", "#1b1f24", 0.8, 1.0)
    schema = _child(document, "Schema", id=_SCHEMA)
    for name in _TRACK_VARIABLES:
        field = _child(schema, "gx:SimpleArrayField", name=name, type="float")
        unit = printed_unit(str(dataset[name].attrs["units"]))
        _child(field, "displayName", f"{dataset[name].attrs['long_name']} ({unit})")

    folder = _folder(document, "Aircraft")
    for index, aircraft in enumerate(fleet):
        track = aircraft_track(dataset, index)
        placemark = _placemark(
            folder, track, f"aircraft-{index}", start, f"goal {aircraft['goal']}; {aircraft['status']}"
        )
        if placemark is not None:
            yaw, pitch, roll = (
                dataset[name].values[track.sample_index, index] for name in ("yaw_deg", "pitch_deg", "roll_deg")
            )
            for heading, tilt, turn in zip(np.mod(yaw, 360.0), -pitch, -roll, strict=True):
                _child(placemark, "gx:angles", f"{heading:.5f} {tilt:.5f} {turn:.5f}")
            _arrays(placemark, dataset, index, track)
    folder = _folder(document, "Rendezvous")
    for index in range(len(fleet)):
        _placemark(folder, rendezvous_track(dataset, summary, index), f"rendezvous-{index}", start, "")
    folder = _folder(document, "Goals")
    for track in goal_tracks(dataset, summary):
        _placemark(folder, track, "goal", start, "")
    ET.indent(root, " ")
    return ET.tostring(root, encoding="utf-8", xml_declaration=True)


def _placemark(parent: ET.Element, track: Track, style: str, start: datetime, description: str) -> ET.Element | None:
    """Add a placemark with a track; return the XML element of the track, or None if no position is finite."""
    if not track.sample_index.size:
        return None
    mark = _child(parent, "Placemark")
    _child(mark, "name", track.name)
    if description:
        _child(mark, "description", html.escape(description))
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
    for name in _TRACK_VARIABLES:
        array = _child(data, "gx:SimpleArrayData", name=name)
        for value in dataset[name].values[track.sample_index, index]:
            _child(array, "gx:value", f"{value:.5f}")


def _style(parent: ET.Element, style_id: str, color: str, scale: float, width: float) -> None:
    red, green, blue = (color[k : k + 2] for k in (1, 3, 5))
    kml_color = f"ff{blue}{green}{red}".lower()  # alpha, blue, green, red
    style = _child(parent, "Style", id=style_id)
    for element, field, size in (("Icon", "scale", scale), ("Label", "scale", 0.8), ("Line", "width", width)):
        part = _child(style, f"{element}Style")
        _child(part, "color", kml_color)
        _child(part, field, f"{size:g}")


def _folder(parent: ET.Element, name: str) -> ET.Element:
    folder = _child(parent, "Folder")
    _child(folder, "name", name)
    return folder


def _child(parent: ET.Element, tag: str, text: str | None = None, **attributes: str) -> ET.Element:
    child = ET.SubElement(parent, tag, attributes)
    child.text = text if text is None else _NOT_IN_XML.sub("\N{REPLACEMENT CHARACTER}", text)
    return child
