"""Campaigns: executing scenarios, one by one for now; trim points and linear models for people."""

from anser.campaign.certified import CertifiedPlanned
from anser.campaign.conditions import ConditionError, Inversion
from anser.campaign.dispersion import FlightPoint
from anser.campaign.envelope import EnvelopeSurvey, survey
from anser.campaign.envelope_cases import survey_limits
from anser.campaign.execute import Flown, run
from anser.campaign.linearizing import Linearized, linearize
from anser.campaign.margins import MarginSurvey, margin_document, margins_at, survey_margins
from anser.campaign.plan_interface import NoPlanError, Planned
from anser.campaign.planned import PublishedPlanned, plan
from anser.campaign.robustness import RobustnessStudy, robustness_study
from anser.campaign.step_tests import CHANNEL_KEYS, PUBLISHED_STEPS, StepTest, step_test
from anser.campaign.stepped_flight import SteppedFlight, step_document
from anser.campaign.stepping import fly_steps
from anser.campaign.tracking import CLIMB_AND_TURN, fly_climb_and_turn
from anser.campaign.trimming import FoundTrim, find_trim
from anser.campaign.warming import warm

__all__ = [
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
    "Planned",
    "PublishedPlanned",
    "RobustnessStudy",
    "StepTest",
    "SteppedFlight",
    "find_trim",
    "fly_climb_and_turn",
    "fly_steps",
    "linearize",
    "margin_document",
    "margins_at",
    "plan",
    "robustness_study",
    "run",
    "step_document",
    "step_test",
    "survey",
    "survey_limits",
    "survey_margins",
    "warm",
]
