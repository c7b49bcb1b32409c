"""Events of a record: changes of the plan, phases, limited commands."""

from anser.report.derived_variables import LIMITED_COMMANDS, REPLANNING_OUTCOMES, find_events


def test_replanning_events_are_changes_of_the_plan(flight):
    renewals = [(time, REPLANNING_OUTCOMES[outcome]) for time, outcome in find_events(flight[0])[0]["renewals"]]
    # the made-up length changes every 10 s up to 70 s; from 40 s to 50 s the plan is told to be made anew
    fitted = REPLANNING_OUTCOMES[0]
    assert renewals == [
        *((time, fitted) for time in (10.0, 20.0, 30.0)),
        (40.0, "planned anew"),
        *((time, fitted) for time in (50.0, 60.0, 70.0)),
    ]


def test_a_new_arrival_time_is_an_event_of_a_new_plan(flight):
    dataset = flight[0].copy(deep=True)
    dataset["arrival_time_s"].values[dataset["time"].values >= 15.0, 1] = 82.0
    assert [15.0, REPLANNING_OUTCOMES.index("planned anew")] in find_events(dataset)[1]["renewals"]


def test_phases_are_contiguous_and_limited_commands_are_recorded(flight):
    for events in find_events(flight[0]):
        names, starts, stops = zip(*events["phases"], strict=True)
        assert names == ("approach", "frozen", "hold")
        assert starts == (0.0, *stops[:-1])
        assert stops == (70.0, 80.0, 130.0)
        ((command, start, end),) = events["limited"]
        assert list(LIMITED_COMMANDS)[command] == "thrust"
        assert (start, end) == (20.025, 25.0)
        assert events["failed"] == events["outside"] == []
