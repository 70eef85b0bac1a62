"""Checkpoints: all that decides the future of a training, so that it goes on to the same bits.

A checkpoint is taken between two rollouts, where no step is half done: networks, optimisers and averages,
replay buffer, environments, every generator of random numbers, and how long the tables of the run were.
It is plain data and tensors, and is read without unpickling anything else.
"""

from __future__ import annotations

import os
import shutil
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np

from redundant_envs.extras import needs

from .. import COMMAND

with needs("train"):
    import torch

NAME = "checkpoint"
STATE, BUFFER = "state.pt", "buffer.pt"
TABLES = ("selection.csv", "monitor.csv")
"""Files of a run that grow, and are cut back to what they were."""
PLAIN = ("num_timesteps", "_n_updates", "_episode_num", "_current_progress_remaining")
"""Counters of stable-baselines3's algorithms."""
LAST = ("_last_obs", "_last_original_obs", "_last_episode_starts")
EPISODES = ("ep_info_buffer", "ep_success_buffer")
MONITOR = ("episode_returns", "episode_lengths", "episode_count")
PROGRESS = ("next", "seconds", "hold")
"""Numbers of the caller: next point of the curve (steps), training time (s), the last point's success."""
BUFFER_ARRAYS = (
    "observations", "next_observations", "actions", "rewards", "dones", "timeouts", "ep_start", "ep_length",
)  # fmt: skip


def exists(folder: Path) -> bool:
    """Whether a run folder has a checkpoint."""
    return (folder / NAME / STATE).is_file()


def remove(folder: Path) -> None:
    """Delete the checkpoint of a run folder: its training is finished."""
    shutil.rmtree(folder / NAME, ignore_errors=True)


def save(folder: Path, model: Any, monitor: Any, progress: dict[str, float]) -> None:
    """Write a checkpoint; the folder holds a whole one, this or the one before.

    Parameters
    ----------
    folder : Path
        The run's.
    model : BaseAlgorithm
    monitor : VecMonitor
        Around the environments.
    progress : dict
        The numbers of ``PROGRESS``.
    """
    part = folder / f"{NAME}.part"
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir()
    monitor.results_writer.file_handler.flush()
    state = {
        "progress": progress,
        "tables": {name: (folder / name).stat().st_size for name in TABLES},
        "counters": {name: getattr(model, name) for name in PLAIN if hasattr(model, name)},
        "last": {name: getattr(model, name) for name in LAST if hasattr(model, name)},
        "episodes": {name: list(getattr(model, name) or ()) for name in EPISODES},
        "monitor": {name: getattr(monitor, name) for name in MONITOR},
        "environments": monitor.venv.get_state(),
        "parameters": model.get_parameters(),
        "variables": {name: getattr(model, name).detach() for name in _variables(model)},
        "learner": model.learner_state(),
        "random": {
            "torch": torch.get_rng_state(),
            "numpy": dict(zip(RANDOM_STATE, np.random.get_state(), strict=True)),
            "actions": model.action_space.np_random,
        },
    }
    torch.save(plain(state), part / STATE)
    buffer = getattr(model, "replay_buffer", None)
    if buffer is not None:
        torch.save(plain(buffer_state(buffer)), part / BUFFER)
    old = folder / f"{NAME}.old"
    shutil.rmtree(old, ignore_errors=True)
    if (folder / NAME).exists():
        os.replace(folder / NAME, old)
    os.replace(part, folder / NAME)
    shutil.rmtree(old, ignore_errors=True)


RANDOM_STATE = ("kind", "keys", "position", "has_gauss", "cached_gaussian")


def restore(folder: Path, model: Any, monitor: Any) -> dict[str, float]:
    """Return to the checkpoint of a run folder; gives its ``progress``.

    Raises
    ------
    ValueError
        There is none, or it is damaged or of another configuration.
    """
    place = folder / NAME
    if not exists(folder) and exists_old(folder):
        place = folder / f"{NAME}.old"  # killed between two renamings
    if not (place / STATE).is_file():
        finished = (folder / "training.json").is_file()
        fix = f"look at it with: {COMMAND} report {folder}"
        if not finished:
            fix = f"make a new run: {COMMAND} train {folder}/config.yaml --out NEW_FOLDER"
        reason = "is finished and" if finished else "was killed before its first one, or made without:"
        raise ValueError(f"run folder {folder} {reason} has no checkpoint; {fix}")
    try:
        state = unplain(torch.load(place / STATE, weights_only=True))
        sizes = {name: _checked_size(folder / name, state["tables"][name]) for name in TABLES}
        _set_state(state, model, monitor)
        buffer = getattr(model, "replay_buffer", None)
        if buffer is not None:
            set_buffer_state(buffer, unplain(torch.load(place / BUFFER, weights_only=True)))
        progress = {name: float(state["progress"][name]) for name in PROGRESS}
    except Exception as error:  # a damaged file fails in any way
        raise ValueError(
            f"{place} is damaged or of another configuration ({str(error)[:300]}); make a new run: {COMMAND} "
            f"train {folder}/config.yaml --out NEW_FOLDER"
        ) from error
    for name, size in sizes.items():
        os.truncate(folder / name, size)
    return progress


