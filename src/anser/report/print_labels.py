"""Labels of printed figures, from the attributes that variables have from the catalogue."""

import textwrap

import xarray as xr

from anser.report.labels import printed_unit

__all__ = ["axis_label", "plain", "symbol", "unit"]

_LINE_LENGTH, _SIGN_LENGTH = 26, 8
"""Characters of a label before it goes on in another line; those that a symbol with its unit takes of them."""


def axis_label(values: xr.DataArray, words: str | None = None) -> str:
    """Words, symbol and unit of a variable, long ones in several lines; other words where they are given."""
    lines = textwrap.wrap(str(values.attrs["long_name"]) if words is None else words, _LINE_LENGTH)
    printed = unit(values)
    sign = symbol(values) + (f" ({printed})" if printed else "")
    # The symbol goes on in the last line where there is room for it.
    text, between = "\n".join(lines), " " if len(lines[-1]) <= _LINE_LENGTH - _SIGN_LENGTH else "\n"
    return f"{text}{between}{sign}"


def symbol(values: xr.DataArray) -> str:
    """Symbol of a variable as matplotlib sets it: `p_N` with a subscript."""
    base, _, subscript = str(values.attrs["symbol"]).partition("_")
    return f"${base}_{{{subscript}}}$" if subscript else f"${base}$"


def unit(values: xr.DataArray) -> str:
    """Unit of a variable as it is printed; empty where there is none."""
    return printed_unit(str(values.attrs["units"]))


def plain(text: object) -> str:
    """Text from a file, of which matplotlib is to read nothing as mathematics."""
    return str(text).replace("$", r"\$")
