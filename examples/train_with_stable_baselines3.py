"""Training with Stable-Baselines3: PPO on the task VelocityCommand at the level of body rates.

    pip install "anser[learning]" stable-baselines3
    python examples/train_with_stable_baselines3.py --decisions 2000000 --out runs/sb3

Stable-Baselines3 has an interface of its own for many environments, `VecEnv`; the class below is the bridge from the
vector of anser, in which one compiled program flies all of them. The training in plain JAX beside this file is many
times faster, for it never leaves the compiled program.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecEnv, VecMonitor

from anser.environments.gymnasium_environments import register_gymnasium

register_gymnasium()
TASK = "anser/VelocityCommand-v0"


class VectorBridge(VecEnv):
    """A vector of Gymnasium with resets within the step, as Stable-Baselines3 expects it."""

    def __init__(self, vector: gymnasium.vector.VectorEnv) -> None:
        super().__init__(vector.num_envs, vector.single_observation_space, vector.single_action_space)
        self.vector = vector
        self.actions = np.zeros(vector.action_space.shape, np.float32)

    def reset(self) -> np.ndarray:
        """Start the next episodes; with the seed of `seed`, if given before."""
        seed = self._seeds[0]
        self._reset_seeds()
        return self.vector.reset(seed=seed)[0]

    def step_async(self, actions: np.ndarray) -> None:
        """Store the actions of the step."""
        self.actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Fly one decision of every aircraft."""
        observations, rewards, terminated, truncated, info = self.vector.step(self.actions)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for k in np.flatnonzero(terminated | truncated):
            infos[k] = {
                "terminal_observation": info["final_obs"][k],
                "TimeLimit.truncated": bool(truncated[k]),
                "is_success": bool(info["final_info"]["is_success"][k]),
            }
        return observations, rewards.astype(np.float32), terminated | truncated, infos

    def close(self) -> None:
        """Close the vector."""
        self.vector.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of the vector for each aircraft."""
        return [getattr(self.vector, attr_name)] * len(self._positions(indices))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refuse: the aircraft of a vector have no attributes of their own."""
        raise NotImplementedError("the aircraft of a vector have no attributes of their own")

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Refuse: the aircraft of a vector have no methods of their own."""
        raise NotImplementedError("the aircraft of a vector have no methods of their own")

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Return False for each aircraft: none has a wrapper of its own."""
        return [False] * len(self._positions(indices))

    def _positions(self, indices: Any) -> Sequence[int]:
        return list(range(self.num_envs)) if indices is None else np.atleast_1d(indices).tolist()


def main() -> None:
    """Train, evaluate, and store the policy with the flight of one episode."""
    parser = argparse.ArgumentParser(description="Train VelocityCommand at body rates with Stable-Baselines3.")
    parser.add_argument("--decisions", type=int, default=2_000_000, help="decisions of the training")
    parser.add_argument("--environments", type=int, default=256, help="aircraft that fly at once")
    parser.add_argument("--cases", type=int, default=4096, help="starts and commands from which a reset draws")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("runs/sb3"))
    options = parser.parse_args()
    vector = gymnasium.make_vec(TASK, num_envs=options.environments, cases=options.cases, precision="float32")
    model = PPO(
        "MlpPolicy",
        VecMonitor(VectorBridge(vector)),
        n_steps=64,
        batch_size=options.environments * 8,
        n_epochs=4,
        gamma=0.98,
        policy_kwargs={"log_std_init": -1.0},
        device="cpu",
        seed=options.seed,
        verbose=1,
    )
    model.learn(options.decisions)
    options.out.mkdir(parents=True, exist_ok=True)
    model.save(options.out / "policy")
    single = gymnasium.make(TASK, cases=options.cases)
    mean, deviation = evaluate_policy(model, single, n_eval_episodes=5, warn=False)
    print(f"return of five episodes: {mean:.1f}, standard deviation {deviation:.1f}")
    observation, _ = single.reset(seed=options.seed)
    is_over = False
    while not is_over:
        action, _ = model.predict(observation, deterministic=True)
        observation, _, terminated, truncated, _ = single.step(action)
        is_over = terminated or truncated
    flight = single.unwrapped.flight()
    flight.save(options.out / "flight", force=True)
    print(flight)


if __name__ == "__main__":
    main()
