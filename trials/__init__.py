"""Random planning tasks and the independent checker of the planner's answers; not part of the installed package."""
