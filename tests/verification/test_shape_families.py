"""Published families of paths by their coefficients and lengths, and the figure of the families."""

import numpy as np
import pytest

from anser.report.plan_figures import draw_shapes
from anser.verification.polynomial_paths import shape_families


@pytest.fixture(scope="module")
def families():
    return shape_families()


@pytest.mark.parametrize(
    ("family", "axis", "parameter"), [("b4", "east_m", "lateral"), ("c4", "altitude_m", "vertical")]
)
def test_each_path_has_its_quartic_coefficient_and_its_length(families, family, axis, parameter):
    dataset = families[family]
    values = dataset[f"{parameter}_shape_m_s4"].values
    assert np.all(np.diff(values) > 0)
    time = dataset["time"].values
    for k, value in enumerate(values):
        path = dataset.isel(path=k)
        coefficients = np.polynomial.Polynomial.fit(time, path[axis].values, 4).convert().coef
        assert (coefficients[4] if coefficients.size > 4 else 0.0) == pytest.approx(value, abs=1e-9)
        steps = np.stack([np.diff(path[name].values) for name in ("north_m", "east_m", "altitude_m")])
        # A polygon of 180 chords is shorter by (turn per chord)^2 / 24: 1e-5 of the length at most here.
        assert float(path["length_m"]) == pytest.approx(np.linalg.norm(steps, axis=0).sum(), rel=2e-5)
        speed = np.linalg.norm(steps, axis=0) / np.diff(time)
        middle = (path["airspeed_command_m_s"].values[1:] + path["airspeed_command_m_s"].values[:-1]) / 2
        np.testing.assert_allclose(middle, speed, rtol=2e-3)
    # The printed lengths are those of the six-point rule, to their last digit.
    np.testing.assert_allclose(dataset["length_estimate_m"], dataset["length_published_m"], atol=0.051)
    end_paths = dataset.isel(path=[0, -1])
    for name in ("length_m", "length_estimate_m"):
        np.testing.assert_allclose(dataset[f"member_{name}"].values[[0, -1]], end_paths[name].values, rtol=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("family", ["b4", "c4"])
def test_the_figure_names_every_path(families, family, tmp_path):
    paths = draw_shapes(families[family], family, tmp_path)
    assert {path.suffix for path in paths} == {".svg", ".png", ".pdf"}
    text = (tmp_path / f"shape-{family}.svg").read_text()
    for label in ("Length by the six-point rule", "Published estimate of the length", "North position", "0.0025 m/s"):
        assert label in text
    with pytest.raises(FileExistsError):
        draw_shapes(families[family], family, tmp_path)
