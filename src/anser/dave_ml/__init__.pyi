from .elements import DaveMlError
from .evaluator import Evaluator
from .model import Model, read_dave_ml
from .writer import write_dave_ml

__all__ = [
    "DaveMlError",
    "Evaluator",
    "Model",
    "read_dave_ml",
    "write_dave_ml",
]
