from .options import cache_folder, enable_compilation_cache
from .program import forget_programs
from .store import FolderStore

__all__ = [
    "FolderStore",
    "cache_folder",
    "enable_compilation_cache",
    "forget_programs",
]
