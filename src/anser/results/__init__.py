"""Results of a flight: a labelled dataset, a file of it, a summary, and the software that computed them."""

from anser.results.arrival import closest_approach, least_distance
from anser.results.dataset import to_dataset
from anser.results.netcdf import read_netcdf, write_netcdf
from anser.results.provenance import versions
from anser.results.requirements import REQUIREMENT_NAMES, Requirement
from anser.results.summary import FORMAT_VERSION, FlightFacts, read_summary, summarize, write_summary

__all__ = [
    "FORMAT_VERSION",
    "REQUIREMENT_NAMES",
    "FlightFacts",
    "Requirement",
    "closest_approach",
    "least_distance",
    "read_netcdf",
    "read_summary",
    "summarize",
    "to_dataset",
    "versions",
    "write_netcdf",
    "write_summary",
]
