"""Make the pictures of the README and of docs/ again, and the README's results: python docs/figures/remake.py

It takes a minute, trains nothing and measures nothing. Clips and thumbnails show the policies in policies/,
those of ids without any their experts; figures are drawn from the tables in docs/results.
"""

import csv
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from PIL import Image

import redundant_envs as rde
from redundant_envs.control import ComputedTorque
from redundant_envs.control.clearance import clearance, discs_of
from redundant_envs.control.nominal import NominalModel
from redundant_envs.control.poses import poses_at
from redundant_envs.envs.face import numbers_of
from redundant_envs.envs.registration import full_id
from redundant_envs.envs.rendering import stated_limits
from redundant_envs.robots import drawn
from redundant_envs.support import palette
from redundant_envs.support.disk import write_text
from redundant_envs.support.figures import bare, new_figure, save_figure
from redundant_envs.support.tables import markdown
from redundant_envs_train.evidence.curves import curves
from redundant_envs_train.evidence.runs import read_groups
from redundant_envs_train.evidence.table import results_of
from redundant_envs_train.play import play
from redundant_envs_train.policies import load_policy
from redundant_envs_train.rollout import expert_act, policy_act, run_episodes, stacked
from redundant_envs_train.run_folder import own_config
from studies import redundancy
from studies import results as success_rates
from studies.__main__ import main
from studies.poses import poses_table
from studies.strength import figure, read_rows

BRIEF = {
    "environment": "environment", "learner": "learner", "seeds": "seeds",
    "goals held, median seed": "hold, median", "worst seed": "hold, worst seed",
    "expert": "hold of the expert", "training on one core": "training, s",
}  # fmt: skip
"""Columns of the table of the README, and those of all results that they show."""
ROOT = Path(__file__).resolve().parents[2]
FIGURES, RESULTS, POLICIES = ROOT / "docs" / "figures", ROOT / "docs" / "results", ROOT / "policies"
AROUND = POLICIES / "FourRReachAround-v0-sac"
THUMBNAILS = {
    "rprp_reach": [("RPRPReach-v0-sac", 4, 60)],
    "four_r_reach": [("FourRReach-v0-sac", 4, 60)],
    "two_r_reach": [("TwoRReach-v0", 4, 90)],
    "four_r_tasks": [
        ("FourRReachLight-v0", 1, 45), ("FourRReachFault-v0", 1, 60), ("FourRReachAround-v0", 1, 45),
        ("FourRTrack-v0", 1, 120), ("FourRTrackAround-v0", 3, 60),
    ],
}  # fmt: skip
"""Thumbnail -> its parts, side by side: policy, or id for its expert; seed; steps until the moment."""
SIDE = 220
CURVES = {"": "runs", "_weak": "weak", "_baselines": "baselines"}
"""End of a figure's name -> table of runs."""
SCENES = ("worn_joints", "heavy_payload", "slow_motors", "cheap_sensors", "shop_floor", "everything")
"""Scenes of docs/example_scenes.md."""
BILLED = (
    "four_r_free",
    "four_r_reach",
    "heavy_payload",
    "rprp_reach",
    "cheap_sensors",
    "worn_joints",
    "everything",
)
"""Scenes of the picture of bills."""
BILL_COLOURS = {
    "arm and integrator": palette.BLUE,
    "effects": palette.VERMILION,
    "task and interval": palette.GREY,
}
TRIED = (
    "[What redundancy buys](../redundancy.md#what-was-tried-and-what-is-learned) says what the columns mean."
)
ROOMS = {
    "functions\non numbers": "language/", "a scene": "robots/ effects/\ntasks/ scenes/",
    "what a lane\ndoes": "simulator/", "graphs and\nkernels": "compiler/",
    "what users call": "model/ control/\nenvs/ verify/\nweb/ exports/",
}  # fmt: skip
"""What the package is made of, in order, and the folders of it."""
IDEAL = {"FourR": "four_r_reach", "RPRP": "rprp_reach"}
"""Arm -> the scene of the same arm without what wears it down."""
STARTS = {"FourR": (-1.2, -0.4, 0.2, 0.6), "RPRP": (-1.2, 0.08, -0.4, 0.1)}
"""Arm -> its first pose, q in rad and m."""
REACHED_FOR = (0.55, 0.35)
"""Goal, m."""
SECONDS = 3.0
FREQUENCY = {"slow_motors": 5.0}
"""Frequency of the controller where its own of 12 rad/s keeps the arm swinging, rad/s: the motors follow it
0.08 s late."""
COLOURS = {"ideal": palette.BLUE, "scene": palette.VERMILION}


