"""The report of a campaign: one page that needs nothing else, not even a network."""

from pathlib import Path

from anser.report.campaign_data import CampaignShown, campaign_data
from anser.report.campaign_map import campaign_map
from anser.report.campaign_parts import (
    bounds,
    causes,
    headline,
    input_words,
    not_begun,
    numbers,
    provenance,
    worst_table,
)
from anser.report.influence_strip import influence_strip
from anser.report.opening import number, scroll_table, text
from anser.report.page_shell import page, write_page
from anser.report.style import COLORS, page_color_of

_STYLES = ("vendor/uplot.min.css", "page.css", "campaign.css")
_SCRIPTS = ("vendor/uplot.min.js", "theme.js", "store.js", "campaign.js")


def write_campaign_report(shown: CampaignShown, path: Path) -> None:
    """Write the report of a campaign as one HTML page, in place of a former one.

    How surely and why not, bounds, convergence, distributions, what the outputs depend on, the worst flights.

    Parameters
    ----------
    shown
        What it shows.
    path
        Where to write the page.
    """
    write_page(_page(shown), path, overwrite=True)


def _page(shown: CampaignShown) -> str:
    title = text(shown.dataset.attrs["title"])
    sure = f"{100 * shown.answers['confidence']:g} %"
    alone = "" if shown.independent.all() else " Only flights that are independent of each other count here."
    contents = f"""<main>
<header>
<h1>{title}</h1>
<p class="lead">{text(shown.study.get("description", ""))}</p>
<p id="fault" class="fault" hidden></p>
</header>
<section class="opening"><div>{headline(shown)}{numbers(shown)}</div>
<div><h2 class="tight">Why flights failed</h2>{causes(shown)}</div></section>
<section id="bounds"><h2>Bounds</h2><p class="caption">What part of the flights keeps, with an interval by order
statistics at {sure} confidence. A flight that has no such number counts as infinitely bad.{alone}</p>
{bounds(shown)}</section>
<section id="converging"><h2>Convergence</h2><p class="caption">Each estimate and its interval at {sure} against the
number of flights.{alone}</p><div class="plots" data-plots="converging"></div></section>
<section id="distributions"><h2>Distributions</h2><p class="caption">Part of the flights that keeps a bound; bars: the
intervals of the bounds above at {sure}. What is missing to 100 % has no such number.{alone}</p>
<div class="plots" data-plots="distributions"></div></section>
{_series(shown)}
{_influences(shown)}
{_against(shown)}
<section id="worst"><h2>The worst flights</h2>{_map(shown)}{worst_table(shown)}</section>
{not_begun(shown)}
<section id="provenance"><h2>Study, scenario, versions, seed</h2>{provenance(shown)}</section>
</main>"""
    return page(
        f"{title} · anser campaign report",
        look="single campaign",
        styles=_STYLES,
        scripts=_SCRIPTS,
        contents=contents,
        data=("campaign", {"colors": len(COLORS), **campaign_data(shown)}),
    )


def _series(shown: CampaignShown) -> str:
    """Section of what was kept over time; empty where nothing was, or codes alone."""
    if not shown.bands:
        return ""
    first = shown.bands[0]
    fleet = shown.dataset.sizes["aircraft"]
    legend = " ".join(
        f'<span class="swatch" style="background:{page_color_of(k)}"></span>{text(name)}'
        for k, name in enumerate(first.aircraft)
    )
    some = f" The first {len(first.aircraft)} of {fleet} aircraft." if len(first.aircraft) < fleet else ""
    return (
        '<section id="series"><h2>Over time</h2><p class="caption">Of each aircraft the median over the flights (line) '
        "and the band from 5 to 95 % of them, at each time by itself; flights that could not begin are not among "
        f'them.{some}</p><p class="caption">{legend}</p><div class="plots" data-plots="series"></div></section>'
    )


def _influences(shown: CampaignShown) -> str:
    """Section of the indices or rank correlations; empty where nothing varied."""
    if not shown.varied:
        return ""
    found = shown.influences
    sobol = found["kind"] == "Sobol indices"
    strips = "".join(
        f'<div><p class="run-name"><b>{text(words)}</b></p>{influence_strip(found["found"], name)}</div>'
        for name, words in found["outputs"].items()
        if any(one["output"] == name for one in found["found"])
    )
    how = (
        "Sobol indices: the part of the variance that an input makes by itself (first) and in whatever combination "
        "(total). What the first ones leave of 1 is combinations, and what is random in each flight."
        if sobol
        else "Spearman rank correlations, −1 to 1: how monotonically an output goes with an input; no parts of a "
        "variance, and blind to what rises and falls. Texts rank in the order of the study."
    )
    rows = "".join(
        f'<tr><td class="text">{text(found["outputs"][one["output"]])}</td>'
        f'<td class="text name">{text(one["path"])}</td>'
        f'<td class="text">{text(one["measure"])}</td>'
        + "".join(f"<td>{number(one[key], 3)}</td>" for key in ("value", "low", "high"))
        + "</tr>"
        for one in found["found"]
    )
    heads = '<th class="text">Output</th><th class="text">Input</th><th class="text">Measure</th>'
    heads += "<th>Value</th><th>From</th><th>To</th>"
    without = "".join(f'<p class="caption">{words}</p>' for words in input_words(found))
    return (
        f'<section id="influences"><h2>What it depends on</h2><p class="caption">{how} Lines: intervals at '
        f'{100 * found["confidence"]:g} %; from {found["flights"]:,} flights.</p><div class="strips">{strips}</div>'
        f'{without}<details class="more"><summary>the numbers</summary>{scroll_table(heads, rows)}</details></section>'
    )


def _against(shown: CampaignShown) -> str:
    """Section of the flights against each input; empty where nothing varied."""
    if not shown.varied:
        return ""
    return (
        '<section id="against"><h2>Every flight against each input</h2><div class="toolbar"><label class="group">'
        'Quantity <select id="quantity"></select></label><span class="caption">A dot met every requirement, a '
        'cross did not; crosses at the edge have no number. <span id="drawn"></span></span></div>'
        '<div class="plots" data-plots="against"></div></section>'
    )


def _map(shown: CampaignShown) -> str:
    drawn = campaign_map(shown)
    if not drawn:
        words = "Flights that began, the worst first. None was flown again for this report: there is no map."
        return f'<p class="caption">{words}</p>'
    others = sum(not one.worst for one in shown.again)
    words = (
        f"Flights that began, the worst first, in colour over {others} others, evenly spaced; from above, each "
        "aircraft until it has arrived. A dot is where one began, a square where it was at the end."
    )
    if shown.otherwise:
        numbers = ", ".join(map(str, shown.otherwise))
        words += f" Flown again, these did not come out as in the campaign: {numbers}."
    return f'<p class="caption">{words}</p>{drawn}'
