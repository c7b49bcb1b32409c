"""Random scenarios, planned and checked: a few seeds, and deliberately wrong planners.

The 2,000 seeds of `make plan-trials` take hours and are no test. The fifty seeds here have plans among the planner's
first candidates, or are proved infeasible, so that few programs are compiled.
"""

import dataclasses
import json
import sys

import jax
import numpy as np
import pytest

from trials import runner
from trials.__main__ import main
from trials.cases import random_case
from trials.data import Paths
from trials.runner import Answer, Trial, run_trial
from trials.tally import CONTRADICTED_MOST, tally
from trials.task import planner_task
from trials.trial_file import TrialFileError, append_trial, begin_trials, read_trials

PLANNED = [
    1, 7, 8, 10, 11, 13, 17, 18, 23, 25, 26, 29, 33, 37, 42, 43, 44, 48, 50, 55, 56, 59, 61,
    67, 81, 82, 87, 89, 91, 93, 98, 99, 105, 106, 107, 109, 111, 116, 117, 118, 122, 125, 138, 142, 148, 149, 151,
]  # fmt: skip
REFUSED = (103, 143, 171)  # rendezvous inside keep-outs
POSSIBLE = 91  # the search finds a plan in a few hundred iterations
IMPOSSIBLE = 6  # a rendezvous inside a keep-out


def _refuse(case):
    return Answer(None, np.empty(0), 1, {"path": [0]})


def _fly_straight(case):
    """Plan straight lines from each start to the goal's position after 100 s, at rest at both ends."""
    times = np.tile([0.0, 100.0], (case.size, 1))
    knots = np.zeros((case.size, 2, 3, 3))
    knots[:, 0, 0] = case.starts.position_n
    for aircraft in range(case.size):
        knots[aircraft, 1, 0] = case.goals.meeting_n(aircraft, np.array([100.0]))[0]
    return Answer(Paths(times, knots, np.zeros_like(knots)), times[:, 1], 1, {})


def _raise(case):
    raise FloatingPointError("no number")


def _trial(seed, verdict, rule="at", **fields):
    return Trial(seed, 2, rule, verdict, 0.1, 0.2, **fields)


@pytest.mark.long
@pytest.mark.parametrize("seed", PLANNED)
def test_plan_of_random_scenario_passes(seed):
    trial = run_trial(seed, 0)
    assert trial.planned, trial
    assert trial.verdict == "passes", trial.breaches
    assert trial.excess["arrival_position"] < 1e-3  # the tolerance of the check


@pytest.mark.long
@pytest.mark.parametrize("seed", REFUSED)
def test_refusal_of_random_scenario_is_proved(seed):
    trial = run_trial(seed, 100)
    assert not trial.planned
    assert trial.verdict == "proved", trial
    assert trial.reasons


def test_fifty_scenarios_with_every_rule_that_sets_times_are_among_these():
    assert len({*PLANNED, *REFUSED}) == 50
    rules = {random_case(seed).rule.name for seed in PLANNED}
    assert rules == {"together", "at", "sequence", "times", "windows"}


def test_all_cases_share_the_planner_programs():
    def shapes(seed):
        return jax.tree.map(lambda leaf: (leaf.shape, leaf.dtype), planner_task(random_case(seed))[:2])

    reference = shapes(0)
    sizes = {
        (random_case(k).size, random_case(k).wind.altitudes.size, random_case(k).keep_outs.radius.size)
        for k in range(30)
    }
    assert {len(set(kind)) for kind in zip(*sizes, strict=True)} == {7, 4, 5}  # 2 to 8, 1 to 4, 0 to 4: none left out
    assert all(shapes(seed) == reference for seed in range(1, 30))


@pytest.mark.parametrize("seed", range(5))
def test_a_task_states_its_case(seed):
    case = random_case(seed)
    task = planner_task(case)
    n = case.size
    assert np.array_equal(np.asarray(task.tasks.active), np.arange(8) < n)
    altitude = np.linspace(0.0, 9000.0, 50)
    wind_n = jax.vmap(lambda up: task.airspace.wind.at(jax.numpy.stack([0.0 * up, 0.0 * up, -up]), 0.0))(altitude)
    assert np.allclose(np.asarray(wind_n).T, case.wind.at(altitude), atol=1e-12)
    air = np.asarray(task.tasks.air_velocity_n)[:n]
    winds = np.stack([case.wind.at(np.array(-p[2])) for p in case.starts.position_n])
    assert np.allclose(air + winds, case.starts.velocity_n, atol=1e-12)
    meeting = np.asarray(task.tasks.goal_position_n + task.tasks.rendezvous.stand_off_n)[:n]
    later = meeting + 60.0 * np.asarray(task.tasks.goal_velocity_n)[:n]
    meeting_points = np.stack([case.goals.meeting_n(aircraft, np.array([60.0]))[0] for aircraft in range(n)])
    assert np.allclose(later, meeting_points, atol=1e-9)  # rounding at 30 km
    for name in ("speed_min", "bank_max", "load_factor_max", "deceleration_max"):
        assert np.array_equal(np.asarray(getattr(task.tasks.limits, name))[:n], getattr(case.limits, name))


def test_a_case_beyond_the_planners_input_is_refused():
    case = random_case(0)
    moving = dataclasses.replace(case.starts, acceleration_n=np.ones((case.size, 3)))
    with pytest.raises(ValueError, match="accelerate"):
        planner_task(dataclasses.replace(case, starts=moving))
    later = dataclasses.replace(case.goals, times=np.ones((case.size, 1)))
    with pytest.raises(ValueError, match="waypoints"):
        planner_task(dataclasses.replace(case, goals=later))


