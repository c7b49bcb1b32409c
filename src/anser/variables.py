"""Catalogue of recorded variables: the only source of dataset attributes, plot labels and variable documentation.

The simulation records a history, a dict of arrays of shape (time, aircraft) by `Variable.key`, in SI units and radians.
A dataset contains each variable under `Variable.name`, with a unit suffix: dataset value = history value * factor.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from anser.units import RAD_DEG


@dataclass(frozen=True)
class Variable:
    """A recorded variable: names, units, reference frame, and labels."""

    name: str  # in a dataset, with unit suffix: `roll_rate_deg_s`
    key: str  # in a history, in SI units and radians: `roll_rate`
    unit: str  # in a dataset, in CF notation: "m s-1"; "1" if dimensionless
    factor: float  # dataset value / history value
    frame: str  # reference frame of the quantity; "none" for a scalar without a frame
    symbol: str  # mathematical symbol, with `_` before a subscript
    long_name: str  # description, for plot labels
    dtype: Literal["float64", "int32", "bool"] = "float64"
    # meanings of the values 0, 1, 2, ... of a discrete variable, one word per value; empty for any other variable
    flags: tuple[str, ...] = ()
    # True: recorded only in flights with gusts, sensor errors, an adaptive autopilot or a decentralised planner
    optional: bool = False


# Unit in the dataset, and dataset value / history value, by the suffix of a variable's name.
UNITS: dict[str, tuple[str, float]] = {
    "": ("1", 1.0),
    "m": ("m", 1.0),
    "s": ("s", 1.0),
    "m_s": ("m s-1", 1.0),
    "m_s2": ("m s-2", 1.0),
    "m_s4": ("m s-4", 1.0),
    "deg": ("degree", RAD_DEG),
    "deg_s": ("degree s-1", RAD_DEG),
    "pa": ("Pa", 1.0),
    "n": ("N", 1.0),
    "percent": ("percent", 1.0),
}

_EARTH, _NED, _BODY, _BODY_NED, _BODY_INERTIAL, _ATTITUDE, _AIR, _MEAN_AIR, _SIGHT, _NONE = (
    "WGS-84",
    "NED",
    "body FRD",
    "body FRD, relative to NED",
    "body FRD, relative to inertial space",
    "NED to body FRD",
    "NED, velocity through the air",
    "NED, velocity through the air without gusts",
    "NEU, from the aircraft to the goal",
    "none",
)


def _variable(key: str, suffix: str, frame: str, symbol: str, long_name: str) -> Variable:
    unit, factor = UNITS[suffix]
    return Variable(f"{key}_{suffix}" if suffix else key, key, unit, factor, frame, symbol, long_name)


def _discrete(
    key: str, dtype: Literal["int32", "bool"], symbol: str, long_name: str, flags: tuple[str, ...]
) -> Variable:
    return Variable(key, key, "1", 1.0, _NONE, symbol, long_name, dtype, flags)


STANDARD_SURFACES: tuple[str, ...] = ("elevator", "aileron", "rudder")
"""Names of the standard control surfaces, for pitch, roll and yaw."""

_SUBSCRIPTS: Mapping[str, str] = dict(zip(STANDARD_SURFACES, "ear", strict=True))
_SURFACE_NAME = re.compile("[a-z][a-z0-9]*(_[a-z0-9]+)*")


def surface_label(name: str) -> str:
    """Return the name of a control surface with blanks in place of underscores: "left elevon" for `left_elevon`."""
    return name.replace("_", " ")


def _surfaces(subscripts: Mapping[str, str]) -> tuple[Variable, ...]:
    """Return the variables of control surfaces, positions before commands; `subscripts` maps names to subscripts."""
    labelled = [(name, f"δ_{subscript}", surface_label(name).capitalize()) for name, subscript in subscripts.items()]
    positions = (_variable(name, "deg", _BODY, symbol, label) for name, symbol, label in labelled)
    commands = (
        _variable(f"{name}_command", "deg", _BODY, f"{symbol},c", f"{label} command")
        for name, symbol, label in labelled
    )
    return (*positions, *commands)


_ADAPTATION_VARIABLES: tuple[Variable, ...] = (
    *(
        _variable(f"{key}_{kind}", "", _BODY, f"{prefix}{symbol}", f"{label}{end}, per rad")
        for key, symbol, label in (
            ("cz_alpha", "C_Zα", "Derivative of C_Z by the angle of attack"),
            ("cm_alpha", "C_mα", "Derivative of C_m by the angle of attack"),
            ("cm_q", "C_mq", "Derivative of C_m by the dimensionless pitch rate"),
            ("cl_beta", "C_lβ", "Derivative of C_l by the sideslip"),
            ("cn_beta", "C_nβ", "Derivative of C_n by the sideslip"),
        )
        for kind, prefix, end in (("estimate", "", ", estimated"), ("sigma", "σ_", ", standard deviation"))
    ),
    *(
        _variable(
            f"{axis}_effectiveness_{kind}", "", _BODY, f"{symbol}{subscript}", f"{axis.capitalize()} control {end}"
        )
        for axis, subscript in (("roll", "l"), ("pitch", "m"), ("yaw", "n"))
        for kind, symbol, end in (
            ("estimate", "κ_", "effectiveness over the model's, estimated"),
            ("sigma", "σ_κ,", "effectiveness, standard deviation"),
        )
    ),
    _variable(
        "effectiveness_uncertainty", "", _BODY, "σ_κ/κ", "Greatest relative standard deviation of control effectiveness"
    ),
    _discrete(
        "fault",
        "int32",
        "fault",
        "Fault that the autopilot found",
        ("none", "centre_of_gravity", "ice", "engine", *(f"surface_{number}" for number in range(1, 9))),
    ),
    _variable("fault_size", "", _NONE, "f", "Size of the fault found: shift over the chord, ice, or loss"),
)
"""Variables recorded for an adaptive autopilot: estimated derivatives and control effectiveness, and the fault."""

_OPTIONAL_VARIABLES: tuple[Variable, ...] = (
    # turbulence and gusts
    _variable("airspeed_mean_wind", "m_s", _NONE, "V_0", "True airspeed without gusts"),
    _variable("gust_u", "m_s", _BODY, "u_g", "Gust along body x"),
    _variable("gust_v", "m_s", _BODY, "v_g", "Gust along body y"),
    _variable("gust_w", "m_s", _BODY, "w_g", "Gust along body z"),
    _variable("gust_roll_rate", "deg_s", _BODY, "p_g", "Roll rate of the gust"),
    _variable("gust_pitch_rate", "deg_s", _BODY, "q_g", "Pitch rate of the gust"),
    _variable("gust_yaw_rate", "deg_s", _BODY, "r_g", "Yaw rate of the gust"),
    # estimates of an aircraft whose sensors have errors
    _variable("own_estimate_north", "m", _NED, "p̂_N", "North position, as the aircraft takes it to be"),
    _variable("own_estimate_east", "m", _NED, "p̂_E", "East position, as the aircraft takes it to be"),
    _variable("own_estimate_altitude", "m", _NED, "ĥ", "Altitude, as the aircraft takes it to be"),
    _variable("own_sigma_north", "m", _NED, "σ_p,N", "Standard deviation of the own north position"),
    _variable("own_sigma_east", "m", _NED, "σ_p,E", "Standard deviation of the own east position"),
    _variable("own_sigma_altitude", "m", _NED, "σ_h", "Standard deviation of the own altitude"),
    _variable("goal_sigma_north", "m", _NED, "σ_g,N", "Standard deviation of the goal's north position"),
    _variable("goal_sigma_east", "m", _NED, "σ_g,E", "Standard deviation of the goal's east position"),
    _variable("goal_sigma_altitude", "m", _NED, "σ_g,h", "Standard deviation of the goal's altitude"),
    _variable("goal_correlation", "", _NED, "ρ_g", "Correlation of the goal's north and east position"),
    _variable("goal_sigma_speed", "m_s", _NED, "σ_W", "Standard deviation of the goal's velocity in the plane"),
    _variable("goal_nis", "", _NONE, "ε_ν", "Normalised innovation squared, over its dimension"),
    _discrete("goal_seen", "bool", "seen", "A measurement of the goal came in", ("unseen", "seen")),
    _discrete("goal_known", "int32", "known", "State of the filter", ("known", "never_seen", "diverged")),
    *_ADAPTATION_VARIABLES,
    # coordination of a decentralised fleet
    _variable("clock_lag", "s", _NONE, "t - γ", "Lag of the clock along the path"),
    _variable("clock_rate", "", _NONE, "γ_dot", "Rate of the clock along the path"),
    _discrete("heard_from", "int32", "H", "Whom it heard: the sum of 2^k over aircraft k", ()),
    _discrete("path_offered", "bool", "offer", "Another path is offered", ("settled", "offered")),
)

CATALOGUE: tuple[Variable, ...] = (
    # position and velocity over ground
    _variable("north", "m", _NED, "p_N", "North position"),
    _variable("east", "m", _NED, "p_E", "East position"),
    _variable("altitude", "m", _NED, "h", "Altitude"),
    _variable("latitude", "deg", _EARTH, "φ_g", "Geodetic latitude"),
    _variable("longitude", "deg", _EARTH, "λ", "Longitude"),
    _variable("velocity_north", "m_s", _NED, "V_N", "North velocity"),
    _variable("velocity_east", "m_s", _NED, "V_E", "East velocity"),
    _variable("velocity_down", "m_s", _NED, "V_D", "Down velocity"),
    _variable("velocity_u", "m_s", _BODY, "U", "Velocity along body x"),
    _variable("velocity_v", "m_s", _BODY, "V_y", "Velocity along body y"),
    _variable("velocity_w", "m_s", _BODY, "W", "Velocity along body z"),
    _variable("ground_speed", "m_s", _NED, "V_g", "Ground speed, horizontal"),
    _variable("ground_course", "deg", _NED, "χ_g", "Course over ground"),
    # air data
    _variable("airspeed", "m_s", _NONE, "V", "True airspeed"),
    _variable("alpha", "deg", _BODY, "α", "Angle of attack"),
    _variable("beta", "deg", _BODY, "β", "Angle of sideslip"),
    _variable("mach", "", _NONE, "M", "Mach number"),
    _variable("dynamic_pressure", "pa", _NONE, "q̄", "Dynamic pressure"),
    _variable("airspeed_calibrated", "m_s", _NONE, "V_CAS", "Calibrated airspeed"),
    _variable("airspeed_equivalent", "m_s", _NONE, "V_EAS", "Equivalent airspeed"),
    _variable("pressure_altitude", "m", _NONE, "H_p", "Pressure altitude"),
    _variable("density_altitude", "m", _NONE, "H_ρ", "Density altitude"),
    # attitude, rates, flight path
    _variable("quaternion_0", "", _ATTITUDE, "q_0", "Attitude quaternion, scalar part"),
    _variable("quaternion_1", "", _ATTITUDE, "q_1", "Attitude quaternion, x part"),
    _variable("quaternion_2", "", _ATTITUDE, "q_2", "Attitude quaternion, y part"),
    _variable("quaternion_3", "", _ATTITUDE, "q_3", "Attitude quaternion, z part"),
    _variable("roll", "deg", _ATTITUDE, "φ", "Roll angle"),
    _variable("pitch", "deg", _ATTITUDE, "θ", "Pitch angle"),
    _variable("yaw", "deg", _ATTITUDE, "ψ", "Yaw angle"),
    _variable("roll_rate", "deg_s", _BODY_NED, "P", "Roll rate"),
    _variable("pitch_rate", "deg_s", _BODY_NED, "Q", "Pitch rate"),
    _variable("yaw_rate", "deg_s", _BODY_NED, "R", "Yaw rate"),
    _variable("inertial_roll_rate", "deg_s", _BODY_INERTIAL, "P_i", "Inertial roll rate"),
    _variable("inertial_pitch_rate", "deg_s", _BODY_INERTIAL, "Q_i", "Inertial pitch rate"),
    _variable("inertial_yaw_rate", "deg_s", _BODY_INERTIAL, "R_i", "Inertial yaw rate"),
    _variable("bank", "deg", _AIR, "μ", "Bank angle about the velocity"),
    _variable("path_angle", "deg", _MEAN_AIR, "γ", "Path angle"),
    _variable("course", "deg", _MEAN_AIR, "χ", "Course"),
    _variable("load_factor", "", _BODY, "n_z", "Normal load factor"),
    # controls and engine
    *_surfaces(_SUBSCRIPTS),
    _variable("throttle", "", _NONE, "δ_t", "Throttle"),
    _variable("power", "percent", _NONE, "P_a", "Engine power"),
    _variable("thrust", "n", _BODY, "T", "Thrust"),
    _variable("thrust_command", "n", _BODY, "T_c", "Thrust command"),
    # commands of guidance and autopilot
    _variable("airspeed_command", "m_s", _NONE, "V_c", "True airspeed command"),
    _variable("path_angle_command", "deg", _AIR, "γ_c", "Path angle command"),
    _variable("course_command", "deg", _AIR, "χ_c", "Course command"),
    _variable("bank_command", "deg", _AIR, "μ_c", "Bank angle command"),
    _variable("alpha_command", "deg", _BODY, "α_c", "Angle of attack command"),
    _variable("beta_command", "deg", _BODY, "β_c", "Angle of sideslip command"),
    _variable("roll_rate_command", "deg_s", _BODY, "P_c", "Roll rate command"),
    _variable("pitch_rate_command", "deg_s", _BODY, "Q_c", "Pitch rate command"),
    _variable("yaw_rate_command", "deg_s", _BODY, "R_c", "Yaw rate command"),
    # plan, goal and rendezvous
    _variable("reference_north", "m", _NED, "p_N,ref", "North position of the planned point"),
    _variable("reference_east", "m", _NED, "p_E,ref", "East position of the planned point"),
    _variable("reference_altitude", "m", _NED, "h_ref", "Altitude of the planned point"),
    _variable("position_error", "m", _NONE, "e_p", "Distance to the planned point"),
    _variable("goal_north", "m", _NED, "g_N", "North position of the goal"),
    _variable("goal_east", "m", _NED, "g_E", "East position of the goal"),
    _variable("goal_altitude", "m", _NED, "g_h", "Altitude of the goal"),
    _variable("goal_estimate_north", "m", _NED, "ĝ_N", "North position of the goal, from the sensor"),
    _variable("goal_estimate_east", "m", _NED, "ĝ_E", "East position of the goal, from the sensor"),
    _variable("goal_estimate_altitude", "m", _NED, "ĝ_h", "Altitude of the goal, from the sensor"),
    _variable("goal_velocity_north", "m_s", _NED, "W_N", "North velocity of the goal"),
    _variable("goal_velocity_east", "m_s", _NED, "W_E", "East velocity of the goal"),
    _variable("goal_velocity_down", "m_s", _NED, "W_D", "Down velocity of the goal"),
    _variable("goal_estimate_velocity_north", "m_s", _NED, "Ŵ_N", "North velocity of the goal, from the sensor"),
    _variable("goal_estimate_velocity_east", "m_s", _NED, "Ŵ_E", "East velocity of the goal, from the sensor"),
    _variable("goal_estimate_velocity_down", "m_s", _NED, "Ŵ_D", "Down velocity of the goal, from the sensor"),
    _variable("rendezvous_north", "m", _NED, "r_N", "North position of the rendezvous"),
    _variable("rendezvous_east", "m", _NED, "r_E", "East position of the rendezvous"),
    _variable("rendezvous_altitude", "m", _NED, "r_h", "Altitude of the rendezvous"),
    _variable("range_to_rendezvous", "m", _NONE, "d_r", "Range to the rendezvous"),
    _variable("clearance", "m", _NONE, "d_g", "Distance to the goal"),
    _variable("sight_range", "m", _SIGHT, "R_s", "Sight line range"),
    _variable("sight_azimuth", "deg", _SIGHT, "s_az", "Sight line azimuth"),
    _variable("sight_elevation", "deg", _SIGHT, "s_el", "Sight line elevation"),
    _variable("sight_range_rate", "m_s", _SIGHT, "Ṙ_s", "Sight line range rate"),
    _variable("sight_azimuth_rate", "deg_s", _SIGHT, "ṡ_az", "Sight line azimuth rate"),
    _variable("sight_elevation_rate", "deg_s", _SIGHT, "ṡ_el", "Sight line elevation rate"),
    _variable("arrival_time", "s", _NONE, "t_f", "Planned arrival time"),
    _variable(
        "planned_length",
        "m",
        _NONE,
        "L",
        "Length of the path in force, through the air in space, from its last renewal",
    ),
    _variable("lateral_bend", "m", _NONE, "b", "Lateral bend of the plan; NaN: its planner has none"),
    # state of the flight
    _discrete("phase", "int32", "phase", "Phase of the flight", ("approach", "frozen", "hold")),
    _discrete(
        "renewal",
        "int32",
        "renewal",
        "How the plan in force came to be",
        ("first", "corrected", "anew", "last_good_kept", "goal_awaited", "bent_in_part"),
    ),
    *(
        _discrete(f"{prefix}_limited", "bool", f"{prefix}_lim", f"{label} at a limit", ("free", "limited"))
        for prefix, label in (
            ("speed", "Airspeed command"),
            ("thrust", "Thrust command"),
            ("lift", "Angle of attack or load factor command"),
            ("bank", "Bank angle command or its rate"),
            ("rates", "Body rate command"),
            ("surfaces", "Control surface command"),
        )
    ),
    _discrete("outside_tables", "bool", "outside", "Outside the aerodynamic tables", ("inside", "outside")),
    _discrete("status", "int32", "status", "Status of the aircraft, 0 when fine", ()),
    *(replace(variable, optional=True) for variable in _OPTIONAL_VARIABLES),
)
"""Every variable of a flight's dataset, for aircraft with the standard surfaces, in dataset order."""

