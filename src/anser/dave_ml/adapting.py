"""A model under other names, and with usual values of inputs."""

from collections.abc import Mapping
from dataclasses import replace

from anser.dave_ml.errors import shown
from anser.dave_ml.model import Model, model_of


def adapted(model: Model, names: Mapping[str, str], given: Mapping[str, float]) -> Model:
    """The same model with other names of some variables and usual values of some inputs.

    Parameters
    ----------
    names
        New name -> varID or name in the file.
    given
        Usual values by varID or name in the file, in its units.

    Raises
    ------
    ValueError
        There is no such variable, or another one has the new name; or (DaveMlError) its units are none of that name.
    """
    if not names and not given:
        return model
    structure, variables = model.evaluator.structure, dict(model.definition.variables)
    for own, value in given.items():
        identifier = structure.find(own)
        known = identifier in structure.inputs or identifier in model.evaluator.constants
        if not known or variables[identifier].formula is not None:
            raise ValueError(f"{shown(own)} is computed by the file; inputs are {', '.join(structure.inputs)}")
        variables[identifier] = replace(variables[identifier], initial=float(value))
    for name, own in names.items():
        identifier = structure.find(own)
        other = next((one.id for one in variables.values() if one.name == name and one.id != identifier), None)
        if other is not None:
            raise ValueError(f"{shown(name)} is the name of another variable of the file, {shown(other)}")
        variables[identifier] = replace(variables[identifier], name=name)
    return model_of(replace(model.definition, variables=variables))
