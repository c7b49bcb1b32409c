"""Simulator of the open-loop motion of one aircraft, or of many at once, advanced step by step under given controls."""

import functools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from anser.aircraft.airframe import AbstractAirframe, Controls
from anser.aircraft.motion import MotionState, to_local_state, to_motion_state
from anser.analysis.trim_points import require_step
from anser.compiling.options import blocks_on_cores, call_on_cores, compiled_quickly, enable_compilation_cache
from anser.compiling.single_kernel import as_single_kernel
from anser.environment.environment import Environment
from anser.environment.gridded_wind import GriddedWind, has_left_field
from anser.simulation.open_loop import dataset_variables
from anser.simulation.vehicle import advance
from anser.single_aircraft.air import read_air
from anser.single_aircraft.flight import set_lags
from anser.single_aircraft.model import aircraft as load_aircraft
from anser.single_aircraft.starts import input_names, reference_inputs, resolve_start
from anser.units import DEG_RAD

_BLOCK_MIN = 64  # least number of aircraft that are computed on a separate core


class NamedState(Mapping[str, Any]):
    """Variables of the aircraft at one sample, by the names of a dataset, such as `state["alpha_deg"]`.

    A value is a number for one aircraft, or an array over the aircraft for several.
    """

    def __init__(self, indices: Mapping[str, int], values: Callable[[], np.ndarray]) -> None:
        self._indices, self._values = indices, values

    def __getitem__(self, name: str) -> Any:
        index = self._indices.get(name)
        if index is None:
            raise KeyError(f"{name!r} is not a variable of the state; the names are {', '.join(self)}")
        values = self._values()
        return float(values[index]) if values.ndim == 1 else values[index]

    def __iter__(self) -> Iterator[str]:
        return iter(self._indices)

    def __len__(self) -> int:
        return len(self._indices)

    def __repr__(self) -> str:
        return "\n".join(f"  {name:<24} {self[name]}" for name in self)


