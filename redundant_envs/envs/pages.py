"""Pages of the environments, written from the code: the tables cannot disagree with it."""

from __future__ import annotations

import inspect
from typing import Any

from redundant_envs.effects import EffortLimits
from redundant_envs.envs.registration import MAX_EPISODE_STEPS
from redundant_envs.envs.vector_env import info_names
from redundant_envs.scene import Scene, load_scene
from redundant_envs.tasks.reach import GoalReachTask, ReachTask

DESCRIPTIONS = {
    "RPRP": "A planar revolute-prismatic-revolute-prismatic arm in a vertical plane",
    "FourR": "A planar arm of four revolute joints in a vertical plane",
}
SCHEMATICS = {
    "RPRP": """\
    base              m1         m2              m3         m4
     O================#----------O================#----------o  tip
     |<----- l1 ----->|<-- r1 -->|<----- l2 ----->|<-- r2 -->|
    theta1                      theta2""",
    "FourR": """\
    base          m1            m2            m3            m4
     O=============O=============O=============O=============o  tip
     |<--- l1 ---->|<--- l2 ---->|<--- l3 ---->|<--- l4 ---->|
    theta1        theta2        theta3        theta4""",
}
"""The arms stretched along +x, with their coordinates, masses and lengths."""
UNITS = {False: "N m", True: "N"}


def table(head: tuple[str, ...], rows: list[tuple[Any, ...]]) -> str:
    """A Markdown table."""
    lines = [head, tuple("---" for _ in head), *rows]
    return "\n".join("| " + " | ".join(str(c) for c in line) + " |" for line in lines)


def action_table(scene: Scene) -> str:
    """Actions with their limits."""
    limits = next(e for e in scene.effects if isinstance(e, EffortLimits)).limits
    rows = [
        (k, f"effort at {joint} / {limits[k]:g} {UNITS[prismatic]}", -1, 1, joint, UNITS[prismatic])
        for k, (joint, prismatic) in enumerate(zip(scene.robot.joints, scene.robot.prismatic, strict=True))
    ]
    return table(("Num", "Action", "Control Min", "Control Max", "Joint", "Unit of the effort"), rows)


def observation_table(scene: Scene, task: ReachTask) -> str:
    """Observed quantities in order."""
    rows = [(k, text, -1, 1) for k, text in enumerate(task.observation(scene).values())]
    return table(("Num", "Observation", "Min", "Max"), rows)


def reward_table(task: ReachTask) -> str:
    """Reward terms with the formulas that their functions state."""
    rows = []
    for function in task.reward_functions:
        formula = (function.__doc__ or "").partition("\n")[0]
        name = function.__name__.removesuffix("_term")
        rows.append((name, f"`{formula}`", f"`return_{name}`"))
    return table(("Term", "Value per step", "Sum over the episode in info"), rows)


INFO = {
    "is_success": "Hold success: the tip is at the goal and slow, for the last `hold_steps` steps.",
    "touch_success": "Whether the goal was touched in this episode.",
    "distance": "Distance of the tip from the goal, m.",
    "manipulability": "sqrt(det(J J^T)) of the tip's Jacobian.",
    "beyond_limit": "How far the farthest joint is beyond the limit of a spring, rad or m.",
    "numerics": "Faults of this step, the sum of the bits named under Episode End; 0 is none.",
    "saturated_actions": "Entries of actions outside [-1, 1] in this episode.",
    "episode_steps": "Control steps of this episode.",
    "evaluations": "Evaluations of the equations of motion in this episode.",
    "events": "Impacts, rests and releases of sliders at their stops in this episode.",
    "error_estimate": "Largest estimated tip error of a control step in this episode, m.",
    "return_*": "Sum of a reward term over this episode; the names stand under Rewards.",
    "final_obs": "Last observation of an environment that ended in this step.",
    "final_info": "Its last `info`.",
    "terminal_observation": "Last observation of an environment that ended in this step.",
    "TimeLimit.truncated": "Whether an end was a truncation.",
}
"""Every key of ``info`` and what it holds."""

INFO_WHERE = {
    "beyond_limit": "scenes with limit springs",
    "events": "scenes with stops",
    "error_estimate": "scenes with a tolerance",
    "evaluations": "scenes with a tolerance, stops or dop853",
    "final_obs": "vector environments, `same_step`",
    "final_info": "vector environments, `same_step`",
    "terminal_observation": "stable-baselines3",
    "TimeLimit.truncated": "stable-baselines3",
}
"""Where keys of ``info`` are found that are not found everywhere."""


def info_table(scene: Scene, task: ReachTask) -> str:
    """Keys of info: those that the environment's columns give, then those of some scenes and faces."""
    given = [name if not name.startswith("return_") else "return_*" for name in info_names(scene, task)]
    names = [*dict.fromkeys(given), *(name for name in INFO_WHERE if name not in given)]
    rows = [(f"`{name}`", INFO[name], INFO_WHERE.get(name, "")) for name in names]
    return table(("Key", "Meaning", "Only in"), rows)


