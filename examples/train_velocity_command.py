"""Training of a policy for the task VelocityCommand at the level of body rates: PPO in plain JAX, from nothing.

    python examples/train_velocity_command.py --seed 0 --out runs/velocity-command

Proximal policy optimization: J. Schulman et al., arXiv:1707.06347. Generalized advantages: J. Schulman et al.,
arXiv:1506.02438.
"""

import argparse
import dataclasses
import functools
import itertools
import math
import time
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from jax import Array

from anser.environments import AircraftEnvironment, EpisodeState, Parameters, make, score
from anser.environments.episodes import Policy
from anser.report.style import COLORS

Layers = list[tuple[Array, Array]]
"""Weights and bias of each layer of a network."""

Model = dict[str, Any]
"""Layers of the policy's mean and of the value, and logarithm of the standard deviation of actions."""

GOAL = 0.9
"""Share of the expert's advantage over random actions that the training has to reach."""


@dataclasses.dataclass(frozen=True)
class Settings:
    """Settings of the training."""

    environments: int = 1024
    rollout: int = 64  # decisions of each environment between two updates
    decisions: int = 40_000_000
    epochs: int = 3
    minibatches: int = 16
    learning_rate: float = 3e-3  # at the start; it falls linearly to 0
    gamma: float = 0.995  # of a decision of 0.05 s: 10 s
    lambda_: float = 0.95
    clip: float = 0.2
    gradient_max: float = 0.5
    width: int = 64
    sigma: float = 0.3  # standard deviation of the first actions

    @property
    def updates(self) -> int:
        """Number of updates."""
        return max(1, self.decisions // (self.environments * self.rollout))


def init_layers(key: Array, sizes: tuple[int, ...], last_scale: float) -> Layers:
    """Return orthogonal weights and zero biases of a network."""
    scales = [2**0.5] * (len(sizes) - 2) + [last_scale]
    draws = zip(jax.random.split(key, len(scales)), scales, sizes[:-1], sizes[1:], strict=True)
    return [
        (jax.nn.initializers.orthogonal(g)(k, (m, n), jnp.float32), jnp.zeros(n, jnp.float32)) for k, g, m, n in draws
    ]


def network(layers: Layers, observation: Array) -> Array:
    """Return the output of a network of tanh layers. Each entry enters as it is, and twice magnified near zero."""
    x = jnp.concatenate([observation, jnp.tanh(8.0 * observation), jnp.tanh(40.0 * observation)])
    for weights, bias in layers[:-1]:
        x = jnp.tanh(x @ weights + bias)
    weights, bias = layers[-1]
    return x @ weights + bias


def init_model(key: Array, environment: AircraftEnvironment, settings: Settings) -> Model:
    """Return policy and value; the first actions are near zero, which is no rotation and half throttle."""
    inputs, actions = 3 * len(environment.observed), environment.num_actions
    policy_key, value_key = jax.random.split(key)
    hidden = (settings.width, settings.width)
    return {
        "policy": init_layers(policy_key, (inputs, *hidden, actions), 0.01),
        "value": init_layers(value_key, (inputs, *hidden, 1), 1.0),
        "log_sigma": jnp.full(actions, np.log(settings.sigma), jnp.float32),
    }


def log_density(model: Model, observation: Array, action: Array) -> Array:
    """Return the logarithm of the probability density of an action, less a constant."""
    deviation = (action - network(model["policy"], observation)) * jnp.exp(-model["log_sigma"])
    return -0.5 * jnp.sum(deviation**2) - jnp.sum(model["log_sigma"])


class Decision(NamedTuple):
    """One decision; in a rollout with leading axes over time and environments."""

    observation: Array
    action: Array
    log_density: Array
    value: Array  # discounted mean of the future rewards, 0..1
    next_value: Array
    reward: Array
    terminated: Array
    truncated: Array
    success: Array


def decide(
    environment: AircraftEnvironment,
    params: Parameters,
    model: Model,
    key: Array,
    observation: Array,
    state: EpisodeState,
) -> tuple[Array, EpisodeState, Decision]:
    """Draw an action in one environment and fly it. Returns observation and state after it, and the decision."""
    noise_key, step_key = jax.random.split(key)
    noise = jax.random.normal(noise_key, (environment.num_actions,), jnp.float32)
    action = network(model["policy"], observation) + jnp.exp(model["log_sigma"]) * noise
    following, state, reward, terminated, truncated, info = environment.step(step_key, state, action, params)
    value = network(model["value"], observation)[0]
    next_value = network(model["value"], info["final_observation"])[0]
    density = log_density(model, observation, action)
    flown = Decision(observation, action, density, value, next_value, reward, terminated, truncated, info["success"])
    return following, state, flown


def advantages(rollout: Decision, settings: Settings) -> Array:
    """Return the generalized advantage of each decision.

    After a failure no reward follows. An episode that is truncated would go on: the value of its last observation
    stands for the rewards that it no longer collects.
    """
    future = settings.gamma * jnp.where(rollout.terminated, 0.0, rollout.next_value)
    surprise = (1.0 - settings.gamma) * rollout.reward + future - rollout.value
    decay = jnp.where(rollout.terminated | rollout.truncated, 0.0, settings.gamma * settings.lambda_)

    def accumulate(later: Array, row: tuple[Array, Array]) -> tuple[Array, Array]:
        advantage = row[0] + row[1] * later
        return advantage, advantage

    return jax.lax.scan(accumulate, jnp.zeros_like(surprise[0]), (surprise, decay), reverse=True)[1]


def loss(model: Model, decision: Decision, advantage: Array, target: Array, clip: float) -> Array:
    """Return the loss of one decision: the clipped objective of the policy, and the squared error of the value."""
    ratio = jnp.exp(log_density(model, decision.observation, decision.action) - decision.log_density)
    gain = jnp.minimum(ratio * advantage, jnp.clip(ratio, 1.0 - clip, 1.0 + clip) * advantage)
    return 0.5 * (network(model["value"], decision.observation)[0] - target) ** 2 - gain


class Training(NamedTuple):
    """State of the training between two updates; environments with a leading axis."""

    model: Model
    moments: tuple[Model, Model]
    count: Array
    observation: Array
    state: EpisodeState


def start(environment: AircraftEnvironment, settings: Settings, key: Array) -> Training:
    """Return the training before the first update; the environments stand at different times of their episodes."""
    model_key, reset_key, time_key = jax.random.split(key, 3)
    model, params = init_model(model_key, environment, settings), environment.default_params
    keys = jax.random.split(reset_key, settings.environments)
    observation, state = jax.jit(jax.vmap(environment.reset, in_axes=(0, None)))(keys, params)
    longest = round(environment.task.duration_s / environment.level.decision_s)
    state = dataclasses.replace(state, time=jax.random.randint(time_key, state.time.shape, 0, longest, jnp.int32))
    zeros = jax.tree.map(jnp.zeros_like, model)
    return Training(model, (zeros, zeros), jnp.zeros((), jnp.float32), observation, state)


def adam(training: Training, gradient: Model, rate: Array, gradient_max: float) -> Training:
    """Return the training after one step of Adam with a bound on the norm of the gradient."""
    norm = jnp.sqrt(sum(jnp.sum(g**2) for g in jax.tree.leaves(gradient)))
    gradient = jax.tree.map(lambda g: g * jnp.minimum(1.0, gradient_max / norm), gradient)
    count = training.count + 1.0
    first = jax.tree.map(lambda m, g: 0.9 * m + 0.1 * g, training.moments[0], gradient)
    second = jax.tree.map(lambda v, g: 0.999 * v + 0.001 * g**2, training.moments[1], gradient)
    scale = rate * jnp.sqrt(1.0 - 0.999**count) / (1.0 - 0.9**count)
    model = jax.tree.map(lambda p, m, v: p - scale * m / (jnp.sqrt(v) + 1e-7), training.model, first, second)
    return training._replace(model=model, moments=(first, second), count=count)


def update(
    environment: AircraftEnvironment,
    settings: Settings,
    params: Parameters,
    training: Training,
    key: Array,
    rate: Array,
) -> tuple[Training, dict[str, Array]]:
    """Fly a rollout in all environments, and improve policy and value by it. Returns also figures of the rollout."""
    flight_key, order_key = jax.random.split(key)
    model = training.model

    def advance(carry: tuple[Array, EpisodeState], keys: Array) -> tuple[tuple[Array, EpisodeState], Decision]:
        *carry, flown = jax.vmap(lambda *one: decide(environment, params, model, *one))(keys, *carry)
        return tuple(carry), flown

    keys = jax.random.split(flight_key, (settings.rollout, settings.environments))
    (observation, state), rollout = jax.lax.scan(advance, (training.observation, training.state), keys)
    advantage = advantages(rollout, settings)
    rows = rollout, advantage, advantage + rollout.value
    rows = jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), rows)

    def mean_loss(model: Model, decision: Decision, advantage: Array, target: Array) -> Array:
        scaled = (advantage - jnp.mean(advantage)) / (jnp.std(advantage) + 1e-8)
        return jnp.mean(jax.vmap(loss, in_axes=(None, 0, 0, 0, None))(model, decision, scaled, target, settings.clip))

    def improve(training: Training, chosen: Array) -> tuple[Training, None]:
        gradient = jax.grad(mean_loss)(training.model, *jax.tree.map(lambda x: x[chosen], rows))
        return adam(training, gradient, rate, settings.gradient_max), None

    count = settings.rollout * settings.environments
    orders = jax.vmap(lambda k: jax.random.permutation(k, count))(jax.random.split(order_key, settings.epochs))
    training = training._replace(observation=observation, state=state)
    training = jax.lax.scan(improve, training, orders.reshape(settings.epochs * settings.minibatches, -1))[0]
    ended = jnp.maximum(jnp.sum(rollout.terminated | rollout.truncated), 1)
    return training, {
        "reward": jnp.mean(rollout.reward),
        "success": jnp.sum(rollout.success) / ended,
        "failed": jnp.sum(rollout.terminated) / ended,
        "sigma": jnp.mean(jnp.exp(model["log_sigma"])),
    }


