"""What is written on the pages can be read, in light and in dark: contrast as WCAG 2.2 AA asks."""

import re

import pytest

from anser.report.page_frame import read_asset
from anser.report.style import COLORS, DARK_COLORS

GROUNDS = ("paper", "panel", "chosen", "pressed")
TEXTS = [
    *((ink, ground) for ink in ("ink", "quiet") for ground in GROUNDS),
    *(("good-ink", "good-ground"), ("bad-ink", "bad-ground"), ("mixed-ink", "chosen")),
    *((ink, "paper") for ink in ("good-ink", "bad-ink", "near-ink", "limit")),
    *(("ink", ground) for ground in ("good-ground", "bad-ground")),
]


def inks():
    """Variables of the style sheet, in light and in dark."""
    found = re.findall(r"--([\w-]+): light-dark\((#\w{6}), (#\w{6})\)", read_asset("page.css"))
    return {name: pair for name, *pair in found}


def luminance(color):
    parts = [int(color[k : k + 2], 16) / 255.0 for k in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one, other):
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("mode", [0, 1], ids=["light", "dark"])
def test_text_stands_out_from_its_ground(mode):
    known = inks()
    weak = {pair: contrast(*(known[name][mode] for name in pair)) for pair in TEXTS}
    assert {pair: found for pair, found in weak.items() if found < 4.5} == {}


def test_colours_of_aircraft_stand_out_in_the_dark():
    paper = inks()["paper"][1]
    assert len(DARK_COLORS) == len(COLORS)
    assert {color for color in DARK_COLORS if contrast(color, paper) < 3.0} == set()
