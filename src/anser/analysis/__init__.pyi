from .deep_stalls import deep_stall
from .envelope import survey_envelope
from .linear_models import linearize
from .linearization import linearize_loop
from .margins import margins_at, survey_margins
from .modes import modes_of
from .robustness import robustness_study
from .step_flights import climb_and_turn, fly_steps
from .step_tests import StepTest, step_test
from .trim_points import trim

__all__ = [
    "StepTest",
    "climb_and_turn",
    "deep_stall",
    "fly_steps",
    "linearize",
    "linearize_loop",
    "margins_at",
    "modes_of",
    "robustness_study",
    "step_test",
    "survey_envelope",
    "survey_margins",
    "trim",
]
