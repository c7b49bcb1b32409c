"""The gains of a scenario's autopilots: given themselves, or as wanted bandwidths and damping."""

from typing import Literal

from anser.scenario.errors import Problem, plain
from anser.scenario.schema_base import Gain3, Table, choice, designed, gain, number, table

_WAYS = "either proportional and integral, or bandwidth_rad_s and damping; not both"


class _LoopGains(Table):
    """What the gains of all loops share: the other way to give them."""

    bandwidth_rad_s: Gain3 | None = designed("wanted bandwidth, instead of proportional and integral")
    damping: Gain3 | None = designed("wanted damping of the pair of poles; left out: no integral")

    def own_problems(self) -> list[Problem]:
        """Find gains given in both ways, and a damping without a bandwidth or too small."""
        found = []
        if self.bandwidth_rad_s is not None:
            both = [key for key in ("proportional", "integral") if key in self.model_fields_set]
            found = [Problem(key, f"{plain(getattr(self, key)[0])} beside bandwidth_rad_s", _WAYS) for key in both]
        elif self.damping is not None:
            found = [Problem("damping", f"{plain(self.damping[0])} without bandwidth_rad_s", _WAYS)]
        if self.damping is not None and min(self.damping) < DAMPING_MIN:
            found.append(Problem("damping", plain(min(self.damping)), f"a number from {DAMPING_MIN:g}"))
        return found


DAMPING_MIN = 0.1


class RateGains(_LoopGains):
    """Gains of the fast loop, axes (roll rate P, pitch rate Q, yaw rate R)."""

    proportional: Gain3 = gain("of the error, 1/s", 10.0)
    integral: Gain3 = gain("of the integrated error, 1/s^2", 0.25)
    derivative: Gain3 = gain("of the error's rate", 1.0)
    feed_forward: Gain3 = gain("of the commanded rate of change", 1.0)


class AttitudeGains(_LoopGains):
    """Gains of the middle loop, axes (bank mu, angle of attack alpha, sideslip beta)."""

    proportional: Gain3 = gain("of the error, 1/s", 2.0)
    integral: Gain3 = gain("of the integrated error, 1/s^2", 0.0)
    derivative: Gain3 = gain("of the error's rate", 0.0)
    feed_forward: Gain3 = gain("of the commanded rate of change", 1.0)


class VelocityGains(_LoopGains):
    """Gains of the slow loop, axes (speed V, path angle gamma, course chi)."""

    proportional: Gain3 = gain("of the error, 1/s", 1.0)
    integral: Gain3 = gain("of the integrated error, 1/s^2", 0.025)
    derivative: Gain3 = gain("of the error's rate", 0.0)
    feed_forward: Gain3 = gain("of the commanded rate of change", 1.0)


class Gains(Table):
    """Gains of the autopilot's three loops (theory section 5), and which inversion they drive."""

    inversion: Literal["model", "incremental"] = choice(
        "what is inverted: the model, or the change from what the sensors measure", ("model", "incremental"), "model"
    )
    sensor_bandwidth_rad_s: float = number(
        "of the filter on the sensors of the incremental inversion", 1, 100, "rad/s", 20.0
    )

    rates: RateGains = table("fast loop", "a table [aircraft.gains.rates]", RateGains())
    attitude: AttitudeGains = table("middle loop", "a table [aircraft.gains.attitude]", AttitudeGains())
    velocity: VelocityGains = table("slow loop", "a table [aircraft.gains.velocity]", VelocityGains())