def thumbnail(name: str, parts: Sequence[tuple[str, int, int]]) -> None:
    """Small pictures of arms at their tasks, as one file."""
    picture = Image.new("RGB", (SIDE * len(parts), SIDE))
    for k, part in enumerate(parts):
        picture.paste(moment(*part), (SIDE * k, 0))
    picture.save(FIGURES / f"{name}.png", optimize=True)


def moment(policy: str, seed: int, steps: int) -> Any:
    """A small picture of the state of an episode after some steps."""
    env_id, kwargs, act = full_id(policy), {}, expert_act()
    if (folder := POLICIES / policy).is_dir():
        config = own_config(folder)
        env_id, kwargs = config.env, config.env_kwargs
        act = policy_act(load_policy(folder, config, trust=False))
    env = gym.make(env_id, render_mode="rgb_array", **kwargs)
    unwrapped = env.unwrapped
    obs, _ = env.reset(seed=seed)
    for step in range(steps):
        obs, *_ = env.step(act(stacked([obs]), unwrapped.core, step)[0])
        env.render()
    picture = Image.fromarray(unwrapped._renderer.draw(0, written=False)).resize((SIDE, SIDE), Image.LANCZOS)
    env.close()
    return picture


def clips() -> None:
    """Both arms under their policies."""
    play(str(POLICIES / "RPRPReach-v0-sac"), None, FIGURES / "rprp_reach.gif", episodes=3, seed=1)
    seed = where_two_joints_fail(AROUND)
    play(str(AROUND), None, FIGURES / "four_r_reach_around.gif", episodes=1, seed=seed)


def where_two_joints_fail(policy: Path) -> int:
    """The first seed with which this policy holds a goal at which both poses of TwoR touch a disc."""
    config, two, gaps = own_config(policy), NominalModel(rde.load_scene("two_r_around")), []
    act = policy_act(load_policy(policy, config, trust=False))

    def acts(obs: Any, core: Any, step: int) -> Any:
        if step == 0:
            poses = poses_at(two, core.goals(), np.zeros((len(core.goals()), two.joints)), 1)
            gaps.append(clearance(two, poses, discs_of(core.scene, numbers_of(core))[:, None]))
        return act(obs, core, step)

    held = run_episodes(config.env, acts, 200, 1, **config.env_kwargs).hold
    return 1 + int(np.flatnonzero(held & (gaps[0] < 0.0).all(axis=1))[0])


def readings(env: Any, obs: Any) -> tuple[Any, Any]:
    """Positions and rates of the joints, (joints,) each, as an observation shows them."""
    core, arm = env.unwrapped.core, env.unwrapped.scene.robot
    shown = dict(zip(core.episode.observed, obs.astype(float), strict=True))
    wide = {name: value / np.sqrt(1.0 - value**2) for name, value in shown.items() if name.endswith("_obs")}
    rates = np.array([wide[f"rate{k}_obs"] for k in (1, 2, 3, 4)]) * core.task.rate_scale
    if arm.kind == "FourR":
        pairs = (("s1", "c1"), ("s21", "c21"), ("s32", "c32"), ("s43", "c43"))
        return np.array([np.arctan2(shown[s], shown[c]) for s, c in pairs]), rates
    turns = np.arctan2(shown["s1"], shown["c1"]), -np.arctan2(shown["s12"], shown["c12"])
    travel = env.unwrapped.scene.parameters()
    ends = [(travel[low], travel[high]) for low, high in env.unwrapped.scene.travel().values()]
    slides = [
        (low + high + wide[f"travel{k}_obs"] * (high - low)) / 2.0
        for k, (low, high) in zip((2, 4), ends, strict=True)
    ]
    return np.array([turns[0], slides[0], turns[1], slides[1]]), rates


