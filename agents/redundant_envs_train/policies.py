"""Policies as files: policy.zip has no objects of this package, and pickled ones, which could run the code of
a stranger, are not read: the policy is built from config.yaml, and only tensors are taken from the file."""

import base64
import io
import itertools
import json
import pickletools
import zipfile
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from redundant_envs.envs.sb3 import make_sb3
from redundant_envs.support.bounded import MAX_JSON, MAX_PACKED, opened, read_members
from redundant_envs.support.disk import write_bytes
from redundant_envs.support.extras import needs

from . import command, train_again
from .config import Config
from .learners.build import ALGORITHM_CLASSES, policy_kwargs, policy_name
from .learners.networks import ACTIVATIONS
from .run_folder import SCENE, own_config, policy_file

with needs("train"):
    import cloudpickle
    import torch
    from gymnasium import spaces

PICKLED = ":serialized:"  # key of an object of policy.zip in stable-baselines3's JSON
MAX_OBJECTS = 1 << 20
"""Bytes of a table of tensors, which may become sixty times as many in memory; policies have ten thousand."""
TENSOR_NAMES = {
    "collections OrderedDict", "torch._utils _rebuild_tensor_v2", "torch FloatStorage", "torch LongStorage",
}  # fmt: skip
"""Objects to which a table of tensors may refer; anything else in a file is refused."""
TENSOR_TYPES = (torch.float32, torch.int64)  # weights, and the counters of CrossQ's normalisation
HARMLESS = (
    "policy.zip is read without its pickled objects, which could run any code; add --trust to load it as "
    "stable-baselines3 does, if you know who made it"
)
NUMBERS = ("learning_rate", "clip_range")
"""Schedules, which are functions of this package: saved as their initial values."""
LEFT_OUT: dict[str, Any] = {
    "replay_buffer_class": None, "replay_buffer_kwargs": {}, "action_noise": None, "_last_obs": None,
    "_last_original_obs": None, "_last_episode_starts": None, "ep_info_buffer": None,
}  # fmt: skip
"""Attributes that are not saved: with the buffer of hindsight goals, stable-baselines3 loads a policy only
together with an environment; noise is a class of this package; the last observations of all environments and
their last episodes would be more than half of the file."""


def save_policy(model: Any, path: Path) -> None:
    """Save a learner's average, which stable-baselines3 alone loads; the file is complete or unchanged."""
    attributes = vars(model)
    changed: dict[str, Any] = {k: float(attributes[k](1.0)) for k in NUMBERS if callable(attributes.get(k))}
    changed |= {k: value for k, value in LEFT_OUT.items() if k in attributes}
    originals = {k: attributes[k] for k in changed}
    attributes.update(changed)
    try:
        with model.averaged():
            data = saved(model, exclude=("lr_schedule",))
    finally:
        attributes.update(originals)
    write_bytes(path, data)


def saved(model: Any, exclude: Sequence[str] = ()) -> bytes:
    """The policy.zip of a learner, with objects that NumPy 1 and 2 read: it pickles arrays by names of its
    inner modules, which NumPy 2 has moved."""
    memory, changed = io.BytesIO(), io.BytesIO()
    model.save(memory, exclude=exclude)
    with zipfile.ZipFile(memory) as old, zipfile.ZipFile(changed, "w") as new:
        for entry in old.infolist():
            content = old.read(entry)
            if entry.filename == "data":
                about = json.loads(content)
                for name, value in about.items():
                    text = value.get(PICKLED) if isinstance(value, dict) else None
                    if text is not None and b"numpy" in base64.b64decode(text):
                        pickled = io.BytesIO()
                        _PublicNames(pickled).dump(vars(model)[name])
                        value[PICKLED] = base64.b64encode(pickled.getvalue()).decode()
                content = json.dumps(about, indent=4).encode()
            new.writestr(entry, content)
    return changed.getvalue()


