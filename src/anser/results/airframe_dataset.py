"""From the numbers of an airframe to a labelled dataset."""

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from anser.derivative_names import COEFFICIENTS
from anser.results.provenance import version_attributes
from anser.results.variable_labels import attributes_of


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
        Axes; m/s and percent.
    surfaces
        Names.
    values
        `over_alpha`, `over_beta` (angle, 6), `thrust` (airspeed, power; N), and over the airspeeds `trimmable`, `alpha`
        (deg), `power` (percent), `surfaces` (airspeed, surface; deg).
    attributes
        Of the whole dataset.
    """
    words = ("Lift", "Drag", "Side force", "Roll moment", "Pitch moment", "Yaw moment")
    data = {
        "over_alpha": (("alpha", "coefficient"), values["over_alpha"], attributes_of("1", "Coefficient, no sideslip")),
        "over_beta": (("beta", "coefficient"), values["over_beta"], attributes_of("1", "Coefficient over sideslip")),
        "thrust": (("airspeed", "power"), values["thrust"], attributes_of("N", "Thrust")),
        "trimmable": ("airspeed", values["trimmable"], attributes_of("1", "Whether level flight is within all limits")),
        "trim_alpha_deg": ("airspeed", values["alpha"], attributes_of("degree", "Angle of attack in level flight")),
        "trim_power": ("airspeed", values["power"], attributes_of("percent", "Power in level flight")),
        "trim_surface_deg": (
            ("airspeed", "surface"),
            values["surfaces"],
            attributes_of("degree", "Deflection in level flight"),
        ),
    }
    coordinates = {
        "alpha": ("alpha", alphas_deg, attributes_of("degree", "Angle of attack")),
        "beta": ("beta", betas_deg, attributes_of("degree", "Sideslip")),
        "airspeed": ("airspeed", airspeeds, attributes_of("m s-1", "True airspeed")),
        "power": ("power", powers, attributes_of("percent", "Engine power")),
        "coefficient": ("coefficient", np.array(COEFFICIENTS), attributes_of("", "Coefficient")),
        "coefficient_meaning": ("coefficient", np.array(words)),
        "surface": ("surface", np.array(surfaces), attributes_of("", "Control surface")),
    }
    return xr.Dataset(data, coordinates, {**attributes, **version_attributes()})
