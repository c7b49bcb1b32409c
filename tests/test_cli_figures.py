"""The command figures: files and refusals. Small datasets replace the published cases."""

from types import SimpleNamespace

import pytest

from anser.report import flight_figures
from anser.results import read_netcdf, write_netcdf
from support.tiny_run import make_run, tiny_dataset

SUFFIXES = (".pdf", ".png", ".svg")
ALL = dict(flight_figures.FLIGHT_FIGURES)


@pytest.fixture(autouse=True)
def one_figure(monkeypatch):
    """Draw a single figure of a flight; tests/report draws them all."""
    monkeypatch.setattr(flight_figures, "FLIGHT_FIGURES", {"plan": flight_figures.FLIGHT_FIGURES["plan"]})


def test_the_figures_of_a_run(anser, tmp_path):
    run, out = make_run(tmp_path / "run"), tmp_path / "figures"
    code, printed, _ = anser("figures", run, "--out", out)
    assert code == 0
    assert "1 figure as .pdf, .png, .svg" in printed
    assert {path.name for path in out.iterdir()} == {f"flight-plan{suffix}" for suffix in SUFFIXES}
    code, _, err = anser("figures", run, "--out", out)
    assert code == 2
    assert "exists" in err


def test_every_published_case_is_drawn(anser, tmp_path, monkeypatch):
    flight = SimpleNamespace(dataset=tiny_dataset())
    figures = []

    def note(name, which):
        def draw(*args):
            figures.append(name)
            for path in args[which]:
                path.write_bytes(b"")

        return draw

    def shape(dataset, family, folder):
        paths = [folder / f"shape-{family}{suffix}" for suffix in SUFFIXES]
        note(family, 0)(paths)
        return paths

    tests = [SimpleNamespace(test=SimpleNamespace(key=key), dataset=None) for key in ("rates-p", "velocity-v")]
    monkeypatch.setattr("anser.analysis.step_flights.fly_steps", lambda *tests_, **settings: tests)
    monkeypatch.setattr("anser.analysis.step_flights.fly_climb_and_turn", lambda variant: flight)
    monkeypatch.setattr("anser.report.aircraft_figures.draw_step", note("step", 1))
    monkeypatch.setattr("anser.report.aircraft_figures.draw_overview", note("overview", 1))
    monkeypatch.setattr("anser.report.aircraft_figures.draw_tracking", note("tracking", 2))
    monkeypatch.setattr("anser.report.plan_figures.draw_shapes", shape)
    monkeypatch.setattr("anser.verification.polynomial_paths.shape_families", lambda: {"b4": None, "c4": None})
    monkeypatch.setattr("anser.verification.missions.published_flights", lambda: {"single": flight})
    out = tmp_path / "figures"
    code, printed, _ = anser("figures", "--out", out)
    assert code == 0
    assert figures == ["b4", "c4", "step", "step", "overview", "tracking"]
    keys = {"shape-b4", "shape-c4", "step-rates-p", "step-velocity-v", "step-overview", "climb-and-turn", "single-plan"}
    assert {path.name for path in out.iterdir()} == {f"{key}{suffix}" for key in keys for suffix in SUFFIXES}
    assert f"{len(keys)} figures" in printed


def test_a_flight_with_missing_variables_is_refused(anser, tmp_path):
    run, out = make_run(tmp_path / "run"), tmp_path / "figures"
    dataset = read_netcdf(run / "flight.nc").drop_vars("goal_velocity_east_m_s")
    (run / "flight.nc").unlink()
    write_netcdf(dataset, run / "flight.nc")
    code, _, err = anser("figures", run, "--out", out)
    assert code == 2
    assert "without goal_velocity_east_m_s" in err
    assert not out.exists()
    code, _, err = anser("figures", tmp_path / "none", "--out", out)
    assert code == 2
    assert "no folder" in err


def test_some_figures_on_a_narrow_paper(anser, tmp_path, monkeypatch):
    monkeypatch.setattr(flight_figures, "FLIGHT_FIGURES", ALL)
    run, out = make_run(tmp_path / "run"), tmp_path / "figures"
    code, _, _ = anser("figures", run, "--out", out, "--only", "bank, load_factor", "--width", "88", "--no-title")
    assert code == 0
    assert {path.name for path in out.iterdir()} == {
        f"flight-{name}{suffix}" for name in ("bank", "load-factor") for suffix in SUFFIXES
    }
    svg = (out / "flight-bank.svg").read_text()
    assert f'width="{88 / 25.4 * 72:.4f}'[:10] in svg
    assert "bank angles" not in svg


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--only", "plan,wheels"), "--only: arrived 'wheels'; expected one of plan"),
        (("--width", "5"), "--width: arrived 5; expected 60 to 400 mm"),
    ],
)
def test_an_unknown_figure_or_width_is_refused(anser, tmp_path, options, message):
    run, out = make_run(tmp_path / "run"), tmp_path / "figures"
    code, _, err = anser("figures", run, "--out", out, *options)
    assert code == 2
    assert message in err
    assert not out.exists()


def test_options_of_flight_figures_are_refused_for_published_cases(anser, tmp_path):
    code, _, err = anser("figures", "--out", tmp_path / "figures", "--only", "plan")
    assert code == 2
    assert "RUN: arrived nothing" in err
