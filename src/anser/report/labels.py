"""Words, symbols and units of a variable as text and as HTML, from its attributes alone."""

import html

import xarray as xr

__all__ = ["label_of", "printed_unit"]

_PRINTED = {
    "m s-1": "m/s",
    "m s-2": "m/s²",
    "m s-4": "m/s⁴",
    "degree": "°",
    "degree s-1": "°/s",
    "percent": "%",
    "1": "",
}


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
