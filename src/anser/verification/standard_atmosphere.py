"""The standard atmosphere against the tables of the standard."""

from collections.abc import Iterator

import jax
import jax.numpy as jnp

from anser.environment import Air, StandardAtmosphere, geometric_from_geopotential
from anser.verification.check import Check, Comparison
from anser.verification.published import as_printed, half_of_last_digit, published

_UNITS = {"temperature": "K", "pressure": "Pa", "density": "kg/m^3", "speed_of_sound": "m/s"}
_air_at = jax.jit(jax.vmap(StandardAtmosphere().at))


def _measure() -> tuple[Comparison, ...]:
    figures = published("ussa76")
    rows, bases = figures["geometric"], figures["bases"]
    heights = jnp.array([float(row[0]) for row in rows])
    base_heights = jnp.array([float(base) for base, _ in bases])
    air = _air_at(jnp.concatenate([heights, jax.vmap(geometric_from_geopotential)(base_heights)]))
    return (*_table(rows, figures["last_digit_one_low"]["pressure_Pa"], air), *_bases(bases, air.pressure[len(rows) :]))


def _table(rows: list, pressure_low_m: list[int], air: Air) -> Iterator[Comparison]:
    for column, (name, unit) in enumerate(_UNITS.items(), start=1):
        values = getattr(air, name)
        for k, row in enumerate(rows):
            if row[column] is None:
                continue
            half = half_of_last_digit(row[column])
            low = name == "pressure" and row[0] in pressure_low_m
            yield Comparison(
                group=name,
                where=f"{row[0] / 1000:g} km",
                unit=unit,
                expected=float(row[column]),
                obtained=float(values[k]),
                tolerance=2.0 * half if low else half,
                why="last digit cut, not rounded" if low else "",
            )


def _bases(bases: list, pressures: jax.Array) -> Iterator[Comparison]:
    for (base, printed), obtained in zip(bases, pressures, strict=True):
        yield as_printed("base_pressure", f"{base / 1000:g} km geopotential", "Pa", printed, obtained)


USSA76 = Check(
    key="ussa76",
    title="U.S. Standard Atmosphere 1976, sea level to 80 km",
    source="[USSA76] tab. I, III, 4",
    why="half the last digit",
    explanation=(
        "Temperature, pressure, density and speed of sound at geometric altitudes, and the pressures at the bases of "
        "the layers. The layers' pressures are chained here from sea level with the standard's own gas constant, "
        "8.31432 J/(mol K); with the newer 8.31447 none of the printed base pressures would come out. Table I cuts "
        "the last digit of the pressures at 10, 11, 15, 60 and 80 km instead of rounding it (its equations give "
        "26499.9, 22700.0, 12111.8, 21.9587 and 1.05247 Pa where it prints 26499, 22699, 12111, 21.958 and 1.0524): "
        "there the tolerance is one unit of the last digit."
    ),
    measure=_measure,
)
