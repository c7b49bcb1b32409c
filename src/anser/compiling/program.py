"""Functions that are compiled once per machine.

The module holds the compiled programs of this process, shares programs between processes through a store on disk, and
limits the memory of loaded programs.
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
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, Generic, ParamSpec, TypeAlias, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import Tracer

from anser.compiling.executables import Executable, load_executable, pack_program, unpack_program
from anser.compiling.keys import NotCacheableError, jax_settings, operations_key, program_key
from anser.compiling.measuring import (
    Compilation,
    compilations,
    compiled_elsewhere,
    count_equations,
    measured,
    waiting,
)
from anser.compiling.store import FolderStore

# A step by hand takes half the time without a hand-over between threads. JAX reads the setting with its first array.
jax.config.update("jax_cpu_enable_async_dispatch", False)

_REGIONS = Path("/proc/self/maps")
_REGIONS_MAX = Path("/proc/sys/vm/max_map_count")


def memory_region_share() -> float:
    """Return the used fraction (0..1) of the memory regions that Linux permits a process; 0 on other systems.

    A loaded program takes up to several thousand regions; the system kills a process without free regions.
    """
    try:
        return _REGIONS.read_bytes().count(b"\n") / int(_REGIONS_MAX.read_text())
    except (OSError, ValueError):  # no Linux
        return 0.0


@functools.cache
def _trim() -> Callable[[int], int] | None:
    return getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None


def return_freed_memory() -> None:
    """Return freed memory to the system on Linux: glibc retains the memory that loading a program has used."""
    trim = _trim()
    if trim is not None:
        trim(0)


_P = ParamSpec("_P")
_R = TypeVar("_R")
_T = TypeVar("_T")
_HIT = "/jax/compilation_cache/cache_hits"


_active_stores: list[FolderStore] = []
_LoadedProgram: TypeAlias = tuple[Callable[..., list[Any]], int]
"""Function from a flat list of arrays to a flat list of results, and the size of the code in bytes."""
_programs: "weakref.WeakSet[Program[..., Any]]" = weakref.WeakSet()


def use_program_store(store: FolderStore | None) -> None:
    """Set the store from which programs are loaded and to which compiled programs are saved; None: no store."""
    _active_stores[:] = [] if store is None else [store]


@contextlib.contextmanager
def _pause_garbage_collection() -> Iterator[None]:
    """Pause Python's garbage collector, which takes a third of the time of tracing a large program."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def forget_programs() -> None:
    """Drop every compiled program of this process, as `jax.clear_caches` does for JAX's own programs."""
    for program in _programs:
        program.forget()


def _release_oldest(size: int) -> None:
    """Release the least recently used programs until new code of `size` bytes fits into the limit `_CODE_MAX`."""
    with _release_lock:
        present = [(prepared, program, key) for program in list(_programs) for key, prepared in program]
        total = size + sum(prepared.size for prepared, _, _ in present)
        for prepared, program, key in sorted(present, key=lambda entry: entry[0].last_use):
            if total <= _CODE_MAX:
                break
            program.release(key)
            total -= prepared.size


def limit_memory_regions() -> None:
    """Release every program, including JAX's own, if the process uses half of its permitted memory regions or more.

    Exceeding the limit kills the process. Released programs are loaded or compiled again when needed; the first release
    logs a warning.
    """
    if memory_region_share() >= _REGIONS_SHARE_MAX:
        _log_crowding()
        release_all_programs()


def release_all_programs() -> None:
    """Release every program, including JAX's own, and return the memory to the system."""
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


class _ArrayMarker:
    """Placeholder for an array among the static parts of arguments."""


_cache_hits: list[int] = []
"""Identifiers of the threads in which JAX's own persistent cache supplied a program, one entry per program."""
_executor = ThreadPoolExecutor(2, "anser-compiling")
_CODE_MAX = 44 << 20
"""Greatest total size of the stored code of a process's programs, bytes. In memory, a loaded program takes about 18
times the size of its stored code, a newly compiled program 38 times."""
_REGIONS_SHARE_MAX = 0.5
_LARGE = 5 << 19
"""Size of stored code above which programs are loaded one after another, bytes."""
_LOG = logging.getLogger(__name__)
_uses = itertools.count()
_release_lock = threading.Lock()
_load_lock = threading.Lock()
_setting_lock = threading.Lock()
_former_minimums: list[float] = []


