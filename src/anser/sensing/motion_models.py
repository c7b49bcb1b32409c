"""Motion models of a goal: steady motion and coordinated turn."""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.shapes import Scalar, ScalarLike

_SMALL = 1e-3  # turn angle, rad, below which sine and cosine integrals use series


class AbstractMotionModel(eqx.Module):
    """Interface of the motion models of a goal. Subclass this class directly, not a concrete model.

    States: position (NED, m), velocity (NED, m/s), and in models with 7 states the turn rate (rad/s, right positive).
    """

    @property
    @abc.abstractmethod
    def size(self) -> int:
        """Number of states: 6, or 7 with the turn rate."""

    @abc.abstractmethod
    def predict_state(self, state: Float[Array, " n"], span: ScalarLike) -> Float[Array, " n"]:
        """Return the state `span` seconds later (earlier if negative), without process noise."""

    @abc.abstractmethod
    def process_noise(self, span: ScalarLike) -> Float[Array, "n n"]:
        """Return the covariance of the process noise accumulated over `span` seconds."""

    @abc.abstractmethod
    def predict_covariance(
        self, mean: Float[Array, " n"], covariance: Float[Array, "n n"], span: ScalarLike
    ) -> Float[Array, "n n"]:
        """Return the covariance `span` seconds later: F P F^T + Q.

        F is the derivative of `predict_state` at `mean`, P is `covariance`, and Q is `process_noise(span)`.
        """


class SteadyMotion(AbstractMotionModel):
    """Nearly constant velocity with white-noise acceleration.

    Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001,
    6.2.2 (discretised continuous white noise acceleration model).
    """

    density: Scalar  # spectral density of the horizontal acceleration, m^2/s^3
    density_up: Scalar  # spectral density of the vertical acceleration, m^2/s^3
    # spectral density of the turn rate's change, rad^2/s^3; None: the turn rate is not a state
    turn_density: Scalar | None = None

    @property
    def size(self) -> int:
        """Number of states: 6, or 7 if `turn_density` is not None. The turn rate does not move the goal."""
        return 6 if self.turn_density is None else 7

    def predict_state(self, state: Float[Array, " n"], span: ScalarLike) -> Float[Array, " n"]:
        """Return the state `span` seconds later (earlier if negative) at constant velocity."""
        return jnp.concatenate([state[:3] + span * state[3:6], state[3:]])

    def process_noise(self, span: ScalarLike) -> Float[Array, "n n"]:
        """Return the covariance of the process noise accumulated over `span` seconds."""
        return _white_acceleration(self.density, self.density_up, self.turn_density, span)

    def predict_covariance(
        self, mean: Float[Array, " n"], covariance: Float[Array, "n n"], span: ScalarLike
    ) -> Float[Array, "n n"]:
        """Return the covariance `span` seconds later (see `AbstractMotionModel.predict_covariance`)."""
        row_product = jnp.concatenate([covariance[:3] + span * covariance[3:6], covariance[3:]], axis=0)
        return jnp.concatenate(
            [row_product[:, :3] + span * row_product[:, 3:6], row_product[:, 3:]], axis=1
        ) + self.process_noise(span)


class CoordinatedTurn(AbstractMotionModel):
    """Horizontal coordinated turn with an unknown turn rate, and white noise of acceleration and turn rate.

    Source: Bar-Shalom, Li, Kirubarajan (see `SteadyMotion`), 11.7.1 and 11.7.2.
    """

    density: Scalar  # spectral density of the horizontal acceleration, m^2/s^3
    density_up: Scalar  # spectral density of the vertical acceleration, m^2/s^3
    turn_density: Scalar  # spectral density of the turn rate's change, rad^2/s^3

    @property
    def size(self) -> int:
        """Number of states: 7."""
        return 7

    def predict_state(self, state: Float[Array, "7"], span: ScalarLike) -> Float[Array, "7"]:
        """Return the state `span` seconds later (earlier if negative) in a steady turn at the state's turn rate."""
        north, east, down, v_n, v_e, v_d, rate = state
        angle = rate * span
        small = jnp.abs(angle) < _SMALL
        safe = jnp.where(small, 1.0, angle)
        square = angle * angle
        along = span * jnp.where(small, 1.0 - square / 6.0, jnp.sin(safe) / safe)
        aside = span * jnp.where(small, angle * (0.5 - square / 24.0), (1.0 - jnp.cos(safe)) / safe)
        cosine, sine = jnp.cos(angle), jnp.sin(angle)
        return jnp.stack(
            [
                north + along * v_n - aside * v_e,
                east + aside * v_n + along * v_e,
                down + span * v_d,
                cosine * v_n - sine * v_e,
                sine * v_n + cosine * v_e,
                v_d,
                rate,
            ]
        )

    def process_noise(self, span: ScalarLike) -> Float[Array, "7 7"]:
        """Return the covariance of the process noise accumulated over `span` seconds."""
        return _white_acceleration(self.density, self.density_up, self.turn_density, span)

    def predict_covariance(
        self, mean: Float[Array, "7"], covariance: Float[Array, "7 7"], span: ScalarLike
    ) -> Float[Array, "7 7"]:
        """Return the covariance `span` seconds later (see `AbstractMotionModel.predict_covariance`)."""
        slopes = jax.jacfwd(lambda state: self.predict_state(state, span))(mean)
        row_product = jnp.sum(slopes[:, :, None] * covariance[None, :, :], axis=1)
        return jnp.sum(row_product[:, None, :] * slopes[None, :, :], axis=2) + self.process_noise(span)


def _white_acceleration(
    density: Scalar, density_up: Scalar, turn_density: Scalar | None, span: ScalarLike
) -> Float[Array, "n n"]:
    densities = jnp.stack([density, density, density_up])
    axes = densities[:, None] * np.eye(3, dtype=densities.dtype)
    position_noise, cross_noise, velocity_noise = (axes * factor for factor in (span**3 / 3.0, span**2 / 2.0, span))
    noise = jnp.concatenate(
        [
            jnp.concatenate([position_noise, cross_noise], axis=1),
            jnp.concatenate([cross_noise, velocity_noise], axis=1),
        ],
        axis=0,
    )
    if turn_density is None:
        return noise
    turn_rate_entry = np.zeros((7, 7), densities.dtype)
    turn_rate_entry[6, 6] = 1.0
    return jnp.pad(noise, ((0, 1), (0, 1))) + turn_rate_entry * (turn_density * span)
