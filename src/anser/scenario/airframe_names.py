"""The names of what comes with anser: airframes, their variants, and rigid bodies for free flight."""

FILES = {"aerosonde": "aircraft/data", "nasa-f16": "dave_ml/nasa"}
"""Airframes of the library that are aircraft files: folder of each within this package."""
AIRFRAMES = ("f16", *FILES)
BODIES = ("dragless-sphere", "sphere", "undamped-brick", "brick")
VARIANTS = {"f16": ("textbook", "s119", "founding", "tp1538")}
"""Variants of the airframes that have any."""
