"""The parts of the report page that are the same for every flight: buttons, keys, the bar of time."""

from collections.abc import Collection, Sequence

from anser.report.goal_forms import goals_key


def _entries(marks: Sequence[tuple[str, str]]) -> str:
    return "".join(f'<span><i style="{style}"></i>{words}</span>' for style, words in marks)


def toolbar() -> str:
    """Buttons of the views, the scale of heights, the switch of the plan."""
    views = (("overview", "Overview"), ("above", "From above"), ("follow", "Follow"), ("behind", "From behind"))
    buttons = "".join(
        f'<button type="button" data-view="{key}" aria-pressed="{str(key == "overview").lower()}">{words}</button>'
        for key, words in views
    )
    lifts = "".join(f'<option value="{k}">×{k}</option>' for k in (1, 2, 3, 5))
    return (
        f'<div class="toolbar"><span class="group">{buttons}</span>'
        f'<label class="group">Heights <select id="lift">{lifts}</select></label>'
        '<label class="group"><input type="checkbox" id="plans" checked> plan and its renewals</label></div>'
    )


def scene_key(forms: Collection[str], keep_outs: bool) -> str:
    """What the lines and marks of the scene are: only those goals that it has, and keep-outs where there are any."""
    entries = [
        ("width:18px;border-top:3px solid var(--c0)", "flown so far"),
        ("width:18px;border-top:1px dashed var(--ink)", "planned"),
        ("width:18px;border-top:1px solid var(--quiet)", "over ground"),
        (
            "width:9px;height:9px;background:var(--c0);transform:rotate(45deg)",
            "rendezvous point of the aircraft's colour",
        ),
        ("width:9px;height:9px;background:var(--c1);border:2px solid var(--ink)", "planned anew"),
    ]
    if keep_outs:
        entries.append(("width:16px;height:7px;border:1px solid var(--limit);border-radius:50%", "where none may be"))
    return (
        '<p class="key"><span class="of-screen">drag: turn (from above: shift); wheel: zoom; right drag: shift; '
        f"click an aircraft: focus</span>{_entries(entries)}{goals_key(forms)}</p>"
    )


EVENTS_KEY = f"""<p class="key">{
    _entries(
        [
            ("width:18px;height:10px;background:var(--approach)", "approach"),
            ("width:18px;height:10px;background:var(--frozen)", "plan frozen"),
            ("width:18px;height:10px;background:var(--hold)", "hold"),
            ("width:1px;height:12px;background:var(--quiet)", "plan fitted to where the goal is now"),
            ("width:1px;height:12px;background:var(--c0)", "corrected"),
            (
                "width:18px;height:3px;border:1px solid var(--quiet)",
                "so many of these that they cannot be told apart here",
            ),
            ("width:3px;height:14px;background:var(--c1)", "planned anew"),
            ("width:3px;height:14px;background:var(--ink)", "last good plan kept"),
            ("width:3px;height:14px;background:var(--c3)", "kept until the goal is known better"),
            ("width:3px;height:14px;background:var(--c5)", "bent as far as the limits allow"),
            ("width:18px;height:5px;background:var(--near)", "a command at the limit that its row names"),
            ("width:18px;height:4px;background:var(--limit)", "outside the tables"),
            ("width:9px;height:9px;background:var(--c0);transform:rotate(45deg)", "arrival"),
        ]
    )
}</p>"""
TRANSPORT = """<div class="transport" role="region" aria-label="Time">
<button type="button" id="play" title="Play"><span aria-hidden="true">▶</span></button>
<div class="track"><input type="range" id="time" min="0" max="1" value="0" aria-label="Time, s">
<div id="marks"></div></div>
<output id="told"></output>
<label><span>Speed</span> <select id="rate"><option value="1">×1</option><option value="2">×2</option>
<option value="5" selected>×5</option><option value="10">×10</option><option value="30">×30</option></select></label>
<label class="of-focus">Focus <select id="focus"></select></label>
</div>"""
