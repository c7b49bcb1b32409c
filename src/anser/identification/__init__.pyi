from .estimates import Estimate

__all__ = ["Estimate"]
