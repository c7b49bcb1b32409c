"""Every dispersible parameter reaches the model: a single change gives a different flight."""

import numpy as np
import pytest

import anser
from anser.campaigns.flights import create_store, fly_campaign
from anser.campaigns.store import CampaignStore
from anser.config.key_paths import value_at
from campaigns.study_cases import STUDIES, study_of

WORLD = anser.load(STUDIES.parent / "scenarios" / "uncertain-world.toml").replace(
    "separation", {}, "fleet.planner", "published"
)
CHANGED = {
    "wind.speed_m_s": 3.0,
    "aircraft[0].start.north_m": 1100.0,
    "aircraft[1].start.speed_m_s": 155.0,
    "goal[0].speed_m_s": 12.0,
    "fleet.speed_m_s": 152.0,
    "guidance.position_gain_per_s": 0.2,
    "turbulence.intensity": "light",
    "navigation.position_m": 4.0,
    "navigation.correlation_s": 30.0,
    "goal_sensor.angle_mrad": 6.0,
    "goal_sensor.range_m": 20.0,
    "goal_sensor.outage_share": 0.2,
    "aircraft[0].deviation.mass": 1.1,
    "aircraft[0].deviation.second_moment_x": 1.2,
    "aircraft[0].deviation.thrust": 0.9,
    "aircraft[0].deviation.cg_shift": 0.02,
    "aircraft[0].deviation.actuator_bandwidth": 0.7,
    "aircraft[0].deviation.coefficients.Cm0": 1.2,
}
PRESET = {"goal_sensor.angle_mrad": 3.0, "goal_sensor.range_m": 10.0}
"""Values of the camera if not set in the file."""


@pytest.mark.long
def test_each_dispersed_parameter_changes_the_flight(tmp_path):
    columns, flights = {}, len(CHANGED) + 2
    for k, (path, value) in enumerate(CHANGED.items()):
        nominal = PRESET.get(path, value_at(WORLD, path))
        assert nominal != value
        column = [nominal] * flights
        column[k + 2] = value  # two flights are as they are
        columns[path] = np.array(column)
    study = study_of(vary=[], sampling={"method": "table", "file": "values.csv"})
    store = create_store(tmp_path, study, WORLD, columns)
    store._array("seed")[:] = 7  # all alike but for what is changed
    store._checksums.record_base(store.attributes)
    fly_campaign(store)
    data = CampaignStore.open(tmp_path).dataset()
    assert (data["reason"].values == "").all()
    results = np.concatenate([data[key].values for key in ("arrival_s", "miss_m", "speed_max_m_s")], axis=1)
    np.testing.assert_array_equal(results[0], results[1])
    for k, path in enumerate(CHANGED):
        assert data[path].values[k + 2] == CHANGED[path]
        assert np.any(results[k + 2] != results[0]), path
