"""How a report looks: colours that the colour-blind can tell apart, the layout of figures, the style sheet."""

from typing import Any

__all__ = ["CONFIG", "LAYOUT", "SCRIPT", "STYLE_SHEET", "color_of"]

# Okabe and Ito (2008), without the yellow, which white paper swallows, and with a dark grey for the black of the text.
_COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#595959")

_INK, _QUIET, _GRID, _LINE = "#1b1f24", "#57606a", "#e6e9ed", "#c8ced6"
_FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"

_AXIS = {
    "showline": True,
    "linecolor": _LINE,
    "gridcolor": _GRID,
    "zeroline": False,
    "ticks": "outside",
    "tickcolor": _LINE,
    "tickformat": ",~r",
    "title": {"font": {"size": 13}},
    "ticklen": 4,
    "automargin": True,
}

LAYOUT: dict[str, Any] = {
    "template": "none",
    "font": {"family": _FONT, "size": 13, "color": _INK},
    "paper_bgcolor": "white",
    "plot_bgcolor": "white",
    "showlegend": False,
    "hoverlabel": {"font": {"family": _FONT, "size": 12}, "namelength": -1},
    "margin": {"l": 56, "r": 14, "t": 34, "b": 44},
    "xaxis": _AXIS,
    "yaxis": _AXIS,
}
"""Layout of every figure; `xaxis` and `yaxis` hold for all axes of a figure."""

CONFIG: dict[str, Any] = {
    "displaylogo": False,
    "responsive": True,
    "scrollZoom": False,
    "modeBarButtons": [["toImage", "zoom2d", "pan2d", "resetScale2d"]],
}
"""Behaviour of every figure; nothing leaves the page."""


def color_of(index: int) -> str:
    """Colour of an aircraft, by its place in the fleet; a large fleet uses each again."""
    return _COLORS[index % len(_COLORS)]


STYLE_SHEET = f"""
:root {{ color-scheme: light; }}
* {{ box-sizing: border-box; }}
body {{ margin: 0; background: white; color: {_INK}; font: 15px/1.5 {_FONT}; }}
main {{ max-width: 1360px; margin: 0 auto; padding: 28px 28px 64px; }}
h1 {{ font-size: 28px; line-height: 1.2; margin: 0 0 6px; letter-spacing: -0.01em; overflow-wrap: anywhere; }}
h2 {{ font-size: 18px; margin: 34px 0 6px; }}
.about {{ color: {_QUIET}; font-size: 13px; margin: 0; overflow-wrap: anywhere; }}
.about span {{ white-space: nowrap; margin-right: 16px; }}
.about code {{ font-size: 12px; }}
.verdict {{ display: inline-block; margin: 16px 0 0; padding: 5px 12px; border-radius: 6px; font-weight: 600; }}
.verdict.good {{ background: #e3f3ec; color: #00563e; }}
.verdict.bad {{ background: #fdeadd; color: #8a3b00; }}
.scroll {{ overflow: auto; max-height: 480px; margin-top: 8px; border: 1px solid {_GRID}; border-radius: 8px; }}
table {{ border-collapse: collapse; width: 100%; font-size: 13.5px; font-variant-numeric: tabular-nums; }}
th, td {{ padding: 7px 10px; text-align: right; border-bottom: 1px solid {_GRID}; }}
th {{ position: sticky; top: 0; background: #f6f8fa; font-weight: 600; color: {_QUIET}; vertical-align: bottom; }}
th small {{ display: block; font-weight: 400; }}
tr:last-child td {{ border-bottom: 0; }}
td.text, th.text {{ text-align: left; }}
td.name {{ font-weight: 600; white-space: nowrap; }}
.swatch {{ display: inline-block; width: 11px; height: 11px; border-radius: 3px; margin-right: 8px; }}
.good-text {{ color: #00664a; }} .bad-text {{ color: #a34300; font-weight: 600; }}
.narrow {{ max-width: 620px; }}
.selector {{ position: sticky; top: 0; z-index: 5; display: flex; flex-wrap: wrap; gap: 6px 8px; align-items: center;
  margin: 26px -28px 0; padding: 9px 28px; background: rgba(255, 255, 255, 0.95); border-bottom: 1px solid {_GRID};
  max-height: 30vh; overflow: auto; }}
.selector label, .selector button {{ font: inherit; font-size: 13.5px; border: 1px solid {_LINE}; border-radius: 999px;
  padding: 3px 12px 3px 9px; background: white; color: {_INK}; cursor: pointer; display: inline-flex;
  align-items: center; }}
.selector button {{ padding: 3px 12px; color: {_QUIET}; }}
.selector label:has(input:not(:checked)) {{ opacity: 0.45; }}
.selector label:has(input:focus-visible), .selector button:focus-visible {{ outline: 2px solid {_COLORS[0]}; }}
.selector input {{ position: absolute; opacity: 0; }}
.caption {{ color: {_QUIET}; font-size: 13px; margin: 0 0 4px; }}
.columns {{ display: grid; grid-template-columns: minmax(0, 11fr) minmax(0, 9fr); gap: 0 20px; }}
@media (max-width: 980px) {{ .columns {{ grid-template-columns: minmax(0, 1fr); }} }}
@media print {{ .selector {{ display: none; }} .scroll {{ max-height: none; }} }}
"""

SCRIPT = """
(function () {
  const boxes = Array.from(document.querySelectorAll("input[data-aircraft]"));
  function show(changed) {
    const shown = new Map(changed.map((box) => [box.dataset.aircraft, box.checked]));
    document.querySelectorAll(".js-plotly-plot").forEach((plot) => {
      [true, false].forEach((state) => {
        const hit = plot.data.flatMap((trace, i) => (shown.get(trace.legendgroup) === state ? [i] : []));
        if (hit.length) Plotly.restyle(plot, { visible: state }, hit);
      });
    });
  }
  boxes.forEach((box) => box.addEventListener("change", () => show([box])));
  document.querySelectorAll("button[data-all]").forEach((button) =>
    button.addEventListener("click", () => {
      boxes.forEach((box) => { box.checked = button.dataset.all === "1"; });
      show(boxes);
    })
  );
})();
"""
