"""Events are those of the record: when the plan changed and how, phases, limits touched."""

from anser.report.derived_variables import LIMITED_COMMANDS, REPLANNING_OUTCOMES, find_events


def test_renewals_are_where_the_plan_changed(flight):
    renewals = [(time, REPLANNING_OUTCOMES[what]) for time, what in find_events(flight[0])[0]["renewals"]]
    # the made-up length changes every 10 s up to 70 s; from 40 s to 50 s the plan is told to be made anew
    fitted = REPLANNING_OUTCOMES[0]
    assert renewals == [
        *((time, fitted) for time in (10.0, 20.0, 30.0)),
        (40.0, "planned anew"),
        *((time, fitted) for time in (50.0, 60.0, 70.0)),
    ]


def test_a_new_arrival_time_tells_of_a_plan_made_anew(flight):
    dataset = flight[0].copy(deep=True)
    dataset["arrival_time_s"].values[dataset["time"].values >= 15.0, 1] = 82.0
    assert [15.0, REPLANNING_OUTCOMES.index("planned anew")] in find_events(dataset)[1]["renewals"]


def test_phases_and_limits_follow_one_another_without_a_hole(flight):
    for one in find_events(flight[0]):
        names, starts, ends = zip(*one["phases"], strict=True)
        assert names == ("approach", "frozen", "hold")
        assert starts == (0.0, *ends[:-1])
        assert ends == (70.0, 80.0, 130.0)
        ((what, start, end),) = one["limited"]
        assert list(LIMITED_COMMANDS)[what] == "thrust"
        assert (start, end) == (20.025, 25.0)
        assert one["failed"] == one["outside"] == []
