from .errors import Problem, ScenarioError
from .file_schema import json_schema

__all__ = [
    "Problem",
    "ScenarioError",
    "json_schema",
]
