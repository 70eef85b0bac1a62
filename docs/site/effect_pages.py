"""What the pages of effects have beside their written text: a picture, the numbers, the hooks, the bill."""

from __future__ import annotations

import collections
import dataclasses
import functools
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from described import described
from numpy.typing import NDArray

import redundant_envs as rde
from redundant_envs.effects.hooks import Actuation, Effect, snake_case
from redundant_envs.effects.numbers import (
    Curve,
    declared_in,
    example_of,
    not_negative,
    positive,
    share,
    strengths,
)
from redundant_envs.envs.animation import animate
from redundant_envs.model.listing import Operations
from redundant_envs.scenes import config_folder
from redundant_envs.support import palette
from redundant_envs.support.figures import bare, new_figure, save_figure
from redundant_envs.support.tables import markdown
from studies.effects import Entry, Study, load_study

HEADS = [name.replace("_", " ") for name in Operations._fields]
JOINT = 1
"""The joint of pictures, counted from 0: examples of springs are at "joint2", and RPRP has a slider there."""
INSTANT = 1e-6  # s: in which velocities change by the forces alone
POSE = np.array([0.8, 0.2, -0.7, -0.5])  # rad: of FourR, at the start of motions
ABOVE = {"FourR": (1.6, 1.2, 0.6, -0.2), "RPRP": (0.9, 0.2, 0.2, 0.1)}
"""Poses from which the arms fall in drawings, rad and m."""
LARGE = 1e3  # command [N m] with which a motor gives all that it can
SLOW = 2.0  # Hz: of commands in pictures over time
ALLOWED = {
    strengths: "-1e100 to 1e100", not_negative: "0 to 1e100", positive: "above 0, to 1e100", share: "0 to 1",
}  # fmt: skip
"""Of numbers by their checks; the descriptions of the others say it."""
UNITS = {"position": ("rad", "m"), "rate": ("rad/s", "m/s"), "force": ("N m", "N")}

Array = NDArray[np.float64]


@functools.cache
def study() -> Study:
    """The study of what effects cost: it has an effect of each kind."""
    return load_study(config_folder("studies") / "effects.yaml")


def page_name(effect: Effect) -> str:
    """The page of an effect."""
    return snake_case(type(effect).__name__)


def written(folder: Path, each: Callable[..., Iterable[Any]]) -> None:
    """Complete the pages of a folder; ``each`` maps, in processes or not."""
    entries = {page_name(entry.effect): name for name, entry in reversed(study().entries.items())}
    made = each(completed, entries.values(), [folder] * len(entries))
    for page, (facts, bill) in zip(entries, made, strict=True):
        file = folder / f"{page}.md"
        text, cost, rest = re.split(r"(?m)^## (?:Cost|Example)\n", file.read_text(encoding="utf-8"))
        text = f"{text}{facts}\n\n## Cost\n{cost}{bill}\n\n## Example\n{rest}"
        file.write_text(f"```{{index}} ! {page.replace('_', ' ')}\n```\n\n{text}", encoding="utf-8")


def completed(name: str, folder: Path) -> tuple[str, str]:
    """What belongs before and into the section of costs of an effect of the study; its picture is written."""
    entry = study().entries[name]
    page = page_name(entry.effect)
    words = picture(entry, folder / page)
    suffix = "svg" if (folder / f"{page}.svg").exists() else "png"
    facts = [
        f"![{words}]({page}.{suffix})",
        f"{words}: `{called(entry.effect)}`",
        "## Numbers",
        numbers(entry),
        hooks(entry),
    ]
    return "\n\n".join(facts), bill_of_effect(entry)


def called(effect: Effect) -> str:
    """The call that makes an example."""
    given = {f.name: getattr(effect, f.name) for f in dataclasses.fields(effect)}
    own = example_of(type(effect)).numbers
    return f"{type(effect).__name__}({', '.join(f'{k}={given[k]!r}' for k in own)})"


# ---- numbers and hooks ---------------------------------------------------------------------------------


def numbers(entry: Entry) -> str:
    """The table of an effect's numbers: unit, default, and what its class says about them."""
    kind, units, words = (
        type(entry.effect),
        entry.effect.units(entry.arm.robot),
        described(type(entry.effect)),
    )
    rows = []
    for field in (f for f in dataclasses.fields(kind) if f.init):
        declared = declared_in(kind, field.name)
        known = [unit for name, unit in units.items() if name.partition("[")[0] == field.name]
        unit = ", ".join(dict.fromkeys(declared.units if declared and declared.units else known))
        missing = field.default is dataclasses.MISSING
        default = "" if missing else "absent" if field.default is None else f"`{field.default!r}`"
        allowed = ALLOWED.get(declared.check, "") if declared else ""
        rows.append((f"`{field.name}`", unit, allowed, default, roles(words[field.name])))
    return markdown(("number", "unit", "allowed", "default", "meaning"), rows, formatted=True)