DERIVED_KEYS: frozenset[str] = frozenset(
    {
        *("latitude", "longitude"),
        *("airspeed_calibrated", "airspeed_equivalent", "pressure_altitude", "density_altitude"),
    }
)
"""Keys of the variables that are in a dataset but not in a history; the conversion to a dataset computes them."""

ADAPTATION_KEYS: frozenset[str] = frozenset(variable.key for variable in _ADAPTATION_VARIABLES)
"""Keys of the variables recorded only in flights with an adaptive autopilot."""

OPTIONAL_KEYS: frozenset[str] = frozenset(variable.key for variable in CATALOGUE if variable.optional)
"""Keys of the variables recorded only with gusts, sensor errors, an adaptive autopilot or a decentralised planner."""


def surface_variables(names: Iterable[str]) -> tuple[Variable, ...]:
    """Return the variables of the control surfaces `names`: all positions, then all commands.

    For `left_elevon` the variables are `left_elevon_deg` and `left_elevon_command_deg`. Raises ValueError if a name is
    not lower-case words joined by `_`, occurs twice, or coincides, alone or with `_command`, with the key of another
    variable.
    """
    surface_names = list(names)
    wrong = [name for name in surface_names if not _SURFACE_NAME.fullmatch(name)]
    if wrong:
        raise ValueError(f"control surface {wrong[0]!r}: expected lower-case words joined by _, as in left_elevon")
    short = {name: _SUBSCRIPTS.get(name) or _initials(name) for name in surface_names}
    subscripts = list(short.values())
    variables = _surfaces(
        {n: subscript if subscripts.count(subscript) == 1 else n.replace("_", ",") for n, subscript in short.items()}
    )
    keys = [variable.key for variable in variables]
    twice = [name for name in surface_names if surface_names.count(name) > 1 or not is_free_surface_name(name)]
    twice += [key for key in keys if keys.count(key) > 1]
    if twice:
        raise ValueError(f"control surface {twice[0]!r}: another variable of the record has this name; choose another")
    return variables


