"""Random drags on the live page in a browser: `python -m trials.live_drags --drags 2000`.

Each drag moves a random handle of the map or of the profile by a random distance. The page then saves its scenario, and
another process plans the saved file by `anser.plan`: the answer on the page must be the same, with arrival times equal
to 1e-9 s and refusals equal word for word. The console of the page must stay empty, and the memory of server and page
must not grow by more than a tenth between the quarter of the drags and the last.
"""

import argparse
import json
import os
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

_ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(_ROOT / "tests"))

from support.chromium import Chromium  # noqa: E402  # pyright: ignore[reportMissingImports]

ARRIVAL_TOLERANCE_S = 1e-9
GROWTH_MAX = 0.1
_IDLE_LIMIT_S = 120.0  # without an answer while the server does not compute
_LIMIT_S = 3600.0  # without an answer at all
_MEMORY_PERIOD = 25  # drags between two readings of the memory
_DRIVER_WORDS = "GL Driver Message"  # of the graphics driver, about the speed of screenshots: no fault of the page
_KEEP_OUT = """
[[keep_out]]
name = "cell"
north_m = 1700.0
east_m = -700.0
radius_m = 300.0
speed_m_s = 3.0
course_deg = 90.0
"""
_WAYPOINTS = """waypoints = [
  { time_s = 0.0, north_m = 2600.0, east_m = 2000.0, altitude_m = 0.0 },
  { time_s = 90.0, north_m = 2900.0, east_m = 2050.0, altitude_m = 0.0 },
  { time_s = 200.0, north_m = 3000.0, east_m = 2300.0, altitude_m = 0.0 },
]
"""
HANDLES = """(() => {
  const found = [];
  for (const one of document.querySelectorAll("#map [data-key], #profile [data-key]")) {
    const b = one.getBoundingClientRect(), x = b.x + b.width / 2, y = b.y + b.height / 2;
    const hit = document.elementFromPoint(x, y)?.closest("[data-key]");
    if (hit) found.push([hit.dataset.key, x, y, hit.closest("#profile") !== null]);
  }
  return found;
})()"""


def scenario_text() -> str:
    """Text of the scenario: three UAVs, boats with velocities and with waypoints, and a keep-out that moves."""
    text = (_ROOT / "scenarios" / "three-uavs.toml").read_text(encoding="utf-8")
    head, boat = text.split('name = "boat-3"\nkind = "surface"\n')
    return f'{head}name = "boat-3"\nkind = "surface"\n{_WAYPOINTS}{boat.partition("course_deg = 10.0")[2]}{_KEEP_OUT}'


