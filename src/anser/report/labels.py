"""Words, symbols and units of a variable, from its attributes alone: as text, as HTML and for printed figures."""

import html
import textwrap

import xarray as xr

_PRINTED = {
    "m s-1": "m/s",
    "m s-2": "m/s²",
    "m s-4": "m/s⁴",
    "degree": "°",
    "degree s-1": "°/s",
    "percent": "%",
    "1": "",
}
_LINE_LENGTH, _SIGN_LENGTH = 26, 8
"""Characters of a label before it goes on in another line; those that a symbol with its unit takes of them."""
_FIVE_DIGITS = 10_000.0


def printed_unit(unit: str) -> str:
    """Print a unit as people write it; empty where there is none."""
    return _PRINTED.get(unit, unit)


def label_of(values: xr.DataArray) -> dict[str, str]:
    """Label of a variable: `words`, `unit` as text, and `symbol` as HTML with its subscript.

    Parameters
    ----------
    values
        Variable with the attributes `long_name`, `units`, `symbol`.
    """
    base, _, subscript = html.escape(str(values.attrs["symbol"])).partition("_")
    return {
        "words": str(values.attrs["long_name"]),
        "unit": printed_unit(str(values.attrs["units"])),
        "symbol": f"<i>{base}</i>" + (f"<sub>{subscript}</sub>" if subscript else ""),
    }


def axis_label(
    values: xr.DataArray, words: str | None = None, in_unit: str | None = None, length: int = _LINE_LENGTH
) -> str:
    """Words, symbol and unit of a variable, long ones in several lines; other words or another unit where given."""
    lines = textwrap.wrap(str(values.attrs["long_name"]) if words is None else words, length)
    printed = unit(values) if in_unit is None else in_unit
    sign = symbol(values) + (f" ({printed})" if printed else "")
    # The symbol goes on in the last line where there is room for it.
    text, between = "\n".join(lines), " " if len(lines[-1]) <= length - _SIGN_LENGTH else "\n"
    return f"{text}{between}{sign}"


def shown_in(values: xr.DataArray, greatest: float) -> tuple[float, str]:
    """Factor and printed unit in which an axis up to `greatest` is drawn: kilometres where metres have five digits."""
    if str(values.attrs["units"]) == "m" and greatest >= _FIVE_DIGITS:
        return 1e-3, "km"
    return 1.0, unit(values)


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