@functools.cache
def _listen() -> None:
    jax.monitoring.register_event_listener(
        lambda event, **_: _cache_hits.append(threading.get_ident()) if event == _HIT else None
    )


@contextlib.contextmanager
def _bypass_jax_cache() -> Iterator[None]:
    """Keep JAX from writing programs to its own persistent cache in the `with` block, in every thread."""
    setting = "jax_persistent_cache_min_compile_time_secs"
    with _setting_lock:
        _former_minimums.append(getattr(jax.config, setting))
        jax.config.update(setting, math.inf)
    try:
        yield
    finally:
        with _setting_lock:
            # The first entry is the original setting: the last of concurrent blocks to end restores it.
            former_minimum = _former_minimums.pop(0) if len(_former_minimums) == 1 else _former_minimums.pop(1)
            jax.config.update(setting, former_minimum)


def _strip_locations(lowered: Any) -> None:
    """Remove source-code locations from a lowered program, because code without them is smaller and loads sooner."""
    with contextlib.suppress(Exception):  # another version of JAX: the program keeps the lines
        from jax._src.lib.mlir import passmanager  # pyright: ignore[reportPrivateImportUsage]

        module = lowered.compiler_ir()
        with module.context:
            passmanager.PassManager.parse("builtin.module(strip-debuginfo)").run(module.operation)


@functools.cache
def _is_supported(options: frozenset[tuple[str, bool | str]]) -> bool:
    """Whether the installed compiler accepts compiler options; a trivial program is compiled once as a test."""
    probe = jax.jit(lambda x: x + 1).lower(jax.ShapeDtypeStruct((), jnp.int32))
    try:
        probe.compile(dict(options))
    except jax.errors.JaxRuntimeError as error:
        if not any(option in str(error) for option, _ in options):
            raise
        return False
    return True


def supported_options(requested: dict[str, bool | str]) -> dict[str, bool | str]:
    """Return the requested compiler options without those that the installed version of XLA rejects."""
    if not requested or _is_supported(frozenset(requested.items())):
        return requested
    return {option: value for option, value in requested.items() if _is_supported(frozenset([(option, value)]))}


def _compile_serializable(lowered: Any, options: dict[str, bool | str]) -> tuple[Any, bool]:
    """Return the compiled program, and whether XLA can serialize it: True unless it came from JAX's own cache."""
    _listen()
    thread = threading.get_ident()
    former_hits = _cache_hits.count(thread)
    with _bypass_jax_cache():
        return lowered.compile(supported_options(options) or None), _cache_hits.count(thread) == former_hits


def _load(executable: Executable, result: Any, size: int) -> _LoadedProgram:
    """Load a program with code of `size` bytes; `result` has `jax.ShapeDtypeStruct` in place of arrays."""
    # Loading takes as much extra memory as the loaded program.
    with _load_lock if size > _LARGE else contextlib.nullcontext():
        _release_oldest(size)
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


def strongly_typed(value: _T) -> _T:
    """Return `value` without weak types of its arrays, because JAX would compile another program for weak types."""
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, leaf.dtype) if eqx.is_array(leaf) else leaf, value)


def _restore_structure(compiled: Callable[..., list[Any]], result: Any) -> Callable[[list[Any]], Any]:
    """Wrap a compiled function with a flat list of results, so that the results have the structure of `result`."""
    leaves, structure = jax.tree.flatten(result)
    array_indices = [k for k, leaf in enumerate(leaves) if _is_shape(leaf)]

    def call(arrays: list[Any]) -> Any:
        result_leaves = list(leaves)
        for index, array in zip(array_indices, compiled(arrays), strict=True):
            result_leaves[index] = array
        return structure.unflatten(result_leaves)

    return call


