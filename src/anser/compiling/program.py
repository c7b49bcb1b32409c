"""Functions that are compiled once per machine.

Programs in this process, the store that keeps them between processes, and the memory that loaded programs take.
"""

import contextlib
import ctypes
import functools
import gc
import inspect
import itertools
import logging
import math
import sys
import threading
import weakref
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Generic, ParamSpec, Protocol, TypeAlias, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import Tracer

from anser.compiling.executables import Executable, load_executable, pack_program, unpack_program
from anser.compiling.keys import NotCacheableError, jax_settings, operations_key, program_key

_REGIONS = Path("/proc/self/maps")
_REGIONS_MAX = Path("/proc/sys/vm/max_map_count")


def regions_used() -> float:
    """Share of the memory regions that the system gives a process, 0 to 1; 0 where there is no such limit.

    A loaded program takes up to some thousands; a process that has none left is ended within the compiler.
    """
    try:
        return _REGIONS.read_bytes().count(b"\n") / int(_REGIONS_MAX.read_text())
    except (OSError, ValueError):  # no Linux
        return 0.0


@functools.cache
def _trim() -> Callable[[int], int] | None:
    return getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None


def return_freed_memory() -> None:
    """Give freed memory back to the system: glibc keeps what loading took beside the program, as much as it again."""
    trim = _trim()
    if trim is not None:
        trim(0)


_P = ParamSpec("_P")
_R = TypeVar("_R")
_HIT = "/jax/compilation_cache/cache_hits"


class ProgramStore(Protocol):
    """Where exported programs are kept between processes; neither method may raise."""

    def load(self, key: str) -> bytes | None:
        """Content that was saved under a key; None where there is none, or none that is whole."""

    def save(self, key: str, content: bytes) -> None:
        """Keep content under a key, or do nothing."""


_in_use: list[ProgramStore] = []
_watchers: list[Callable[[bool], None]] = []
_announcing: list[None] = []
_LoadedProgram: TypeAlias = tuple[Callable[..., list[Any]], int]
"""A program of arrays, and the size of its code."""
_programs: "weakref.WeakSet[Program[..., Any]]" = weakref.WeakSet()


def use_program_store(store: ProgramStore | None) -> None:
    """Keep programs in a store from now on; None: in none."""
    _in_use[:] = [] if store is None else [store]


@contextlib.contextmanager
def watch_compilation(on_compiling: Callable[[bool], None]) -> Iterator[None]:
    """Have a function called with True whenever compiling begins and with False when it has ended."""
    _watchers.append(on_compiling)
    try:
        yield
    finally:
        _watchers.remove(on_compiling)


@contextlib.contextmanager
def _announced() -> Iterator[None]:
    """Tell the watchers, once where this is entered within itself."""
    watchers = [] if _announcing else list(_watchers)
    _announcing.append(None)
    for tell in watchers:
        tell(True)
    try:
        yield
    finally:
        _announcing.pop()
        for tell in watchers:
            tell(False)


def forget_programs() -> None:
    """Give up all compiled programs of this process, as `jax.clear_caches` does with JAX's own."""
    for program in _programs:
        program.forget()


def _make_room(size: int) -> None:
    """Release the programs used longest ago, so that the code of all, with one of a size, stays within a bound."""
    with _releasing:
        present = sorted(
            (
                (prepared.last_use, prepared.size, program, key)
                for program in list(_programs)
                for key, prepared in program
            ),
            key=lambda entry: entry[0],
        )
        total = size + sum(entry[1] for entry in present)
        for _, released, program, key in present:
            if total <= _CODE_MAX:
                break
            program.release(key)
            total -= released


def limit_memory_regions() -> None:
    """Release all programs, JAX's own too, if the process has used half of the memory regions that it may have.

    A region more than allowed ends the process. What is released is loaded or compiled anew where it is needed again.
    """
    if regions_used() >= _REGIONS_SHARE_MAX:
        _log_crowding()
        release_all_programs()


def release_all_programs() -> None:
    """Release all programs, JAX's own too, and give their memory back to the system."""
    forget_programs()
    jax.clear_caches()
    gc.collect()
    return_freed_memory()


