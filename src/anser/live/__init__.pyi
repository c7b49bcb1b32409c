from .notebook import live

__all__ = ["live"]