def train(
    environment: AircraftEnvironment, settings: Settings, seed: int, minutes: float = math.inf
) -> tuple[Model, list[dict[str, float]]]:
    """Train a policy from nothing, for at most some minutes of CPU time.

    Returns
    -------
    The model, and figures of each update. "reward", "success" and "failed" are those of the exploring policy: mean of
    the decisions, and shares of the episodes that ended.
    """
    begin = time.process_time()
    start_key, *keys = jax.random.split(jax.random.key(seed), settings.updates + 1)
    training, rows = start(environment, settings, start_key), []
    improve = jax.jit(functools.partial(update, environment, settings))
    for number, key in enumerate(keys):
        rate = settings.learning_rate * (1.0 - number / settings.updates)
        training, measured = improve(environment.default_params, training, key, jnp.float32(rate))
        figures = {name: float(figure) for name, figure in measured.items()}
        cpu_s = time.process_time() - begin
        rows.append({"decisions": (number + 1) * settings.environments * settings.rollout, "cpu_s": cpu_s, **figures})
        if number % 20 == 0 or number == settings.updates - 1:
            print("  ".join(f"{name} {figure:.4g}" for name, figure in rows[-1].items()), flush=True)
        if cpu_s > 60.0 * minutes:
            break
    return training.model, rows


