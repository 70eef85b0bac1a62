"""Pages of the environments, generated from the code, so that the tables cannot disagree with it."""

from __future__ import annotations

import dataclasses
import inspect
import math
import re
from typing import Any

from redundant_envs.algebra import gives_of
from redundant_envs.envs.outputs import Columns
from redundant_envs.envs.registration import MAX_EPISODE_STEPS, NAMESPACE
from redundant_envs.model.programs import environment_simulator
from redundant_envs.scene import Scene, load_scene
from redundant_envs.tables import markdown
from redundant_envs.tasks import REGISTRY as TASKS
from redundant_envs.tasks import Task


def action_table(scene: Scene) -> str:
    """Actions with their limits."""
    values, arm, rows = scene.parameters(), scene.robot, []
    for k, (joint, limit) in enumerate(zip(arm.joints, scene.action_units(), strict=True)):
        unit = "N" if arm.prismatic[k] else "N m"
        rows.append((k, f"effort at {joint} / {values[limit]:g} {unit}", -1, 1, joint, unit))
    return markdown(("Num", "Action", "Control Min", "Control Max", "Joint", "Unit of the effort"), rows)


def observation_table(scene: Scene, task: Task) -> str:
    """Observed quantities in order."""
    rows = [(k, text, -1, 1) for k, text in enumerate(task.observation(scene).values())]
    return markdown(("Num", "Observation", "Min", "Max"), rows)


def reward_table(scene: Scene, task: Task) -> str:
    """Reward terms with the formulas that their functions state."""
    rows = []
    for function in task.reward_functions(scene):
        formula = (function.__doc__ or "").partition("\n")[0]
        names = [term.removesuffix("_term") for term in gives_of(function)]
        rows += [(name, f"`{formula}`", f"`return_{name}`") for name in names]
    return markdown(("Term", "Value per step", "Sum over the episode in info"), rows)


INFO = {
    "is_success": ("Hold success: the tip is at the goal and slow, for the last `hold_steps` steps.", ""),
    "touch_success": ("Whether the goal was touched in this episode.", ""),
    "distance": ("Distance of the tip from the goal, m.", ""),
    "manipulability": ("sqrt(det(J J^T)) of the tip's Jacobian.", ""),
    "beyond_limit": (
        "How far the farthest joint is beyond the limit of a spring, rad or m.", "scenes with limit springs",
    ),
    "numerics": ("Faults of this step, the sum of the bits named under Episode End; 0 is none.", ""),
    "saturated_actions": ("Entries of actions outside [-1, 1] in this episode.", ""),
    "episode_steps": ("Control steps of this episode.", ""),
    "evaluations": (
        "Evaluations of the equations of motion in this episode.",
        "scenes with a tolerance, stops or dop853",
    ),
    "events": ("Impacts, rests and releases of sliders at their stops in this episode.", "scenes with stops"),
    "error_estimate": (
        "Largest estimated tip error of a control step in this episode, m.", "scenes with a tolerance",
    ),
    "return_*": ("Sum of a reward term over this episode; the names are listed under Rewards.", ""),
    "final_obs": (
        "Last observation of an environment that ended in this step.", "vector environments, `same_step`",
    ),
    "final_info": ("Its last `info`.", "vector environments, `same_step`"),
    "terminal_observation": (
        "Last observation of an environment that ended in this step.", "stable-baselines3",
    ),
    "TimeLimit.truncated": ("Whether an end was a truncation.", "stable-baselines3"),
    "episode": (
        "Of an episode that ended: return `r`, control steps `l`, and `t`, s since the making.",
        "stable-baselines3",
    ),
}  # fmt: skip
"""Every key of ``info``: its meaning, and the scenes or kinds of environments that alone have it."""


