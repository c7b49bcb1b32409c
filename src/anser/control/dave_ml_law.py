"""A controller whose law comes in a DAVE-ML file."""

from collections.abc import Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp

from anser.aircraft import STANDARD_SURFACES, AircraftState, Controls
from anser.control.interface import AbstractController
from anser.control.named_signals import named_signals
from anser.dave_ml import ANGLE, Evaluator, Model, refuse_other_units
from anser.sensing import Belief
from anser.shapes import Scalar, ScalarLike, Vector3


class DaveMlLaw(AbstractController):
    """A control law of a file, evaluated once per sampling period in the units of the file.

    Its inputs, by name, are taken from the command and, what that does not give, from the flight condition
    (`named_signals`); what neither gives keeps the file's own value. Filters and integrals have no place in such a file
    and are the guidance's, which gives their values as commands.

    Attributes
    ----------
    law
        The evaluator of the file.
    surfaces
        Names of the outputs for the airframe's surfaces, in their order.
    power
        Name of the output that is the power wanted of the engine.
    """

    law: Evaluator
    surfaces: tuple[str, ...] = eqx.field(static=True)
    power: str = eqx.field(static=True)

    def init(self, state: AircraftState, attitude: Vector3) -> None:
        """Nothing is kept."""

    def control(
        self, memory: None, belief: Belief, command: Mapping[str, Scalar], step: ScalarLike
    ) -> tuple[Controls, None, None]:
        """Surfaces and throttle.

        Parameters
        ----------
        memory
            None.
        belief
            What the aircraft believes.
        command
            Inputs of the law by name, SI units and radians.
        step
            Sampling period, s.

        Raises
        ------
        ValueError
            The law has no input of a commanded name, or misses one.
        """
        given = {**_known_to(self.law, named_signals(belief)), **command}
        found = self.law.evaluate_si(given, (*self.surfaces, self.power))
        surfaces = jnp.stack([found[name] for name in self.surfaces])
        return Controls(surfaces, belief.airframe.engine.throttle_for_power(100.0 * found[self.power])), None, None


def _known_to(law: Evaluator, signals: Mapping[str, Scalar]) -> dict[str, Scalar]:
    """Those of some signals that are inputs of a law."""
    names = {law.structure.by_id[identifier].name for identifier in law.structure.inputs}
    return {name: value for name, value in signals.items() if name in names}


def dave_ml_law(model: Model, surfaces: Sequence[str] = STANDARD_SURFACES, power: str = "powerLeverAngle") -> DaveMlLaw:
    """The controller of a file.

    Parameters
    ----------
    model
        The file, as read.
    surfaces
        The airframe's surfaces; the output for `elevator` is `elevatorDeflection`.
    power
        Output that is the power wanted of the engine.

    Raises
    ------
    ValueError
        The file does not give one of them, or a surface in units of no angle; or it has states of its own, for which it
        does not say how they go on.
    """
    outputs = tuple(f"{name}Deflection" for name in surfaces)
    for name in (*outputs, power):
        model.evaluator.structure.find(name)
    for name in outputs:
        refuse_other_units(model.definition.variables[model.evaluator.structure.find(name)], ANGLE)
    states = model.having("isState")
    if states:
        raise ValueError(f"the law has states ({', '.join(states)}); expected one that has none")
    return DaveMlLaw(model.evaluator, outputs, power)
