"""The parts of the report page that are the same for every flight: buttons, keys, the bar of time."""


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


SCENE_KEY = (
    '<p class="key"><span>drag: turn; wheel: zoom; right drag: shift; click an aircraft: focus</span>'
    '<span><i style="width:18px;border-top:3px solid #0072b2"></i>flown so far</span>'
    '<span><i style="width:18px;border-top:1px dashed #1b1f24"></i>planned</span>'
    '<span><i style="width:18px;border-top:1px solid #8c959f"></i>over ground</span>'
    '<span><i style="width:9px;height:9px;background:#3d444d;transform:rotate(45deg)"></i>goal</span>'
    '<span><i style="width:9px;height:9px;background:#0072b2;transform:rotate(45deg)"></i>'
    "stand-off point above it</span>"
    '<span><i style="width:9px;height:9px;background:#d55e00;border:2px solid #1b1f24"></i>planned anew</span></p>'
)
KEEP_OUT_KEY = (
    '<span><i style="width:16px;height:7px;border:1px solid #b3261e;border-radius:50%"></i>where none may be</span></p>'
)
EVENTS_KEY = (
    '<p class="key"><span><i style="width:18px;height:10px;background:#d7e7f3"></i>approach</span>'
    '<span><i style="width:18px;height:10px;background:#9cc3de"></i>plan frozen</span>'
    '<span><i style="width:18px;height:10px;background:#edeff2"></i>hold</span>'
    '<span><i style="width:1px;height:12px;background:#57606a"></i>plan fitted to where the goal is now</span>'
    '<span><i style="width:1px;height:12px;background:#0072b2"></i>corrected</span>'
    '<span><i style="width:3px;height:14px;background:#d55e00"></i>planned anew</span>'
    '<span><i style="width:3px;height:14px;background:#1b1f24"></i>last good plan kept</span>'
    '<span><i style="width:3px;height:14px;background:#cc79a7"></i>kept until the goal is known better</span>'
    '<span><i style="width:3px;height:14px;background:#56b4e9"></i>bent as far as the limits allow</span>'
    '<span><i style="width:18px;height:5px;background:#e69f00"></i>a command at a limit</span>'
    '<span><i style="width:18px;height:4px;background:#b3261e"></i>outside the tables</span>'
    '<span><i style="width:9px;height:9px;background:#0072b2;transform:rotate(45deg)"></i>arrival</span></p>'
)
TRANSPORT = """<div class="transport" role="group" aria-label="Time">
<button type="button" id="play" aria-label="Play">▶</button>
<div class="track"><input type="range" id="time" min="0" max="1" value="0" aria-label="Time, s">
<div id="marks"></div></div>
<output id="told"></output>
<label>Speed <select id="rate"><option value="1">×1</option><option value="2">×2</option>
<option value="5" selected>×5</option><option value="10">×10</option><option value="30">×30</option></select></label>
<label>Focus <select id="focus"></select></label>
</div>"""
