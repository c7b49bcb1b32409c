from .airframes import list_airframes, survey_airframe
from .deep_stalls import deep_stall
from .envelope import EnvelopeSurvey, survey_envelope
from .linear_models import LinearizationResult
from .linearization import linearize, linearize_loop
from .margins import MarginSurvey, margins_at, survey_margins
from .modes import modes_of
from .precompilation import warm_cache
from .robustness import RobustnessStudy, robustness_study
from .step_flights import fly_steps
from .step_tests import PUBLISHED_STEPS, StepTest, StepTestResult, step_test
from .tracking_case import climb_and_turn
from .trim_maps import survey_limits
from .trim_points import ConditionError, TrimResult, trim

__all__ = [
    "PUBLISHED_STEPS",
    "ConditionError",
    "EnvelopeSurvey",
    "LinearizationResult",
    "MarginSurvey",
    "RobustnessStudy",
    "StepTest",
    "StepTestResult",
    "TrimResult",
    "climb_and_turn",
    "deep_stall",
    "fly_steps",
    "linearize",
    "linearize_loop",
    "list_airframes",
    "margins_at",
    "modes_of",
    "robustness_study",
    "step_test",
    "survey_airframe",
    "survey_envelope",
    "survey_limits",
    "survey_margins",
    "trim",
    "warm_cache",
]
