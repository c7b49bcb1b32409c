"""What a valid scenario had better not do: said, not refused."""

import math

from anser.control import SEPARATION_MIN, separations
from anser.scenario.build import build_gains
from anser.scenario.schema import Scenario


def cautions(scenario: Scenario) -> tuple[str, ...]:
    """Say what will probably not work as meant, one sentence each; empty where nothing is to be said.

    Parameters
    ----------
    scenario
        Validated.
    """
    found = []
    for index, aircraft in enumerate(scenario.aircraft):
        for pair in separations(build_gains(aircraft)):
            ratio = float(pair.ratio)
            if ratio < SEPARATION_MIN:
                found.append(
                    f'aircraft[{index}].gains (aircraft "{aircraft.name}"): the loop of {pair.outer} has a bandwidth '
                    f"of {float(pair.outer_bandwidth):.3g} 1/s and rests on {pair.inner} with "
                    f"{float(pair.inner_bandwidth):.3g} 1/s, a ratio of {ratio:.2f}; below {SEPARATION_MIN:g} the two "
                    f"swing against each other (damping {0.5 * math.sqrt(ratio):.2f})"
                )
    return tuple(found)
