"""A server of the live page that stands still while the page's socket is cut: `python -m trials.standing_server`.

The page flies, then its server is stopped (SIGSTOP) and the socket cut. Meanwhile a goal is moved twice and one move is
undone. After `--seconds` the server goes on: the page must connect again by itself, with its document and history, the
plan of the present document, and the flight that was under way.
"""

import argparse
import signal
import sys
import tempfile
import time
from pathlib import Path

from trials.live_drags import (
    Chromium,  # pyright: ignore[reportAttributeAccessIssue]
    answered,
    scenario_text,
    served,
    wait_for,
)


def stand_still(folder: Path, seconds: float) -> tuple[list[str], float]:
    """Stop the server of a page for a time, s; returns the faults, and the seconds until the page had everything."""
    faults = []

    def check(is_right: bool, fault: str) -> None:
        faults.extend([] if is_right else [fault])

    with (
        served(folder, scenario_text()) as (server, url),
        Chromium(folder / "browser", 1280, 900, software=True) as browser,
    ):
        browser._ask("Page.navigate", url=url)
        wait_for(browser, "location.protocol === 'http:' && window.live?.answer?.status === 'planned'", server)
        answered(browser, server)
        browser.run("live.flights.start()")
        wait_for(browser, "live.flights.number && live.flights.incoming.time_s.length", server)
        server.send_signal(signal.SIGSTOP)
        try:
            began = time.monotonic()
            browser.run("live.connection.socket.close()")
            north_m = browser.run("live.scenario.get('goal[0].north_m')")
            for moved_m in (40, 900):
                browser.run(f"live.scenario.set('goal[0].north_m', {north_m + moved_m}, {{ merge: '{moved_m}' }})")
            browser.run("live.scenario.undo()")
            wait_for(browser, "!live.connection.open", server)
            check(
                "Connection lost" in browser.run("live.status.textContent"),
                "the page does not tell the lost connection",
            )
            time.sleep(max(0.0, seconds - (time.monotonic() - began)))
        finally:
            server.send_signal(signal.SIGCONT)
        began = time.monotonic()
        wait_for(browser, "live.connection.open", server)
        answered(browser, server)
        wait_for(browser, "live.flights.known.length === 1", server)
        duration_s = time.monotonic() - began
        check(browser.run("live.scenario.get('goal[0].north_m')") == north_m + 40, "the document was lost")
        check(browser.run("[live.scenario.done.length, live.scenario.undone.length]") == [1, 1], "the history was lost")
        check(browser.run("live.answer.status") == "planned", "no plan for the present document")
        here = browser.run("live.answer.goals[0].north_m[0]")
        check(abs(here - north_m - 40) < 0.01, f"the plan is that of another document: goal at {here} m")
        # the browser itself reports each attempt to connect that fails
        faults += [fault for fault in browser.faults if "WebSocket" not in fault and "GL Driver Message" not in fault]
    return faults, duration_s


def main() -> int:
    """Let the server stand still; return 1 after a fault."""
    parser = argparse.ArgumentParser(prog="python -m trials.standing_server", description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0, help="time for which the server stands still, s")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        faults, duration_s = stand_still(Path(folder), options.seconds)
    line = f"stood still for {options.seconds:.0f} s; everything was there {duration_s:.1f} s after the server went on"
    sys.stdout.write("\n".join([line, *faults]) + "\n")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main())
