from .options import cache_folder, enable_compilation_cache

__all__ = [
    "cache_folder",
    "enable_compilation_cache",
]