def info_table(scene: Scene, task: Task) -> str:
    """Keys of info: those of the environment's columns, then those of some scenes or environments only."""
    episode = environment_simulator(scene, task).episode
    assert episode is not None
    given = ["return_*" if name.startswith("return_") else name for name in Columns(episode).names]
    names = dict.fromkeys((*given, *(name for name, (_, where) in INFO.items() if where)))
    rows = [(f"`{name}`", *INFO.get(name, ("A metric of the task.", ""))) for name in names]
    return markdown(("Key", "Meaning", "Only in"), rows)


def argument_table(kind: type[Any]) -> str:
    """Keyword arguments of the constructor with their defaults."""
    given = {name: f"`{p.default!r}`" for name, p in inspect.signature(kind.__init__).parameters.items()}
    given["scene"] = "of the id"
    rows = [(f"`{name}`", default, ARGUMENTS[name]) for name, default in given.items() if name != "self"]
    return markdown(("Parameter", "Default", "Description"), rows)


ARGUMENTS = {
    "scene": "Scene by name, path of a YAML file, or mapping (`Scene.to_dict()`).",
    "accuracy": "`'standard'`, `'exact'`, or the tip error per control interval in metres; `None` "
    "keeps the scene's own.",
    "render_mode": "`None`, `'rgb_array'`, or `'human'`: a window (needs pygame: the extra `human`).",
    "on_bad_action": "`'raise'` or `'terminate'`: the response to a non-finite action.",
    "task": "Mapping of the task's numbers, listed under Task.",
}


def task_table(task: Task) -> str:
    """Numbers of the task, with the sentences of its docstring."""
    sentences = meanings(type(task))
    rows = [
        (
            f"`{field.name}`", getattr(task, field.name), task.units.get(field.name, ""),
            _allowed(*task.ranges.get(field.name, (0.0, math.inf))), sentences.get(field.name, ""),
        )
        for field in dataclasses.fields(task)
    ]  # fmt: skip
    return markdown(("Number", "Default", "Unit", "Allowed", "Meaning"), rows)


def _allowed(low: float, high: float) -> str:
    if low != 0.0:
        return f"{low:g} to {high:g}"
    return "positive" if high == math.inf else f"above 0, at most {high:g}"


ENTRY = re.compile(r"^(\w+(?:, \w+)*) : .*\n((?: +.*\n?|\n)+)", re.MULTILINE)


def meanings(kind: type[Any]) -> dict[str, str]:
    """What the numbers of a class mean: the "Parameters" of its docstring and of those of its bases."""
    found: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        text = inspect.cleandoc(base.__dict__.get("__doc__") or "")
        section = text.partition("Parameters\n----------\n")[2].partition("\n---")[0]
        for names, sentence in ENTRY.findall(section):
            found |= dict.fromkeys(names.split(", "), " ".join(sentence.split()))
    return found


def members(kind: type[Any]) -> str:
    """Methods and values of an environment, those of Gymnasium's classes left out."""
    own: dict[str, Any] = {}
    for base in reversed(kind.__mro__):
        if base.__module__.startswith(f"{NAMESPACE}."):
            own |= {name: value for name, value in vars(base).items() if not name.startswith("_")}
    methods = {name: value for name, value in own.items() if inspect.isfunction(value)}
    values = [name for name, value in own.items() if isinstance(value, property)]
    lines = ["## Methods"]
    for name, method in methods.items():
        given = inspect.signature(method).parameters.values()
        plain = [p.replace(annotation=inspect.Parameter.empty) for p in given if p.name != "self"]
        lines += [f"* `{name}{inspect.Signature(plain)}`: {_indented(method)}"]
    lines += ["", "## Values"]
    lines += [f"* `{name}`: {_indented(getattr(kind, name))}" for name in values]
    return "\n".join(lines) + "\n"


def _indented(member: Any) -> str:
    """The docstring of a member, as an entry of a list."""
    return (inspect.getdoc(member) or "").replace("\n", "\n  ").replace("\n  \n", "\n\n")


