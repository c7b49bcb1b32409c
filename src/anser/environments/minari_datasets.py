"""Episodes as datasets of Minari, for learning from recorded flights."""

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from anser.environments.episodes import Episode
from anser.environments.gymnasium_environments import OBSERVATION_MAX, box_spaces
from anser.results.documents import install_hint


def save_minari(dataset_id: str, episodes: Sequence[Episode], **description: Any) -> Any:
    """Write episodes of one environment of one aircraft as a dataset of Minari, and return the dataset.

    `dataset_id` must have Minari's form, such as "anser/velocity-command/expert-v0"; `description` are further
    arguments of `minari.create_dataset_from_buffers`. Observations are clipped to +-`OBSERVATION_MAX`. Raises
    ImportError if Minari is not installed, and ValueError for an empty sequence, episodes of a fleet, or numbers that
    are not finite.
    """
    try:
        import minari
        from minari.data_collector import EpisodeBuffer
    except ImportError:
        raise ImportError(install_hint("Minari", "learning")) from None
    if not episodes:
        raise ValueError("episodes: arrived none; expected at least one episode")
    if np.ndim(episodes[0].observations) != 2:
        raise ValueError("episodes: arrived those of a fleet; expected episodes of an environment of one aircraft")
    for number, episode in enumerate(episodes):
        if not all(np.isfinite(part).all() for part in (episode.observations, episode.actions, episode.rewards)):
            raise ValueError(f"episodes[{number}]: arrived numbers that are not finite; expected finite ones")
    make_buffer: Any = EpisodeBuffer
    buffers = [
        make_buffer(
            id=number,
            observations=np.clip(episode.observations, -OBSERVATION_MAX, OBSERVATION_MAX),
            actions=episode.actions,
            rewards=episode.rewards.astype(np.float64),
            terminations=(ends := np.arange(len(episode.actions)) == len(episode.actions) - 1) & episode.terminated,
            truncations=ends & (not episode.terminated),
        )
        for number, episode in enumerate(episodes)
    ]
    spaces = dict(zip(("observation_space", "action_space"), box_spaces(episodes[0].environment), strict=True))
    arguments = {**spaces, "data_format": "arrow", **description}
    with warnings.catch_warnings():
        # warnings about the optional arguments `env` and `eval_env`
        warnings.filterwarnings("ignore", message=".*(eval_env|env_spec)")
        return minari.create_dataset_from_buffers(dataset_id, buffers, **arguments)
