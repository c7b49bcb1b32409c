"""User-defined airframes with an impossible body are refused at every entry."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import anser
from anser.aircraft.airframe import refuse_impossible_body
from anser.aircraft_files import AIRFRAMES, library, load_airframe
from anser.aircraft_files.sources import VARIANTS
from support.light_aircraft import light_aircraft

GOOD = light_aircraft()
FLAWS = {
    "mass": (lambda a: a.mass_properties.mass, jnp.asarray(0.0), "0 as mass_properties.mass; expected a positive"),
    "moment": (lambda a: a.mass_properties.inertia_b, jnp.asarray(np.diag([1.0, 1.0, 3.0])), "3 as Jzz .*at most Jxx"),
    "sign": (lambda a: a.mass_properties.inertia_b, jnp.asarray(-np.eye(3)), "-1 as Jxx in mass_properties.inertia_b"),
    "symmetry": (
        lambda a: a.mass_properties.inertia_b,
        jnp.asarray([[1.0, 0.1, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        "not symmetric",
    ),
    "shape": (lambda a: a.mass_properties.inertia_b, jnp.asarray(np.ones(3)), r"of shape \(3,\)"),
    "inverse": (lambda a: a.mass_properties.inertia_inverse_b, jnp.asarray(np.eye(3)), "expected the inverse"),
    "span": (lambda a: a.span, jnp.asarray(-10.0), "-10 as span"),
    "area": (lambda a: a.wing_area, jnp.asarray(jnp.nan), "nan as wing_area"),
}


def flawed(flaw):
    selector, value, _ = FLAWS[flaw]
    return eqx.tree_at(selector, GOOD, value)


@pytest.mark.parametrize("flaw", FLAWS)
def test_an_impossible_body_is_refused_with_the_attribute(flaw):
    with pytest.raises(ValueError, match=rf"mine: arrived .*{FLAWS[flaw][2]}"):
        refuse_impossible_body(flawed(flaw), "mine")


def test_an_impossible_body_is_refused_by_public_functions():
    with pytest.raises(ValueError, match=r"LightAircraft: arrived 0 as mass_properties\.mass"):
        anser.linearize(flawed("mass"), speed_m_s=50.0, altitude_m=0.0)


def test_an_impossible_body_is_refused_at_an_entry_point(monkeypatch):
    class Point:
        value = "mine:aircraft"

        def load(self):
            return lambda: flawed("sign")

    monkeypatch.setattr(library, "entry_points", lambda: {"mine": Point()})
    with pytest.raises(ValueError, match=r"entry point 'mine' \(mine:aircraft\): arrived -1 as Jxx"):
        library._load_entry_point.__wrapped__("mine")


@pytest.mark.parametrize(
    ("name", "variant"), [*((name, "textbook") for name in AIRFRAMES), *(("f16", one) for one in VARIANTS["f16"][1:])]
)
def test_the_library_has_possible_bodies(name, variant):
    refuse_impossible_body(load_airframe(name, variant), name)
    smallest, middle, greatest = np.linalg.eigvalsh(load_airframe(name, variant).mass_properties.inertia_b)
    assert smallest + middle > 1.02 * greatest
