"""The build-up of NASA TP-1538 with SciPy's interpolation, as printed in the report: an independent reference."""

import json
from importlib import resources

import numpy as np
from scipy.interpolate import RegularGridInterpolator

DATA = json.loads(resources.files("anser.aircraft").joinpath("data/tp1538.json").read_text(encoding="utf-8"))
AXES = {name: np.array(points) for name, points in DATA["breakpoints_deg"].items()}
TABLES = {name: np.array(table["values"]) for name, table in DATA["tables"].items()}
X_REFERENCE, CHORD_FT, SPAN_FT = 0.35, 11.32, 30.0

_LOOK_UP = {
    name: RegularGridInterpolator([AXES[axis] for axis in table["axes"]], TABLES[name], bounds_error=True)
    for name, table in DATA["tables"].items()
}


def look_up(name, *at):
    at = np.broadcast_arrays(*at)
    return _LOOK_UP[name](np.stack(at, axis=-1)).reshape(at[0].shape)


def coefficients(alpha, beta, elevator, aileron, rudder, lef, P, Q, R, V_ft_s, x_cg):
    """CX, CY, CZ, Cl, Cm, Cn along a last axis; angles in deg, rates in rad/s, numbers or arrays of one shape.

    Above an alpha of 45 deg the flap has to be at 25 deg.
    """
    f, a, r = 1 - lef / 25, aileron / 20, rudder / 30
    p, q, y = P * SPAN_FT / (2 * V_ft_s), Q * CHORD_FT / (2 * V_ft_s), R * SPAN_FT / (2 * V_ft_s)
    assert np.all((np.asarray(alpha) <= 45) | (f == 0))

    def short(name, *at):
        return look_up(name, np.minimum(alpha, 45), *at)

    def base(name, e):
        return look_up(name, alpha, beta, e) if name != "Cy" else look_up(name, alpha, beta)

    def flap(name):
        return short(f"{name}_lef", beta) - base(name, 0.0)

    def damped(name):
        return look_up(name, alpha) + f * short(f"delta{name}_lef")

    def lateral(name, base_value, increment):
        rudder_part = look_up(f"{name}_r30", alpha, beta) - base(name, 0.0)
        aileron_part = look_up(f"{name}_a20", alpha, beta) - base(name, 0.0)
        flap_part = short(f"{name}_a20_lef", beta) - short(f"{name}_lef", beta) - aileron_part
        C = "CY" if name == "Cy" else name
        return (
            base_value
            + f * flap(name)
            + a * (aileron_part + f * flap_part)
            + r * rudder_part
            + y * damped(C.replace("CY", "Cy") + "r")
            + p * damped(C.replace("CY", "Cy") + "p")
            + increment
        )

    CX = base("Cx", elevator) + f * flap("Cx") + q * damped("Cxq")
    CZ = base("Cz", elevator) + f * flap("Cz") + q * damped("Czq")
    Cm = (
        look_up("eta_el", elevator) * base("Cm", elevator)
        + (X_REFERENCE - x_cg) * CZ
        + f * flap("Cm")
        + q * damped("Cmq")
        + look_up("deltaCm", alpha)
    )
    CY = lateral("Cy", base("Cy", 0.0), 0.0)
    Cl = lateral("Cl", base("Cl", elevator), look_up("deltaClbeta", alpha) * beta)
    Cn = lateral("Cn", base("Cn", elevator), look_up("deltaCnbeta", alpha) * beta)
    return np.stack([CX, CY, CZ, Cl, Cm, Cn - (X_REFERENCE - x_cg) * CHORD_FT / SPAN_FT * CY], axis=-1)