@functools.cache
def _log_crowding() -> None:
    _LOG.warning(
        "caution: half of the memory regions of this process are in use (vm.max_map_count): all compiled programs are "
        "released, and loaded or compiled anew where they are needed again"
    )


class _Hole:
    """In the place of an array in the structure of arguments."""


_hits: list[int] = []
"""The thread of each program that came out of JAX's own cache."""
_beside = ThreadPoolExecutor(2, "anser-compiling")
_CODE_MAX = 72 << 20
"""Bytes of code of all programs of the process; loaded they take some twenty times as much memory."""
_REGIONS_SHARE_MAX = 0.5
_LARGE = 4 << 20
_LOG = logging.getLogger(__name__)
_uses = itertools.count()
_releasing = threading.Lock()
_loading = threading.Lock()
_changing = threading.Lock()
_compiling: list[float] = []


@functools.cache
def _listen() -> None:
    jax.monitoring.register_event_listener(
        lambda event, **_: _hits.append(threading.get_ident()) if event == _HIT else None
    )


@contextlib.contextmanager
def _kept_by_the_store() -> Iterator[None]:
    """What is compiled here, in whatever thread, is kept once, in the store, and not in JAX's own cache."""
    setting = "jax_persistent_cache_min_compile_time_secs"
    with _changing:
        _compiling.append(getattr(jax.config, setting))
        jax.config.update(setting, math.inf)
    try:
        yield
    finally:
        with _changing:
            # The last one out puts back what the first one found.
            found = _compiling.pop(0) if len(_compiling) == 1 else _compiling.pop(1)
            jax.config.update(setting, found)


def _compiled(lowered: Any, options: dict[str, bool | str]) -> tuple[Any, bool]:
    """The program, and whether it can be kept: XLA cannot serialize one again that came out of JAX's own cache."""
    _listen()
    own = threading.get_ident()
    before = _hits.count(own)
    with _kept_by_the_store():
        return lowered.compile(options or None), _hits.count(own) == before


def _load(executable: Executable, result: Any, size: int) -> _LoadedProgram:
    """Load a program of `size` bytes, whose result has `jax.ShapeDtypeStruct` in the place of arrays."""
    # Loading takes as much memory again as the loaded program.
    with _loading if size > _LARGE else contextlib.nullcontext():
        _make_room(size)
        program = load_executable(executable, filter(_is_shape, jax.tree.leaves(result)))
        if size > _LARGE:
            return_freed_memory()
        return program, size


def _is_shape(leaf: Any) -> bool:
    return isinstance(leaf, jax.ShapeDtypeStruct)


def _is_array(leaf: Any) -> bool:
    return eqx.is_array(leaf) or _is_shape(leaf)


def _shape_of(array: Any) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct(array.shape, array.dtype, weak_type=getattr(array, "weak_type", False))


def _returning(compiled: Callable[..., list[Any]], result: Any) -> Callable[[list[Any]], Any]:
    """Call a compiled program of arrays and put its arrays into the structure of the result."""
    leaves, structure = jax.tree.flatten(result)
    places = [k for k, leaf in enumerate(leaves) if _is_shape(leaf)]

    def call(arrays: list[Any]) -> Any:
        filled = list(leaves)
        for place, array in zip(places, compiled(arrays), strict=True):
            filled[place] = array
        return structure.unflatten(filled)

    return call


class PreparedProgram:
    """A program that is loaded or compiled beside other work: what is kept at once, what is not from `begin` on.

    Attributes
    ----------
    shapes
        What the program gives, with `jax.ShapeDtypeStruct` in the place of arrays.
    size
        Bytes of its code; 0 until it is there.
    used
        Number of its last use, counted over all programs.
    """

    def __init__(self, shapes: Any, make: Callable[[], _LoadedProgram], *, compiles: bool) -> None:
        self.shapes, self._made, self._compiles, self._begun = shapes, make, compiles, False
        self.size, self.last_use = 0, next(_uses)
        if not compiles:
            self.start()

    def start(self) -> "PreparedProgram":
        """Have it made, in a thread of its own."""
        if not self._begun:
            self._made, self._begun = _beside.submit(self._made).result, True
        return self

    @functools.cached_property
    def function(self) -> Callable[[list[Any]], Any]:
        """The program, as soon as it is there: arrays in, result out."""
        with _announced() if self._compiles else contextlib.nullcontext():
            made = self._made()
        self._made, self._begun = (lambda: made), True  # the arrays that it was made for go
        self.size = made[1]
        return _returning(made[0], self.shapes)


