"""A page in which arms reach, go around discs, track and lose a motor: files that a browser opens, without a
server.

All that the page shows of a scene is in its data: modules, names and ranges of numbers, bills, trained
policies, and digests of this machine's bits. Its scripts know no scene.
"""

import base64
import dataclasses
import hashlib
import itertools
import lzma
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from redundant_envs.effects import (
    Effect,
    EffortLimits,
    Gravity,
    KeepOut,
    PrismaticStop,
    TipForce,
    ViscousFriction,
)
from redundant_envs.effects.motor_faults import MotorFault
from redundant_envs.envs.core import Core
from redundant_envs.envs.registration import id_of, scene_of
from redundant_envs.model.listing import Operations, bill
from redundant_envs.scenes.scene import Scene, load_scene
from redundant_envs.simulator.batch.environment import Autoreset
from redundant_envs.simulator.lane.faults import Fault
from redundant_envs.support.bounded import read_arrays
from redundant_envs.support.disk import check_plain, write_text
from redundant_envs.tasks.base import Task
from redundant_envs.tasks.reach import ReachTask
from redundant_envs.tasks.reach_around import ReachAroundTask
from redundant_envs.tasks.reach_fault import ReachFaultTask
from redundant_envs.tasks.track import TrackTask
from redundant_envs.web.module import HOST, as_json, environment_module

SOURCES = (Path(__file__).parent / "site" / "index.html", HOST, Path(__file__).parent / "site" / "page.js")
DATA = "data.js"
ARMS = ("RPRP", "FourR")
TASKS = (ReachTask(), ReachAroundTask(), TrackTask(), ReachFaultTask())
PAIRS = [*itertools.product(ARMS, TASKS)]
LEARNERS = ("sac", "ppo")  # whose policies the page takes, from folders such as RPRPReach-v0-sac
POLICIES = Path(__file__).parents[2] / "policies"  # of the source tree; a wheel has none
LARGEST_PUSH = 100.0  # N
CHECKED_STEPS, CHECKED_KEY = 1000, (1, 2, 3, 4)  # whose digest is compared
FNV_OFFSET, FNV_PRIME, WORD = 0xCBF29CE484222325, 0x100000001B3, 2**64  # FNV-1a on words of 64 bits
PACKING = {"id": lzma.FILTER_LZMA1, "preset": 9 | lzma.PRESET_EXTREME, "lc": 2, "lp": 0, "pb": 0}
"""What page.js can unpack: the modules, which are alike, take half of what gzip makes of them."""
SHARES = 2**15 - 1  # of the largest weight of a policy: the page has weights of 16 bits
HIDDEN, OUTPUTS = ("silu", "tanh", "relu"), ("tanh", "clip")  # what policies apply after layers, at the end
FAULTS = {
    Fault.NON_FINITE: "a state is no finite number",
    Fault.BAD_ACTION: "the action was no finite number",
    Fault.SPEED_BOUND: "a joint is faster than the task allows",
    Fault.TOLERANCE_NOT_REACHED: "the most steps allowed did not suffice for the tolerance",
    Fault.EVENT_BUDGET: "more events in a step than allowed",
    Fault.NO_STEP_FOUND: "no step is short enough",
    Fault.LARGE_ANGLE: "an angle has lost its last digits",
}


class Slider(NamedTuple):
    """A number of the page that a reader may change, and the fields that it sets."""

    label: str
    unit: str
    low: float
    high: float
    step: float
    fields: list[str]
    factor: bool = False  # of the scene's own numbers
    body: bool = False  # of the arm, not of an effect


def files(folder: Path) -> list[Path]:
    """The files of the page in a folder; the last one has its data."""
    return [folder / name for name in (*(source.name for source in SOURCES), DATA)]