def roles(words: str) -> str:
    """Roles and literals of reStructuredText as Markdown."""
    return re.sub(r":\w+:`~?(?:\w+\.)*(\w+)`|``(.*?)``", lambda m: f"`{m[1] or m[2]}`", words)


def hooks(entry: Entry) -> str:
    """A sentence that names the hooks of an effect and its states."""
    arm, effect = entry.arm.robot, entry.pair.scene.effects[-1]  # as the scene has it
    counts = collections.Counter(type(hook).__name__ for hook in effect.hooks(arm))
    states = dict.fromkeys(f"`{name.partition('[')[0]}` [{s.unit}]" for name, s in effect.states(arm).items())
    told = ", ".join(f"`{name}`" + (f" ({count})" if count > 1 else "") for name, count in counts.items())
    remembers = f" It remembers {', '.join(states)}." if states else ""
    return f"Hooks on {arm.kind}: {told or 'none'}.{remembers}"


# ---- what it costs -------------------------------------------------------------------------------------


def bill_of_effect(entry: Entry) -> str:
    """What an effect adds to a step, as a bar and a table."""
    bill = rde.bill(entry.pair.scene)
    counts = bill[entry.effect.key]
    others, own = operations(bill["arm"], bill["integrator"]), operations(counts)
    return f"""One step of {entry.arm.robot.kind} with the effect takes {others} operations of the arm \
and its integrator, and {own} of its own:

<div class="bill"><span style="flex-grow: {others}"></span><span class="effect" style="flex-grow: {own}">\
</span></div>

{markdown(HEADS, [counts])}"""


def operations(*bills: Operations) -> int:
    """The number of all operations."""
    return sum(sum(bill[:-1]) for bill in bills)  # the last one: bytes


# ---- pictures ------------------------------------------------------------------------------------------


def picture(entry: Entry, path: Path) -> str:
    """Draw an effect with the numbers of its example, as its class says; what the picture shows."""
    curve = example_of(type(entry.effect)).curve
    if curve is None:
        return drawn(entry, path.with_suffix(".png"))
    shown = {"force": force, "effort": effort, "reading": reading}.get(curve.of, motion)
    return shown(entry, curve, path.with_suffix(".svg"))


def panel(x: str, y: str) -> tuple[Any, Any]:
    """A small figure and its axes, with their names."""
    figure = new_figure(4.0, 2.4)
    axes = figure.subplots()
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    bare(axes)
    return figure, axes


def unit_of(entry: Entry, quantity: str) -> str:
    return UNITS[quantity][entry.arm.robot.prismatic[JOINT]]


def forces(scene: rde.Scene, q: Array, qd: Array, efforts: Array) -> Array:
    """Forces on all joints, (n, joints), by what happens in an instant."""
    scene = dataclasses.replace(scene, control_dt=INSTANT, integrator="euler", tolerance=None)
    batch = rde.BatchSimulator(scene, len(q))
    batch.set_state(q, qd)
    batch.advance(efforts)
    arm = scene.robot
    at_coordinates = (arm.mass_matrix(q) @ ((batch.qd - qd) / INSTANT)[..., None])[..., 0]
    return np.asarray(at_coordinates @ np.linalg.inv(arm.motor_map).T)


def law(entry: Entry, over: str, along: Array) -> Array:
    """The force of an effect on a joint over its position, its rate or its command; of a motor over its rate,
    the largest that it gives."""
    arm = entry.arm.robot
    at = {name: np.zeros((len(along), len(arm.joints))) for name in ("position", "rate", "command")}
    zero = at["command"].copy()
    if any(isinstance(hook, Actuation) for hook in entry.effect.hooks(arm)):
        at["command"][:, JOINT] = LARGE
    at[over][:, JOINT] = along
    q, qd = (at[name] @ np.linalg.inv(arm.motor_map) for name in ("position", "rate"))
    with_it, without = rde.Scene(arm, (entry.effect,)), rde.Scene(arm, ())
    return (forces(with_it, q, qd, at["command"]) - forces(without, q, qd, zero))[:, JOINT]


def force(entry: Entry, curve: Curve, path: Path) -> str:
    """The force of an effect over what its class says."""
    along, joint = np.linspace(-curve.most, curve.most, 401), entry.arm.robot.joints[JOINT]
    unit = unit_of(entry, "force" if curve.over == "command" else curve.over)
    figure, axes = panel(f"{curve.over} of {joint} [{unit}]", f"force [{unit_of(entry, 'force')}]")
    axes.plot(along, law(entry, curve.over, along), color=palette.VERMILION)
    save_figure(figure, path)
    return f"The force on {joint} over its {curve.over}"


