"""Compiling once per machine, what is kept of it on disk and in memory, compiler options, a step as one kernel."""

from anser.compiling.cache import cache_folder, enable_compilation_cache, program_store
from anser.compiling.one_kernel import as_one_kernel, in_one_kernel
from anser.compiling.options import compiled, compiled_by_older_generator, compiled_quickly
from anser.compiling.program import (
    Prepared,
    Program,
    ProgramStore,
    forget_programs,
    keep_within_regions,
    release_all,
    use_program_store,
    watching,
)
from anser.compiling.store import FolderStore

__all__ = [
    "FolderStore",
    "Prepared",
    "Program",
    "ProgramStore",
    "as_one_kernel",
    "cache_folder",
    "compiled",
    "compiled_by_older_generator",
    "compiled_quickly",
    "enable_compilation_cache",
    "forget_programs",
    "in_one_kernel",
    "keep_within_regions",
    "program_store",
    "release_all",
    "use_program_store",
    "watching",
]
