"""Excitation of a closed-loop flight of one aircraft: input signals by name, checked against the controller."""

from collections.abc import Mapping

from anser.aircraft.actuators import AbstractActuators
from anser.control.inversion_autopilot import InversionAutopilot
from anser.parts.controllers import AbstractController
from anser.parts.excitation import LOOP_INPUTS, PATH_INPUTS, Excitation, build_excitation
from anser.parts.input_signals import InputSignal
from anser.simulation.open_loop import FeedbackControls, PrescribedControls

_COMMANDS = {
    f"{name}_{'m_s' if name == 'airspeed' else 'deg_s' if name.endswith('rate') else 'deg'}": name
    for name in (*PATH_INPUTS, *LOOP_INPUTS)
}
"""Commands that can be excited: name with unit, such as `bank_deg`, and key of the excitation."""


def read_excitation(
    actuators: AbstractActuators,
    excitation: Mapping[str, InputSignal] | None,
    controller: AbstractController,
    step_s: float,
) -> Excitation | None:
    """Return the excitation of a flight with a controller from input signals by name; None if no signal is given.

    Raises ValueError if the flight has no controller, if an input is unknown or does not exist with this controller, or
    if a value is not a signal or has a frequency above half the sampling rate.

    Parameters
    ----------
    actuators
        Actuators of the aircraft, whose commanded surfaces can be excited.
    excitation
        Signals by input: a surface (deg), `throttle`, or a command such as `bank_deg` or `bank`.
    controller
        Controller of the flight.
    step_s
        Sampling period, s.
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
    keys, terms = {f"{name}_deg": name for name in surfaces} | {"throttle": "throttle"} | _COMMANDS, []
    for name, signal in excitation.items():
        key = keys.get(name, name)
        if key not in keys.values():
            inputs = ", ".join((*surfaces, "throttle", *_COMMANDS))
            raise ValueError(f"excitation: arrived {name!r}; expected inputs among {inputs}")
        if not isinstance(signal, InputSignal):
            raise ValueError(
                f"excitation[{name!r}]: arrived {type(signal).__name__}; expected a signal, such as anser.doublet(1.0)"
            )
        if key in (given for given, _ in terms):
            raise ValueError(
                f"excitation: arrived {name!r} beside another name of this input; expected each input once"
            )
        signal.require_sampling(step_s, f"excitation[{name!r}]")
        has_loops = isinstance(controller, InversionAutopilot) and controller.loop == "velocity"
        if key in LOOP_INPUTS and not has_loops:
            raise ValueError(
                f"excitation: arrived {name!r} with {type(controller).__name__}; expected an input of the aircraft or "
                'the path, or controller="inversion", whose loops have this command'
            )
        terms.append((key, signal))
    return build_excitation(terms)
