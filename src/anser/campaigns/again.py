"""A flight of a campaign flown again, and whether it is the same."""

from typing import TYPE_CHECKING, Any

import numpy as np

from anser.campaigns.store import CampaignStore
from anser.results.flight_columns import flight_columns
from anser.results.flight_row import FlightRow

if TYPE_CHECKING:
    import xarray as xr

SAME = {"float64": 1e-9, "float32": 1e-5}
"""Of a quantity's scale: what rounding changes between a flight alone and one in a batch, by the precision."""
_SCALES = {"s": 100.0, "m": 1e4, "m s-1": 150.0, "1": 1.0}


def departures(store: CampaignStore, number: int, summary: dict[str, Any], *, met: bool) -> dict[str, float | str]:
    """What differs between a flight flown again and its row.

    Parameters
    ----------
    store
        Of the campaign.
    number
        Of the flight, complete in the store.
    summary, met
        Of the flight flown again.

    Returns
    -------
    By quantity the greatest difference over its scale, where that is more than `SAME` of the campaign's precision; of
    texts what the row says.
    """
    return row_departures(
        store.dataset(), number, FlightRow(summary["aircraft"], summary["fleet"], summary["requirements"], met)
    )


def row_departures(data: "xr.Dataset", number: int, row: FlightRow) -> dict[str, float | str]:
    """As `departures`, of a row that was flown again; the campaign is as `CampaignStore.dataset` gives it."""
    same, data = SAME[data.attrs["precision"]], data.sel(flight=number)
    found: dict[str, float | str] = {}
    for name, (_, values, labels) in flight_columns([row], data.sizes["aircraft"]).items():
        kept, flown = data[name].values, values[0]
        if values.dtype.kind != "f":
            if not np.array_equal(kept, flown):
                found[name] = str(kept)
            continue
        off = np.where(np.isnan(kept) & np.isnan(flown), 0.0, np.abs(kept - flown)) / _SCALES[labels["units"]]
        if not np.all(off <= same):
            found[name] = float(np.max(off))
    return found