class _PublicNames(cloudpickle.Pickler):
    """A pickler that names nothing of NumPy but ``numpy.array`` and ``numpy.dtype``."""

    def reducer_override(self, obj: Any) -> Any:
        """How an object is made again; numbers become those of Python, and generators None."""
        if isinstance(obj, np.ndarray):
            return np.array, (obj.tolist(), obj.dtype.str)
        if isinstance(obj, np.generic):
            return type(obj.item()), (obj.item(),)
        if isinstance(obj, np.random.Generator):
            return type(None), ()
        return super().reducer_override(obj)


def load_policy(folder: Path, config: Config, trust: bool = False) -> Any:
    """The policy of a run folder with this configuration; its ``predict`` is that of stable-baselines3, which
    with ``trust`` loads the whole learner, and runs any code that the file contains. ValueError if the file
    is damaged, holds anything but finite float32 tensors, or does not fit the configuration."""
    path = folder / "policy.zip"
    if not path.is_file():
        fix = f"make a new run: {train_again(folder)}"
        if (folder / "checkpoint").is_dir():
            fix = f"go on with its training: {command('resume', folder)}"
        raise ValueError(f"run folder {folder} has no policy.zip; {fix}")
    if trust:
        try:
            return ALGORITHM_CLASSES[config.algo].load(path, device="cpu")
        except Exception as error:  # a damaged file may raise any error
            raise ValueError(f"{path} cannot be loaded by stable-baselines3: {error}") from error
    weights, size = read_weights(path, config.settings.activation)
    layers = config.settings.net_arch
    # Checked before a policy is built: a stranger's configuration must not use up all memory.
    if 4 * (sum(layers) + sum(a * b for a, b in itertools.pairwise(layers))) > size:
        held = f"the {size} bytes of weights in {path}"
        raise ValueError(f"config.yaml has net_arch {list(layers)}, larger than {held}")
    env = make_sb3(config.env, 1, **config.env_kwargs)
    build = ALGORITHM_CLASSES[config.algo].policy_aliases[policy_name(config)]
    policy = build(env.observation_space, env.action_space, lambda _: 0.0, **policy_kwargs(config))
    check_weights(path, weights, policy.state_dict())
    policy.load_state_dict(weights)
    return policy


def _members(path: Path, name: str) -> bytes:
    """A member of a policy.zip."""
    with opened(path, "policy", MAX_PACKED) as file:
        return read_members(file, str(path), [name])[name]


def about_of(path: Path) -> dict[str, Any]:
    """The plain data of stable-baselines3 about a learner, of its policy.zip."""
    data = _members(path, "data")
    try:
        if len(data) > MAX_JSON:
            raise ValueError(f"{len(data)} bytes, more than the {MAX_JSON} that are read")
        return dict(json.loads(data))
    except (ValueError, TypeError, RecursionError) as error:
        raise ValueError(f"{path} has a damaged member 'data' ({str(error)[:300]}). {HARMLESS}") from error


def read_weights(path: Path, activation: str) -> tuple[dict[str, torch.Tensor], int]:
    """The tensors of a policy.zip by name, and their bytes."""
    wanted, packed = ACTIVATIONS[activation].module.__name__, io.BytesIO(_members(path, "policy.pth"))
    kwargs = about_of(path).get("policy_kwargs")
    said = kwargs.get("activation_fn", "") if isinstance(kwargs, dict) else ""
    if wanted not in str(said):  # tensors do not show it
        other = str(said)[:80]
        raise ValueError(f"{path} was saved with the activation {other!r} instead of {wanted}. {HARMLESS}")
    try:
        tensors = read_members(packed, "it")
        (table,) = (name for name in tensors if name.endswith("/data.pkl"))
        check_table(tensors[table], TENSOR_NAMES)
        size = sum(map(len, tensors.values()))
        memory = io.BytesIO()  # what was read, and nothing that torch alone would find in the file
        with zipfile.ZipFile(memory, "w") as archive:
            for name in list(tensors):
                archive.writestr(name, tensors.pop(name))
        memory.seek(0)
        weights = torch.load(memory, map_location="cpu", weights_only=True)
        _check_tensors(weights, size)
    except Exception as error:  # bytes of a stranger may raise any error
        what = f"policy.pth in {path} is not a plain table of float32 tensors"
        raise ValueError(f"{what}: {str(error)[:300]}. {HARMLESS}") from error
    return weights, size


