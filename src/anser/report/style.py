"""Colours that the colour-blind can tell apart, for every figure and page."""

COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#595959")
"""Okabe and Ito (2008), without the yellow, which white paper swallows, and with a dark grey for the black of text."""

DARK_COLORS = ("#3D97E0", "#F0772B", "#1FBF90", "#DE93BC", "#EFB530", "#9AD6F7", "#AEB6BF")
"""The same hues on a dark ground: each at least 3 to 1 against it, as WCAG 2.2 (1.4.11) asks of graphics."""


def color_of(index: int) -> str:
    """Colour of an aircraft, by its place in the fleet; a large fleet uses each again."""
    return COLORS[index % len(COLORS)]


def page_color_of(index: int) -> str:
    """Colour of an aircraft on a page, for CSS and SVG: the page has it in light and in dark."""
    return f"var(--c{index % len(COLORS)})"


def page_colors() -> str:
    """Rule of the style sheet that defines what `page_color_of` names."""
    pairs = zip(COLORS, DARK_COLORS, strict=True)
    return ":root { " + " ".join(f"--c{k}: light-dark({one}, {dark});" for k, (one, dark) in enumerate(pairs)) + " }"
