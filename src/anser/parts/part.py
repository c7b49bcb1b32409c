"""Base of the interfaces of the closed loop's parts."""

import inspect
from typing import Any

import equinox as eqx


class AbstractPart(eqx.Module):
    """Base of the interfaces of user-defined parts.

    The definition of a subclass raises TypeError if a field of it has the name of a method of a base class.
    """

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        for base in cls.__mro__[1:]:
            methods = {name for name, value in vars(base).items() if callable(value) or isinstance(value, property)}
            clashes = [name for name in inspect.get_annotations(cls) if name in methods and not name.startswith("__")]
            if clashes and base is not AbstractPart:
                raise TypeError(
                    f"{cls.__qualname__}: the field {clashes[0]!r} has the name of a method of {base.__qualname__}; "
                    "choose another name for the field"
                )
