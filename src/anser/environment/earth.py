"""Earth models, flat or round: gravity, the local map (chart), and terms of the equations of motion."""

import abc

import equinox as eqx
import jax.numpy as jnp

from anser.constants import (
    EARTH_GM_M3_S2,
    EARTH_J2,
    EARTH_ROTATION_RAD_S,
    SOMIGLIANA_EQUATOR_M_S2,
    SOMIGLIANA_K,
    WGS84_A_M,
    WGS84_F,
)
from anser.numerics.arrays import as_array, namespace
from anser.numerics.linear import cross
from anser.shapes import Matrix33, Scalar, ScalarLike, Vector3
from anser.spatial.frames import rotation_ned_from_ecef
from anser.spatial.rotations import rotate, rotate_back
from anser.spatial.wgs84 import (
    WGS84,
    Ellipsoid,
    ecef_from_geodetic,
    flat_from_geodetic,
    flat_map_scale,
    geodetic_from_ecef,
    geodetic_from_flat,
    radii_of_curvature,
)


def somigliana(latitude: ScalarLike) -> Scalar:
    """Return the normal gravity on the WGS-84 ellipsoid (m/s^2, down) at a geodetic latitude (rad).

    The result includes the centrifugal acceleration. Source: theory section 1, [WGS84].
    """
    xp = namespace(latitude)
    s2 = xp.sin(latitude) ** 2
    return as_array(SOMIGLIANA_EQUATOR_M_S2 * (1.0 + SOMIGLIANA_K * s2) / xp.sqrt(1.0 - WGS84.e2 * s2))


def gravitation_j2(
    position_e: Vector3, gravitational_parameter: ScalarLike, oblateness_j2: ScalarLike, equatorial_radius: ScalarLike
) -> Vector3:
    """Compute the gravitation (3,), ECEF, m/s^2, of an oblate Earth, without centrifugal acceleration.

    `position_e` is the position (3,), ECEF, m; `gravitational_parameter` is GM, m^3/s^2. `oblateness_j2` is J2 for the
    reference radius `equatorial_radius` (m); 0 gives the field of a point mass. Source: [SL] eq. 1.6-14; [NESC].
    """
    r2 = jnp.sum(position_e * position_e)
    strength = gravitational_parameter / (r2 * jnp.sqrt(r2))
    bulge = 1.5 * oblateness_j2 * equatorial_radius * equatorial_radius / r2
    z2 = position_e[2] * position_e[2] / r2
    across, along = 1.0 + bulge * (1.0 - 5.0 * z2), 1.0 + bulge * (3.0 - 5.0 * z2)
    return -strength * position_e * jnp.stack([across, across, along])


class LocalEarth(eqx.Module):
    """Earth-dependent terms of the equations of motion at one position and velocity, in local NED axes."""

    gravity: Scalar  #: Effective gravity (gravitation and centrifugal acceleration) along down, m/s^2.
    #: Acceleration of a free body relative to the NED axes, which travel with the aircraft, m/s^2: effective gravity
    #: minus the Coriolis acceleration and the acceleration due to the rotation of the axes.
    apparent_gravity_n: Vector3
    earth_rate_n: Vector3  #: Angular velocity of the Earth, rad/s.
    transport_rate_n: Vector3  #: Angular velocity of the travelling NED axes relative to the Earth, rad/s.
    chart_scale: Vector3  #: Rates of the chart coordinates divided by the velocity (north, east, down).


class AbstractEarth(eqx.Module):
    """Interface of an Earth model with a chart, the local map in which positions are given.

    Chart positions are (north, east, down) from the chart's origin, m; altitude is up.
    """

    @property
    @abc.abstractmethod
    def gravity_at_origin(self) -> Scalar:
        """Effective gravity at the chart's origin, m/s^2."""

    @abc.abstractmethod
    def local_earth(self, position_n: Vector3, velocity_n: Vector3) -> LocalEarth:
        """Compute the terms of the equations of motion at a chart position (m) and velocity over ground (NED, m/s)."""

    @abc.abstractmethod
    def sight(self, position_n: Vector3, other_n: Vector3, other_velocity_n: Vector3) -> tuple[Vector3, Vector3]:
        """Return the line of sight (m) from an observer to a second point, and the point's velocity over ground (m/s).

        `position_n` and `other_n` are the chart positions of observer and second point, m. `other_velocity_n` is the
        rate of `other_n`, m/s. The results are in the NED axes at the observer.
        """

    @abc.abstractmethod
    def motion_on_chart(self, position_n: Vector3, line_n: Vector3, velocity_n: Vector3) -> tuple[Vector3, Vector3]:
        """Return a point's chart position (m) and its rate (m/s) from the line of sight: the inverse of `sight`.

        `position_n` is the observer's chart position (m). The line of sight `line_n` (m) and the point's velocity over
        ground `velocity_n` (m/s) are in the NED axes at the observer.
        """


