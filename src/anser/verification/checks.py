"""All checks, in the order in which they are printed."""

from anser.verification.arc_lengths import ARC_LENGTHS
from anser.verification.check import Check
from anser.verification.earth_figure import WGS84_FIGURE
from anser.verification.f16_rates import F16_DERIVATIVES, F16_TURN
from anser.verification.f16_shots import F16_AERO_SHOTS, F16_ENGINE_SHOTS
from anser.verification.f16_trim import F16_TRIM
from anser.verification.integration import INTEGRATION_CHECKS
from anser.verification.linear import LINEAR_CHECKS
from anser.verification.missions import MISSION_CHECKS
from anser.verification.nesc import NESC_CHECKS
from anser.verification.standard_atmosphere import USSA76

CHECKS: tuple[Check, ...] = (
    USSA76,
    WGS84_FIGURE,
    F16_DERIVATIVES,
    F16_TRIM,
    F16_TURN,
    F16_AERO_SHOTS,
    F16_ENGINE_SHOTS,
    ARC_LENGTHS,
    *LINEAR_CHECKS,
    *INTEGRATION_CHECKS,
    *NESC_CHECKS,
    *MISSION_CHECKS,
)