class Program(Generic[_P, _R]):
    """A function of arrays, compiled for each structure, shape and static value of its arguments.

    With a store in use (`use_program_store`), what another process compiled is neither traced nor compiled again.
    Within another compiled function or a derivative it is a part of that one.

    Parameters
    ----------
    function
        Pure.
    options
        Gives the compiler's options when they are first needed.
    static_argnames
        Names of static arguments, as of `jax.jit`: all others are traced. None: all that are no arrays are static.
    """

    def __init__(
        self,
        function: Callable[_P, _R],
        options: Callable[[], dict[str, bool | str]],
        static_argnames: Sequence[str] | None = None,
    ) -> None:
        functools.update_wrapper(self, function)
        self._function, self._options, self._static = function, options, static_argnames
        self._ready: dict[Any, PreparedProgram] = {}
        _programs.add(self)

    @functools.cached_property
    def _within(self) -> Callable[..., Any]:
        """Part of another compiled function: JAX takes compiler options for the outermost one only."""
        if self._static is None:
            return eqx.filter_jit(self._function)
        return jax.jit(self._function, static_argnames=self._static)

    @functools.cached_property
    def _signature(self) -> inspect.Signature:
        return inspect.signature(self._function)

    def __call__(self, *args: _P.args, **kwargs: _P.kwargs) -> _R:
        """Call the function, compiled."""
        return self.ready(*args, **kwargs)()

    def ready(self, *args: _P.args, **kwargs: _P.kwargs) -> Callable[[], _R]:
        """Have the program for such arguments compiled; what is returned calls it with these ones."""
        traced = any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((args, kwargs)))
        if traced or jax.config.jax_disable_jit or jax.config.jax_debug_nans:  # pyright: ignore[reportAttributeAccessIssue]
            return functools.partial(self._within, *args, **kwargs)
        arrays, static = self._parted(args, kwargs)
        prepared = self._known(arrays, static)
        if prepared is None:
            with _announced():
                return functools.partial(self._prepared(arrays, static).function, arrays)
        return functools.partial(prepared.function, arrays)

    def prepare(self, *args: Any, **kwargs: Any) -> PreparedProgram:
        """Begin with the program for arguments of such shapes: `jax.ShapeDtypeStruct` may stand for arrays."""
        return self._prepared(*self._parted(args, kwargs))

    def forget(self) -> None:
        """Give up what is compiled."""
        self._ready.clear()

    def release(self, key: Any) -> None:
        """Give up the program of a key of `__iter__`; whoever is calling it still has it."""
        self._ready.pop(key, None)

    def __iter__(self) -> Iterator[tuple[Any, PreparedProgram]]:
        """What is compiled, with its key."""
        return iter(list(self._ready.items()))

    def _parted(self, args: Any, kwargs: Any) -> tuple[list[Any], tuple[Any, tuple[Any, ...]]]:
        """Array leaves of the arguments; structure and everything else, hashable."""
        if self._static is None:
            leaves, structure = jax.tree.flatten((args, kwargs))
            return [one for one in leaves if _is_array(one)], (
                structure,
                tuple(_Hole if _is_array(one) else one for one in leaves),
            )
        named = self._signature.bind(*args, **kwargs).arguments
        # Numbers of Python become weakly typed arrays, as by `jax.jit`.
        traced = {
            name: jax.tree.map(lambda leaf: leaf if _is_array(leaf) else jnp.asarray(leaf), value)
            for name, value in named.items()
            if name not in self._static
        }
        leaves, structure = jax.tree.flatten(traced)
        return leaves, (structure, tuple((name, named[name]) for name in self._static if name in named))

    def _arguments(self, arrays: Sequence[Any], static: tuple[Any, tuple[Any, ...]]) -> tuple[Any, Any]:
        structure, rest = static
        if self._static is None:
            left = iter(arrays)
            return structure.unflatten([next(left) if one is _Hole else one for one in rest])
        return (), structure.unflatten(arrays) | dict(rest)

    def _key(self, arrays: list[Any], static: tuple[Any, Any], options: dict[str, bool | str]) -> str | None:
        """Name of the program for such arguments in a store; None: it cannot be kept."""
        try:
            return program_key((self._function, self._arguments(list(map(_shape_of, arrays)), static), options))
        except NotCacheableError:
            return None

    def _prepared(self, arrays: list[Any], static: tuple[Any, Any]) -> PreparedProgram:
        """The program for such arguments: known, or traced to be compiled and put into the store."""
        prepared = self._known(arrays, static)
        if prepared is None:
            with _announced():
                prepared = PreparedProgram(*self._compiling(arrays, static), compiles=True)
            self._ready[self._called(arrays, static)] = prepared
        return prepared

    def _called(self, arrays: list[Any], static: tuple[Any, Any]) -> Any:
        shapes = tuple((one.shape, one.dtype, getattr(one, "weak_type", False)) for one in arrays)
        return static, shapes, jax_settings()

    def _known(self, arrays: list[Any], static: tuple[Any, Any]) -> PreparedProgram | None:
        """The program for such arguments that this process has, or the store; None: neither."""
        called = self._called(arrays, static)
        known = self._ready.get(called)
        if known is None:
            limit_memory_regions()
            known = self._kept(arrays, static)
            if known is None:
                return None
            self._ready[called] = known
        known.last_use = next(_uses)
        return known

    def _kept(self, arrays: list[Any], static: tuple[Any, Any]) -> PreparedProgram | None:
        """What is kept of the program; None: nothing. Whatever is wrong with it, it is made anew."""
        store = _in_use[0] if _in_use else None
        key = None if store is None else self._key(arrays, static, self._options())
        content = store.load(key) if store is not None and key is not None else None
        if content is None:
            return None
        with contextlib.suppress(Exception):
            parts, shapes, size = *unpack_program(content, len(arrays)), len(content)

            def load_or_compile() -> _LoadedProgram:
                with contextlib.suppress(Exception):
                    return _load(parts, shapes, size)
                return self._compiling(arrays, static)[1]()

            return PreparedProgram(shapes, load_or_compile, compiles=False)
        return None

    def _compiling(self, arrays: list[Any], static: tuple[Any, Any]) -> tuple[Any, Callable[[], _LoadedProgram]]:
        """What the program gives, traced and lowered; what compiles it and puts it into the store."""
        results: list[Any] = []
        function: Callable[..., Any] = self._function

        def flat(arrays: list[Any]) -> list[Any]:
            args, kwargs = self._arguments(arrays, static)
            leaves, structure = jax.tree.flatten(function(*args, **kwargs))
            results.append(structure.unflatten([_shape_of(leaf) if eqx.is_array(leaf) else leaf for leaf in leaves]))
            return [leaf for leaf in leaves if eqx.is_array(leaf)]

        lowered, options, store = jax.jit(flat).lower(arrays), self._options(), _in_use[0] if _in_use else None
        key = None if store is None else self._key(arrays, static, options)
        shapes, argument_count = list(filter(_is_shape, jax.tree.leaves(results[0]))), len(arrays)

        def make() -> _LoadedProgram:
            # Parts of a user's own are traced in each process; what they compile to is kept by its operations.
            store_key = key
            if store is not None and key is None:
                with contextlib.suppress(NotCacheableError):
                    store_key = operations_key(lowered.as_text(), options)
            content = store.load(store_key) if store is not None and store_key is not None and key is None else None
            if content is not None:
                with contextlib.suppress(Exception):
                    executable, stored_shapes = unpack_program(content, argument_count)
                    if stored_shapes == shapes:
                        return _load(executable, shapes, len(content))
            compiled, whole = _compiled(lowered, options)
            content = b""
            if whole:
                # Some cannot be serialized, such as those that call back into Python.
                with contextlib.suppress(Exception):
                    content = pack_program(compiled, shapes if key is None else results[0])
            if store is not None and store_key is not None and content:
                store.save(store_key, content)
            _make_room(len(content))
            return_freed_memory()
            return compiled, len(content)

        return results[0], make
