"""The certified planner: paths that keep limits, distances and closed volumes, with bounds that prove it."""
