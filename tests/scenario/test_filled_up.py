"""Bucket sizes: other numbers of aircraft, waypoints, wind layers or keep-outs do not compile another program."""

import re
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.scenario import build_flight, loads
from support.certified_scenario import GOOD

THREE = (Path(__file__).parents[2] / "scenarios" / "three-aircraft.toml").read_text()
FOURTH = """
[[aircraft]]
name = "aircraft-4"
goal = "buoy"
start = { north_m = 6000.0, east_m = -7000.0, altitude_m = 900.0, speed_m_s = 150.0, course_deg = 140.0 }
rendezvous = { stand_off_up_m = 900.0 }
"""
KEEP_OUT = '[[keep_out]]\nname = "{}"\nnorth_m = 50000.0\neast_m = {}\nradius_m = 500.0\ntop_m = 900.0\n'
LAYERS = "[wind]\nlayers = [{}]\n"
LAYER = "{{ altitude_m = {}, speed_m_s = {}, from_deg = 250.0 }}"
ROUTE = "waypoints = [{}]\n"
POINT = "{{ time_s = {0}, north_m = 0, east_m = {0}, altitude_m = 0 }}"


def shape(text):
    """Everything a compiled program depends on: static fields, and shapes and types of the arrays."""
    arrays, static_fields = eqx.partition(build_flight(loads(text), pad_fleet=True), eqx.is_array)
    return jax.tree.structure(arrays), jax.tree.map(lambda a: (a.shape, a.dtype, a.weak_type), arrays), static_fields


def like(text, other_text):
    return eqx.tree_equal(shape(text), shape(other_text))


def keep_outs(count):
    return GOOD + "".join(KEEP_OUT.format(f"zone-{k}", 5000.0 * k) for k in range(count))


def layers(count):
    return GOOD + LAYERS.format(", ".join(LAYER.format(500 * k, 2 * k) for k in range(count)))


def route(count):
    straight = 'name = "buoy"\nkind = "surface"\nnorth_m = 300\neast_m = 2000\n'
    assert straight in GOOD
    points = ", ".join(POINT.format(10 * k) for k in range(count))
    return GOOD.replace(straight, 'name = "buoy"\nkind = "surface"\n' + ROUTE.format(points))


def fleet(count):
    return {1: _without(3, 2), 2: _without(3), 3: THREE, 4: THREE + FOURTH, 5: THREE + FOURTH + _fifth()}[count]


def _without(*numbers):
    head, *parts = THREE.split("[[aircraft]]")
    aircraft, goals = parts[:-1], parts[-1].partition("[[goal]]")
    if len(numbers) == 2:  # one aircraft has no separation
        head = re.sub(r"separation_min_m = .*\n", "", head)
    remaining_parts = [part for part in [*aircraft, goals[0]] if not any(f'"aircraft-{k}"' in part for k in numbers)]
    return "[[aircraft]]".join([head, *remaining_parts]) + goals[1] + goals[2]


def _fifth():
    return FOURTH.replace("aircraft-4", "aircraft-5").replace("6000.0", "6500.0").replace("= 900.0 }", "= 1500.0 }")


@pytest.mark.parametrize("count", [1, 2, 4])
def test_up_to_four_aircraft_are_one_shape(count):
    assert like(fleet(count), THREE)
    certified = [text.replace('planner = "published"', 'planner = "certified"') for text in (fleet(count), THREE)]
    assert like(*certified)


def test_a_fifth_aircraft_has_another_shape():
    assert not like(fleet(5), THREE)


@pytest.mark.parametrize(
    ("make_text", "count", "same_bucket", "next_bucket"), [(keep_outs, 1, 2, 3), (layers, 2, 4, 5), (route, 2, 4, 5)]
)
def test_numbers_in_one_bucket_have_one_shape(make_text, count, same_bucket, next_bucket):
    assert like(make_text(count), make_text(same_bucket))
    assert not like(make_text(count), make_text(next_bucket))


def test_padding_changes_nothing():
    exact, filled = build_flight(loads(THREE)), build_flight(loads(THREE), pad_fleet=True)
    assert (exact.count, filled.count) == (3, 4)
    for exact_leaf, padded_leaf in zip(jax.tree.leaves(exact.groups), jax.tree.leaves(filled.groups), strict=True):
        if np.ndim(exact_leaf):
            np.testing.assert_array_equal(exact_leaf, np.asarray(padded_leaf)[: np.shape(exact_leaf)[0]])


def test_padded_layers_do_not_change_the_wind():
    for height in (0.0, 250.0, 1000.0, 5000.0):
        winds_n = [
            build_flight(loads(layers(count)), pad_fleet=True).environment.wind.at(jnp.array([0.0, 0.0, -height]), 0.0)
            for count in (3, 4)
        ]
        if height <= 1000.0:
            np.testing.assert_allclose(*winds_n, atol=1e-12)
        else:
            np.testing.assert_allclose([np.linalg.norm(wind_n) for wind_n in winds_n], [4.0, 6.0], rtol=1e-12)
