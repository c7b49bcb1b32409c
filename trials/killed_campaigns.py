"""Campaigns of 2,000 flights whose processes or workers are killed 20 times: `python -m trials.killed_campaigns`.

After the last resume every data array must equal, bit for bit, the array of an undisturbed campaign.
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
    """Every array of a store, including marks and series."""
    members = zarr.open_group(folder / "flights.zarr", mode="r").members(max_depth=None)
    return {name: np.asarray(array[...]) for name, array in members if isinstance(array, zarr.Array)}


def differing(folder: Path, reference: Path) -> list[str]:
    """Names of the arrays that differ in any bit."""
    arrays, reference_arrays = arrays_of(folder), arrays_of(reference)
    names = sorted(set(arrays) | set(reference_arrays))
    return [
        name
        for name in names
        if name not in arrays
        or name not in reference_arrays
        or arrays[name].tobytes() != reference_arrays[name].tobytes()
    ]


def killed_processes(study: Path, folder: Path, draw: random.Random) -> int:
    """Start the campaign, kill its processes at random moments, resume; return the number of kills."""
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
                shutil.rmtree(folder, ignore_errors=True)  # killed before the store was created
            continue
        return killed


def killed_workers(study: Path, folder: Path, draw: random.Random) -> int:
    """Fly on a cluster of two workers that are killed alternately; return the number of kills."""
    from distributed import LocalCluster

    killed, store = 0, open_campaign_store(study, folder, resume=False)
    dask_cluster: Any = LocalCluster(n_workers=_WORKERS, threads_per_worker=1, dashboard_address=":0")
    with dask_cluster as cluster:
        while not CampaignStore.open(folder).chunk_is_complete.all():

            def fly() -> None:
                with contextlib.suppress(
                    StoreError
                ):  # raised for a chunk whose workers were killed three times; it is resumed
                    fly_campaign(store, cluster=cluster.scheduler_address)

            flying = threading.Thread(target=fly, daemon=True)
            flying.start()
            while flying.is_alive():
                flying.join(draw.uniform(4.0, 15.0))
                if flying.is_alive() and killed < KILLS:
                    # dask gives up a worker killed during its start, and finally no worker would be left
                    nannies = [nanny for nanny in cluster.workers.values() if nanny.process is not None]
                    running = [nanny.pid for nanny in nannies if nanny.process.status.name == "running"]
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
    """Fly undisturbed, with killed processes and with killed workers; return 1 if a store differs."""
    differences = []
    with tempfile.TemporaryDirectory() as temporary_folder:
        here, draw = Path(temporary_folder), random.Random(1)
        (here / "scenario.toml").write_text(_SCENARIO.read_text(encoding="utf-8"), encoding="utf-8")
        study = here / "study.toml"
        study.write_text(_STUDY.format(flights=FLIGHTS), encoding="utf-8")
        start_time = time.perf_counter()
        fly_campaign(open_campaign_store(study, here / "undisturbed", resume=False), 2)
        _say(f"undisturbed: {FLIGHTS} flights in {time.perf_counter() - start_time:.0f} s")
        kinds = {"processes": killed_processes, "workers": killed_workers}
        for name, fly in [(name, kinds[name]) for name in sys.argv[1:] or kinds]:
            killed, number = 0, 0
            while killed < KILLS:
                folder = here / f"{name}-{number}"
                killed += fly(study, folder, draw)
                differences += differing(here / "undisturbed", folder)
                number += 1
                _say(f"{name}: {killed} kills, {number} campaigns, {len(differences)} arrays differ")
    return int(bool(differences))


if __name__ == "__main__":
    sys.exit(main())
