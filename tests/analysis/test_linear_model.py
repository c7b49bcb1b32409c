"""Forms of a linear model: names and units of every number, in the dataset and in JSON."""

import json
import math
from functools import partial

import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

from anser.analysis import fly_steps, linearize, margins_at, modes_of, survey_envelope, survey_margins
from anser.analysis.linear_models import linear_dataset, linear_document, unit_of
from anser.analysis.linearization import LinearModel
from anser.results import write_netcdf
from support.plain_files import read_alone

BODY = ("V", "alpha", "beta", "phi", "theta", "psi", "P", "Q", "R", "altitude", "power")
OUTPUTS = (*BODY, "n_z", "gamma", "chi", "mu")


def make_model(step=0.0) -> LinearModel:
    random = np.random.default_rng(1)
    C = random.standard_normal((15, 11))
    A = -np.diag(np.arange(11.0)) + 0.1 * random.standard_normal((11, 11))
    A[5] = A[:, 5] = 0.0  # heading: an eigenvalue of 0, with infinite times
    arrays = (A, random.standard_normal((11, 2)), C, random.standard_normal((15, 2)))
    values = (random.standard_normal(11), random.standard_normal(2), random.standard_normal(15), np.zeros(11))
    return LinearModel(
        *(jnp.asarray(a) for a in (*arrays, *values)),
        step=jnp.asarray(step),
        regular=jnp.asarray(True),
        states=BODY,
        inputs=("throttle", "elevator"),
        outputs=OUTPUTS,
    )


@pytest.fixture(scope="module")
def labelled():
    model = make_model()
    modes = modes_of(model)
    return model, modes, {"aircraft": "f16", "speed_m_s": 153.0}


def test_the_dataset_has_every_number_under_its_names(labelled):
    model, modes, condition = labelled
    dataset = linear_dataset(model, modes, condition)
    for name, row_dimension, column_dimension in (
        ("A", "state_rate", "state"),
        ("B", "state_rate", "input"),
        ("C", "output", "state"),
        ("D", "output", "input"),
    ):
        assert dataset[name].dims == (row_dimension, column_dimension)
        np.testing.assert_array_equal(dataset[name], getattr(model, name))
    assert float(dataset.A.sel(state_rate="Q", state="alpha")) == float(model.A[7, 1])
    assert float(dataset.B.sel(state_rate="power", input="throttle")) == float(model.B[10, 0])
    assert float(dataset.D.sel(output="n_z", input="elevator")) == float(model.D[11, 1])
    assert dataset.state_unit.sel(state="Q").item() == "rad s-1"
    assert dataset.A.attrs["units"] == "state_unit s-1 / state_unit"
    assert dataset.C.attrs["units"] == "output_unit / state_unit"
    assert all(variable.attrs["units"] for variable in dataset.data_vars.values())
    assert dataset.attrs["aircraft"] == "f16"
    assert dataset.attrs["version_anser"]
    assert list(dataset.mode_name.values) == [mode.name for mode in modes]
    np.testing.assert_allclose(dataset.share.sum("wind_state"), 1.0)
    np.testing.assert_array_equal(dataset.natural_frequency_rad_s, [mode.natural_frequency for mode in modes])
    assert float(dataset.time_to_half_s[-1]) == math.inf


def test_a_sampled_model_has_next_states_instead_of_rates(labelled):
    _, _, condition = labelled
    model = make_model(step=0.01)
    dataset = linear_dataset(model, modes_of(model), condition)
    assert dataset.A.attrs["units"] == "state_unit / state_unit"
    assert dataset.attrs["step_s"] == 0.01


def test_a_netcdf_file_returns_the_dataset(labelled, tmp_path):
    dataset = linear_dataset(*labelled)
    write_netcdf(dataset, tmp_path / "model.nc")
    xr.testing.assert_identical(read_alone(tmp_path / "model.nc"), dataset)


def test_the_document_is_plain_json_with_the_same_numbers(labelled):
    model, modes, condition = labelled
    document = json.loads(json.dumps(linear_document(model, modes, condition), allow_nan=False))
    assert document["condition"] == condition
    assert document["provenance"]["anser"]
    assert [element["name"] for element in document["states"]] == list(BODY)
    assert [element["name"] for element in document["outputs"]] == list(OUTPUTS)
    assert document["states"][7] == {"name": "Q", "unit": "rad s-1", "value": float(model.x[7]), "rate": 0.0}
    for name in "ABCD":
        np.testing.assert_array_equal(document[name], getattr(model, name))
    assert [mode["name"] for mode in document["modes"]] == [mode.name for mode in modes]
    heading = document["modes"][-1]
    assert heading["eigenvalue_real_1_s"] == 0.0
    assert heading["time_to_half_s"] is None
    assert all(share >= 0.005 for mode in document["modes"] for share in mode["shares"].values())


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("V", "m s-1"),
        ("n_z", "1"),
        ("P_w", "rad s-1"),
        ("elevator_command", "rad"),
        ("V_command", "m s-1"),
        ("V_integral", "m"),
        ("mu_integral", "rad s"),
        ("Q_integral", "rad"),
        ("R_filter", "rad s-1"),
        ("rudder_slow", "rad"),
        ("Z_residual", "N"),
        ("P_dot_residual", "rad s-2"),
        ("P_last", "rad s-1"),
        ("R_dot_last", "rad s-2"),
    ],
)
def test_every_name_has_its_unit(name, unit):
    assert unit_of(name) == unit


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("left_elevon", "rad"),
        ("left_elevon_command", "rad"),
        ("left_elevon_velocity", "rad s-1"),
        ("right_elevon_filter", "rad"),
        ("throttle", "1"),
    ],
)
def test_other_surfaces_have_units(name, unit):
    assert unit_of(name, ("left_elevon", "right_elevon")) == unit


@pytest.mark.parametrize("name", ["rudder", "rudder_command", "left_elevon_speed"])
def test_a_name_without_unit_is_refused(name):
    with pytest.raises(ValueError, match=f"no unit is known for {name}"):
        unit_of(name, ("left_elevon", "right_elevon"))


@pytest.mark.parametrize("step_s", [0.0, -0.01, 0.06, float("nan"), float("inf")])
def test_a_sampling_period_outside_the_range_is_refused(step_s):
    point = {"speed_m_s": 150.0, "altitude_m": 1000.0}
    calls = (linearize, {**point, "loop": "rates"}), (margins_at, point), (survey_margins, {}), (survey_envelope, {})
    for function, options in calls:
        with pytest.raises(ValueError, match=r"step_s: arrived .*; expected a number from 0.001 to 0.05 s"):
            function(step_s=step_s, **options)


def test_an_unknown_inversion_is_refused():
    point = {"speed_m_s": 150.0, "altitude_m": 1000.0}
    calls = (margins_at, point), (survey_margins, {}), (survey_envelope, {}), (partial(fly_steps, []), point)
    for function, options in calls:
        with pytest.raises(ValueError, match='inversion: arrived \'adaptive\'; expected "model" or "incremental"'):
            function(inversion="adaptive", **options)
