"""Verification page: a Markdown file with plots of the errors, made from the output of `anser verify --json`.

`python docs/verification_page.py DOCUMENT.json FOLDER` writes FOLDER/verification.md and a plot of each check
with a time history into FOLDER/verification/, replacing earlier files.
"""

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from anser.files import MIB, read_file, staged_folder, write_file
from anser.report.style import COLORS, new_figure, save_figure

_PANELS = (
    ("Place", ("altitudeMsl", "latitude", "longitude", "eiPosition", "gePosition")),
    ("Velocity", ("feVelocity", "eiVelocity", "altitudeRate", "trueAirspeed")),
    ("Attitude", ("eulerAngle",)),
    ("Body rates", ("bodyAngularRate",)),
    ("Forces and moments", ("aero_",)),
    ("Air and gravity", ("",)),
)
"""Panels of a plot, each with the prefixes of the names of its quantities; the last takes all remaining quantities."""

_COLORS = (*COLORS[:6], "#000000", "#7f7f7f")
_STYLE = {"svg.fonttype": "none", "font.size": 8, "axes.grid": True, "grid.alpha": 0.3}


def plot_errors(check: Mapping[str, Any], path: Path) -> bool:
    """Draw the errors of a check over time, divided by their tolerances; False for a check without such errors."""
    timed = [c for c in check["comparisons"] if c["time_s"] is not None and c["tolerance"] and c["error"] is not None]
    if len({c["time_s"] for c in timed}) < 2:
        return False
    mpl, figure = new_figure((13, 7))
    with mpl.rc_context(_STYLE | {"svg.hashsalt": check["key"]}):
        panels = figure.subplots(2, 3, sharex=True).flat
        for axes, (name, quantities) in zip(panels, _sorted_panels(timed), strict=True):
            axes.axhspan(-1, 1, color="#0072b2", alpha=0.08, linewidth=0)
            axes.set_title(name)
            for k, (group, members) in enumerate(quantities.items()):
                for reference in sorted({c["reference"] for c in members}):
                    line = sorted((c for c in members if c["reference"] == reference), key=lambda c: c["time_s"])
                    times, errors = [c["time_s"] for c in line], [c["error"] / c["tolerance"] for c in line]
                    is_second = reference == "sim_04"
                    style: dict[str, Any] = {"linestyle": "--"} if is_second else {"linestyle": "-", "label": group}
                    axes.plot(times, errors, marker=".", color=_COLORS[k % len(_COLORS)], linewidth=1, **style)
            axes.set_ylabel("error / tolerance")
            if quantities:
                axes.legend(fontsize=6, ncols=2, loc="best")
        for axes in figure.axes[3:]:
            axes.set_xlabel("time (s)")
        figure.suptitle(f"{check['title']}: obtained less sim_05 (full lines) and sim_04 (broken lines)")
        save_figure(figure, [path])
    return True


def _sorted_panels(comparisons: Sequence[Mapping[str, Any]]) -> list[tuple[str, dict[str, list[Mapping[str, Any]]]]]:
    panels: list[tuple[str, dict[str, list[Mapping[str, Any]]]]] = [(name, {}) for name, _ in _PANELS]
    for comparison in comparisons:
        group = comparison["group"]
        panel_index = next(k for k, (_, prefixes) in enumerate(_PANELS) if group.startswith(prefixes))
        panels[panel_index][1].setdefault(group, []).append(comparison)
    return panels


_ROWS_MAX = 24
"""Greatest number of comparisons listed in full; of more, only the worst of each quantity is listed."""
_LISTED_TIMES = 4
_NOT_JUDGED = "flown, not judged"
"""Verdict of a comparison without a published value, as in the document."""
_VERDICTS = {
    True: "All checks with published figures pass",
    False: "**Not all checks pass**",
    None: "Nothing was judged",
}

_HEAD = """# Verification

Every figure below was computed by `anser verify --json`; this page and its plots are made from that document by
`make verification`. Errors are obtained minus expected. A check passes when every one of its figures lies within its
tolerance; the reason of each tolerance stands with the check. Sources in brackets are listed under
[theory](theory/index.md#sources). What has no figure in this package is flown, not judged:
what was obtained is listed.
"""


def write_verification_page(document: Mapping[str, Any], folder: Path) -> Path:
    """Write the page of a document of `anser verify --json` and its plots into a folder, replacing earlier ones."""
    folder.mkdir(parents=True, exist_ok=True)
    parts = [_HEAD, _provenance(document), _summary(document["checks"])]
    with staged_folder(folder) as staging:
        plots = staging / "verification"
        plots.mkdir()
        for check in document["checks"]:
            has_plot = plot_errors(check, plots / f"{check['key']}.svg")
            parts.append(_section(check, f"verification/{check['key']}.svg" if has_plot else None))
        write_file(staging / "verification.md", "\n".join(parts))
        names = {path.name for path in plots.iterdir()}
    for stale in (folder / "verification").glob("*.svg"):
        if stale.name not in names:
            stale.unlink()
    return folder / "verification.md"


def _provenance(document: Mapping[str, Any]) -> str:
    software = ", ".join(
        f"{name} {version}" for name, version in document["provenance"].items() if name != "anser_commit"
    )
    verdict = _VERDICTS[document["passed"]]
    return f"{verdict}; computed with {software}.\n"


