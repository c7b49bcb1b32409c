"""What trims, linear models, step tests and surveys begin with: an airframe, gains, a steady flight."""

from collections.abc import Mapping
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp

from anser.aircraft import AbstractAirframe, AbstractF16, condition, refuse_impossible_body
from anser.compiling import compiled
from anser.control import AutopilotGains, Bandwidths, automatic_gains, own_bandwidths, published_gains
from anser.environment import Environment
from anser.scenario import VARIANTS, load_airframe
from anser.scenario.schema_aircraft import Gains
from anser.shapes import Scalar
from anser.simulation import MapPoint, TrimPoint, TrimTarget, map_point, nearest_trims, solve_trim, trim_violations

Inversion = Literal["model", "incremental"]

solve = compiled(solve_trim)


class ConditionError(ValueError):
    """A condition that cannot be flown steadily, held by the loop or described by Euler angles; the text is final."""


def airframe_of(
    aircraft: str | AbstractAirframe, variant: str = "textbook", x_cg_over_c: float | None = None
) -> tuple[AbstractAirframe, dict[str, str | int | float]]:
    """Airframe by its name or file, or the caller's own as it is; and attributes that say which.

    Parameters
    ----------
    aircraft
        Name of an airframe of the library or of an entry point, path of an aircraft file, or an airframe.
    variant, x_cg_over_c
        Of the library's F-16: see `load_f16`.

    Raises
    ------
    ValueError
        No such airframe; a centre of gravity for an airframe that is not the library's F-16; or an airframe of
        an impossible body.
    ScenarioError
        No valid aircraft file.
    """
    if isinstance(aircraft, str):
        of: dict[str, str | int | float] = {"aircraft": aircraft}
        return load_airframe(aircraft, variant, x_cg_over_c), of | (
            {"variant": variant} if aircraft in VARIANTS else {}
        )
    if x_cg_over_c is not None:
        raise ValueError(
            f"x_cg_over_c: arrived {x_cg_over_c} with an airframe of your own; expected None, "
            "and the airframe built with the centre of gravity that it is to have"
        )
    refuse_impossible_body(aircraft, type(aircraft).__name__)
    return aircraft, {"aircraft": "custom"}


def name_of(attributes: Mapping[str, Any]) -> str:
    """Airframe as attributes of `airframe_of` name it, with its variant where it has one."""
    return " ".join(
        [str(attributes["aircraft"]), *(f"({attributes[key]})" for key in ("variant",) if key in attributes)]
    )


def gains_for(inversion: Inversion, gains: AutopilotGains | None = None) -> AutopilotGains:
    """Gains of the autopilot, the published ones if none are given, with the bandwidth of the sensors' filter set."""
    bandwidth = Gains().sensor_bandwidth_rad_s if inversion == "incremental" else 0.0
    wanted = published_gains() if gains is None else gains
    return eqx.tree_at(lambda g: g.sensor_bandwidth, wanted, jnp.asarray(bandwidth, dtype=float))


def own_gains(
    airframe: AbstractAirframe, environment: Environment, trim: TrimPoint, step_s: float, inversion: Inversion
) -> AutopilotGains:
    """Gains where none are given: the published ones of an F-16, those of the aircraft itself of any other."""
    if isinstance(airframe, AbstractF16):
        return gains_for(inversion)
    bandwidths = _bandwidths(airframe, environment, trim, jnp.asarray(step_s, dtype=float))
    return gains_for(inversion, automatic_gains(bandwidths))


@compiled
def _bandwidths(airframe: AbstractAirframe, environment: Environment, trim: TrimPoint, step: Scalar) -> Bandwidths:
    now = condition(airframe, environment, 0.0, trim.state)
    return own_bandwidths(airframe, now, trim.state.surfaces, trim.power, step)


def steady_trim(airframe: AbstractAirframe, environment: Environment, target: TrimTarget) -> TrimPoint:
    """Trim point of a steady flight; ConditionError with the nearest trim points where there is none."""
    trim = solve(airframe, environment, target)
    if trim_violations(airframe, environment, trim):
        raise ConditionError(nearest_trims(airframe, environment, target).message())
    return trim


@compiled
def map_points(airframe: AbstractAirframe, environment: Environment, targets: TrimTarget) -> MapPoint:
    """Points of the trim map at stacked targets."""
    return jax.vmap(lambda target: map_point(airframe, environment, target))(targets)
