"""Results of a flight: a labelled dataset, a file of it, a summary, and the software that computed them."""

from anser.results.arrival import closest_approach, least_distance
from anser.results.dataset import to_dataset
from anser.results.envelope_dataset import RESERVE_MIN, envelope_dataset
from anser.results.envelope_reasons import OUTCOMES, REASONS, Verdicts, judge
from anser.results.linear_model import LINEAR_FORMAT_VERSION, linear_dataset, linear_document, unit_of
from anser.results.netcdf import read_netcdf, write_netcdf
from anser.results.provenance import versions
from anser.results.requirements import REQUIREMENT_NAMES, Requirement
from anser.results.summary import FORMAT_VERSION, FlightFacts, read_summary, summarize, write_summary

__all__ = [
    "FORMAT_VERSION",
    "LINEAR_FORMAT_VERSION",
    "OUTCOMES",
    "REASONS",
    "REQUIREMENT_NAMES",
    "RESERVE_MIN",
    "FlightFacts",
    "Requirement",
    "Verdicts",
    "closest_approach",
    "envelope_dataset",
    "judge",
    "least_distance",
    "linear_dataset",
    "linear_document",
    "read_netcdf",
    "read_summary",
    "summarize",
    "to_dataset",
    "unit_of",
    "versions",
    "write_netcdf",
    "write_summary",
]
