"""Contrast of the pages in the light and the dark scheme, by WCAG 2.2 AA."""

import io
import re

import pytest

from anser.report.page_templates import read_asset
from anser.report.style import COLORS, DARK_COLORS, PRINT_STYLE, figure_content, new_figure

BACKGROUNDS = ("paper", "panel", "chosen", "pressed")
TEXTS = [
    *((ink, ground) for ink in ("ink", "quiet") for ground in BACKGROUNDS),
    *(("good-ink", "good-ground"), ("bad-ink", "bad-ground"), ("mixed-ink", "chosen")),
    *((ink, "paper") for ink in ("good-ink", "bad-ink", "near-ink", "limit")),
    *(("ink", ground) for ground in ("good-ground", "bad-ground")),
]


def style_colors():
    """Colour variables of the style sheet, in light and in dark."""
    matches = re.findall(r"--([\w-]+): light-dark\((#\w{6}), (#\w{6})\)", read_asset("page.css"))
    return {name: pair for name, *pair in matches}


def luminance(color):
    parts = [int(color[k : k + 2], 16) / 255.0 for k in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(first_color, second_color):
    low, high = sorted((luminance(first_color), luminance(second_color)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("mode", [0, 1], ids=["light", "dark"])
def test_text_has_enough_contrast(mode):
    colors = style_colors()
    ratios = {pair: contrast(*(colors[name][mode] for name in pair)) for pair in TEXTS}
    assert {pair: ratio for pair, ratio in ratios.items() if ratio < 4.5} == {}


def test_aircraft_colours_have_enough_contrast_in_the_dark():
    paper = style_colors()["paper"][1]
    assert len(DARK_COLORS) == len(COLORS)
    assert {color for color in DARK_COLORS if contrast(color, paper) < 3.0} == set()


@pytest.mark.parametrize("suffix", [".svg", ".png", ".pdf"])
def test_a_figure_content_is_the_file_of_savefig(suffix):
    matplotlib, figure = new_figure((3.0, 2.0))
    with matplotlib.rc_context(PRINT_STYLE):
        axes = figure.subplots()
        axes.plot([0.0, 1.0, 2.0], [0.0, 40.0, 20.0], label="altitude")
        axes.set(xlabel="time, s", ylabel="altitude, m", title="a title")
        axes.legend()
        canvas, dpi = figure.canvas, figure.dpi
        content = figure_content(figure, suffix, dpi=160)
        assert (figure.canvas, figure.dpi) == (canvas, dpi)
        saved = io.BytesIO()
        names = {".svg": ["Date"], ".png": ["Software"], ".pdf": ["CreationDate", "Producer", "Creator"]}
        figure.savefig(saved, format=suffix[1:], dpi=160, metadata=dict.fromkeys(names[suffix]))
    assert content == saved.getvalue()