def is_free_surface_name(name: str) -> bool:
    """Return whether no other variable of a flight has the name of a control surface, alone or with `_command`."""
    return not {name, f"{name}_command"} & ({variable.key for variable in CATALOGUE} - _STANDARD_KEYS)


def _initials(name: str) -> str:
    parts = name.split("_")
    return name if len(parts) == 1 else "".join(part[0] for part in parts)


_STANDARD_KEYS = frozenset(variable.key for variable in _surfaces(_SUBSCRIPTS))


def all_surface_names(names_by_aircraft: Iterable[Sequence[str]]) -> tuple[str, ...]:
    """Return the distinct surface names of several aircraft, in order of first occurrence."""
    return tuple(dict.fromkeys(name for names in names_by_aircraft for name in names))


def catalogue(surfaces: Sequence[str] = STANDARD_SURFACES) -> tuple[Variable, ...]:
    """Return `CATALOGUE` with the variables of the given control surfaces instead of the standard surfaces."""
    start = next(k for k, variable in enumerate(CATALOGUE) if variable.key in _STANDARD_KEYS)
    return (*CATALOGUE[:start], *surface_variables(surfaces), *CATALOGUE[start + len(_STANDARD_KEYS) :])


def recorded_keys(surfaces: Sequence[str] = STANDARD_SURFACES) -> tuple[str, ...]:
    """Return the keys that every history of aircraft with the given control surfaces must contain."""
    return tuple(v.key for v in catalogue(surfaces) if v.key not in DERIVED_KEYS | OPTIONAL_KEYS)