class FlatEarth(AbstractEarth):
    """A flat Earth at rest with uniform gravity (theory section 2)."""

    gravity: Scalar  #: Gravity along down, m/s^2.

    @property
    def gravity_at_origin(self) -> Scalar:
        """Gravity along down, m/s^2."""
        return self.gravity

    def local_earth(self, position_n: Vector3, velocity_n: Vector3) -> LocalEarth:
        """Return the terms of the equations of motion: gravity along down, zero angular velocities, chart scale 1."""
        zero = jnp.zeros_like(self.gravity)
        return LocalEarth(
            gravity=self.gravity,
            apparent_gravity_n=jnp.stack([zero, zero, self.gravity]),
            earth_rate_n=jnp.zeros(3, zero.dtype),
            transport_rate_n=jnp.zeros(3, zero.dtype),
            chart_scale=jnp.ones(3, zero.dtype),
        )

    def sight(self, position_n: Vector3, other_n: Vector3, other_velocity_n: Vector3) -> tuple[Vector3, Vector3]:
        """Return the line of sight, `other_n - position_n` (m), and `other_velocity_n` (m/s)."""
        return other_n - position_n, other_velocity_n

    def motion_on_chart(self, position_n: Vector3, line_n: Vector3, velocity_n: Vector3) -> tuple[Vector3, Vector3]:
        """Return the point's position, `position_n + line_n` (m), and `velocity_n` (m/s)."""
        return position_n + line_n, velocity_n


