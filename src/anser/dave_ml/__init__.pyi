from .definition import Definition
from .elements import DaveMlError
from .evaluator import Evaluator
from .model import CheckResult, Model, adapt_model, read_dave_ml
from .writer import write_dave_ml

__all__ = [
    "CheckResult",
    "DaveMlError",
    "Definition",
    "Evaluator",
    "Model",
    "adapt_model",
    "read_dave_ml",
    "write_dave_ml",
]
