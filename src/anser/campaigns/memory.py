"""How many processes fly a campaign, and in batches of how many flights: as many as the memory of the machine holds."""

from dataclasses import dataclass

from anser.execution.machine import available_memory, usable_cores
from anser.execution.series import SeriesKept
from anser.scenario import Scenario
from anser.simulation import SEGMENT_STEPS

_PROCESS = 1_350_000_000
"""Of a process that flies: libraries, and the most that compiling takes. Measured: docs/how-to/many-flights.md."""
_AIRCRAFT = 500_000
"""Of each aircraft of a batch: tables of its own, state, plans, and what one segment of the flight takes."""
_COPIES = 3
"""Of the series of a batch: as recorded, as one array of each flight, and as written."""
_MB = 1e6


@dataclass(frozen=True)
class Room:
    """How many processes fly.

    Attributes
    ----------
    processes
        How many.
    words
        One line where memory limits something; else empty.
    """

    processes: int
    words: str


def room_for(scenario: Scenario, batch: int, series: SeriesKept | None = None) -> Room:
    """One process for each core, or as many as the memory holds that is free; one at least.

    Parameters
    ----------
    scenario
        What is flown.
    batch
        Flights of one compiled call.
    series
        Variables that are kept of each flight over time; None: none are.
    """
    cores, free = usable_cores(), available_memory()
    if free is None:
        return Room(cores, "")
    needed = _PROCESS + batch * _of_flight(scenario, series)
    processes = max(1, min(cores, free // needed))
    has = f"memory: {free / _MB:,.0f} MB are free, and a process that flies {batch} flights at a time takes"
    has += f" {needed / _MB:,.0f} MB"
    if free < needed:
        return Room(1, f"{has}: one flies, and may be killed for want of memory")
    if processes < cores:
        return Room(processes, f"{has}: {processes} fly, not one for each of {cores} cores")
    return Room(processes, "")


def batch_for(most: int, scenario: Scenario, series: SeriesKept | None = None) -> int:
    """Flights of one compiled call: so many at most, or as many as one process has memory for; one at least."""
    free = available_memory()
    if free is None:
        return most
    return int(max(1, min(most, (free - _PROCESS) // _of_flight(scenario, series))))


def _of_flight(scenario: Scenario, series: SeriesKept | None) -> int:
    """What a flight of a batch takes, bytes."""
    aircraft = len(scenario.aircraft)
    numbers = 0
    if series is not None:
        rows = _COPIES * series.rows(scenario) + 2 * SEGMENT_STEPS // series.recorded_every
        numbers = len(series.keys) * aircraft * rows
    return aircraft * _AIRCRAFT + 8 * numbers
