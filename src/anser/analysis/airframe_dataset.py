"""Labelled dataset of an airframe survey."""

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from anser.airframe_data import COEFFICIENTS
from anser.results.documents import version_attributes
from anser.results.variable_labels import unit_attributes


def airframe_dataset(
    alphas_deg: np.ndarray,
    betas_deg: np.ndarray,
    airspeeds: np.ndarray,
    powers: np.ndarray,
    surfaces: Sequence[str],
    values: Mapping[str, np.ndarray],
    attributes: Mapping[str, str | int | float],
) -> xr.Dataset:
    """Label an airframe's survey.

    Parameters
    ----------
    alphas_deg, betas_deg, airspeeds, powers
        Axes: angle of attack and sideslip, deg; true airspeed, m/s; engine power, percent.
    surfaces
        Names of the control surfaces.
    values
        `over_alpha` and `over_beta`: coefficients, shape (angle, 6); `thrust`: N, shape (airspeed, power). Over the
        airspeeds: `trimmable`, `alpha` (deg), `power` (percent), `surfaces` (deg, shape (airspeed, surface)).
    attributes
        Attributes of the dataset.
    """
    meanings = ("Lift", "Drag", "Side force", "Roll moment", "Pitch moment", "Yaw moment")
    data = {
        "over_alpha": (
            ("alpha", "coefficient"),
            values["over_alpha"],
            unit_attributes("1", "Coefficient, no sideslip"),
        ),
        "over_beta": (("beta", "coefficient"), values["over_beta"], unit_attributes("1", "Coefficient over sideslip")),
        "thrust": (("airspeed", "power"), values["thrust"], unit_attributes("N", "Thrust")),
        "trimmable": (
            "airspeed",
            values["trimmable"],
            unit_attributes("1", "Whether level flight is within all limits"),
        ),
        "trim_alpha_deg": ("airspeed", values["alpha"], unit_attributes("degree", "Angle of attack in level flight")),
        "trim_power": ("airspeed", values["power"], unit_attributes("percent", "Power in level flight")),
        "trim_surface_deg": (
            ("airspeed", "surface"),
            values["surfaces"],
            unit_attributes("degree", "Deflection in level flight"),
        ),
    }
    coordinates = {
        "alpha": ("alpha", alphas_deg, unit_attributes("degree", "Angle of attack")),
        "beta": ("beta", betas_deg, unit_attributes("degree", "Sideslip")),
        "airspeed": ("airspeed", airspeeds, unit_attributes("m s-1", "True airspeed")),
        "power": ("power", powers, unit_attributes("percent", "Engine power")),
        "coefficient": ("coefficient", np.array(COEFFICIENTS), unit_attributes("", "Coefficient")),
        "coefficient_meaning": ("coefficient", np.array(meanings)),
        "surface": ("surface", np.array(surfaces), unit_attributes("", "Control surface")),
    }
    return xr.Dataset(data, coordinates, {**attributes, **version_attributes()})
