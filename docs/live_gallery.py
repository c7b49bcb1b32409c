"""Eight situations of the live page as recorded pages, each with steps: `python docs/live_gallery.py FOLDER`.

`make docs` calls it. Each step changes keys of a shipped scenario; its answer is planned here. A page needs no server
and no network.
"""

import sys
import tomllib
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any, NamedTuple

from anser.live.answers import make_answer
from anser.live.documents import DocumentFolder
from anser.live.page import render_live_page

SCENARIOS = Path(__file__).parents[1] / "scenarios"
Step = tuple[str, dict[str, Any]]  # label; values by key path, None to leave a key out


class Situation(NamedTuple):
    """A scenario in steps."""

    name: str  # of the file
    title: str
    scenario: str
    steps: tuple[Step, ...]


def _cell(north_m: float, east_m: float, radius_m: float, speed_m_s: float) -> dict[str, Any]:
    motion = {"speed_m_s": speed_m_s, "course_deg": 60.0} if speed_m_s else {}
    return {"keep_out": [{"name": "cell", "north_m": north_m, "east_m": east_m, "radius_m": radius_m, **motion}]}


def _windows(*windows: tuple[float, float]) -> dict[str, Any]:
    values: dict[str, Any] = {"arrival.rule": "windows"}
    for k, (begin_s, end_s) in enumerate(windows):
        values |= {f"aircraft[{k}].arrive_from_s": begin_s, f"aircraft[{k}].arrive_to_s": end_s}
    return values


SITUATIONS = (
    Situation(
        "wind",
        "A storm's wind",
        "storm-sampling",
        (
            ("no wind", {"wind.speed_m_s": 0.0}),
            ("12 m/s from south-west, as forecast", {}),
            ("30 m/s from south-west", {"wind.speed_m_s": 30.0}),
            ("30 m/s from north-east", {"wind.speed_m_s": 30.0, "wind.from_deg": 60.0}),
        ),
    ),
    Situation(
        "keep-out",
        "A keep-out that moves",
        "storm-sampling",
        (
            ("no keep-out", {}),
            ("a cell at rest on the way of west", _cell(-900.0, -6500.0, 1200.0, 0.0)),
            ("the cell drifts with the wind", _cell(-900.0, -6500.0, 1200.0, 12.0)),
            ("a wider cell", _cell(-900.0, -6500.0, 2500.0, 12.0)),
        ),
    ),
    Situation(
        "refused",
        "A refused wish, and its mending",
        "storm-sampling",
        (
            ("150 m of separation: planned", {}),
            ("6,000 m of separation: refused", {"separation.horizontal_m": 6000.0}),
            ("1,500 m of separation: planned", {"separation.horizontal_m": 1500.0}),
        ),
    ),
    Situation(
        "sequence",
        "One after another",
        "storm-sampling",
        (
            ("all together", {}),
            ("ten seconds apart", {"arrival.rule": "sequence", "arrival.spacing_s": 10.0}),
            (
                "ten seconds apart, south first",
                {
                    "arrival.rule": "sequence",
                    "arrival.spacing_s": 10.0,
                    "arrival.order": ["south", "east", "north", "west"],
                },
            ),
            ("each as early as it can", {"arrival.rule": "earliest"}),
        ),
    ),
    Situation(
        "ships",
        "Ships turn",
        "turning-ships",
        (
            ("the ferry steams north", {}),
            ("the ferry steams east", {"goal[0].course_deg": 90.0}),
            ("the ferry steams south-west", {"goal[0].course_deg": 225.0}),
            ("and hurries: 20 m/s", {"goal[0].course_deg": 225.0, "goal[0].speed_m_s": 20.0}),
        ),
    ),
    Situation(
        "mixed",
        "Jets and UAVs at one second",
        "mixed-fleet",
        (
            ("as shipped", {}),
            ("jets from farther away", {"aircraft[0].start.north_m": -21000.0, "aircraft[1].start.north_m": -20000.0}),
            ("the ship steams at 12 m/s", {"goal[0].speed_m_s": 12.0}),
        ),
    ),
    Situation(
        "altitude",
        "Higher and higher",
        "three-uavs",
        (
            ("160 m above the boat", {}),
            ("uav-1: 300 m above the boat", {"aircraft[0].rendezvous.stand_off_up_m": 300.0}),
            ("uav-1: 600 m above the boat", {"aircraft[0].rendezvous.stand_off_up_m": 600.0}),
            ("uav-1: 1,500 m above the boat", {"aircraft[0].rendezvous.stand_off_up_m": 1500.0}),
        ),
    ),
    Situation(
        "windows",
        "Windows of arrival",
        "three-uavs",
        (
            ("all together", {}),
            ("wide windows", _windows((100.0, 200.0), (100.0, 200.0), (100.0, 200.0))),
            ("uav-3 before the others", _windows((150.0, 200.0), (150.0, 200.0), (100.0, 140.0))),
            ("uav-1 too early", _windows((83.0, 95.0), (100.0, 200.0), (100.0, 200.0))),
        ),
    ),
)


def changed(document: dict[str, Any], values: dict[str, Any]) -> dict[str, Any]:
    """Return a document with changed values by key path."""
    changed_document = deepcopy(document)
    for path, value in values.items():
        *parts, last = path.replace("[", ".").replace("]", "").split(".")
        table: Any = changed_document
        for part in parts:
            table = table[int(part)] if isinstance(table, list) else table.setdefault(part, {})
        table[last] = value
    return changed_document


def recording(situation: Situation) -> Iterator[dict[str, Any]]:
    """Yield the steps of a situation with their answers, for `render_live_page`."""
    document = tomllib.loads((SCENARIOS / f"{situation.scenario}.toml").read_text(encoding="utf-8"))
    folder = DocumentFolder(SCENARIOS)
    for label, values in situation.steps:
        step = changed(document, values)
        answer, _ = make_answer(folder.scenario(step), lambda message: None)
        shown = {key: value for key, value in answer.items() if key not in ("sliders", "templates", "elapsed_ms")}
        yield {"label": f"{situation.title}: {label}", "scenario": step, "answer": shown}


def write_gallery(folder: Path) -> None:
    """Write the pages of all situations into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for situation in SITUATIONS:
        (folder / f"{situation.name}.html").write_text(render_live_page(list(recording(situation))), encoding="utf-8")


if __name__ == "__main__":
    write_gallery(Path(sys.argv[1]))
