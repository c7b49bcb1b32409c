"""The trial of random wind fields: its fields are within their bounds, and a few of its tasks are flown as planned."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from trials.wind_field_flights import SHEAR_MAX_PER_S, SPEED_MAX_M_S, fly, write_field


def test_random_fields_are_within_their_bounds_and_reach_them(tmp_path: Path) -> None:
    shears, speeds = [], []
    for seed in range(6):
        shear, speed = write_field(tmp_path / "field.nc", seed)
        with xr.open_dataset(tmp_path / "field.nc") as data:
            wind = np.stack([data[name].values for name in "uvw"])
            altitude = data.altitude.values
        assert np.max(np.linalg.norm(wind, axis=0)) == pytest.approx(speed)
        shear_in_file = np.linalg.norm(np.diff(wind, axis=2), axis=0) / np.diff(altitude)[:, None, None]
        assert np.max(shear_in_file) == pytest.approx(shear)
        assert np.max(np.ptp(wind[:2], axis=(3, 4))) > 1.0
        shears.append(shear)
        speeds.append(speed)
    assert max(shears) == pytest.approx(SHEAR_MAX_PER_S)
    assert max(speeds) == pytest.approx(SPEED_MAX_M_S)


@pytest.mark.long
@pytest.mark.parametrize("seed", [2, 3])
def test_tasks_in_random_fields_are_planned_with_a_bound_and_flown_as_required(tmp_path: Path, seed: int) -> None:
    trial = fly(seed, tmp_path)
    assert trial.refusal == ""
    assert 0.5 < trial.difference_m_s < 15.0
    assert trial.unmet == ()