class RotatingEarth(AbstractEarth):
    """A rotating ellipsoid (or sphere) with the gravitation of an oblate body.

    The chart is the flat-Earth map of theory section 1, without approximation (`geodetic_from_flat`). North depends on
    latitude alone, east on longitude alone, down on height alone. At the distance d from the origin,
    `chart_scale` differs from 1 by at most about (1 + |tan(latitude of the position)|) d/R, with the Earth's radius R.
    No path may be planned across a pole or the meridian opposite to the origin, because neighbouring points on both
    sides are far apart in the chart.
    """

    ellipsoid: Ellipsoid  #: Figure of the Earth; altitudes are heights above the ellipsoid.
    rotation_rate: Scalar  #: Rotation rate about the polar axis, rad/s.
    gravitational_parameter: Scalar  #: GM, m^3/s^2.
    oblateness_j2: Scalar  #: J2 for the ellipsoid's equatorial radius, no unit.
    #: Geodetic coordinates of the chart's origin at height 0, rad; not a pole.
    latitude: Scalar
    longitude: Scalar

    @property
    def gravity_at_origin(self) -> Scalar:
        """Effective gravity at the chart's origin, along down, m/s^2."""
        zero = jnp.zeros(3)
        return self.local_earth(zero, zero).gravity

    def geodetic(self, position_n: Vector3) -> tuple[Scalar, Scalar, Scalar]:
        """Return geodetic latitude and longitude (rad) and height above the ellipsoid (m) of a chart position (m)."""
        return geodetic_from_flat(position_n, self.latitude, self.longitude, 0.0, self.ellipsoid)

    def ecef_from_chart(self, position_n: Vector3) -> Vector3:
        """Convert a chart position (3,) to an Earth-fixed position (3,), ECEF, both in m."""
        return ecef_from_geodetic(*self.geodetic(position_n), self.ellipsoid)

    def chart_from_ecef(self, position_e: Vector3) -> Vector3:
        """Convert an Earth-fixed position (3,), ECEF, to a chart position (3,), both in m."""
        lat, lon, h = geodetic_from_ecef(position_e, self.ellipsoid)
        return flat_from_geodetic(lat, lon, h, self.latitude, self.longitude, 0.0, self.ellipsoid)

    def effective_gravity_e(self, position_e: Vector3) -> Vector3:
        """Return gravitation plus centrifugal acceleration (3,), ECEF axes, m/s^2, at an Earth-fixed position (m)."""
        out_e = jnp.stack([position_e[0], position_e[1], jnp.zeros_like(position_e[2])])
        return self.gravitation_e(position_e) + self.rotation_rate * self.rotation_rate * out_e

    def gravitation_e(self, position_e: Vector3) -> Vector3:
        """Return the gravitation without centrifugal acceleration (3,), ECEF, m/s^2, at an Earth-fixed position (m)."""
        return gravitation_j2(position_e, self.gravitational_parameter, self.oblateness_j2, self.ellipsoid.a)

    def local_earth(self, position_n: Vector3, velocity_n: Vector3) -> LocalEarth:
        """Compute the terms of the equations of motion at a chart position (m) and a velocity over ground (NED, m/s).

        Source: [SL] eq. 1.7-18 to 1.7-20 in NED axes.
        """
        lat, lon, h = self.geodetic(position_n)
        R_M, R_N = radii_of_curvature(lat, self.ellipsoid)
        R_ne = rotation_ned_from_ecef(lat, lon)
        gravity_n = rotate(R_ne, self.effective_gravity_e(ecef_from_geodetic(lat, lon, h, self.ellipsoid)))
        c_lat, s_lat = jnp.cos(lat), jnp.sin(lat)
        earth_rate_n = self.rotation_rate * jnp.stack([c_lat, jnp.zeros_like(lat), -s_lat])
        east_rate = velocity_n[1] / (R_N + h)
        transport_rate_n = jnp.stack([east_rate, -velocity_n[0] / (R_M + h), -east_rate * s_lat / c_lat])
        reference_M, reference_N = radii_of_curvature(self.latitude, self.ellipsoid)
        reference_east = reference_N * jnp.cos(self.latitude)
        return LocalEarth(
            gravity=gravity_n[2],
            apparent_gravity_n=gravity_n - cross(2.0 * earth_rate_n + transport_rate_n, velocity_n),
            earth_rate_n=earth_rate_n,
            transport_rate_n=transport_rate_n,
            chart_scale=jnp.stack(
                [
                    reference_M * flat_map_scale(position_n[0], reference_M) / (R_M + h),
                    reference_east * flat_map_scale(position_n[1], reference_east) / ((R_N + h) * c_lat),
                    jnp.ones_like(lat),
                ]
            ),
        )

    def sight(self, position_n: Vector3, other_n: Vector3, other_velocity_n: Vector3) -> tuple[Vector3, Vector3]:
        """Return line of sight (m) and velocity over ground (m/s) of a second point, in the observer's NED axes.

        Arguments: `AbstractEarth.sight`.
        """
        R_ne, other_R_ne = self._axes(position_n), self._axes(other_n)
        line_e = self.ecef_from_chart(other_n) - self.ecef_from_chart(position_n)
        velocity_n = other_velocity_n / self.local_earth(other_n, jnp.zeros_like(other_n)).chart_scale
        return rotate(R_ne, line_e), rotate(R_ne, rotate_back(other_R_ne, velocity_n))

    def motion_on_chart(self, position_n: Vector3, line_n: Vector3, velocity_n: Vector3) -> tuple[Vector3, Vector3]:
        """Return the chart position (m) of the far end of the line of sight, and the rate of this position (m/s).

        Arguments: `AbstractEarth.motion_on_chart`.
        """
        R_ne = self._axes(position_n)
        other_n = self.chart_from_ecef(self.ecef_from_chart(position_n) + rotate_back(R_ne, line_n))
        other_velocity_n = rotate(self._axes(other_n), rotate_back(R_ne, velocity_n))
        return other_n, self.local_earth(other_n, jnp.zeros_like(other_n)).chart_scale * other_velocity_n

    def _axes(self, position_n: Vector3) -> Matrix33:
        lat, lon, _ = self.geodetic(position_n)
        return rotation_ned_from_ecef(lat, lon)


def wgs84_earth(latitude: ScalarLike, longitude: ScalarLike) -> RotatingEarth:
    """Build the rotating WGS-84 Earth with J2 gravitation; the chart's origin has latitude and longitude (rad)."""
    return _earth(WGS84_A_M, WGS84_F, EARTH_ROTATION_RAD_S, EARTH_J2, latitude, longitude)


def spherical_earth(
    radius: ScalarLike, latitude: ScalarLike, longitude: ScalarLike, rotation_rate: ScalarLike = 0.0
) -> RotatingEarth:
    """Build a spherical Earth (radius in m) with inverse-square gravitation; rotation rate in rad/s, by default 0.

    GM is the Earth's for any radius. The chart's origin is at `latitude` and `longitude`, rad. Source: [NESC] cases 4
    and 5.
    """
    return _earth(radius, 0.0, rotation_rate, 0.0, latitude, longitude)


def _earth(
    a: ScalarLike, f: ScalarLike, rotation_rate: ScalarLike, j2: ScalarLike, latitude: ScalarLike, longitude: ScalarLike
) -> RotatingEarth:
    # Strongly typed leaves: replacing one by another array does not recompile.
    radius, flattening, rate, gm, oblateness, lat, lon = (
        as_array(x) for x in (a, f, rotation_rate, EARTH_GM_M3_S2, j2, latitude, longitude)
    )
    return RotatingEarth(Ellipsoid(radius, flattening), rate, gm, oblateness, lat, lon)