def commands(scene: rde.Scene, share: float) -> Array:
    """Commands at a share of what actions reach, or of the limits of efforts."""
    units = scene.action_units() or scene.effort_units()
    return share * np.array([scene.parameters()[name] for name in units])


def effort(entry: Entry, curve: Curve, path: Path) -> str:
    """The effort of a motor, and its command, which is a sine."""
    scene, joint = entry.pair.scene, entry.arm.robot.joints[JOINT]
    times = np.linspace(0.0, curve.most, 501)
    command = lambda t: commands(scene, 0.05) * np.sin(2.0 * np.pi * SLOW * t)  # noqa: E731
    run = rde.simulate(scene, POSE, np.zeros(4), times, lambda t, q, qd: command(t))
    unit = unit_of(entry, "force")
    figure, axes = panel("time [s]", f"effort at {joint} [{unit}]")
    steps = scene.control_dt * np.floor(times / scene.control_dt + 1e-9)
    axes.plot(times, [command(t)[JOINT] for t in steps], color=palette.GREY, label="command")
    axes.plot(times, run.efforts[:, JOINT], color=palette.VERMILION, label="effort")
    axes.legend(frameon=False)
    save_figure(figure, path)
    return f"What the motor of {joint} gives for its command"


def reading(entry: Entry, curve: Curve, path: Path) -> str:
    """The error of the first sensor in an episode."""
    rows = []
    for effects in ((), ({"type": type(entry.effect).__name__, **example_of(type(entry.effect)).numbers},)):
        scene = rde.load_scene("four_r_reach").to_dict()
        scene["effects"] = [*scene["effects"], *effects]
        env = gym.make("redundant_envs/FourRReach-v0", scene=scene)
        seen = [env.reset(seed=0, options={"q": POSE})[0]]
        action = np.zeros(4, np.float32)
        for k in range(round(curve.most / 0.02)):
            action[:] = 0.2 * np.sin(2.0 * np.pi * SLOW * 0.02 * k)
            seen.append(env.step(action)[0])
        rows.append(np.array(seen, dtype=np.float64))
    true, read = (np.arctan2(x[:, 0], x[:, 1]) for x in rows)
    figure, axes = panel("time [s]", "reading less angle\nof joint1 [rad]")
    axes.axhline(0.0, color=palette.GREY, zorder=0)
    axes.step(0.02 * np.arange(len(true)), read - true, where="post", color=palette.VERMILION)
    save_figure(figure, path)
    return "The error of the first sensor in an episode"


def motion(entry: Entry, curve: Curve, path: Path) -> str:
    """A motion with an effect, beside the one without it, or the one that is wanted."""
    arm, pair = entry.arm.robot, entry.pair
    times = np.linspace(0.0, curve.most, 501)
    figure, axes = panel("time [s]", "")
    shared = entry.effect.shared_commands(arm)
    share = 0.05 if shared else 0.5
    names = {"tip": ("tip, x [m/s]",), "rate": ("joint1 [rad/s]",), "position": ("joint1 [rad]",)}[curve.of]
    for scene, color, label in motions_of(pair, bool(shared)):
        run = rde.simulate(scene, POSE, np.zeros(4), times, commands(scene, share), seed=1)
        tips = np.einsum("tij,tj->ti", arm.jacobian(run.q), run.qd)
        value = {"tip": tips[:, 0], "rate": run.qd[:, 0], "position": run.q[:, 0]}[curve.of]
        axes.plot(times, value, color=color, label=label)
    if shared:
        axes.axhline(commands(pair.scene, share)[0], color=palette.GREY, label="command", zorder=0)
    axes.set_ylabel(names[0])
    axes.legend(frameon=False)
    save_figure(figure, path)
    what = "the commanded value" if shared else "the motion without it"
    return f"A motion of FourR from rest, beside {what}"


def motions_of(pair: Any, alone: bool) -> Iterator[tuple[rde.Scene, str, str]]:
    if not alone:
        yield pair.without, palette.GREY, "without"
    yield pair.scene, palette.VERMILION, "with"


def drawn(entry: Entry, path: Path) -> str:
    """The arm with an effect, as all pictures of the package draw it."""
    import imageio.v3 as imageio

    scene = entry.pair.scene
    run = rde.simulate(scene, ABOVE[scene.robot.kind], np.zeros(4), np.linspace(0.0, 0.6, 61))
    imageio.imwrite(path, animate(run).frame(len(run.t) - 1))
    return f"How pictures and clips draw it, here with {scene.robot.kind}"