def policy(layers: Layers) -> Policy:
    """Return the policy without exploration, in the form that `anser.environments.score` expects."""
    return lambda key, observation, state, own: (network(layers, observation), None)


def save_policy(layers: Layers, path: Path) -> None:
    """Write weights and biases of a policy, in the order of its layers."""
    np.savez(path, *(np.asarray(array) for layer in layers for array in layer))


def load_policy(path: Path) -> Layers:
    """Read the layers of a policy."""
    with np.load(path) as arrays:
        flat = [jnp.asarray(arrays[name]) for name in arrays.files]
    return list(zip(flat[::2], flat[1::2], strict=True))


def draw_curves(folder: Path, levels: dict[str, float]) -> None:
    """Draw mean reward and share of successes of all seeds in a folder, and levels of the mean reward."""
    figure, axes = plt.subplots(1, 2, figsize=(9.0, 3.4), layout="constrained")
    for path, color in zip(sorted(folder.glob("seed-*.csv")), itertools.cycle(COLORS)):
        rows = np.genfromtxt(path, delimiter=",", names=True)
        for axis, name in zip(axes, ("reward", "success"), strict=True):
            mean = np.convolve(np.pad(rows[name], 4, mode="edge"), np.full(9, 1.0 / 9.0), mode="valid")
            axis.plot(rows["decisions"] / 1e6, mean, color=color, label=path.stem)
    for name, level in levels.items():
        axes[0].axhline(level, color="0.4", linewidth=0.9, linestyle="dashed")
        axes[0].text(0.99, level, name, transform=axes[0].get_yaxis_transform(), ha="right", va="bottom", fontsize=8)
    axes[0].set(xlabel="decisions, millions", ylabel="mean reward, with exploration", ylim=(0.0, 1.0))
    axes[1].set(xlabel="decisions, millions", ylabel="share of successes, with exploration", ylim=(0.0, 1.0))
    axes[1].legend(frameon=False)
    figure.savefig(folder / "curve.png", dpi=110)
    plt.close(figure)


def main() -> None:
    """Train, save policy and curve, and print the score beside those of the expert and of random actions."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--decisions", type=float, default=Settings.decisions, help="decisions of the training")
    parser.add_argument("--minutes", type=float, default=math.inf, help="greatest CPU time of the training")
    parser.add_argument("--out", type=Path, default=Path("runs/velocity-command"), help="folder of policy and curve")
    arguments = parser.parse_args()
    settings = Settings(decisions=int(arguments.decisions))
    environment = make("VelocityCommand", "rates", precision="float32")
    model, rows = train(environment, settings, arguments.seed, arguments.minutes)

    arguments.out.mkdir(parents=True, exist_ok=True)
    path = arguments.out / f"seed-{arguments.seed}.npz"
    save_policy(model["policy"], path)
    table = [list(row.values()) for row in rows]
    np.savetxt(path.with_suffix(".csv"), table, "%.6g", ",", header=",".join(rows[0]), comments="")
    scores = {name: score(environment, name) for name in ("random", "expert")}
    scores["trained"] = score(environment, policy(model["policy"]))
    for name, result in scores.items():
        print(f"{name:8} return {result.mean_return:.4f}, success {result.success:.1%}, failed {result.failed:.1%}")
    random, expert, trained = (result.mean_return for result in scores.values())
    share = (trained - random) / (expert - random)
    print(f"(trained - random) / (expert - random) = {share:.3f}; goal: {GOAL}")
    print(f"{rows[-1]['cpu_s']:.0f} s of CPU time, {rows[-1]['decisions'] / 1e6:.1f} million decisions")
    draw_curves(arguments.out, {"random": random, "expert": expert, "goal": random + GOAL * (expert - random)})


if __name__ == "__main__":
    main()