class PreparedProgram:
    """A program for arguments of certain shapes that is loaded or compiled in a background thread.

    A stored program starts to load at once; a new program starts to compile when `start` is called. `shapes` is the
    result of the program, with `jax.ShapeDtypeStruct` in place of arrays.
    """

    def __init__(self, shapes: Any, lower: Callable[[], Callable[[], _LoadedProgram]], *, compiles: bool) -> None:
        self.shapes, self._compiles = shapes, compiles
        self._lower, self._result = lower, None  # the result of `lower` loads or compiles the program
        self._future: Future[_LoadedProgram] | None = None  # loading or compilation in the background
        self.size = 0  # code size, bytes; 0 until loaded or compiled
        self.last_use = next(_uses)  # value at the last use of a counter common to every program
        if not compiles:
            self.start()

    def start(self) -> "PreparedProgram":
        """Lower the program, and start to compile it in a background thread unless already started; return self."""
        if self._result is None:
            self._future = _executor.submit(self._lower())
            self._result = self._future.result
        return self

    @property
    def is_compiling(self) -> bool:
        """Whether the program is being compiled in the background; false while a stored program is loaded."""
        return self._compiles and self._future is not None and not self._future.done()

    @functools.cached_property
    def function(self) -> Callable[[list[Any]], Any]:
        """The compiled function of a list of arrays; the first access waits until the program is loaded or compiled."""
        with waiting() if self._compiles else contextlib.nullcontext():
            loaded = self._lower()() if self._result is None else self._result()
        self._result = lambda: loaded
        del self._lower  # with the arrays of the first call
        self.size = loaded[1]
        return _restore_structure(loaded[0], self.shapes)


