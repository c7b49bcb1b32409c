"""Excitation of a flight in the closed loop: test inputs added to controls and commands, as in a flight test.

A signal is added to the commanded deflections or the throttle after the control law (before the limits of the
actuators), to a command of the guidance before the control law, or to a command between two loops of the autopilot.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from anser.aircraft.airframe import Controls
from anser.numerics.arrays import as_array
from anser.parts.input_signals import AbstractSignal, InputSignal
from anser.parts.paths import LoopExcitation, PathCommand
from anser.shapes import ScalarLike, Vector
from anser.units import DEG_RAD

PATH_INPUTS = ("airspeed", "path_angle", "course")
"""Commands to the velocity loop (in user input m/s and deg)."""
LOOP_INPUTS = ("bank", "alpha", "beta", "roll_rate", "pitch_rate", "yaw_rate")
"""Commands to the attitude loop (in user input deg) and to the rate loop (in user input deg/s)."""


class Excitation(eqx.Module):
    """Test inputs of one aircraft: signals in SI units and rad, each added to the input named in `targets`.

    Targets are names of surfaces, "throttle", `PATH_INPUTS` and `LOOP_INPUTS`; signals of the same target are summed.
    """

    signals: tuple[AbstractSignal, ...]
    targets: tuple[str, ...] = eqx.field(static=True)

    def _sums(self, names: Sequence[str], time: ScalarLike) -> Vector:
        """Return the sum of the signals of each input in `names` at a time (s); 0 if an input has no signal."""
        zero = jnp.zeros((), jnp.result_type(time))
        values = [(target, signal.at(time)) for target, signal in zip(self.targets, self.signals, strict=True)]
        return jnp.stack([sum((value for target, value in values if target == name), start=zero) for name in names])

    def excite_controls(self, controls: Controls, surfaces: Sequence[str], time: ScalarLike) -> Controls:
        """Return controls plus the signals at a time (s).

        `surfaces` are the names of the deflections in `controls`, in order; no limits are applied.
        """
        added = self._sums((*surfaces, "throttle"), time)
        return Controls(controls.surfaces + added[:-1], controls.throttle + added[-1])

    def excite_command(self, command: Any, time: ScalarLike) -> Any:
        """Return a command plus the signals of `PATH_INPUTS` and `LOOP_INPUTS` at a time (s).

        If no such signal exists, the command is returned unchanged. Raises ValueError if such a signal exists and the
        command is no `PathCommand`.
        """
        targets = set(self.targets)
        if targets.isdisjoint((*PATH_INPUTS, *LOOP_INPUTS)):
            return command
        if not isinstance(command, PathCommand):
            raise ValueError(
                f"excitation: arrived {type(command).__name__} as the command, for {', '.join(sorted(targets))}; "
                "expected a PathCommand from the guidance, or an excitation of surfaces"
            )
        if not targets.isdisjoint(PATH_INPUTS):
            V, gamma, chi = self._sums(PATH_INPUTS, time)
            command = replace(command, V=command.V + V, gamma=command.gamma + gamma, chi=command.chi + chi)
        if not targets.isdisjoint(LOOP_INPUTS):
            added = self._sums(LOOP_INPUTS, time)
            command = replace(command, excitation=LoopExcitation(added[:3], added[3:]))
        return command


def build_excitation(terms: Sequence[tuple[str, InputSignal]]) -> Excitation | None:
    """Build the excitation of one aircraft from pairs (name of an input, signal); None if there are no pairs.

    The signals are in m/s for the airspeed, in 0..1 for the throttle, and in deg or deg/s for all other inputs.
    """
    if not terms:
        return None
    factors = {"airspeed": 1.0, "throttle": 1.0}
    signals = [signal.signal.scaled(factors.get(name, DEG_RAD)) for name, signal in terms]
    return Excitation(jax.tree.map(as_array, tuple(signals)), tuple(name for name, _ in terms))