RECORDED_KEYS: tuple[str, ...] = recorded_keys()
"""Keys that every history of aircraft with the standard surfaces must contain."""

PLAN_VARIABLES: tuple[Variable, ...] = (
    _variable("climb_rate", "m_s", _AIR, "V_h", "Climb rate"),
    _variable("vertical_load_factor", "", _AIR, "n_v", "Load factor in the vertical plane"),
    _variable("thrust_surplus", "m_s2", _AIR, "a_T", "Surplus of thrust over drag per mass"),
    _variable("distance_min", "m", _NONE, "d_min", "Least distance between two aircraft"),
    _variable("separation", "m", _NED, "d_sep", "Least separation between two aircraft"),
)
"""Variables that a plan's dataset contains, and a flight's dataset does not."""

MEASUREMENT_VARIABLES: tuple[Variable, ...] = (
    _variable("specific_force_x", "m_s2", _BODY, "f_x", "Specific force along body x, from an accelerometer"),
    _variable("specific_force_y", "m_s2", _BODY, "f_y", "Specific force along body y, from an accelerometer"),
    _variable("specific_force_z", "m_s2", _BODY, "f_z", "Specific force along body z, from an accelerometer"),
)
"""Accelerometer readings of flight-test records, absent in simulated flights; at rest f_z is -9.8 m/s^2."""

SHAPE_VARIABLES: tuple[Variable, ...] = (
    _variable("lateral_shape", "m_s4", _NED, "b_4", "Lateral shape parameter"),
    _variable("vertical_shape", "m_s4", _NED, "c_4", "Vertical shape parameter"),
    _variable("final_path_angle", "deg", _NED, "γ_f", "Path angle at the end"),
    _variable("length", "m", _NED, "L", "Length of the path"),
    _variable("length_estimate", "m", _NED, "L_6", "Length by the six-point rule"),
    _variable("length_published", "m", _NED, "L_pub", "Published estimate of the length"),
)
"""Variables of the published planner's polynomial paths, which shape parameters bend sideways or vertically."""
