"""Campaigns of 2,000 flights whose processes or workers are killed 20 times: `python -m trials.killed_campaigns`.

After the last resume every data array must be, bit for bit, that of a campaign which nobody disturbed.
"""

import contextlib
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import zarr

from anser.campaigns import StoreError
from anser.campaigns.campaign_folder import open_campaign_store
from anser.campaigns.flights import fly_campaign
from anser.campaigns.store import CampaignStore

FLIGHTS, KILLS = 2000, 20
_WORKERS = 2
_SCENARIO = Path(__file__).parents[1] / "scenarios" / "single-aircraft.toml"
_STUDY = """format = 1
name = "killed"
description = "Killed again and again"
scenario = "scenario.toml"
seed = 1

[sampling]
method = "monte-carlo"
flights = {flights}

[[vary]]
path = "aircraft[0].start.north_m"
distribution = "normal"
mean = 0.0
sigma = 20.0
how = "add"

[keep]
series = ["position_error", "airspeed"]
"""


def arrays_of(folder: Path) -> dict[str, np.ndarray]:
    """Every array of a store, the marks and the series among them."""
    members = zarr.open_group(folder / "flights.zarr", mode="r").members(max_depth=None)
    return {name: np.asarray(one[...]) for name, one in members if isinstance(one, zarr.Array)}


def differing(folder: Path, other: Path) -> list[str]:
    """Names of the arrays that are not the same to the bit."""
    one, two = arrays_of(folder), arrays_of(other)
    names = sorted(set(one) | set(two))
    return [name for name in names if name not in one or name not in two or one[name].tobytes() != two[name].tobytes()]


def killed_processes(study: Path, folder: Path, draw: random.Random) -> int:
    """Begin the campaign, kill all its processes at random moments, resume; how often it was killed before its end."""
    killed = 0
    while True:
        resume = ["--resume"] if folder.exists() else []
        command = [sys.executable, "-m", "anser", "campaign", str(study), "--out", str(folder), *resume]
        quiet = subprocess.DEVNULL
        running = subprocess.Popen(command, start_new_session=True, stdout=quiet, stderr=quiet)
        try:
            running.wait(None if killed == KILLS else draw.uniform(4.0, 20.0))
        except subprocess.TimeoutExpired:
            os.killpg(running.pid, signal.SIGKILL)
            running.wait()
            killed += 1
            if not (folder / "checksums" / "store.json").exists():
                shutil.rmtree(folder, ignore_errors=True)  # killed before there was a store
            continue
        return killed


def killed_workers(study: Path, folder: Path, draw: random.Random) -> int:
    """Fly on a cluster of two workers of which one after the other is killed; how often before the campaign's end."""
    from distributed import LocalCluster

    killed, store = 0, open_campaign_store(study, folder, resume=False)
    both: Any = LocalCluster(n_workers=_WORKERS, threads_per_worker=1, dashboard_address=":0")
    with both as cluster:
        while not CampaignStore.open(folder).chunk_is_complete.all():

            def fly() -> None:
                with contextlib.suppress(StoreError):  # a chunk whose workers were killed thrice: resumed
                    fly_campaign(store, cluster=cluster.scheduler_address)

            flying = threading.Thread(target=fly, daemon=True)
            flying.start()
            while flying.is_alive():
                flying.join(draw.uniform(4.0, 15.0))
                if flying.is_alive() and killed < KILLS:
                    # one that is killed while it starts is given up by dask, and nobody would fly in the end
                    nannies = [one for one in cluster.workers.values() if one.process is not None]
                    running = [one.pid for one in nannies if one.process.status.name == "running"]
                    if len(cluster.workers) < _WORKERS:
                        cluster.scale(_WORKERS)
                    elif len(running) == _WORKERS:
                        os.kill(draw.choice(running), signal.SIGKILL)
                        killed += 1
    return killed


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def main() -> int:
    """Fly undisturbed, killed, and with killed workers; 1 where a store differs."""
    found = []
    with tempfile.TemporaryDirectory() as place:
        here, draw = Path(place), random.Random(1)
        (here / "scenario.toml").write_text(_SCENARIO.read_text(encoding="utf-8"), encoding="utf-8")
        study = here / "study.toml"
        study.write_text(_STUDY.format(flights=FLIGHTS), encoding="utf-8")
        began = time.perf_counter()
        fly_campaign(open_campaign_store(study, here / "undisturbed", resume=False), 2)
        _say(f"undisturbed: {FLIGHTS} flights in {time.perf_counter() - began:.0f} s")
        kinds = {"processes": killed_processes, "workers": killed_workers}
        for name, fly in [(name, kinds[name]) for name in sys.argv[1:] or kinds]:
            killed, number = 0, 0
            while killed < KILLS:
                folder = here / f"{name}-{number}"
                killed += fly(study, folder, draw)
                found += differing(here / "undisturbed", folder)
                number += 1
                _say(f"{name}: {killed} kills, {number} campaigns, {len(found)} arrays differ")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
