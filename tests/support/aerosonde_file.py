"""The Aerosonde's file, changed as a test says."""

import tomllib
from importlib import resources

from anser.aircraft_files import build_airframe
from anser.aircraft_files.sources import validate_airframe

AEROSONDE = resources.files("anser.aircraft").joinpath("data/aerosonde.toml").read_text(encoding="utf-8")
TABLE = """
[[table]]
replaces = "Cm"
over = ["alpha", "elevator"]
breakpoints_deg = [[-10, 0, 10, 30], [-30, 0, 30]]
values = [[1, 0.5, 0], [0.5, 0, -0.5], [0, -0.5, -1], [-1, -1.5, -2]]
"""


def changed(*pairs, text=AEROSONDE):
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new, 1)
    return tomllib.loads(text)


def built(*pairs, text=AEROSONDE):
    return build_airframe(validate_airframe(changed(*pairs, text=text), "test"))
