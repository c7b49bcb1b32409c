"""Excitation of the flight of one aircraft in the closed loop: check of the test inputs by name."""

from collections.abc import Mapping

from anser.aircraft.actuators import AbstractActuators
from anser.control.inversion_autopilot import InversionAutopilot
from anser.parts.controllers import AbstractController
from anser.parts.excitation import LOOP_INPUTS, PATH_INPUTS, Excitation, build_excitation
from anser.parts.input_signals import InputSignal
from anser.simulation.open_loop import FeedbackControls, PrescribedControls

_UNITS = ("_deg_s", "_deg", "_m_s")


def read_excitation(
    actuators: AbstractActuators, excitation: Mapping[str, InputSignal] | None, controller: AbstractController
) -> Excitation | None:
    """Build the test inputs of a flight with a controller; None without any.

    Parameters
    ----------
    actuators
        Actuators of the aircraft, whose commanded surfaces can be excited.
    excitation
        Signals by input; the names may have a unit suffix.
    controller
        Controller of the flight.

    Raises
    ------
    ValueError
        The flight has no controller, an input is unknown or not part of the loop, or a value is no signal.
    """
    if not excitation:
        return None
    if isinstance(controller, PrescribedControls | FeedbackControls):
        raise ValueError(
            "excitation: arrived without a controller; expected one, or the signals among the controls: "
            'controls={"elevator": anser.doublet(1.0)}'
        )
    if not isinstance(excitation, Mapping):
        raise ValueError(
            f"excitation: arrived {type(excitation).__name__}; expected signals by input, such as "
            '{"elevator": anser.doublet(1.0)}'
        )
    surfaces = [name for name, commanded in zip(actuators.names, actuators.is_commanded, strict=True) if commanded]
    inputs, terms = (*surfaces, "throttle", *PATH_INPUTS, *LOOP_INPUTS), []
    for name, signal in excitation.items():
        key = name if name in inputs else _without_unit(name)
        if key not in inputs:
            raise ValueError(f"excitation: arrived {name!r}; expected inputs among {', '.join(inputs)}")
        if not isinstance(signal, InputSignal):
            raise ValueError(
                f"excitation[{name!r}]: arrived {type(signal).__name__}; expected a signal, such as anser.doublet(1.0)"
            )
        has_loops = isinstance(controller, InversionAutopilot) and controller.loop == "velocity"
        if key in LOOP_INPUTS and not has_loops:
            raise ValueError(
                f"excitation: arrived {name!r} with {type(controller).__name__}; expected an input of the aircraft or "
                'the path, or controller="inversion", whose loops have this command'
            )
        terms.append((key, signal))
    return build_excitation(terms)


def _without_unit(name: str) -> str:
    suffix = next((suffix for suffix in _UNITS if name.endswith(suffix)), "")
    return name.removesuffix(suffix)
