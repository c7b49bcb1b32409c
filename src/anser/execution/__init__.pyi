from .airframe_survey import survey_airframe
from .airframes import check_airframe, check_dave_ml, described_airframe, file_of, list_airframes, trimmed_speeds
from .certified import CertifiedPlanned
from .conditions import ConditionError, Inversion, airframe_of, name_of
from .deep_stalling import CENTRES, deep_stall, deep_stall_document, first_stable
from .dispersion import FlightPoint
from .envelope import EnvelopeSurvey, survey
from .envelope_cases import survey_limits
from .execute import Flown, run
from .linearizing import Linearized, linearize
from .margins import MarginSurvey, margin_document, margins_at, survey_margins
from .plan_file import read_plan, write_plan
from .plan_interface import NoPlanError, PlanFileError, Planned
from .planned import PublishedPlanned, plan
from .robustness import RobustnessStudy, robustness_study
from .saved_flight import SavedFlight, load_flight
from .step_cases import gallery_steps, step_pace
from .step_tests import CHANNEL_KEYS, PUBLISHED_STEPS, StepTest, step_test
from .stepped_flight import SteppedFlight, step_document
from .stepping import fly_steps
from .sweeping import sweep, swept_scenarios
from .tracking import CLIMB_AND_TURN, climb_and_turn, fly_climb_and_turn
from .trimming import FoundTrim, trim
from .warming import warm

__all__ = [
    "CENTRES",
    "CHANNEL_KEYS",
    "CLIMB_AND_TURN",
    "PUBLISHED_STEPS",
    "CertifiedPlanned",
    "ConditionError",
    "EnvelopeSurvey",
    "FlightPoint",
    "Flown",
    "FoundTrim",
    "Inversion",
    "Linearized",
    "MarginSurvey",
    "NoPlanError",
    "PlanFileError",
    "Planned",
    "PublishedPlanned",
    "RobustnessStudy",
    "SavedFlight",
    "StepTest",
    "SteppedFlight",
    "airframe_of",
    "check_airframe",
    "check_dave_ml",
    "climb_and_turn",
    "deep_stall",
    "deep_stall_document",
    "described_airframe",
    "file_of",
    "first_stable",
    "fly_climb_and_turn",
    "fly_steps",
    "gallery_steps",
    "linearize",
    "list_airframes",
    "load_flight",
    "margin_document",
    "margins_at",
    "name_of",
    "plan",
    "read_plan",
    "robustness_study",
    "run",
    "step_document",
    "step_pace",
    "step_test",
    "survey",
    "survey_airframe",
    "survey_limits",
    "survey_margins",
    "sweep",
    "swept_scenarios",
    "trim",
    "trimmed_speeds",
    "warm",
    "write_plan",
]