class Simulator:
    """Open-loop motion of one aircraft, or of several of the same type, advanced step by step.

    Parameters
    ----------
    aircraft, wind, earth, atmosphere, actuator_lag, engine_lag
        Aircraft, air and Earth, and lags, as in `anser.simulate`.
    start
        Trim or state by name, as in `anser.simulate`; or a sequence of these, one for each of several aircraft.
    step_s
        Period of a step, 0.001 to 0.05 s; a step of the motion is one classical Runge-Kutta step.
    """

    def __init__(
        self,
        aircraft: Any,
        start: Any,
        step_s: float = 0.01,
        *,
        wind: Mapping[str, Any] | None = None,
        earth: str | Mapping[str, Any] | None = None,
        atmosphere: Mapping[str, Any] | None = None,
        actuator_lag: bool = True,
        engine_lag: bool = True,
    ) -> None:
        enable_compilation_cache()
        require_step(step_s)
        airframe = load_aircraft(aircraft).airframe
        environment = read_air(earth, wind, atmosphere=atmosphere).environment()
        starts = list(start) if isinstance(start, Sequence) else [start]
        if not starts:
            raise ValueError("start: arrived an empty sequence; expected a start for each aircraft")
        points = [resolve_start(airframe, environment, item) for item in starts]
        airframe, points = set_lags(airframe, points, step_s, actuator_lag=actuator_lag, engine_lag=engine_lag)
        self.inputs = input_names(airframe)  #: Names of the inputs: surfaces (deg), and `throttle` (0..1).
        self._count = len(starts) if isinstance(start, Sequence) else None
        self.step_s = float(step_s)
        motions = [_to_motion(environment, point.state) for point in points]
        batched = self._count is not None
        self._constants, self._programs = _prepare(airframe, environment, motions[0], self.step_s, batched=batched)
        # motion, number of the sample and, for one aircraft, its variables, which the first step computes
        blank = np.zeros(1 if batched else 1 + len(self._programs.indices))
        states = [np.append(np.asarray(ravel_pytree(motion)[0]), blank) for motion in motions]
        inputs = [np.array(list(reference_inputs(airframe, point.controls).values())) for point in points]
        self._blocks = blocks_on_cores(len(starts), _BLOCK_MIN)
        self._wind = environment.wind
        self._start: dict[str, Any] = {
            "motion": np.stack(states, axis=1) if batched else states[0],
            "inputs": np.stack(inputs) if batched else inputs[0],
            "number": 0,
        }
        self.reset()

    def reset(self) -> NamedState:
        """Reset time, motion and inputs to the start, and return the state there."""
        return self.restore(self._start)

    @property
    def time_s(self) -> float:
        """Time since the start, s."""
        return self._number * self.step_s

    @property
    def state(self) -> NamedState:
        """State at the present sample, by the names of a dataset: numbers, or arrays over several aircraft."""
        packed, inputs = self._packed, self._inputs
        if self._count is None and self._number > 0:
            values = np.asarray(packed[0])
            return NamedState(self._programs.indices, lambda: values)
        compute = functools.cache(
            lambda: np.concatenate(self._in_parallel(self._programs.read, packed, inputs), axis=-1)
        )
        return NamedState(self._programs.indices, compute)

    def step(self, controls: Mapping[str, Any] | Float[np.ndarray, "... input"] | None = None) -> NamedState:
        """Advance the motion by one step under constant controls, and return the state at the end of the step.

        Raises ValueError if an input is unknown, not finite or of a wrong shape, if the throttle is not within 0 to 1,
        or if the aircraft leaves the wind field of a file without `outside = "hold"`. The state is then unchanged.

        Parameters
        ----------
        controls
            Surfaces in deg, throttle 0 to 1; None: the previous inputs.

            - Mapping by name to numbers or, for several aircraft, arrays; absent inputs keep the previous value.
            - Array of all inputs in the order of `inputs`, for several aircraft with a leading axis over the aircraft.
        """
        inputs = self._merge(controls)
        packed = self._in_parallel(self._programs.step, self._packed, inputs)
        if isinstance(self._wind, GriddedWind):
            for block in packed:
                self._check_field(block if self._count is not None else block[:, None])
        self._packed, self._inputs = packed, inputs
        self._number += 1
        return self.state

    def _in_parallel(self, program: Callable[..., Array], packed: Sequence[Any], inputs: np.ndarray) -> list[Array]:
        """Call a program for each block of aircraft, each on a separate core, and return a result per block."""
        if self._count is None:
            return [program(self._constants, packed[0], inputs)]
        parts = zip(packed, self._blocks, strict=True)
        return call_on_cores([functools.partial(program, self._constants, p, inputs[block].T) for p, block in parts])

    def _check_field(self, packed: Array) -> None:
        time_s = self.time_s + self.step_s
        positions_n = self._programs.positions_n(self._constants, packed)
        is_outside = jax.vmap(has_left_field, in_axes=(None, 0, None))(self._wind, positions_n, time_s)
        if np.any(np.asarray(is_outside)):
            north, east, down = np.asarray(positions_n)[int(np.argmax(is_outside))]
            raise ValueError(
                f"wind.field: the aircraft leaves the wind field of the file at {time_s:g} s, {north:.0f} m north, "
                f"{east:.0f} m east, at {-down:.0f} m; expected a flight within the field, or wind "
                '{"outside": "hold"}, with which the wind beyond is as at the boundary'
            )

    def save(self) -> dict[str, Any]:
        """Return a checkpoint (arrays, can be pickled), from which `restore` continues with identical numbers."""
        motion = np.concatenate(self._packed, axis=-1)
        return {"motion": motion, "inputs": np.array(self._inputs), "number": self._number}

    def restore(self, checkpoint: Mapping[str, Any]) -> NamedState:
        """Reset to a checkpoint from `save` of this or an equal simulator, and return the state there.

        Raises ValueError if the argument is no checkpoint, or if the number of states, inputs or aircraft differs.
        """
        if not isinstance(checkpoint, Mapping) or not checkpoint.keys() >= self._start.keys():
            raise ValueError(f"checkpoint: arrived {checkpoint!r:.60}; expected one that `save` has returned")
        packed, inputs = np.asarray(checkpoint["motion"]), np.asarray(checkpoint["inputs"])
        shape = self._start["motion"].shape
        if packed.shape != shape or inputs.shape != self._start["inputs"].shape:
            raise ValueError(
                f"checkpoint: arrived states of shape {packed.shape}; expected {shape}: one of the same aircraft, and "
                "of as many of them"
            )
        self._packed = [packed] if self._count is None else [packed[:, block] for block in self._blocks]
        self._inputs, self._number = inputs, int(checkpoint["number"])
        return self.state

    def _merge(self, controls: Any) -> np.ndarray:
        """Return all inputs of a step (deg, throttle 0 to 1); inputs that `controls` lacks keep the previous values."""
        if controls is None:
            return self._inputs
        if isinstance(controls, Mapping):
            inputs = self._inputs.copy()
            for name, value in controls.items():
                if name not in self.inputs:
                    raise ValueError(f"controls: arrived {name!r}; expected inputs among {', '.join(self.inputs)}")
                try:
                    inputs[..., self.inputs.index(name)] = value
                except (TypeError, ValueError):
                    each = "a number" if self._count is None else f"a number or {self._count} numbers"
                    raise ValueError(f"controls[{name!r}]: arrived {value!r:.60}; expected {each}") from None
        else:
            inputs = np.array(controls, dtype=float)  # a copy: the caller may reuse the array before the state is read
            if inputs.shape != self._inputs.shape:
                raise ValueError(
                    f"controls: arrived an array of shape {inputs.shape}; expected {self._inputs.shape}, in the order "
                    f"{', '.join(self.inputs)}"
                )
        if self._count is None:  # in Python, which takes a tenth of the time for few numbers
            values = inputs.tolist()
            is_valid = all(map(math.isfinite, values)) and 0.0 <= values[-1] <= 1.0
        else:
            throttle = inputs[:, -1]
            is_valid = np.isfinite(inputs).all() and 0.0 <= throttle.min() <= throttle.max() <= 1.0
        if not is_valid:
            named = dict(zip(self.inputs, inputs.T.tolist(), strict=True)) if self._count is None else inputs
            raise ValueError(f"controls: arrived {named!s:.200}; expected finite numbers, and a throttle from 0 to 1")
        return inputs


