"""A DAVE-ML model: what its file says, and what it computes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from anser.dave_ml.checking import CheckResult, check_shots, make_shots
from anser.dave_ml.definition import Definition, Role
from anser.dave_ml.evaluator import Evaluator, make_evaluator
from anser.dave_ml.reading import definition_of
from anser.dave_ml.standard_names import refuse_wrong_units
from anser.shapes import Scalar, ScalarLike


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """A DAVE-ML model.

    Attributes
    ----------
    definition
        What the file says, as plain data.
    evaluator
        The part that is compiled: a pytree to put into modules, jit, vmap and differentiate.
    """

    definition: Definition
    evaluator: Evaluator

    @property
    def inputs(self) -> tuple[str, ...]:
        """The varIDs of what is given from outside, states among them."""
        return self.evaluator.structure.inputs

    @property
    def outputs(self) -> tuple[str, ...]:
        """The varIDs of what the file marks as output."""
        return self.evaluator.structure.outputs

    def having(self, role: Role) -> tuple[str, ...]:
        """The varIDs of the variables that the file marks with a role, such as ``isState`` or ``isStateDeriv``."""
        return tuple(v.id for v in self.definition.variables.values() if role in v.roles)

    def evaluate(self, inputs: Mapping[str, ScalarLike], outputs: Sequence[str] | None = None) -> dict[str, Scalar]:
        """See `Evaluator.evaluate`."""
        return self.evaluator.evaluate(inputs, outputs)

    def evaluate_si(self, inputs: Mapping[str, ScalarLike], outputs: Sequence[str] | None = None) -> dict[str, Scalar]:
        """See `Evaluator.evaluate_si`."""
        return self.evaluator.evaluate_si(inputs, outputs)

    def check(self) -> list[CheckResult]:
        """Every internal value and output of every check shot of the file.

        Raises
        ------
        ValueError
            See `check_shots`.
        """
        return check_shots(self.definition, self.evaluator)

    def with_shots(self, inputs: Mapping[str, Mapping[str, float]], tolerance: float = 1e-9) -> "Model":
        """The same model with check shots at the given inputs, computed from it; see `make_shots`."""
        shots = make_shots(self.definition, self.evaluator, inputs, tolerance)
        return replace(self, definition=replace(self.definition, shots=shots))


def model_of(definition: Definition) -> Model:
    """The model of a definition.

    Raises
    ------
    DaveMlError
        See `make_evaluator` and `refuse_wrong_units`.
    """
    refuse_wrong_units(definition)
    return Model(definition, make_evaluator(definition))


def read_dave_ml(content: str | bytes, name: str) -> Model:
    """Read a DAVE-ML 2 file.

    Nothing in it is executed, fetched or expanded; size, depth and numbers are bounded.

    Parameters
    ----------
    content
        The file's text, or its bytes in the encoding that it declares.
    name
        What errors call it.

    Raises
    ------
    DaveMlError
        The one error that a file can cause: where, what arrived, and what would be right.
    """
    return model_of(definition_of(content, name))