def write(folder: Path, policies: Path | None = None) -> tuple[list[Path], list[str]]:
    """Write the page; the paths of its files, and names of the policies in it.

    ``policies`` is a folder with policies in folders such as ``RPRPReach-v0-sac``, each with a ``policy.npz``
    as ``agents export`` writes it; by default those of the source tree, if it is there. ValueError if one
    does not fit its environment, or the folder holds links.
    """
    if policies is None and POLICIES.is_dir():
        policies = POLICIES
    elif policies is not None and not policies.is_dir():
        raise ValueError(f"policies is {policies}, which is no folder; give one with policies")
    if policies is not None:
        check_plain(policies)
    folder.mkdir(parents=True, exist_ok=True)
    *paths, data = files(folder)
    for path, source in zip(paths, SOURCES, strict=True):
        lines = source.read_text(encoding="utf-8").splitlines()
        text = "".join(f"{line.lstrip()}\n" for line in lines)  # without indentation, 5 kB less
        write_text(path, with_digest(text) if path.suffix == ".html" else text)
    content, learners = _content(policies)
    packed = struct.pack("<II", len(content), zlib.adler32(content))
    packed += lzma.compress(content, lzma.FORMAT_RAW, filters=[PACKING])
    text = base64.b85encode(packed).decode()  # 4 bytes in 5 characters, in place of 3 in 4
    write_text(data, f'"use strict";\nconst DATA = "{text}";\n')
    return [*paths, data], learners


def _content(policies: Path | None) -> tuple[bytes, list[str]]:
    """The data of the page: length of a JSON text, the text, bytes to which it refers; and its policies."""
    rest = bytearray()

    def add_bytes(part: bytes) -> list[int]:
        """The place of some bytes behind the text, and their number."""
        rest.extend(part)
        return [len(rest) - len(part), len(part)]

    pairs = {f"{arm}{task.name}": _of_pair(arm, task, policies, add_bytes) for arm, task in PAIRS}
    text = as_json({
        "arms": ARMS, "tasks": [task.name for task in TASKS], "pairs": pairs,
        "most_push": LARGEST_PUSH, "bill_columns": Operations._fields,
        "faults": {int(fault): f"{fault.name}: {said}" for fault, said in FAULTS.items()},
    }).encode()  # fmt: skip
    learners = [f"{name} of {pair}" for pair, about in pairs.items() for name in about["policies"]]
    return struct.pack("<I", len(text)) + text + rest, learners


def _of_pair(arm: str, task: Task, policies: Path | None, add_bytes: Any) -> dict[str, Any]:
    """What the page knows of an arm in a task."""
    scene = page_scene(arm, task)
    code, description = environment_module(scene, task, endless=True)
    place, switches, entries = add_bytes(code), _switches(scene), {}
    for learner in LEARNERS if policies is not None else ():
        path = policies / f"{arm}{task.name}-v0-{learner}" / "policy.npz"  # type: ignore[operator]
        if path.is_file():
            about, weights = policy(path, len(description["observation"]), description["actions"])
            scale = float(np.abs(weights).max()) / SHARES
            # First bytes, then second bytes: alike ones together take less when they are packed.
            planes = np.rint(weights / scale).astype("<i2").view(np.uint8).reshape(-1, 2).T.tobytes()
            entries[learner.upper()] = {**about, "scale": scale, "weights": add_bytes(planes)}
    return {
        "id": id_of(arm, task.name),
        "task": task.name,
        "steps": task.steps,
        "joints": scene.robot.joints,
        "discs": [effect.key for effect in scene.effects if isinstance(effect, KeepOut)],
        "fault": next((effect.key for effect in scene.effects if isinstance(effect, MotorFault)), None),
        "description": description,
        "code": place,
        "policies": entries,
        "sliders": [slider._asdict() for slider in _sliders(scene)],
        "switches": switches,
        "bills": _bills(scene, task, [switch["key"] for switch in switches]),
        "check": {"key": CHECKED_KEY, "steps": CHECKED_STEPS, "digest": digest(scene, task)},
    }


def with_digest(html: str) -> str:
    """A page whose policy of contents allows its own style and no other."""
    style = html.partition("<style>")[2].partition("</style>")[0]
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    return html.replace("'STYLE'", f"'sha256-{digest}'")


def page_scene(arm: str, task: Task) -> Scene:
    """The scene of an arm in a task with a force at the tip, by which readers push it."""
    scene = load_scene(scene_of(arm, task.name))
    return dataclasses.replace(scene, effects=(*scene.effects, TipForce(step=(0.0, 0.0))))


def _fields(scene: Scene, kind: type[Effect]) -> list[str]:
    """Names of the numbers of an effect of a scene."""
    effects = (effect for effect in scene.effects if isinstance(effect, kind))
    return [f"{effect.key}.{name}" for effect in effects for name in effect.parameters()]


