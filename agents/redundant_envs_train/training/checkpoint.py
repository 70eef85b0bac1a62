"""Checkpoints, taken between two rollouts: everything that determines the rest of a training, so that it goes
on to the same bits, as plain data and tensors, which are read without unpickling anything else."""

import shutil
import time
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np

from redundant_envs.support import bounded
from redundant_envs.support.disk import DiskFull, disk_errors, write_bytes
from redundant_envs.support.extras import needs
from redundant_envs.support.values import shown

from .. import train_again
from ..policies import TENSOR_NAMES as WEIGHTS
from ..policies import check_table
from ..rollout import each
from ..run_folder import CHECKPOINT, OLD_CHECKPOINT, STATE, check_resumable, first_difference, replace_folder

with needs("train"):
    import torch

PART = f"{CHECKPOINT}.part"
TABLES = ("selection.csv", "monitor.csv")  # files that grow, and are cut back to their earlier length
PLAIN = ("num_timesteps", "_n_updates", "_episode_num", "_current_progress_remaining")
"""Counters of stable-baselines3's algorithms."""
MOST = 1e18  # largest number of a run
LAST = ("_last_obs", "_last_original_obs", "_last_episode_starts")
EPISODES = ("ep_info_buffer", "ep_success_buffer")
MONITOR = ("episode_returns", "episode_lengths", "episode_count")
RANDOM_STATE = ("kind", "keys", "position", "has_gauss", "cached_gaussian")
"""State of NumPy's global generator, from which replay buffers sample."""
PROGRESS = ("next", "seconds", "hold", "return")
"""Of the caller: next point of the curve (steps), training time (s), success and return of the last one."""
BUFFER_ARRAYS = (
    "observations", "next_observations", "actions", "rewards", "dones", "timeouts", "ep_start", "ep_length",
)  # fmt: skip

STORAGES = "Bool", "Byte", "Char", "Double", "Half", "Int", "Short"
TENSOR_NAMES = {
    *WEIGHTS, *(f"torch {kind}Storage" for kind in STORAGES), "torch.storage UntypedStorage",
    "torch._utils _rebuild_tensor_v3", *(f"torch uint{bits}" for bits in (16, 32, 64)),
}  # fmt: skip
"""Objects to which a checkpoint may refer: tensors of numbers, and nothing that allocates by itself."""


def remove(folder: Path) -> None:
    """Delete the checkpoint of a run folder: its training is finished."""
    for name in (CHECKPOINT, OLD_CHECKPOINT, PART):
        shutil.rmtree(folder / name, ignore_errors=True)


def save(folder: Path, model: Any, monitor: Any, progress: dict[str, float], run: dict[str, Any]) -> None:
    """Write a checkpoint; the folder always holds a complete one. ``monitor`` is around the environments,
    ``progress`` has the numbers of ``PROGRESS``, and :func:`restore` requires the same identity ``run``."""
    part = folder / PART
    shutil.rmtree(part, ignore_errors=True)
    monitor.results_writer.file_handler.flush()
    part.mkdir()
    state = {
        "run": run,
        "progress": progress,
        "elapsed": time.time() - monitor.t_start,
        "tables": {name: (folder / name).stat().st_size for name in TABLES},
        "counters": {name: getattr(model, name) for name in PLAIN if hasattr(model, name)},
        "last": {name: getattr(model, name) for name in LAST if hasattr(model, name)},
        "episodes": {name: list(getattr(model, name) or ()) for name in EPISODES},
        "monitor": {name: getattr(monitor, name) for name in MONITOR},
        "environments": monitor.venv.get_state(),
        "parameters": model.get_parameters(),
        "variables": {name: getattr(model, name).detach() for name in _variables(model)},
        "learner": model.learner_state(),
        "buffer": buffer_state(model.replay_buffer) if hasattr(model, "replay_buffer") else None,
        "random": {
            "torch": torch.get_rng_state(),
            "numpy": dict(zip(RANDOM_STATE, np.random.get_state(), strict=True)),
            "actions": model.action_space.np_random,
        },
    }
    try:
        # torch alone would leave the file open after an error
        with disk_errors(folder / CHECKPOINT), (part / STATE).open("wb") as file:
            torch.save(plain(state), file)
    except DiskFull:
        shutil.rmtree(part, ignore_errors=True)  # leaves room for the policy
        raise
    replace_folder(part, folder / CHECKPOINT, folder / OLD_CHECKPOINT)


def restore(folder: Path, model: Any, monitor: Any, run: dict[str, Any]) -> dict[str, float]:
    """Return to the checkpoint of a run folder, and give its ``progress``; ValueError if it is damaged or of
    another configuration or simulator."""
    place = check_resumable(folder) or folder / CHECKPOINT
    try:
        state = _load(place / STATE, _room(model, monitor))
        if state["run"]["simulator"] != run["simulator"]:
            raise ValueError("its simulator is another one")
        if differing := first_difference(state["run"]["settings"], run["settings"]):
            raise ValueError("it was made with {}: {}, and config.yaml has {}".format(*differing))
        for name in TABLES:
            size, there = state["tables"][name], (folder / name).stat().st_size
            if not isinstance(size, int) or not 0 <= size <= there:
                raise ValueError(f"{folder / name} has {there} bytes, and had {size}")
        _set_state(state, model, monitor)
        progress = {name: float(state["progress"][name]) for name in PROGRESS}
        monitor.t_start = time.time() - float(state["elapsed"])
    except Exception as error:  # a damaged file may raise any error
        told_of, fix = " ".join(str(error).split())[:300], f"make a new run: {train_again(folder)}"
        raise ValueError(f"{place} is damaged or of another run ({told_of}); {fix}") from error
    for name in TABLES:  # written anew, since a copy of the folder may share the files
        content = bounded.read_bytes(folder / name, name, bounded.MAX_PACKED)[: state["tables"][name]]
        write_bytes(folder / name, content)
    return progress


