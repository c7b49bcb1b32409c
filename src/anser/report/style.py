"""Colours that the colour-blind can tell apart, for every figure and page."""

COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#595959")
"""Okabe and Ito (2008), without the yellow, which white paper swallows, and with a dark grey for the black of text."""


def color_of(index: int) -> str:
    """Colour of an aircraft, by its place in the fleet; a large fleet uses each again."""
    return COLORS[index % len(COLORS)]
