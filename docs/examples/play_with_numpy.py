"""Act with a trained policy by NumPy alone: python docs/examples/play_with_numpy.py policies/RPRPReach-v0-sac

Beside redundant-envs and what it needs (neither torch nor stable-baselines3), this uses nothing but NumPy.
"""

import argparse
from pathlib import Path

import gymnasium as gym
import numpy as np

import redundant_envs  # noqa: F401  (registers the ids)
from redundant_envs.scenes.files import read_yaml
from redundant_envs.support.bounded import read_arrays


def load(path):
    """A function from observations to actions, both (environments, numbers)."""
    file = read_arrays(path, "policy")  # np.load, within bounds of memory
    count = sum(name.startswith("weights_") for name in file)
    layers = [(file[f"weights_{k}"].T, file[f"biases_{k}"]) for k in range(count)]
    hidden = {"silu": lambda x: x * (0.5 + 0.5 * np.tanh(0.5 * x)), "tanh": np.tanh,
              "relu": lambda x: np.maximum(x, 0.0)}[str(file["activation"])]  # fmt: skip
    last = np.tanh if str(file["output"]) == "tanh" else lambda x: np.clip(x, -1.0, 1.0)
    parts = file["inputs"].tolist()  # goal environments observe a dictionary of these

    def act(observations):
        if isinstance(observations, dict):
            observations = np.concatenate([observations[name] for name in parts], axis=1)
        x = observations.astype(np.float32).astype(np.float64)
        for weights, biases in layers[:-1]:
            x = hidden(x @ weights + biases)
        weights, biases = layers[-1]
        return last(x @ weights + biases).astype(np.float32)

    return act


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="folder of a policy, such as policies/RPRPReach-v0-sac")
    parser.add_argument("--episodes", type=int, default=1000)
    parser.add_argument(
        "--seed", type=int, default=1_000_000, help="of the goals; the default are the frozen ones"
    )
    arguments = parser.parse_args()
    if arguments.episodes < 1 or arguments.seed < 0:
        parser.error("--episodes is at least 1, and --seed at least 0")
    if not (arguments.folder / "policy.npz").is_file():
        parser.error(f"{arguments.folder} has no policy.npz; give a folder of policies/")
    settings = read_yaml(arguments.folder / "config.yaml", "config")
    act = load(arguments.folder / "policy.npz")
    envs = gym.make_vec(settings["env"], num_envs=arguments.episodes, **settings["env_kwargs"])
    observations, _ = envs.reset(seed=arguments.seed)
    held = np.zeros(arguments.episodes, dtype=bool)
    running = ~held
    while running.any():
        observations, _, terminated, truncated, infos = envs.step(act(observations))
        ended = running & (terminated | truncated)
        if ended.any():
            held[ended] = np.asarray(infos["is_success"])[ended]
        running &= ~ended
    print(f"{settings['env']}: {100 * held.mean():.1f} % of {arguments.episodes} goals are held")


if __name__ == "__main__":
    main()