def _load(path: Path, most: int) -> dict[str, Any]:
    """Plain data of a file, of at most so many bytes, which cannot expand to more than its size."""
    with bounded.opened(path, "checkpoint", most) as file:
        names = bounded.stored_members(file, path.name, most)
        (table,) = (name for name in names if name.endswith("/data.pkl"))
        check_table(bounded.read_members(file, path.name, [table])[table], TENSOR_NAMES)
        file.seek(0)
        plain = torch.load(file, weights_only=True)
    if (size := _bytes(plain)) > most:  # a tensor may claim more numbers than it has
        raise ValueError(f"{path.name} claims {size} bytes, more than the {most} that this training has")
    return unplain(plain)


def _room(model: Any, monitor: Any) -> int:
    """Most bytes of a checkpoint of a learner: its networks with their optimisers, and its full buffer."""
    arrays = [getattr(getattr(model, "replay_buffer", None), name, None) for name in BUFFER_ARRAYS]
    networks = [model.get_parameters(), model.learner_state(), monitor.venv.get_state()]
    return bounded.MAX_UNPACKED + 4 * _bytes(networks) + _bytes(arrays)


def _bytes(value: Any) -> int:
    """Bytes of the arrays and tensors in nested data."""
    if isinstance(value, dict | list | tuple):
        return sum(map(_bytes, value.values() if isinstance(value, dict) else value))
    return getattr(value, "nbytes", 0)


def _set_state(state: dict[str, Any], model: Any, monitor: Any) -> None:
    for name in PLAIN:
        if hasattr(model, name):
            setattr(model, name, _like(name, state["counters"][name], getattr(model, name)))
    observations = model.env.reset()  # structure of the last observations
    for name, like in zip(LAST, (observations, observations, np.ones(model.n_envs, dtype=bool)), strict=True):
        if state["last"].get(name) is not None:
            setattr(model, name, _like(name, state["last"][name], like))
    for name in EPISODES:
        setattr(model, name, deque(state["episodes"][name], maxlen=model._stats_window_size))
    for name in MONITOR:
        setattr(monitor, name, _like(name, state["monitor"][name], getattr(monitor, name)))
    monitor.venv.set_state(state["environments"])
    model.set_parameters(state["parameters"])
    for name in _variables(model):
        getattr(model, name).data.copy_(state["variables"][name])
    model.set_learner_state(_like("learner", state["learner"], model.learner_state()))
    if hasattr(model, "replay_buffer"):
        set_buffer_state(model.replay_buffer, state["buffer"])
    torch.set_rng_state(state["random"]["torch"])
    np.random.set_state(tuple(state["random"]["numpy"][name] for name in RANDOM_STATE))
    model.action_space._np_random = state["random"]["actions"]


def _like(name: str, value: Any, like: Any) -> Any:
    """A value of a checkpoint, if it has the kind, shape and range of the model's own."""
    if isinstance(like, dict):
        if not isinstance(value, dict) or value.keys() != like.keys():
            raise ValueError(f"{name} has other entries")
        return {key: _like(f"{name}.{key}", value[key], like[key]) for key in like}
    if isinstance(like, int | float):
        number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= MOST
        if not number or (isinstance(like, int) and not (isinstance(value, int) and value >= 0)):
            raise ValueError(f"{name} is {shown(value)}")
        return value
    if type(value) is not type(like) or value.shape != like.shape or value.dtype != like.dtype:
        raise ValueError(f"{name} is of another kind")
    if not bool((abs(value) < float("inf")).all()):
        raise ValueError(f"{name} is not finite")
    return value


def _variables(model: Any) -> list[str]:
    """Names of an algorithm's tensors that are in no module."""
    return list(model._get_torch_save_params()[1] or ())


def buffer_state(buffer: Any) -> dict[str, Any]:
    """The content of a replay buffer of stable-baselines3, without its empty rows."""
    rows = buffer.buffer_size if buffer.full else buffer.pos
    there = [name for name in BUFFER_ARRAYS if hasattr(buffer, name)]
    arrays = {name: each(lambda array: array[:rows], getattr(buffer, name)) for name in there}
    start = getattr(buffer, "_current_ep_start", None)
    return {"arrays": arrays, "pos": buffer.pos, "full": buffer.full, "rows": rows, "episode_start": start}


def set_buffer_state(buffer: Any, state: dict[str, Any]) -> None:
    for name in filter(lambda name: hasattr(buffer, name), BUFFER_ARRAYS):
        old, new = getattr(buffer, name), state["arrays"][name]
        for target, source in [(old[k], new[k]) for k in old] if isinstance(old, dict) else [(old, new)]:
            target[: state["rows"]] = source
    if not (isinstance(state["pos"], int) and 0 <= state["pos"] < buffer.buffer_size):
        raise ValueError(f"the buffer's position is {shown(state['pos'])}")
    buffer.pos, buffer.full = state["pos"], bool(state["full"])
    if state["episode_start"] is not None:
        buffer._current_ep_start = state["episode_start"]


# ---- plain data, which torch reads without unpickling objects ------------------------------------


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