def argument_table(kind: type[Any]) -> str:
    """Keyword arguments of the constructor with their defaults."""
    rows = []
    for name, parameter in inspect.signature(kind.__init__).parameters.items():
        if name != "self":
            default = "of the id" if name == "scene" else f"`{parameter.default!r}`"
            rows.append((f"`{name}`", default, ARGUMENTS[name]))
    return table(("Parameter", "Default", "Description"), rows)


ARGUMENTS = {
    "scene": "Scene by name, path of a YAML file, or mapping (`Scene.to_dict()`).",
    "accuracy": "`'standard'`, `'exact'`, or the tip error per control interval in metres; `None` "
    "keeps what the scene gives.",
    "render_mode": "`None`, `'rgb_array'`, or `'human'`: a window (needs pygame: the extra `human`).",
    "on_bad_action": "`'raise'` or `'terminate'`: what a non-finite action does.",
    "task": "Mapping of the task's numbers, listed under Task.",
}


def task_table(task: ReachTask) -> str:
    """Numbers of the task."""
    rows = [(f"`{name}`", getattr(task, name)) for name in task.__dataclass_fields__]
    return table(("Number", "Default"), rows)


def page(kind: type[Any], arm: str, scene_name: str) -> str:
    """The docstring of an environment under Gymnasium's headings."""
    goal = bool(kind.goal_conditioned)
    scene, task = load_scene(scene_name), GoalReachTask() if goal else ReachTask()
    masses = ", ".join(f"{m:g}" for m in scene.robot.masses)
    lengths = ", ".join(f"{length:g}" for length in scene.robot.lengths)
    dt, rate = f"{scene.control_dt:g}", f"{1 / scene.control_dt:g}"
    percent, held = f"{100 * task.goal_tolerance:g}", task.hold_steps
    observation = (
        "A dictionary: `observation` below, `achieved_goal` the tip and `desired_goal` the goal "
        "(2 numbers each, m, float64).\n\n"
        if goal
        else ""
    )
    reward = (
        "1 when the tip is within the goal tolerance, 0 otherwise: a function of the two goals "
        "alone, `compute_reward(achieved_goal, desired_goal, info)`, for hindsight replay."
        if goal
        else "The sum of the terms; `tolerance(x, margin)` is 1 / (1 + (x / margin)^2), and "
        "`saturation(x, scale)` is x / (x + scale). A step pays 0 to 1. A fault that ends the "
        "episode takes back what was `paid`, so that nothing is gained by ending early."
    )
    reward += "\n\n" + reward_table(task)
    fast = f"4 a velocity beyond {task.speed_bound:g} rad/s or m/s"
    ends, flags = ("", f"{fast}, ") if goal else (f"{fast}, ", "")
    sliders = any(scene.robot.prismatic)
    slider = ", and `#` is a slider, whose\ntravel r extends its link" if sliders else ""
    travel = "; prismatic\njoints uniform over their travel" if sliders else ""
    return f"""{DESCRIPTIONS[arm]} brings its tip to a goal and holds it there.

## Description
Point masses of {masses} kg, link lengths {lengths} m, joint friction and gravity. Efforts act at
the joints and are constant over a control interval of {dt} s ({rate} Hz), which is simulated to a
tip error of {scene.tolerance:g} m; `accuracy` chooses another. The reach is redundant: four joints place
a tip in two dimensions.

{SCHEMATICS[arm]}

The arm stretched along +x: `O` is a revolute joint, m1 to m4 are point masses{slider}.
Angles are absolute, counterclockwise from +x, and gravity acts along -y. `docs/figures/arms.svg` in
the repository shows the arm bent.

## Action Space
`Box(-1.0, 1.0, (4,), float32)`. Finite actions outside saturate and are counted in
`info["saturated_actions"]`.

{action_table(scene)}

## Observation Space
{observation}`Box(-1.0, 1.0, ({len(task.observation(scene))},), float32)`, where
squash(x) is x / sqrt(1 + x^2).

{observation_table(scene, task)}

## Rewards
{reward}

`info["is_success"]` is hold success, at every step: the tip was within {percent} % of the
full reach of the goal and slower than {task.hold_speed:g} reaches per second for the last {held} steps.
`info["touch_success"]` says whether the goal was ever touched.

## Starting State
At rest; joint angles uniform in +-{task.start_angle:g} rad{travel}; all inside the lane's own limits
(springs and stops). The goal is uniform over the area of the annulus from {task.inner:g} to
{task.outer:g} of the full reach.

`reset(options=...)` sets `q`, `qd`, `goal` and `parameters` exactly. A `q` beyond a hard stop is
refused; one beyond a limit spring is allowed, and `info["beyond_limit"]` shows how far.

## Episode End
Termination: only a fault, named by a bit of `info["numerics"]`: 1 a state or 2 an action that is not
finite, {ends}16 more than 256 impacts in a control interval. The episode goes on with
{flags}8 a tolerance that was not reached. Truncation: after {MAX_EPISODE_STEPS} steps.

## Info
At a reset and at every step; a stable-baselines3 environment gives most of it at the end of an episode
and in `reset_infos`, and in between `is_success` and `TimeLimit.truncated`. In vector environments
`_<key>` tells for which environments a key holds.

{info_table(scene, task)}

## Arguments
{argument_table(kind)}

## Task
{task_table(task)}

## Version History
* v0: initial version; dynamics, observation and reward may change until the first release.
"""
