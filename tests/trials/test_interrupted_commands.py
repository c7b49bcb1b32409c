"""A sample of the trials of interrupted commands, and the definition of their faults."""

import random

import pytest

from trials.interrupted_commands import COMMANDS, Ended, faults_of, interrupt, prepare

STOPPED = Ended(130, "stopped\n", 1.0, 0.1)


@pytest.mark.long
def test_a_command_interrupted_at_random_moments_of_its_imports_stops_with_one_message(tmp_path):
    faults, line = interrupt("new", tmp_path, 3, random.Random(1))
    assert faults == []
    assert line.startswith("new: ")


@pytest.mark.parametrize(
    ("command", "ended", "files", "fault"),
    [
        ("run", STOPPED, set(), None),
        ("run", STOPPED, {"out", "out/flight.nc"}, None),
        ("run", Ended(0, "", 1.0, 0.1), {"out", "out/flight.nc"}, None),
        ("campaign", STOPPED, {"out", "out/flights.zarr"}, None),
        ("run", STOPPED, {"out"}, "files ['out'] instead of"),
        ("run", STOPPED, {"out", "out/flight.nc", "out/.anser-1"}, "temporary files"),
        ("run", Ended(3, "", 1.0, 0.1), set(), "exit code 3"),
        ("run", Ended(-2, "", 1.0, 0.1), set(), "exit code -2"),
        ("run", Ended(0, "", 1.0, 0.1), set(), "exit code 0 with 0 of 2 files"),
        ("run", Ended(130, "stopped\nstopped\n", 1.0, 0.1), set(), "messages"),
        ("run", Ended(130, "Traceback\nstopped\n", 1.0, 0.1), set(), "messages"),
    ],
)
def test_files_and_messages_of_interrupted_commands_are_assessed(command, ended, files, fault):
    faults = faults_of(command, ended, files, {"out", "out/flight.nc"})
    assert faults == [] if fault is None else fault in faults[0]


@pytest.mark.long
@pytest.mark.parametrize("command", [name for name in COMMANDS if name not in ("new", "envelope", "margins")])
def test_each_long_command_stops_with_one_message_and_nothing_half_written(command, tmp_path):
    prepare(tmp_path)
    assert interrupt(command, tmp_path, 3, random.Random(2))[0] == []