def _summary(checks: Sequence[Mapping[str, Any]]) -> str:
    table_rows = []
    for check in checks:
        figures, worst = _counts(check)
        result = f"**{check['verdict']}**" if check["passed"] is False else check["verdict"]
        table_rows.append((f"[{check['title']}](#{_anchor(check['title'])})", figures, worst, result, check["source"]))
    return _table(("check", "figures within tolerance", "worst error, in tolerances", "result", "source"), table_rows)


def _counts(check: Mapping[str, Any]) -> tuple[str, str]:
    """Return how many figures of a check are within tolerance, and the worst error in tolerances, as texts."""
    compared = [c for c in check["comparisons"] if c["expected"] is not None]
    if not compared:
        return "none", ""
    figures = f"{sum(c['passed'] for c in compared)} of {len(compared)}"
    not_judged = len(check["comparisons"]) - len(compared)
    return figures + (f", {not_judged} more not judged" if not_judged else ""), f"{max(map(_severity, compared)):.2g}"


def _section(check: Mapping[str, Any], plot: str | None) -> str:
    figures, worst = _counts(check)
    counts = f" Figures within tolerance: {figures}; worst error, in tolerances: {worst}." if worst else ""
    verdict = f"**{check['verdict'].capitalize()}.**{counts}"
    lines = [f"## {check['title']}", "", verdict, "", check["explanation"], ""]
    tolerance = "" if check["passed"] is None else f"; tolerance: {check['why']}"
    lines += [f"Key `{check['key']}`; source: {check['source']}{tolerance}.", ""]
    if check["problem"]:
        lines += [f"**Could not be computed:** {check['problem']}", ""]
    if plot:
        lines += [f"![Errors of {check['title']} over time, in tolerances]({plot})", ""]
    comparisons = check["comparisons"]
    with_figure = {c["group"] for c in comparisons if c["expected"] is not None}
    over_time = [c for c in comparisons if c["time_s"] is not None and c["group"] not in with_figure]
    if over_time:
        lines += [f"{_NOT_JUDGED.capitalize()}:", "", _table_over_times(over_time)]
        comparisons = [c for c in comparisons if c["group"] in with_figure]
    if comparisons:
        shown = comparisons if len(comparisons) <= _ROWS_MAX else list(_worst_of_each_quantity(comparisons))
        head = "where" if shown is comparisons else "worst where"
        body = []
        for c in shown:
            values = _figure(c["expected"]), _figure(c["obtained"]), _figure(c["error"], 2), _tolerance(c, check)
            body.append((c["group"], c["where"], *values, c["unit"]))
        lines.append(_table(("quantity", head, "expected", "obtained", "error", "tolerance", "unit"), body))
    return "\n".join(lines)


def _tolerance(comparison: Mapping[str, Any], check: Mapping[str, Any]) -> str:
    """Return the tolerance as text, with its reason if the reason differs from the check's."""
    if comparison["expected"] is None:
        return _NOT_JUDGED
    reason = comparison["why"]
    return _figure(comparison["tolerance"], 2) + (f" ({reason})" if reason and reason != check["why"] else "")


def _worst_of_each_quantity(comparisons: Sequence[Mapping[str, Any]]) -> Iterable[Mapping[str, Any]]:
    by_group: dict[str, list[Mapping[str, Any]]] = {}
    for comparison in comparisons:
        by_group.setdefault(comparison["group"], []).append(comparison)
    return (max(members, key=_severity) for members in by_group.values())


def _severity(comparison: Mapping[str, Any]) -> float:
    if comparison["obtained"] is None:
        return float("inf")
    if not comparison["tolerance"]:
        return float("inf") if comparison["passed"] is False else 0.0
    return abs(comparison["error"]) / comparison["tolerance"]


def _table_over_times(comparisons: Sequence[Mapping[str, Any]]) -> str:
    times = sorted({c["time_s"] for c in comparisons})
    step = max(1, (len(times) - 1) // (_LISTED_TIMES - 1))
    shown_times = [*times[:-1:step][: _LISTED_TIMES - 1], times[-1]]
    values = {(c["group"], c["time_s"]): c["obtained"] for c in comparisons}
    units = {c["group"]: c["unit"] for c in comparisons}
    table_rows = [
        (group, *(_figure(values.get((group, t))) for t in shown_times), unit) for group, unit in units.items()
    ]
    return _table(("quantity", *(f"t = {t:g} s" for t in shown_times), "unit"), table_rows)


def _table(head: Sequence[str], body: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *body]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines) + "\n"


def _figure(value: float | None, digits: int = 10) -> str:
    return "" if value is None else f"{value:.{digits}g}"


def _anchor(title: str) -> str:
    """Return the anchor that a heading gets in rendered Markdown."""
    letters = "".join(letter for letter in title.lower() if letter.isalnum() or letter in " -_")
    return letters.replace(" ", "-")


def _main(arguments: Sequence[str]) -> int:
    if len(arguments) != 2:
        sys.stderr.write("expected two arguments: the document that `anser verify --json` printed, and a folder\n")
        return 2
    source, folder = Path(arguments[0]), Path(arguments[1])
    try:
        document = json.loads(read_file(source, 64 * MIB).decode())
    except (OSError, ValueError, RecursionError) as error:
        sys.stderr.write(f"{source}: expected the document that `anser verify --json` prints ({error})\n")
        return 2
    try:
        page = write_verification_page(document, folder)
    except OSError as error:
        sys.stderr.write(f"{folder}: expected a folder that can be written ({error})\n")
        return 2
    sys.stdout.write(f"{page}: written\n")
    return 0


if __name__ == "__main__":
    sys.exit(_main(sys.argv[1:]))