class _Programs:
    """Compiled functions of simulators with the same structure of aircraft and air, for one aircraft or for several.

    Few arguments make a call fast. The array `constants` holds the numbers of aircraft and air, then the step (s).
    `packed` holds motion, sample number and variables (at `indices`); its last axis is over the aircraft if there are
    several. For several aircraft, `step` does not compute the variables.
    """

    def __init__(
        self, unpack: Callable[[Array], Any], unravel: Callable[[Array], Any], size: int, batched: bool
    ) -> None:
        self.indices: dict[str, int] = {}

        def situation(constants: Array, packed: Array, inputs: Array) -> tuple[Any, ...]:
            time, state = packed[size] * constants[-1], unravel(packed[:size])
            return *unpack(constants[:-1]), time, state, Controls(DEG_RAD * inputs[:-1], inputs[-1])

        def read(constants: Array, packed: Array, inputs: Array) -> Array:
            named = dataset_variables(*situation(constants, packed, inputs))
            self.indices.update({name: index for index, name in enumerate(named, start=size + 1)})
            return jnp.concatenate([packed[: size + 1], *(jnp.asarray(v, dtype=float)[None] for v in named.values())])

        def advance_once(constants: Array, packed: Array, inputs: Array) -> Array:
            moved = advance(*situation(constants, packed, inputs), step=constants[-1])
            return jnp.append(ravel_pytree(moved)[0], packed[size] + 1.0)

        def advance_and_read(constants: Array, packed: Array, inputs: Array) -> Array:
            # A loop of one step runs on one thread even if `as_single_kernel` has no effect. If no loop existed, XLA's
            # runtime would give small operations to other threads.
            def body(_: Any, before: Array) -> Array:
                return read(constants, advance_once(constants, before, inputs), inputs)

            return jax.lax.fori_loop(0, (packed[size] >= 0.0).astype(int), body, packed)

        def position_n(constants: Array, packed: Array) -> Array:
            return to_local_state(unpack(constants[:-1])[1], unravel(packed[:size])).position_n

        in_axes = (None, 1, 1)
        self.positions_n = jax.jit(jax.vmap(position_n, in_axes[:2]))
        self.read = jax.jit(jax.vmap(read, in_axes, 1) if batched else read)
        self.step = jax.jit(jax.vmap(advance_once, in_axes, 1) if batched else as_single_kernel(advance_and_read))


_programs: dict[Any, _Programs] = {}  # by structure, shared by the simulators of a process
_to_motion = compiled_quickly(to_motion_state)


def _prepare(
    airframe: AbstractAirframe, environment: Environment, motion: MotionState, step: float, *, batched: bool
) -> tuple[Array, _Programs]:
    """Return the array `constants` of `_Programs` (numbers of aircraft and air, step in s), and the functions."""
    numbers, rest = eqx.partition((airframe, environment), lambda leaf: getattr(leaf, "dtype", None) == np.float64)
    constants, unravel_constants = ravel_pytree(numbers)
    state, unravel = ravel_pytree(motion)

    def static_key(leaf: Any) -> Any:
        return (leaf.shape, str(leaf.dtype), np.asarray(leaf).tobytes()) if hasattr(leaf, "dtype") else leaf

    def unpack(packed: Array) -> Any:
        return eqx.combine(unravel_constants(packed), rest)

    shapes = tuple(leaf.shape for leaf in jax.tree.leaves(numbers))
    structures = jax.tree.structure((numbers, rest, motion))
    key = (structures, shapes, tuple(map(static_key, jax.tree.leaves(rest))), state.size, batched)
    constants = jnp.append(constants, step)
    programs = _programs.get(key)
    if programs is None:
        programs = _programs[key] = _Programs(unpack, unravel, state.size, batched)
        # The names of the variables are known from a trace.
        row, inputs = jnp.append(state, 0.0), np.zeros(len(airframe.actuators.names) + 1)
        jax.eval_shape(programs.read, constants, *((row[:, None], inputs[:, None]) if batched else (row, inputs)))
    return constants, programs