@contextmanager
def served(folder: Path, text: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Run `anser live` for the text of a scenario in a folder; yields the process and the address of the page."""
    (folder / "base.toml").write_text(text, encoding="utf-8")
    command = [sys.executable, "-c", "from anser.cli import main; main()", "live", str(folder / "base.toml")]
    process = subprocess.Popen([*command, "--no-open"], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        yield process, process.stdout.readline().split()[-1]
    finally:
        process.terminate()
        process.wait(30)
        if process.stdout is not None:
            process.stdout.close()


def cpu_s(process: subprocess.Popen[str]) -> float:
    """CPU time that a process has used, s."""
    fields = Path(f"/proc/{process.pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def wait_for(browser: Chromium, condition: str, server: subprocess.Popen[str]) -> None:
    """Wait until an expression in the page is true, as long as the server computes."""
    begin = last = time.monotonic()
    idle_s, used_s = 0.0, cpu_s(server)
    while not browser.run(f"Boolean({condition})"):
        now = time.monotonic()
        idle_s += min(now - last, 1.0)  # a pause of both processes by somebody else does not count
        last = now
        if cpu_s(server) > used_s + 1.0:
            idle_s, used_s = 0.0, cpu_s(server)
        if idle_s > _IDLE_LIMIT_S or now > begin + _LIMIT_S:
            raise TimeoutError(f"{condition}; {browser.run('live.status.textContent')}; {browser.faults}")
        time.sleep(0.02)


def answered(browser: Chromium, server: subprocess.Popen[str]) -> None:
    """Wait until the newest scenario has its answer."""
    newest = "live.requests.answered === live.requests.number && !live.requests.due && !live.requests.flying"
    wait_for(browser, newest, server)


def drag(browser: Chromium, draw: random.Random, reach_px: float) -> str:
    """Drag a random handle in three steps; returns its key."""
    key, x, y, is_upright = draw.choice(browser.run(HANDLES))
    dx, dy = (draw.uniform(-reach_px, reach_px) for _ in range(2))
    dx, dy = (0.0, 0.5 * dy) if is_upright else (dx, dy)
    browser.mouse("mousePressed", x, y, button="left", clickCount=1)
    for share in (0.4, 1.0):
        browser.mouse("mouseMoved", x + share * dx, y + share * dy, button="left", buttons=1)
    browser.mouse("mouseReleased", x + dx, y + dy, button="left", clickCount=1)
    return key


def save_answer(browser: Chromium, name: str) -> dict[str, Any]:
    """Save the scenario by the page; returns what its answer states."""
    return browser.run(
        f"""new Promise((done, fail) => live.connection.send("save", {{ name: "{name}", scenario: live.scenario.table,
        base: "base.toml", overwrite: true }}, (message) => message.type === "saved" ? done({{
          name: "{name}", status: live.invalid ? "invalid" : live.answer.status,
          problems: live.problems.map((one) => one.text),
          arrivals_s: live.invalid ? [] : live.answer.aircraft.map((one) => one.arrival_s) }})
        : done({{ name: "{name}", status: "invalid", problems: message.problems.map((one) => one.text) }})))"""
    )


def difference(path: Path, answer: dict[str, Any]) -> str | None:
    """Difference between an answer of the page and `anser.plan` of the saved file; None if there is none."""
    import anser

    planned = anser.plan(path)
    reasons = [str(reason) for reason in planned.problems()]
    status = "planned" if not reasons else "refused"
    if status != answer["status"] or reasons != answer["problems"]:
        return f"{path.name}: the page says {answer['status']} {answer['problems']}, anser.plan {status} {reasons}"
    if status == "planned":
        apart_s = max(abs(a - float(b)) for a, b in zip(answer["arrivals_s"], planned.arrivals_s, strict=True))
        if not apart_s <= ARRIVAL_TOLERANCE_S:
            return f"{path.name}: arrival times differ by {apart_s} s"
    return None


def compare(folder: Path) -> int:
    """Plan the saved files that standard input names, each with its answer; prints the differences as JSON."""
    differences = []
    for line in sys.stdin:
        answer = json.loads(line)
        found = difference(folder / answer["name"], answer)
        differences += [] if found is None else [found]
    sys.stdout.write(json.dumps(differences))
    return 0


def memory_mb(browser: Chromium, server: subprocess.Popen[str]) -> tuple[float, float]:
    """Resident memory of the server, and heap of the page after a collection of garbage, MB."""
    pages = int(Path(f"/proc/{server.pid}/statm").read_text(encoding="ascii").split()[1])
    browser._ask("HeapProfiler.collectGarbage")
    used = browser._ask("Runtime.getHeapUsage")["usedSize"]
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6, used / 1e6


def growth(readings: list[tuple[float, float]]) -> tuple[float, float]:
    """Relative growth of both memories from the quarter of the readings to the last; medians of five readings."""
    quarter = max(len(readings) // 4 - 1, 0)
    # the median, because a drawing in progress adds up to two fifths to a single reading of the page's heap
    before, after = (np.median(part, axis=0) for part in (readings[quarter : quarter + 5], readings[-5:]))
    server, page = after / before - 1.0
    return float(server), float(page)


def drag_often(folder: Path, drags: int, seed: int, reset: int, reach_px: float) -> tuple[list[str], str]:
    """Drag, save and compare; returns the faults and a summary line. The scenario begins anew every `reset` drags."""
    draw, counts, readings = random.Random(seed), Counter[str](), []
    command = [sys.executable, "-m", "trials.live_drags", "--compare", str(folder)]
    comparing = subprocess.Popen(command, cwd=_ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert comparing.stdin is not None
    with (
        served(folder, scenario_text()) as (server, url),
        Chromium(folder / "browser", 1280, 900, software=True) as browser,
    ):
        browser._ask("Page.navigate", url=url)
        wait_for(browser, "location.protocol === 'http:' && window.live?.answer?.status === 'planned'", server)
        browser.run("window.base = JSON.stringify(live.scenario.table)")
        for k in range(drags):
            if k % reset == 0:
                browser.run("live.opened(JSON.parse(base), 'base.toml')")
                answered(browser, server)
            before = browser.run("JSON.stringify(live.scenario.table)")
            drag(browser, draw, reach_px)
            answered(browser, server)
            counts["unmoved"] += browser.run("JSON.stringify(live.scenario.table)") == before
            answer = save_answer(browser, f"drag-{k:05d}.toml")
            counts[answer["status"]] += 1
            if answer["status"] != "invalid":  # nothing is saved of an invalid scenario
                comparing.stdin.write(json.dumps(answer) + "\n")
                comparing.stdin.flush()
            if k % _MEMORY_PERIOD == _MEMORY_PERIOD - 1:
                readings.append(memory_mb(browser, server))
                sys.stderr.write(f"{k + 1} drags, {dict(counts)}, memory {readings[-1]} MB\n")
        latencies_ms = browser.run("live.latencies.map((one) => one.latency_ms).sort((a, b) => a - b)")
        faults = [fault for fault in browser.faults if _DRIVER_WORDS not in fault]
    faults += json.loads(comparing.communicate()[0])
    line = f"{drags} drags: {dict(counts)}; median latency {latencies_ms[len(latencies_ms) // 2]:.0f} ms"
    if len(readings) >= 8:
        grown = growth(readings)
        line += f"; growth of the memory, server {100 * grown[0]:.1f} %, page {100 * grown[1]:.1f} %"
        if max(grown) > GROWTH_MAX:
            faults.append(f"the memory grew by {grown[0]:.3f} (server) and {grown[1]:.3f} (page)")
    return faults, line


def main() -> int:
    """Drag at random; return 1 after a fault."""
    parser = argparse.ArgumentParser(prog="python -m trials.live_drags", description=__doc__)
    parser.add_argument("--drags", type=int, default=2000, help="number of drags")
    parser.add_argument("--seed", type=int, default=1, help="seed of the drags")
    parser.add_argument("--reset", type=int, default=6, help="drags until the scenario begins anew")
    parser.add_argument("--reach", type=float, default=45.0, help="greatest distance of a drag, pixels")
    parser.add_argument("--compare", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.compare is not None:
        return compare(options.compare)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        faults, line = drag_often(Path(folder), options.drags, options.seed, options.reset, options.reach)
    sys.stdout.write("\n".join([line, *faults]) + "\n")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main())