def reaching(scene_name: str, frequency: float) -> dict[str, Any]:
    """A motion of a scene under computed torque of its ideal arm, which acts on what sensors show."""
    scene = rde.load_scene(scene_name)
    arm, steps = scene.robot, round(SECONDS / scene.control_dt)
    env = gym.make(
        f"redundant_envs/{arm.kind}Reach-v0", scene=scene_name, randomize=False, max_episode_steps=steps + 1
    )
    expert = ComputedTorque(rde.load_scene(IDEAL[arm.kind]), frequency=frequency)
    start, back = np.array(STARTS[arm.kind]), np.linalg.inv(arm.motor_map)
    expert.begin(start[None], np.array([REACHED_FOR]))
    motors: Any = next((e for e in scene.effects if e.key == "dc_motor"), None)
    obs, _ = env.reset(seed=0, options={"q": start, "qd": np.zeros(4), "goal": REACHED_FOR})
    kept = []
    for step in range(steps):
        positions, rates = readings(env, obs)
        kept.append((env.unwrapped.q, positions))
        action = expert.action(step * scene.control_dt, (positions @ back)[None], (rates @ back)[None])[0]
        if motors:  # the voltage that gives this effort at this rate
            each = {name: np.broadcast_to(getattr(motors, name), 4) for name in motors.of_joints}
            per_current = each["gear"] * each["constant"]
            volts = action * expert.limits / per_current * each["resistance"] + per_current * rates
            action = np.clip(volts / each["voltage"], -1.0, 1.0).astype(np.float32)
        obs, *_ = env.step(action)
    env.close()
    q, shown = (np.array(column) for column in zip(*kept, strict=True))
    return {
        "t": np.arange(steps) * scene.control_dt, "tip": arm.forward_kinematics(q),
        "joints": q @ arm.motor_map, "shown": shown,
    }  # fmt: skip