def _checked_size(path: Path, size: Any) -> int:
    if not isinstance(size, int) or not 0 <= size <= path.stat().st_size:
        raise ValueError(f"{path} has {path.stat().st_size} bytes, and had {size}")
    return size


def exists_old(folder: Path) -> bool:
    """Whether a run folder has the checkpoint before the last one."""
    return (folder / f"{NAME}.old" / STATE).is_file()


def _set_state(state: dict[str, Any], model: Any, monitor: Any) -> None:
    for part, names in (("counters", PLAIN), ("last", LAST)):
        for name in names:
            if name in state[part]:
                setattr(model, name, state[part][name])
    for name in EPISODES:
        setattr(model, name, _deque(state["episodes"][name], model))
    for name in MONITOR:
        setattr(monitor, name, state["monitor"][name])
    monitor.venv.set_state(state["environments"])
    model.set_parameters(state["parameters"])
    for name in _variables(model):
        getattr(model, name).data.copy_(state["variables"][name])
    model.set_learner_state(state["learner"])
    torch.set_rng_state(state["random"]["torch"])
    np.random.set_state(tuple(state["random"]["numpy"][name] for name in RANDOM_STATE))
    model.action_space._np_random = state["random"]["actions"]


def _variables(model: Any) -> list[str]:
    """Names of an algorithm's tensors that are in no module."""
    return list(model._get_torch_save_params()[1] or ())


def _deque(values: list[Any], model: Any) -> Any:
    return deque(values, maxlen=model._stats_window_size)


def buffer_state(buffer: Any) -> dict[str, Any]:
    """What a replay buffer of stable-baselines3 holds, without its empty rows."""
    rows = buffer.buffer_size if buffer.full else buffer.pos
    arrays = {name: _rows(getattr(buffer, name), rows) for name in BUFFER_ARRAYS if hasattr(buffer, name)}
    start = getattr(buffer, "_current_ep_start", None)
    return {"arrays": arrays, "pos": buffer.pos, "full": buffer.full, "rows": rows, "episode_start": start}


def set_buffer_state(buffer: Any, state: dict[str, Any]) -> None:
    """Return to a state of :func:`buffer_state`."""
    for name in BUFFER_ARRAYS:
        if not hasattr(buffer, name):
            continue
        for target, source in _pairs(getattr(buffer, name), state["arrays"][name]):
            target[: state["rows"]] = source
    buffer.pos, buffer.full = state["pos"], state["full"]
    if state["episode_start"] is not None:
        buffer._current_ep_start = state["episode_start"]


def _rows(array: Any, rows: int) -> Any:
    return {k: v[:rows] for k, v in array.items()} if isinstance(array, dict) else array[:rows]


def _pairs(array: Any, values: Any) -> list[tuple[Any, Any]]:
    return [(array[k], values[k]) for k in array] if isinstance(array, dict) else [(array, values)]


# ---- plain data: what torch reads without unpickling objects -------------------------------------


def plain(value: Any) -> Any:
    """Nested data with arrays as tensors, and generators as their states."""
    if isinstance(value, np.ndarray):
        if value.dtype.kind not in "biuf":
            raise TypeError(f"an array of {value.dtype} has no tensor")
        return {"array": torch.from_numpy(np.ascontiguousarray(value))}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.random.Generator):
        return {"generator": value.bit_generator.state}
    if isinstance(value, dict):
        return {"dict": [(k, plain(v)) for k, v in value.items()]}
    if isinstance(value, list | tuple):
        return {"list": [plain(v) for v in value]}
    return value


def unplain(value: Any) -> Any:
    """The data of :func:`plain`; lists and tuples come back as lists."""
    if not isinstance(value, dict):
        return value
    ((kind, content),) = value.items()
    if kind == "array":
        return content.numpy()
    if kind == "generator":
        generator = np.random.Generator(np.random.PCG64())
        generator.bit_generator.state = content
        return generator
    if kind == "dict":
        return {k: unplain(v) for k, v in content}
    return [unplain(v) for v in content]
