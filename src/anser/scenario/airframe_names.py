"""The names of what comes with anser: airframes, their variants, and rigid bodies for free flight."""

AIRFRAMES = ("f16",)
BODIES = ("dragless-sphere", "sphere", "undamped-brick", "brick")
VARIANTS = {"f16": ("textbook", "s119", "founding", "tp1538")}