class Program(Generic[_P, _R]):
    """A function of arrays, compiled for each combination of structure, shapes and static arguments.

    If a store is active (`use_program_store`), a program that another process has stored is neither traced nor
    compiled. Inside another compiled function or a derivative, the function is inlined.
    """

    def __init__(
        self,
        function: Callable[_P, _R],  # pure function
        options: dict[str, bool | str],  # for the compiler, if supported
        # names of static arguments, as in `jax.jit`; other arguments are traced. None: every argument without arrays
        # is static
        static_argnames: Sequence[str] | None = None,
        title: str | None = None,  # name for the user; default: the function's name in words
    ) -> None:
        functools.update_wrapper(self, function)
        name = str(getattr(getattr(function, "func", function), "__name__", "program"))
        self.title = title or name.strip("_").removesuffix("_compiled").replace("_", " ")
        self._function, self._options, self._static = function, options, static_argnames
        self._ready: dict[Any, PreparedProgram] = {}
        _programs.add(self)

    @functools.cached_property
    def _inner_function(self) -> Callable[..., Any]:
        """The program's function without its compiler options, which JAX accepts only for the outermost function."""
        if self._static is None:
            return eqx.filter_jit(self._function)
        return jax.jit(self._function, static_argnames=self._static)

    @functools.cached_property
    def _signature(self) -> inspect.Signature:
        return inspect.signature(self._function)

    def __call__(self, *args: _P.args, **kwargs: _P.kwargs) -> _R:
        """Call the function, compiled for the arguments."""
        return self.ready(*args, **kwargs)()

    def ready(self, *args: _P.args, **kwargs: _P.kwargs) -> Callable[[], _R]:
        """Load or compile the program for the arguments; return a function without arguments that calls the program.

        If the arguments are traced, or JAX's settings disable compilation or stop at NaN, JAX itself runs the function.
        """
        traced = any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((args, kwargs)))
        if traced or jax.config.jax_disable_jit or jax.config.jax_debug_nans:  # pyright: ignore[reportAttributeAccessIssue]
            return functools.partial(self._inner_function, *args, **kwargs)
        arrays, static = self._split_arguments(args, kwargs)
        prepared = self._find(arrays, static)
        if prepared is None:
            with waiting():
                return functools.partial(self._find_or_trace(arrays, static).function, arrays)
        return functools.partial(prepared.function, arrays)

    def prepare(self, *args: Any, **kwargs: Any) -> PreparedProgram:
        """Return the program for the arguments without calling it; `jax.ShapeDtypeStruct` may replace arrays.

        A stored program starts to load at once. A new program is traced; its compilation starts with `start`.
        """
        return self._find_or_trace(*self._split_arguments(args, kwargs))

    def forget(self) -> None:
        """Drop the compiled programs of this function."""
        self._ready.clear()

    def release(self, key: Any) -> None:
        """Drop the compiled program with a key from `__iter__`; running calls keep the program alive."""
        self._ready.pop(key, None)

    def __iter__(self) -> Iterator[tuple[Any, PreparedProgram]]:
        """Iterate over pairs of key and compiled program."""
        return iter(list(self._ready.items()))

    def _split_arguments(self, args: Any, kwargs: Any) -> tuple[list[Any], tuple[Any, tuple[Any, ...]]]:
        """Return the arrays among the arguments, and the hashable pair of pytree structure and static arguments."""
        if self._static is None:
            leaves, structure = jax.tree.flatten((args, kwargs))
            return [leaf for leaf in leaves if _is_array(leaf)], (
                structure,
                tuple(_ArrayMarker if _is_array(leaf) else leaf for leaf in leaves),
            )
        arguments = self._signature.bind(*args, **kwargs).arguments
        # Python numbers become weakly typed arrays, as in `jax.jit`.
        traced = {
            name: jax.tree.map(lambda leaf: leaf if _is_array(leaf) else jnp.asarray(leaf), value)
            for name, value in arguments.items()
            if name not in self._static
        }
        leaves, structure = jax.tree.flatten(traced)
        return leaves, (structure, tuple((name, arguments[name]) for name in self._static if name in arguments))

    def _join_arguments(self, arrays: Sequence[Any], static: tuple[Any, tuple[Any, ...]]) -> tuple[Any, Any]:
        structure, static_leaves = static
        if self._static is None:
            remaining = iter(arrays)
            return structure.unflatten([next(remaining) if leaf is _ArrayMarker else leaf for leaf in static_leaves])
        return (), structure.unflatten(arrays) | dict(static_leaves)

    def _key(self, arrays: list[Any], static: tuple[Any, Any]) -> str | None:
        """Return the store's key of the program for these arguments; None if the program cannot be stored."""
        try:
            arguments = self._join_arguments(list(map(_shape_of, arrays)), static)
            return program_key((self._function, arguments, self._options))
        except NotCacheableError:
            return None

    def _find_or_trace(self, arrays: list[Any], static: tuple[Any, Any]) -> PreparedProgram:
        """Return the program for these arguments, from memory or the store, or newly traced and not yet compiled."""
        prepared = self._find(arrays, static)
        if prepared is None:
            with waiting():
                prepared = PreparedProgram(*self._trace(arrays, static), compiles=True)
            self._ready[self._call_key(arrays, static)] = prepared
        return prepared

    def _call_key(self, arrays: list[Any], static: tuple[Any, Any]) -> Any:
        shapes = tuple((array.shape, array.dtype, getattr(array, "weak_type", False)) for array in arrays)
        return static, shapes, jax_settings()

    def _find(self, arrays: list[Any], static: tuple[Any, Any]) -> PreparedProgram | None:
        """Return the program for these arguments from memory or the store, or None."""
        key = self._call_key(arrays, static)
        prepared = self._ready.get(key)
        if prepared is None:
            limit_memory_regions()
            prepared = self._load_stored(arrays, static)
            if prepared is None:
                return None
            self._ready[key] = prepared
        prepared.last_use = next(_uses)
        return prepared

    def _load_stored(self, arrays: list[Any], static: tuple[Any, Any]) -> PreparedProgram | None:
        """Return the program for these arguments from the store, or None. A program whose loading fails is compiled."""
        store = _active_stores[0] if _active_stores else None
        key = None if store is None else self._key(arrays, static)
        content = store.load(key) if store is not None and key is not None else None
        if content is None:
            return None
        with contextlib.suppress(Exception):
            parts, shapes, size = *unpack_program(content, len(arrays)), len(content)

            def load_or_compile() -> _LoadedProgram:
                with contextlib.suppress(Exception):
                    return _load(parts, shapes, size)
                return self._trace(arrays, static)[1]()()

            return PreparedProgram(shapes, lambda: load_or_compile, compiles=False)
        return None

    def _trace(
        self, arrays: list[Any], static: tuple[Any, Any]
    ) -> tuple[Any, Callable[[], Callable[[], _LoadedProgram]]]:
        """Trace the program; return its result with `jax.ShapeDtypeStruct` in place of arrays, and a lowering function.

        The lowering function returns a second function, which compiles and stores the program, or loads the program if
        another process has stored it meanwhile.
        """
        results: list[Any] = []
        function: Callable[..., Any] = self._function

        def flat(arrays: list[Any]) -> list[Any]:
            args, kwargs = self._join_arguments(arrays, static)
            leaves, structure = jax.tree.flatten(strongly_typed(function(*args, **kwargs)))
            results.append(structure.unflatten([_shape_of(leaf) if eqx.is_array(leaf) else leaf for leaf in leaves]))
            return [leaf for leaf in leaves if eqx.is_array(leaf)]

        store = _active_stores[0] if _active_stores else None
        key = None if store is None else self._key(arrays, static)
        record = Compilation(self.title, self._options)
        compilations.append(record)

        def translate(phase: str, step: Callable[[], Any]) -> Any:
            try:
                with _pause_garbage_collection(), measured(record, phase):
                    return step()
            except BaseException:
                compilations.remove(record)
                raise

        traced = translate("tracing", lambda: jax.jit(flat).trace(arrays))
        record.equations = count_equations(traced.jaxpr.jaxpr)
        shapes, argument_count = list(filter(_is_shape, jax.tree.leaves(results[0]))), len(arrays)

        def lower() -> Callable[[], _LoadedProgram]:
            # Unused arguments are left out of the lowered text: with them, XLA's older code generator ends the process.
            lowered = translate("lowering", traced.lower)
            _strip_locations(lowered)
            return functools.partial(make, lowered)

        def make(lowered: Any) -> _LoadedProgram:
            # Code from outside the package is traced in each process, and stored under a key of its operations.
            store_key = key
            if store is not None and key is None:
                with contextlib.suppress(NotCacheableError, AttributeError, KeyError):
                    # The operations identify a program only together with the arguments that they use.
                    used = sorted(lowered._lowering.compile_args["kept_var_idx"])
                    store_key = operations_key(f"{used}\n{lowered.as_text()}", self._options)
            if store is None or store_key is None:
                return compile_and_save(lowered, None)
            # Workers of a campaign need the same programs at the same time: one compiles, the others wait and load.
            with contextlib.ExitStack() as reserved:
                with compiled_elsewhere(record):
                    reserved.enter_context(store.reserve(store_key))
                content = store.load(store_key)
                if content is not None:
                    with contextlib.suppress(Exception):
                        executable, stored = unpack_program(content, argument_count)
                        if key is not None or stored == shapes:
                            loaded = _load(executable, stored, len(content))
                            compilations.remove(record)
                            return loaded
                return compile_and_save(lowered, store_key)

        def compile_and_save(lowered: Any, store_key: str | None) -> _LoadedProgram:
            with measured(record, "compiling"):
                compiled, whole = _compile_serializable(lowered, self._options)
            record.is_compiled = True
            content = b""
            if whole:
                # Programs that call back into Python, among others, cannot be serialized.
                with contextlib.suppress(Exception):
                    content = pack_program(compiled, shapes if key is None else results[0])
            record.code_bytes = len(content)
            if store is not None and store_key is not None and content:
                store.save(store_key, content)
            _release_oldest(len(content))
            return_freed_memory()
            return compiled, len(content)

        return results[0], lower
