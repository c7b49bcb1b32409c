"""Random planning tasks, and what judges the planner's answers to them; not part of the installed package."""