def check_table(table: bytes, names: Collection[str]) -> None:
    """Refuse a pickled table of tensors that is too large, or refers to objects beside ``names``."""
    if len(table) > MAX_OBJECTS:
        raise ValueError(f"its data.pkl has {len(table)} bytes, more than the {MAX_OBJECTS} that are read")
    for operation, argument, _ in pickletools.genops(table):
        refers = operation.name in ("STACK_GLOBAL", "INST", "EXT1", "EXT2", "EXT4")
        if refers or (operation.name == "GLOBAL" and argument not in names):
            raise ValueError(f"it refers to {str(argument or operation.name)[:80]!r}")


def _check_tensors(weights: Any, size: int) -> None:
    if not isinstance(weights, dict) or not all(isinstance(name, str) for name in weights):
        raise ValueError("it holds no names of tensors")
    for name, tensor in weights.items():
        if not isinstance(tensor, torch.Tensor) or tensor.dtype not in TENSOR_TYPES:
            raise ValueError(f"{name!r} is not a float32 tensor")
        if tensor.untyped_storage().nbytes() > size or tensor.nbytes > size:
            raise ValueError(f"{name!r} claims {tensor.numel()} numbers, more than the file holds")


def check_weights(path: Path, loaded: Mapping[str, torch.Tensor], needed: Mapping[str, torch.Tensor]) -> None:
    """Refuse tensors that are not those of a policy, or not finite."""
    for name in sorted(needed.keys() ^ loaded.keys()):
        verb, other = ("lacks", "asks for") if name in needed else ("has", "does not ask for")
        raise ValueError(f"{path} {verb} weights {name[:80]!r} that config.yaml {other}: is it of this run?")
    for name, tensor in needed.items():
        actual, weights = loaded[name], f"{path} has weights {name!r}"
        if actual.dtype != tensor.dtype:
            raise ValueError(f"{weights} of {actual.dtype}; give {tensor.dtype}")
        if actual.shape != tensor.shape:
            asked = f"config.yaml asks for {tuple(tensor.shape)}: is it of this run?"
            raise ValueError(f"{weights} of shape {tuple(actual.shape)}, {asked}")
        if not torch.isfinite(actual).all():
            raise ValueError(f"{weights} that are not finite: the training diverged")


# ---- a training that begins with the weights of a policy


def start_from(model: Any, config: Config, env: Any) -> None:
    """Give a learner, its averages and its targets the weights of the policy of ``config.start_from``;
    ValueError if algorithm, networks or meaning of ``env``'s observations are others, or it is damaged."""
    assert config.start_from is not None
    file = policy_file(config.start_from)
    try:
        if all((file.parent / name).is_file() for name in ("config.yaml", SCENE)):
            # observations of the same shape may have another meaning, if a folder records it
            other = own_config(file.parent)
            there: Any = make_sb3(other.env, 1, **other.env_kwargs)
            theirs, ours = (", ".join(e.core.simulator.episode.observed) for e in (there, env))
            if theirs != ours:
                raise ValueError(f"its observations are {theirs}, and those of this training {ours}")
        goals = "spaces" in (about_of(file).get("observation_space") or ())
        if goals != isinstance(env.observation_space, spaces.Dict):
            raise ValueError(f"it is {'' if goals else 'not '}of a goal environment")
        weights, _ = read_weights(file, config.settings.activation)
        check_weights(file, weights, model.policy.state_dict())
    except ValueError as error:
        fix = "give a policy of the same algorithm, observations and networks"
        raise ValueError(f"start_from does not fit: {error}; {fix}") from error
    model.policy.load_state_dict(weights)
    model.read_networks()