def test_wrong_plan_fails_with_its_figures():
    trial = run_trial(POSSIBLE, 0, _fly_straight)
    assert trial.verdict == "fails"
    kinds = {breach["kind"] for breach in trial.breaches}
    assert {"speed_min", "start_velocity"} <= kinds
    case = random_case(POSSIBLE)
    assert trial.excess["speed_min"] > case.limits.speed_min.max() - 25.0  # it stands still in winds of up to 20 m/s
    shown = tally([trial])
    assert not shown.passes
    assert "speed_min of 0" in shown.disagreements[0]


@pytest.mark.long
def test_wrong_refusal_is_contradicted_by_a_plan():
    trial = run_trial(POSSIBLE, 1000, _refuse)
    assert trial.verdict == "found"
    assert len(trial.found) == trial.size
    case = random_case(POSSIBLE)
    for description, low, high in zip(trial.found, case.limits.speed_min, case.limits.speed_max, strict=True):
        assert low - 1e-3 <= description["speed_least_m_s"] <= description["speed_greatest_m_s"] <= high + 1e-3
        assert description["length_of_straight"] >= 1.0 - 1e-9
    assert not tally([trial]).passes


def test_right_refusal_is_proved():
    trial = run_trial(IMPOSSIBLE, 1000, _refuse)
    assert trial.verdict == "proved"
    assert "keep-out" in trial.reasons[0]
    assert tally([trial]).passes


def test_planner_that_raises_is_named_and_fails():
    trial = run_trial(0, 0, _raise)
    assert trial.verdict == "broken"
    shown = tally([trial])
    assert not shown.passes
    assert "FloatingPointError: no number" in shown.disagreements[0]


def test_tally_allows_two_percent_of_the_refusals():
    confirmed = [_trial(k, "proved") for k in range(49)]
    assert CONTRADICTED_MOST == 0.02
    assert tally([*confirmed, _trial(50, "found")]).passes  # 1 of 50
    assert not tally([*confirmed[:-1], _trial(50, "found")]).passes  # 1 of 49
    plans = [_trial(k, "passes", "earliest") for k in range(100, 200)]
    shown = tally([*plans, *confirmed])
    assert (shown.planned, shown.refused, shown.count()) == (100, 49, 149)
    assert list(shown.by_rule) == ["earliest", "at"]
    assert not tally([*plans, *confirmed, _trial(300, "fails")]).passes


def test_file_keeps_trials_and_mends_a_cut_line(tmp_path):
    path = tmp_path / "trials.jsonl"
    begin_trials(path, 500)
    trials = [run_trial(POSSIBLE, 0, _fly_straight), _trial(1, "proved", reasons=("why",), closest={"path": [0, 1]})]
    for trial in trials:
        append_trial(path, trial)
    whole = path.read_text()
    path.write_text(whole + '{"seed": 3, "si')
    assert [dataclasses.asdict(trial) for trial in read_trials(path, 500)] == [
        dataclasses.asdict(trial) for trial in trials
    ]
    assert path.read_text() == whole
    with pytest.raises(TrialFileError, match="expected 600 as asked now"):
        read_trials(path, 600)
    path.write_text(whole.replace('"seed"', '"sead"'))
    with pytest.raises(TrialFileError, match="line 2"):
        read_trials(path, 500)
    with pytest.raises(FileExistsError):
        begin_trials(path, 500)


@pytest.fixture
def trials(monkeypatch, capsys):
    """Run `python -m trials` in this process with a planner that always refuses; returns exit code, output, errors."""
    monkeypatch.setattr(runner.run_trial, "__defaults__", (_refuse,))

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["trials", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        return ended.value.code or 0, printed.out, printed.err

    return call


@pytest.mark.long
def test_command_resumes_and_fails_on_contradictions(trials, tmp_path):
    path = tmp_path / "trials.jsonl"
    code, printed, _ = trials("--seeds", "6:7", "--search-iterations", 1000, "--out", path)
    assert code == 0
    assert "1 of 1 seeds" in printed
    code, _, err = trials("--seeds", "6:92", "--search-iterations", 1000, "--out", path)
    assert (code, "--resume" in err) == (2, True)
    earlier_text = path.read_text()
    code, printed, err = trials("--seeds", "91:92", "--search-iterations", 1000, "--out", path, "--resume", "--json")
    assert code == 1
    document = json.loads(printed)
    assert (document["seeds"], document["done"], document["passes"]) == ([91, 92], 1, False)
    assert document["disagreements"] == err.splitlines()
    assert path.read_text().startswith(earlier_text)
    assert "seed 91" in err
    assert [json.loads(line)["seed"] for line in path.read_text().splitlines()[1:]] == [6, 91]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--seeds", "9:9"), "--seeds: arrived '9:9'"),
        (("--seeds", "many"), "--seeds: arrived 'many'"),
        (("--search-iterations", "0"), "--search-iterations: arrived 0"),
        (("--jobs", "0"), "--jobs: arrived 0"),
        (("--resume",), "expected a file to resume"),
    ],
)
def test_the_command_states_its_expectations(trials, tmp_path, words, said):
    code, printed, err = trials("--out", tmp_path / "none.jsonl", *words)
    assert (code, printed) == (2, "")
    assert said in err
    assert not list(tmp_path.iterdir())
