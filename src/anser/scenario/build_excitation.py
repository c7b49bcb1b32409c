"""Construction of an aircraft's test inputs from the tables [[excitation]]."""

from collections.abc import Callable

from anser.config.errors import Problem, ScenarioError
from anser.parts.excitation import Excitation, build_excitation
from anser.parts.input_signals import InputSignal, doublet, multisine, sine_sweep, step_input, three_two_one_one
from anser.scenario import schema_excitation
from anser.scenario.schema import Scenario
from anser.scenario.schema_aircraft import Aircraft


def build_aircraft_excitation(scenario: Scenario, aircraft: Aircraft, surfaces: tuple[str, ...]) -> Excitation | None:
    """Build the test inputs of one aircraft with the control surfaces `surfaces`; None if the aircraft has none.

    Raises
    ------
    ScenarioError
        If an input is neither a surface of the aircraft nor in `EXCITED_INPUTS`.
    """
    terms, known = [], (*surfaces, *schema_excitation.EXCITED_INPUTS)
    for index, table in enumerate(scenario.excitation):
        if table.aircraft not in (None, aircraft.name):
            continue
        for k, name in enumerate(table.inputs):
            if name not in known:  # checked here: surfaces of an airframe defined in code are unknown before
                expected = f"an input of it: {', '.join(known)}"
                problem = Problem(f"excitation[{index}].inputs[{k}]", f'"{name}"', expected, aircraft.label)
                raise ScenarioError(scenario.name, [problem])
            terms.append((name, _signal(table, k)))
    return build_excitation(terms)


_PULSES: dict[str, Callable[..., InputSignal]] = {"doublet": doublet, "3-2-1-1": three_two_one_one}


def _signal(table: schema_excitation.Excitation, index: int) -> InputSignal:
    """Return the signal of the input with index `index` in a table [[excitation]], in the units of the table."""
    amplitude = table.amplitude_of(index)
    if table.signal == "step":
        return step_input(amplitude, table.start_s)
    if table.signal in _PULSES:
        width = {} if table.width_s is None else {"width_s": table.width_s}
        return _PULSES[table.signal](amplitude, table.start_s, **width)
    assert table.frequencies_hz is not None
    assert table.duration_s is not None
    if table.signal == "sweep":
        return sine_sweep(amplitude, table.frequencies_hz, table.duration_s, table.start_s)
    return multisine(
        amplitude,
        table.frequencies_hz,
        table.duration_s,
        table.start_s,
        channel=index,
        channels=len(table.inputs),
        power_exponent=table.power_exponent or 0.0,
    )