def _sliders(scene: Scene) -> Iterator[Slider]:
    """Numbers that a reader may change; each sets its fields to its value, or to this times their own."""
    robot = scene.robot
    gravity = [name for name in _fields(scene, Gravity) if name.endswith(".g")]
    yield Slider("gravity", "m/s²", 0.0, 20.0, 0.01, gravity)
    friction, units = _fields(scene, ViscousFriction), scene.units()
    unit = " or ".join(dict.fromkeys(units[name].replace("/rad", "") for name in friction))
    yield Slider("joint friction", unit, 0.0, 1.0, 0.01, friction)
    yield Slider("motor strength", "×", 0.2, 2.0, 0.05, _fields(scene, EffortLimits), factor=True)
    if stops := [name for name in _fields(scene, PrismaticStop) if "restitution" in name]:
        yield Slider("restitution", "", 0.0, 1.0, 0.05, stops)
    for k in range(len(robot.masses)):
        yield Slider(f"mass {k + 1}", "kg", 0.1, 2.0, 0.05, [f"m{k + 1}"], body=True)
    for k in range(len(robot.lengths)):
        yield Slider(f"length {k + 1}", "m", 0.1, 0.5, 0.01, [f"l{k + 1}"], body=True)


def _switches(scene: Scene) -> list[dict[str, Any]]:
    """Effects that a reader may switch off: the numbers that are 0 then."""
    switches = []
    for label, kind in {"gravity": Gravity, "friction": ViscousFriction, "push": TipForce}.items():
        (key,) = (effect.key for effect in scene.effects if isinstance(effect, kind))
        fields = [name for name in _fields(scene, kind) if ".down" not in name and ".start" not in name]
        switches.append({"label": label, "key": key, "fields": fields})
    return switches


def _bills(scene: Scene, task: Task, keys: list[str]) -> dict[str, Any]:
    """Bills of the scene without each subset of the effects that can be off, by their keys."""
    bills = {}
    for off in (off for count in range(len(keys) + 1) for off in itertools.combinations(keys, count)):
        rest = tuple(effect for effect in scene.effects if effect.key not in off)
        bills["+".join(off)] = bill(dataclasses.replace(scene, effects=rest), task=task)
    return bills


def digest(scene: Scene, task: Task) -> str:
    """A digest of the states of an episode with actions that are the same everywhere, of this machine."""
    core = Core(scene, 1, task)
    core.keys[:], core.waiting[:] = CHECKED_KEY, True
    core.begin(np.ones(1, dtype=bool), {})
    state_hash, states, number = FNV_OFFSET, core.memory.arrays["state"][0], 1
    for _ in range(CHECKED_STEPS):
        action = np.empty((1, len(core.actions)), dtype=np.float32)
        for joint in range(len(core.actions)):  # of a linear congruential generator
            number = (number * 1664525 + 1013904223) % 2**32
            action[0, joint] = number / 2**31 - 1.0
        core.step(action, Autoreset.DISABLED)
        for word in np.ascontiguousarray(states[:, 0]).view(np.uint64).tolist():
            state_hash = (state_hash ^ word) * FNV_PRIME % WORD
    return f"{state_hash:016x}"


def policy(path: Path, inputs: int, actions: int) -> tuple[dict[str, Any], NDArray[np.float64]]:
    """Structure and numbers of a ``policy.npz`` with layers from some inputs to some actions."""
    try:
        arrays = read_arrays(path, "policy")
        layers = [
            tuple(np.asarray(arrays[f"{part}_{k}"], dtype=np.float64) for part in ("weights", "biases"))
            for k in range(sum(name.startswith("weights_") for name in arrays))
        ]
        about = {"activation": str(arrays["activation"]), "output": str(arrays["output"])}
    except (ValueError, KeyError) as error:
        raise ValueError(f"{path} is no policy as agents export writes it: {error}") from error
    sizes = [inputs, *(biases.size for _, biases in layers)]
    shapes = [weights.shape for weights, _ in layers]
    numbers = np.concatenate([np.zeros(0), *(part.ravel() for layer in layers for part in layer)])
    known = about["activation"] in HIDDEN and about["output"] in OUTPUTS and np.isfinite(numbers).all()
    if not known or shapes != [*zip(sizes[1:], sizes[:-1], strict=True)] or sizes[-1] != actions:
        raise ValueError(
            f"{path} has layers {shapes}, {about}; give a policy of finite numbers from {inputs} observed "
            f"numbers to {actions} actions, with {', '.join(HIDDEN)}, and {' or '.join(OUTPUTS)} at the end"
        )
    return {**about, "sizes": sizes}, numbers
