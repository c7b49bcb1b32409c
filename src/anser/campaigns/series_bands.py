"""How the series of a campaign's flights spread: quantiles over the flights at each time, for its report."""

import numpy as np

from anser.campaigns.store import CampaignStore
from anser.report import SeriesBands
from anser.results.series_values import is_number, variable_of

SHARES = (0.05, 0.5, 0.95)
"""Quantiles that are drawn: the ends of the band, and the line in it."""
_TIMES = 400
_AIRCRAFT = 6
_NUMBERS = 1 << 26
"""Of one variable that are held at once at most: of more flights, evenly spaced ones count."""


def series_bands(store: CampaignStore, flights: np.ndarray) -> tuple[SeriesBands, ...]:
    """Find the bands of what a campaign has kept; empty where it kept nothing, or nothing was flown.

    Parameters
    ----------
    store
        Of the campaign.
    flights
        Numbers of the flights that count, all of them complete.
    """
    if store.kept is None or not flights.size:
        return ()
    data, found = store.series(), []
    times = data["time"].values
    drawn = np.unique(np.linspace(0, times.size - 1, min(times.size, _TIMES)).round().astype(int))
    names = data["aircraft"].values[:_AIRCRAFT].tolist()
    most = max(1, _NUMBERS // (len(names) * drawn.size))
    if flights.size > most:
        flights = flights[np.linspace(0, flights.size - 1, most).round().astype(int)]
    for key in store.kept.keys:
        variable = variable_of(key)
        if not is_number(variable):
            continue
        parts = store.series_of(variable.name, flights)
        values = np.concatenate([part[:, : len(names), drawn] for part in parts])
        bands = quantiles_over(values, circular=variable.unit == "degree")
        label = "" if variable.unit == "1" else variable.unit
        found.append(SeriesBands(variable.name, variable.long_name, label, times[drawn], tuple(names), bands))
    return tuple(found)


def quantiles_over(values: np.ndarray, *, circular: bool) -> np.ndarray:
    """Quantiles over the flights, at each time of each aircraft; NaN where no flight has a number.

    Parameters
    ----------
    values
        Shape (flights, aircraft, times).
    circular
        Whether they are angles in degrees: then they are quantiles of the turn from their mean direction, and a value
        may lie beyond 180.

    Returns
    -------
    Shape (quantiles, aircraft, times).
    """
    found = np.full((len(SHARES), *values.shape[1:]), np.nan)
    known = ~np.isnan(values).all(axis=0)
    some = values[:, known].astype(float)
    if circular:
        turned = np.radians(some)
        middle = np.degrees(np.arctan2(np.nanmean(np.sin(turned), axis=0), np.nanmean(np.cos(turned), axis=0)))
        some = middle + (180.0 - np.mod(180.0 - (some - middle), 360.0))
    if some.size:
        found[:, known] = np.nanquantile(some, SHARES, axis=0)
    return found