def page(kind: type[Any], scene_name: Any) -> str:
    """The docstring of an environment under Gymnasium's headings."""
    scene, task = load_scene(scene_name), TASKS[kind.task_name]()
    arm, joints = scene.robot, len(scene.robot.joints)
    masses, lengths = (", ".join(f"{x:g}" for x in numbers) for numbers in (arm.masses, arm.lengths))
    effects = ", ".join(type(effect).__name__ for effect in scene.effects)
    dt, rate = f"{scene.control_dt:g}", f"{1 / scene.control_dt:g}"
    accuracy = f"\nto a tip error of {scene.tolerance:g} m" if scene.tolerance else f" by {scene.integrator}"
    observation = ""
    if task.goal_conditioned:
        observation = (
            "A dictionary: `observation` below, `achieved_goal` the tip and `desired_goal` the goal "
            "(2 numbers each, m, float64).\n\n"
        )
    reward = f"{task.reward_note()}\n\n{reward_table(scene, task)}"
    fast = f"4 a velocity beyond {task.speed_bound:g} rad/s or m/s"
    ends, flags = (f"{fast}, ", "") if task.speed_bound_ends else ("", f"{fast}, ")
    sliders = any(arm.prismatic)
    slider = ", and `#` is a slider, whose\ntravel r extends its link" if sliders else ""
    travel = "; prismatic\njoints uniform over their travel" if sliders else ""
    redundant = ""
    if joints > 2:
        redundant = f"\nThe arm has {joints} joints for a 2-D tip position, so it is redundant."
    drawn = ""
    if arm.schematic:
        drawn = f"""
{arm.schematic}

The arm stretched along +x: `O` is a revolute joint, m1 to m{joints} are point masses{slider}.
Angles are absolute, counterclockwise from +x, and gravity acts along -y. `docs/figures/arms.svg` in
the repository shows the arm bent.
"""
    name = scene_name if isinstance(scene_name, str) else "given where the arm is registered"
    return f"""{arm.description} {task.summary}.

This page describes the id with its own scene, {name}; made with another `scene`, numbers differ.

## Description
Point masses of {masses} kg, link lengths {lengths} m; effects: {effects}.
Efforts act at the joints and are constant over a control interval of {dt} s ({rate} Hz), which is simulated
{accuracy.lstrip()}; `accuracy` chooses another.{redundant}
{drawn}
## Action Space
`Box(-1.0, 1.0, ({joints},), float32)`. Finite actions outside saturate and are counted in
`info["saturated_actions"]`.

{action_table(scene)}

## Observation Space
{observation}`Box(-1.0, 1.0, ({len(task.observation(scene))},), float32)`, where
squash(x) is x / sqrt(1 + x^2).

{observation_table(scene, task)}

## Rewards
{reward}

{task.success_note()}

## Starting State
At rest; joint angles uniform in +-{task.start_angle:g} rad{travel}; all inside the lane's own limits
(springs and stops). {task.start_note()}

`reset(options=...)` sets `q`, `qd`, `goal` and `parameters` exactly. A `q` beyond a hard stop is
refused; one beyond a limit spring is allowed, and `info["beyond_limit"]` shows how far.

## Episode End
Termination: only a fault, named by a bit of `info["numerics"]`: 1 a state or 2 an action that is not
finite, {ends}16 more than 256 impacts in a control interval. The episode goes on with
{flags}8 a tolerance that was not reached. Truncation: after {MAX_EPISODE_STEPS} steps.

## Info
At a reset and at every step; a stable-baselines3 environment reports most keys at the end of an episode
and in `reset_infos`, and only `is_success` and `TimeLimit.truncated` in between. In vector environments
`_<key>` says for which environments a key holds.

{info_table(scene, task)}

## Arguments
{argument_table(kind)}

## Task
{task_table(task)}

## Version History
* v0: initial version; dynamics, observation and reward may change until the first release.
"""
