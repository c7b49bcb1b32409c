"""The standard atmosphere against the printed table, ambiance, NASA's check-cases and the hydrostatic law."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ambiance import Atmosphere as AmbianceAtmosphere
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.constants import AIR_HEAT_RATIO, AIR_MOLAR_MASS_KG_MOL, GAS_CONSTANT_J_MOL_K, STANDARD_GRAVITY_M_S2
from anser.environment import StandardAtmosphere
from anser.environment.air import geometric_altitude, geopotential_altitude, standard_layers
from anser.environment.atmosphere import LayeredAtmosphere
from anser.units import FOOT_M, PSF_PA, RANKINE_K, SLUG_FT3_KG_M3

air_at = jax.jit(StandardAtmosphere().at)
airs_at = jax.jit(jax.vmap(StandardAtmosphere().at))
slopes_at = jax.jit(jax.jacrev(StandardAtmosphere().at))

# Theory section 3, [USSA76] tables 4 and I: geopotential base m, temperature K, pressure Pa, half a unit of its last
# figure.
PRINTED_BASES = [
    (0.0, 288.15, 101325.0, 0.0),
    (11000.0, 216.65, 22632.1, 0.05),
    (20000.0, 216.65, 5474.89, 0.005),
    (32000.0, 228.65, 868.019, 0.0005),
    (47000.0, 270.65, 110.906, 0.0005),
    (51000.0, 270.65, 66.9389, 0.00005),
    (71000.0, 214.65, 3.9564, 0.00005),
    (84852.0, 186.946, 0.3734, 0.00005),
]
BASES_M = np.array([row[0] for row in PRINTED_BASES])


@pytest.mark.parametrize(("base", "temperature", "pressure", "half_unit"), PRINTED_BASES)
def test_layer_bases_equal_the_printed_table(base, temperature, pressure, half_unit):
    """The chained pressures round to the printed values, unlike with the newer gas constant 8.31447."""
    air = air_at(geometric_altitude(base))
    assert air.temperature == pytest.approx(temperature, abs=1e-9)  # rounding of the altitude, 1e-11 m
    assert air.pressure == pytest.approx(pressure, abs=half_unit + 1e-9)


def test_sea_level_values_equal_the_printed_ones():
    """[USSA76] table 2 and part 1.3: rho 1.2250 kg/m^3, speed of sound 340.294 m/s, to the printed digits."""
    air = air_at(0.0)
    assert (air.temperature, air.pressure) == (288.15, 101325.0)
    assert air.density == pytest.approx(1.2250, abs=5e-5)
    assert air.speed_of_sound == pytest.approx(340.294, abs=5e-4)


# [NESC] participants sim_04 and sim_05: altitude ft, density slug/ft^3, speed of sound ft/s, pressure psf, deg R.
NESC_AIR = [
    (0.0, (0.002376892825, 0.0023769), (1116.450003, 1116.449208), (2116.238417, 2116.22), 518.67),
    (10013.0, (0.001754833495, 0.001754837946), (1077.352733, 1077.351965), (1454.883393, 1454.87003), 482.9791755),
    (30000.0, (0.0008906854512, 0.0008906867504), (994.8494935, 994.8487846), (629.6737095, 629.6672472), 411.8388731),
]


@pytest.mark.parametrize(("altitude_ft", "density", "speed_of_sound", "pressure", "temperature"), NESC_AIR)
def test_air_equals_that_of_the_nesc_check_cases(altitude_ft, density, speed_of_sound, pressure, temperature):
    """The two participants differ by rounded constants; the same difference from the mean is tolerated.

    Density by 3e-6 (sim_05 starts from 0.0023769), sound by 1e-6, pressure by 1e-5 (sim_04 from 2116.238). The newer
    gas constant, 1.8e-5 larger, would change density by up to 1.8e-5 and sound by 9e-6.
    """
    air = air_at(altitude_ft * FOOT_M)
    assert air.density / SLUG_FT3_KG_M3 == pytest.approx(np.mean(density), rel=3e-6)
    assert air.speed_of_sound / FOOT_M == pytest.approx(np.mean(speed_of_sound), rel=1.2e-6)
    assert air.pressure / PSF_PA == pytest.approx(np.mean(pressure), rel=1e-5)
    assert air.temperature / RANKINE_K == pytest.approx(temperature, abs=1e-7)  # ten figures


@settings(deadline=None, max_examples=60)
@given(st.floats(-5000.0, 81000.0))
def test_air_agrees_with_ambiance(altitude):
    """ICAO 1993, the same layers: from -5 km to 80 km geopotential."""
    air, reference = air_at(altitude), AmbianceAtmosphere(altitude)
    assert air.temperature == pytest.approx(reference.temperature[0], rel=1e-13)
    # ICAO has the molar mass 28.964420 g/mol, [USSA76] 28.9644: 7e-7 apart; sound takes the root.
    assert air.speed_of_sound == pytest.approx(reference.speed_of_sound[0], rel=4e-7)
    # In the exponent that makes up to 8e-6 (ICAO prints 3.95639 Pa at 71 km), and ICAO's bases have six figures only.
    assert air.pressure == pytest.approx(reference.pressure[0], rel=1.2e-5)
    assert air.density == pytest.approx(reference.density[0], rel=1.2e-5)


@settings(deadline=None, max_examples=60)
@given(st.floats(-4999.0, 120e3))
def test_air_satisfies_gas_law_and_hydrostatic_equation(altitude):
    """Ideal gas, speed of sound and, by differentiation, the hydrostatic equation dp/dz = -rho g(z)."""
    air, slopes = air_at(altitude), slopes_at(altitude)
    R_air = GAS_CONSTANT_J_MOL_K / AIR_MOLAR_MASS_KG_MOL
    # A few roundings of relative size 1e-16.
    assert air.pressure == pytest.approx(float(air.density * R_air * air.temperature), rel=1e-15)
    assert air.speed_of_sound**2 == pytest.approx(float(AIR_HEAT_RATIO * R_air * air.temperature), rel=1e-15)
    # Geopotential height is defined by g0 dH = g dz, with gravity as the inverse square of the distance.
    gravity = STANDARD_GRAVITY_M_S2 * (6356766.0 / (6356766.0 + altitude)) ** 2
    # r0 z / (r0 + z) differentiated, and the pressure's exponent of up to 17 ln(..), round by some 1e-15.
    assert slopes.pressure == pytest.approx(float(-air.density * gravity), rel=1e-14)


def test_the_pressure_is_continuous_at_the_bases():
    z = geometric_altitude(BASES_M)
    step = 1e-6
    below, above = airs_at(z - step), airs_at(z + step)
    # Over 2e-6 m pressure changes by 4e-10 of itself; a base printed to six figures would jump by 1e-6.
    np.testing.assert_allclose(below.pressure, above.pressure, rtol=1e-9)
    np.testing.assert_allclose(below.temperature, above.temperature, rtol=1e-9)
    for jacobian in (jax.jacfwd, jax.jacrev):
        slopes = jax.jit(jax.vmap(jacobian(StandardAtmosphere().at)))(jnp.concatenate([z, z - step]))
        for slope in jax.tree.leaves(slopes):
            assert np.all(np.isfinite(slope))
        assert np.all(slopes.pressure < 0.0)


def test_slopes_at_a_base_are_those_of_the_layer_above():
    """At 11 km geopotential the layer above counts: isothermal."""
    slopes = slopes_at(geometric_altitude(11000.0) + 1e-6)
    assert (slopes.temperature, slopes.speed_of_sound) == (0.0, 0.0)
    # Lapse rate times dH/dz, which is 1 at sea level, where exactly on the base the first layer counts.
    assert slopes_at(0.0).temperature == pytest.approx(-0.0065, rel=1e-14)


def test_air_outside_the_standard_stays_defined():
    lowest, below = air_at(-5000.0), air_at(-9000.0)
    for at_limit, outside_value in zip(jax.tree.leaves(lowest), jax.tree.leaves(below), strict=True):
        assert at_limit == outside_value
    top = air_at(geometric_altitude(84852.0))
    heights = jnp.array([87e3, 100e3, 200e3, 1e6, 1e8])
    above = airs_at(heights)
    np.testing.assert_allclose(above.temperature, top.temperature, rtol=1e-12)
    pressures = np.concatenate([[top.pressure], above.pressure])
    assert np.all(np.diff(pressures[:4]) < 0.0)
    assert np.all(pressures >= 0.0)  # underflows to zero far out
    slopes = jax.jit(jax.vmap(jax.jacrev(StandardAtmosphere().at)))(jnp.concatenate([heights, jnp.array([-5e3, -1e5])]))
    assert all(np.all(np.isfinite(slope)) for slope in jax.tree.leaves(slopes))


@settings(deadline=None, max_examples=30)
@given(st.floats(-5000.0, 100e3))
def test_the_geopotential_round_trip_is_exact(altitude):
    h = geopotential_altitude(altitude)
    # The difference is z^2 / r0 but for a relative z / r0 < 2 %; it is taken between altitudes of up to 1e5 m.
    assert altitude - h == pytest.approx(altitude**2 / 6356766.0, rel=0.02, abs=1e-10)
    # The quotient r0 / (r0 - h) rounds by 1e-16, altitudes of 1e5 m by 1e-11.
    assert geometric_altitude(h) == pytest.approx(altitude, rel=1e-14, abs=1e-12)


def test_geopotential_altitudes_equal_the_printed_pairs():
    """[USSA76] table I prints Z = 86,000 m with H = 84,852 m, and Z = 11,019 m with H = 11,000 m."""
    assert geopotential_altitude(86000.0) == pytest.approx(84852.0, abs=0.5)
    assert geometric_altitude(11000.0) == pytest.approx(11019.0, abs=0.5)


def test_batches_equal_single_evaluations():
    altitudes = jnp.linspace(-4e3, 84e3, 45)
    batch = airs_at(altitudes)
    for i in (0, 20, 44):
        for whole, single in zip(jax.tree.leaves(batch), jax.tree.leaves(air_at(altitudes[i])), strict=True):
            np.testing.assert_allclose(whole[i], single, rtol=1e-14)  # vector exp and log may round differently


def test_layers_of_the_standard_are_the_standard_atmosphere():
    altitudes = jnp.linspace(-4000.0, 80_000.0, 200)
    layered = jax.jit(jax.vmap(LayeredAtmosphere(jnp.asarray(standard_layers())).at))(altitudes)
    standard = airs_at(altitudes)
    for field in ("density", "pressure", "temperature", "speed_of_sound"):
        np.testing.assert_allclose(getattr(layered, field), getattr(standard, field), rtol=1e-13)


def test_a_warm_day_of_low_pressure_satisfies_the_hydrostatic_equation():
    """dp/dh = -rho g0 by geopotential altitude, 30 K above the standard and 98,000 Pa at sea level."""
    atmosphere = LayeredAtmosphere(jnp.asarray(standard_layers(30.0, 98_000.0)))
    sea_level = jax.jit(lambda h: atmosphere.at(h))(0.0)
    assert float(sea_level.pressure) == pytest.approx(98_000.0, rel=1e-12)
    assert float(sea_level.temperature) == pytest.approx(318.15, rel=1e-12)
    geopotential = jnp.asarray([500.0, 5000.0, 15_000.0, 25_000.0])
    slope = jax.jit(jax.vmap(jax.grad(lambda h: atmosphere.at(geometric_altitude(h)).pressure)))(geopotential)
    density = jax.jit(jax.vmap(atmosphere.at))(geometric_altitude(geopotential)).density
    np.testing.assert_allclose(slope, -density * STANDARD_GRAVITY_M_S2, rtol=1e-9)
