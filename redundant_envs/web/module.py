"""The simulator of an environment as a WebAssembly module, and what a host must know of it.

The host is :file:`kernel.js`. It needs the arguments of the kernels, the sizes of the memories, and the names
of their rows: with these it has the same blocks as a batch here, of two lanes, and no word of physics.
"""

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from redundant_envs import __version__
from redundant_envs.compiler.backends import wasm
from redundant_envs.compiler.backends.processors import WASM
from redundant_envs.compiler.tracing.flow import Program
from redundant_envs.compiler.tracing.graph import uncollected
from redundant_envs.effects import EffortLimits, ViscousFriction
from redundant_envs.envs.core import first_memory
from redundant_envs.envs.registration import check_motors
from redundant_envs.scenes.scene import Scene, check_scene
from redundant_envs.simulator.batch.environment import EPISODE_KEY, Autoreset, EnvironmentKernel, KernelCall
from redundant_envs.simulator.batch.hosts import arm_kernel, arm_quantities, prepare_kernel
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.simulator.lane.episode import TABLES, Episode
from redundant_envs.simulator.lane.fields import LOG, PARAMETER, STATE
from redundant_envs.support.disk import write_bytes, write_text
from redundant_envs.tasks.base import Task
from redundant_envs.tasks.checks import check_task

HOST = Path(__file__).with_name("kernel.js")  # of the modules, for browsers and Node
FORMAT = 1  # of the description; a host refuses others


class Module(NamedTuple):
    """A module and its description, which is plain JSON data."""

    code: bytes
    description: dict[str, Any]


def environment_module(scene: Scene, task: Task, endless: bool = False) -> Module:
    """The environment of a scene and a task, as a module of two lanes; ``endless`` episodes are not truncated
    after the steps of the task.

    Its kernels are ``environment``, which steps, resets and observes; ``prepare``, which computes what
    follows from parameters and is to be called when one was changed; ``arm``, which tells positions, J, M, h
    and G. ValueError if the scene has no motors, or the task does not fit it.
    """
    check(scene, task)
    with uncollected():
        dynamics = Dynamics(scene)
        episode = Episode(dynamics, task)
        environment = EnvironmentKernel(episode, WASM.lanes)
        layout = environment.blocks.layout
        arm = arm_kernel(episode.features, layout, WASM.lanes)
        kernels = [environment.p, prepare_kernel(dynamics, layout, WASM.lanes), arm]
        code = wasm.module(Program(kernels))
    memory = first_memory(episode, episode.layout(), 1, None if endless else task.steps)
    robot = scene.robot
    description = {
        "format": FORMAT,
        "version": __version__,
        "scene": scene.to_dict(),
        "task": task.name,
        "identity": wasm.identity(code),
        "lanes": WASM.lanes,
        "control_dt": scene.control_dt,
        "substeps": scene.substeps,
        "coordinates": list(robot.coordinates),
        "rates": list(robot.rates),
        "actions": len(episode.actions),
        "observation": list(episode.observed),
        "parameters": [*dynamics.parameters.values, *task.parameters(), "limit"],
        "motors": _motors(dynamics),
        "kernels": {kernel.name: kernel.arguments for kernel in kernels},
        "operations": {one.name.lower(): int(one) for one in KernelCall},
        "autoreset": {one.name.lower(): int(one) for one in Autoreset},
        "episode_key": EPISODE_KEY,
        "memories": {
            **{str(space): layout.size(space) * WASM.lanes for space in (STATE, PARAMETER, LOG)},
            "scratch": environment.blocks.scratch_size,
            "queue": environment.blocks.queue_size,
        },
        "rows": {str(space): layout.rows[space] for space in (STATE, PARAMETER)},
        "tables": {name: {"type": kind, "rows": list(episode.tables[name])} for name, kind in TABLES.items()},
        "arm": list(arm_quantities(robot)),
        "initial": {str(space): memory.arrays[str(space)][0, :, 0].tolist() for space in (STATE, PARAMETER)},
    }
    return Module(code, description)


def check(scene: Scene, task: Task) -> None:
    """ValueError unless an environment may have a scene and a task."""
    check_scene(scene)
    check_motors(scene)
    check_task(task, scene)


def _motors(dynamics: Dynamics) -> dict[str, Any]:
    """What a controller needs of motors: B and its inverse, and the fields with the numbers of effort limits,
    of viscous friction and of the ends of travel; None where there are none."""
    scene, robot, field_of = dynamics.scene, dynamics.scene.robot, dynamics.parameters.field_of
    fields = {type(x): [field_of(f"{x.key}.{name}") for name in x.parameters()] for x in scene.effects}
    limits, units = fields.get(EffortLimits), [*map(field_of, scene.action_units())]
    travel = {k: [*map(field_of, ends)] for k, ends in scene.travel().items()}
    return {
        "map": robot.motor_map.tolist(),
        "inverse": np.linalg.inv(robot.motor_map).tolist(),
        "limits": limits if limits == units else None,
        "friction": fields.get(ViscousFriction),
        "travel": [travel.get(joint) for joint in range(len(robot.joints))],
    }


def as_json(value: Any) -> str:
    """Plain data as JSON text, in which NaN and infinities are texts, as JavaScript's Number() reads them."""
    return json.dumps(json.loads(json.dumps(value), parse_constant=str))


def files(name: str, folder: Path) -> list[Path]:
    """The host, NAME.wasm and NAME.json in a folder."""
    return [folder / file for file in (HOST.name, f"{name}.wasm", f"{name}.json")]


def write(scene: Scene, task: Task, name: str, folder: Path) -> list[Path]:
    """Write NAME.wasm, NAME.json and their host; the paths."""
    check(scene, task)
    folder.mkdir(parents=True, exist_ok=True)
    paths = files(name, folder)
    write_bytes(paths[0], HOST.read_bytes())  # a folder that cannot be written is refused at once
    module = environment_module(scene, task)
    write_bytes(paths[1], module.code)
    write_text(paths[2], f"{as_json(module.description)}\n")
    return paths