def scene_picture(name: str) -> Any:
    """Paths of the tip, the last revolute joint and the distance from the goal, in a scene and without its
    effects."""
    frequency, kind = FREQUENCY.get(name, 12.0), rde.load_scene(name).robot.kind
    motions = {"ideal": reaching(IDEAL[kind], frequency), "scene": reaching(name, frequency)}
    made = new_figure(9.0, 3.2)
    path, turn, distance = made.subplots(1, 3)
    for of, motion in motions.items():
        look = {"color": COLOURS[of], "lw": 1.5, "label": name if of == "scene" else IDEAL[kind]}
        if np.abs(motion["joints"] - motion["shown"]).max() > 1e-5:
            turn.plot(
                motion["t"], motion["shown"][:, 2], ".", color=palette.GREY, ms=3, label="as sensors show it"
            )
        path.plot(*motion["tip"].T, **look)
        turn.plot(motion["t"], motion["joints"][:, 2], **look)
        distance.plot(motion["t"], np.linalg.norm(motion["tip"] - REACHED_FOR, axis=1), **look)
    path.plot(*REACHED_FOR, "+", color=palette.DARK, ms=10, label="goal")
    path.set_aspect("equal", adjustable="datalim")
    path.set(xlabel="x of the tip [m]", ylabel="y of the tip [m]")
    turn.set(xlabel="time [s]", ylabel="joint 3 [rad]")
    distance.set(xlabel="time [s]", ylabel="distance from the goal [m]", yscale="log", ylim=(1e-4, 2.0))
    for panel in (path, turn, distance):
        bare(panel)
    lines = [*turn.lines, path.lines[-1]]
    made.legend(handles=lines, loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    off, ideal = (1e3 * np.linalg.norm(motions[of]["tip"][-1] - REACHED_FOR) for of in ("scene", "ideal"))
    beside = f"{ideal:.2g}" if ideal >= 0.01 else "less than 0.01"
    title = f"{name}: after {SECONDS:g} s the tip is {off:.2g} mm from its goal, in {IDEAL[kind]} {beside} mm"
    made.suptitle(title, x=0.01, ha="left", fontsize="medium", fontweight="bold")
    return made


def bill_picture() -> Any:
    """Operations of one step in each of some scenes, by the part that needs them."""
    made = new_figure(7.0, 3.2)
    panel, at = made.subplots(), range(len(BILLED))
    scenes = [rde.load_scene(name) for name in BILLED]
    shares = []
    for scene in scenes:
        counts = {owner: sum(one[:-1]) for owner, one in rde.bill(scene).items()}  # the last one: bytes
        effects = sum(counts[effect.key] for effect in scene.effects)
        arm = counts["arm"] + counts["integrator"]
        shares.append((arm, effects, sum(counts.values()) - arm - effects))
    left = np.zeros(len(BILLED))
    for share, (label, colour) in zip(np.transpose(shares), BILL_COLOURS.items(), strict=True):
        panel.barh(at, share / 1000.0, left=left, color=colour, label=label)
        left += share / 1000.0
    names = [f"{name}, {scene.robot.kind}" for name, scene in zip(BILLED, scenes, strict=True)]
    panel.set_yticks(at, names)
    panel.invert_yaxis()
    least, most = BILLED[int(left.argmin())], BILLED[int(left.argmax())]
    title = (
        f"Only used effects cost: {most} has {left.max() / left.min():.1f} times the operations of {least}"
    )
    panel.set_title(title, loc="right", fontsize="medium", fontweight="bold")
    panel.set(xlabel="operations of one rk8 step, thousands")
    panel.legend(frameon=False)
    bare(panel)
    return made


def estimates_picture() -> Any:
    """Errors of single steps over their estimates, of the estimate before and of the one now."""
    rows = list(csv.DictReader((RESULTS / "estimates.csv").open(encoding="utf-8", newline="")))
    made = new_figure(8.0, 3.8)
    for panel, measure in zip(made.subplots(1, 2, sharey=True), ("before", "now"), strict=True):
        own = [row for row in rows if row["measure"] == measure]
        estimate, median, most, largest = (
            [float(row[name]) for row in own] for name in ("estimate", "median", "q999", "largest")
        )
        panel.loglog(estimate, estimate, color=palette.DARK, lw=1.2, label="error = estimate")
        panel.loglog(estimate, largest, "o-", color=palette.BLUE, ms=4, lw=1.2, label="largest error")
        panel.loglog(estimate, most, "--", color=palette.BLUE, lw=1.2, label="error of one step in 1000")
        panel.loglog(estimate, median, color=palette.VERMILION, lw=2.2, label="median error")
        panel.fill_between(estimate, median, most, color=palette.BLUE, alpha=0.15, linewidth=0)
        beyond, steps = (sum(int(row[name]) for row in own) for name in ("beyond", "steps"))
        title = f"{measure}: {beyond} of {steps} steps\nexceed their estimate"
        panel.set_title(title, loc="left", fontsize="medium", fontweight="bold")
        panel.set(xlabel="estimate of a step, m", ylabel="error of the tip, m")
        panel.label_outer()
        bare(panel)
    made.axes[0].legend(frameon=False, fontsize=8.5)
    return made


def rooms_picture() -> Any:
    """The folders of the package, and what each gives to the next."""
    made = new_figure(9.0, 1.9)
    panel = made.subplots()
    panel.set(xlim=(-0.55, 4.55), ylim=(-0.6, 0.6))
    panel.axis("off")
    for k, (what, folders) in enumerate(ROOMS.items()):
        box = {
            "boxstyle": "round,pad=0.6",
            "facecolor": palette.css(palette.REACH),
            "edgecolor": palette.BLUE,
        }
        panel.text(k, 0.0, f"{what}\n\n{folders}", ha="center", va="center", fontsize=9, bbox=box)
        if k:
            arrow = {"arrowstyle": "-|>", "color": palette.DARK}
            panel.annotate("", (k - 0.4, 0.0), (k - 0.6, 0.0), arrowprops=arrow)
    return made


def brief_table(places: Iterable[str | Path], expert: bool = True) -> str:
    """Hold success and training time of runs as one small Markdown table, without or with their experts'."""
    shown = {head: name for head, name in BRIEF.items() if expert or head != "expert"}
    rows = [[row[name] for name in shown.values()] for row in map(results_of, read_groups(places))]
    return markdown(list(shown), ([*row, f"{seconds} s"] for *row, seconds in rows))


def readme_table() -> str:
    stock = RESULTS / "baselines.jsonl" / "*plain*" / "*"
    return brief_table([RESULTS / "runs.jsonl", stock], expert=False)


def results(readme: Path) -> None:
    """Write the table of results between its marks."""
    table = readme_table()
    text = readme.read_text(encoding="utf-8")
    marked = re.compile(r"(<!-- results: .*? -->\n).*?(<!-- end of results -->)", re.S)
    readme.write_text(marked.sub(rf"\g<1>{table}\n\g<2>", text), encoding="utf-8")


def tried_page() -> str:
    """The table of what was tried, as a page of its own."""
    rows = csv.DictReader((RESULTS / "tried.csv").open(encoding="utf-8", newline=""))
    return f"# What was tried\n\n{TRIED}\n\n{poses_table(list(rows))}\n"


def side_by_side(pictures: list[str]) -> str:
    """Drawings of arms in one."""
    placed = [p.replace("<svg ", f'<svg x="{k * drawn.WIDTH:g}" ', 1) for k, p in enumerate(pictures)]
    width = f"{len(pictures) * drawn.WIDTH:g}"
    size = f'viewBox="0 0 {width} {drawn.HEIGHT:g}" width="{width}" height="{drawn.HEIGHT:g}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{"".join(placed)}</svg>'


if __name__ == "__main__":
    results(ROOT / "README.md")
    clips()
    for name, parts in THUMBNAILS.items():
        thumbnail(name, parts)
    for name, runs in CURVES.items():
        curves([RESULTS / f"{runs}.jsonl"], FIGURES / f"learning_curves{name}.png")
    save_figure(figure(read_rows(RESULTS / "strength" / "strength.csv")), FIGURES / "strength.png")
    rows = list(csv.DictReader((RESULTS / "redundancy.csv").open(encoding="utf-8", newline="")))
    bought = redundancy.figure(rows, redundancy.learned([RESULTS / "redundancy_runs.jsonl"]))
    save_figure(bought, FIGURES / "redundancy.png")
    write_text(RESULTS / "tried.md", tried_page())
    write_text(RESULTS / "README.md", success_rates.page())
    save_figure(rooms_picture(), FIGURES / "rooms.svg")
    save_figure(bill_picture(), FIGURES / "bill.png")
    save_figure(estimates_picture(), FIGURES / "estimates.png")
    for name in SCENES:
        save_figure(scene_picture(name), FIGURES / f"scene_{name}.png")
    arms = [rde.load_scene(name) for name in ("rprp_reach", "four_r_reach", "two_r_reach")]
    pictures = [drawn.schematic(scene.robot, stated_limits(scene)) for scene in arms]
    write_text(FIGURES / "arms.svg", side_by_side(pictures))
    for study in ("accuracy", "policy"):
        main([study, "--redraw", str(RESULTS / study)])
