"""Pages from the code: environments, tasks, effects, integrators, scenes, the API; and a gallery."""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from pathlib import Path

import api
import effect_pages
import gymnasium as gym
import imageio.v3 as imageio
import numpy as np
import printed
from sources import DOCS, PAGES, ROOT

import redundant_envs as rde
from redundant_envs.envs.named import page as page_of
from redundant_envs.envs.registration import IDS, id_of, scene_of
from redundant_envs.envs.rendering import stated_limits
from redundant_envs.robots.drawn import schematic
from redundant_envs.scenes import config_folder
from redundant_envs.scenes.scene import scene_names
from redundant_envs.scenes.tableaus import METHODS
from redundant_envs.support.disk import write_text
from redundant_envs.support.tables import markdown
from redundant_envs.tasks import OWN as OWN_TASKS
from redundant_envs_train.rollout import expert_act, expert_name

sys.path.insert(0, str(DOCS / "examples"))
from play_with_numpy import load

TASKS = tuple(OWN_TASKS.values())
OWN_IDS = [id_of(arm, task.name) for arm in ("RPRP", "FourR", "TwoR") for task in TASKS]
"""Ids of the package: a process may have registered others."""
POLICIES = {
    "RPRPReach-v0": "RPRPReach-v0-sac", "FourRReach-v0": "FourRReach-v0-sac",
    "RPRPGoalReach-v0": "RPRPGoalReach-v0-her", "FourRGoalReach-v0": "FourRGoalReach-v0-her",
}  # fmt: skip
"""Shipped policies that the clips show; the other clips show the experts of the tasks."""
SEED, FRAMES, EVERY, FPS = 6, 50, 2, 25
COMMANDS = {
    "figures/page.png": "python docs/figures/picture_of_page.py",
    "figures/": "python docs/figures/remake.py",
    "results/accuracy/": "python -m studies accuracy",
    "results/policy/": "python -m studies policy",
}
"""Figures of docs/, and the commands that make them."""


def written(site: Path, pool: Executor) -> None:
    """Write all of them; what is counted and drawn is by the processes of a pool."""
    for name, text in pages(pool.map).items():
        (site / name).parent.mkdir(parents=True, exist_ok=True)
        (site / name).write_text(text.rstrip() + "\n", encoding="utf-8")
    (site / "effects" / "README.md").write_text(index_of_effects(site / "effects"), encoding="utf-8")
    effect_pages.written(site / "effects", pool.map)
    pictures(site)


def pages(each: Callable[..., Iterable[str]] = map) -> dict[str, str]:
    """The pages of their own, by their places in the site."""
    return {
        **environments(), **tasks(), **scenes(each), "reference/integrators.md": integrators(),
        **api.pages(), "reference/report.md": printed.page(), "gallery.md": gallery(),
    }  # fmt: skip


def pictures(site: Path) -> None:
    """Clips of the environments, and drawings of the arms."""
    for env_id in OWN_IDS:
        frames = played(env_id)
        imageio.imwrite(
            site / "environments" / f"{env_id.partition('/')[2]}.gif", frames, duration=1000 // FPS, loop=0
        )
    scenes = [rde.load_scene(name) for name in scene_names()]
    for kind, scene in {scene.robot.kind: scene for scene in scenes}.items():
        write_text(site / "scenes" / f"{kind}.svg", schematic(scene.robot, stated_limits(scene)))


# ---- environments and tasks ----------------------------------------------------------------------------


def environments() -> dict[str, str]:
    """A page for each id, in the order of Gymnasium's pages."""
    made = {}
    for env_id in OWN_IDS:
        name, arm = env_id.partition("/")[2], IDS[env_id].arm
        env = gym.make(env_id)
        spaces = {"Action space": env.action_space, "Observation space": env.observation_space}
        rows = [("Import", f'`gymnasium.make("{env_id}")`'), *((k, f"`{v}`") for k, v in spaces.items())]
        text = inspect.cleandoc(page_of(type(env.unwrapped), scene_of(*IDS[env_id])))
        first, _, rest = text.partition("\n\n## Description")
        made[f"environments/{name}.md"] = f"""# {name}

{first}

![{name}: an episode with {"a trained policy" if name in POLICIES else expert_name(env_id)}]({name}.gif)

{markdown(("", ""), rows, formatted=True)}

![The arm {arm}, with its angles, lengths and masses](../scenes/{arm}.svg)

```python
import gymnasium as gym
import redundant_envs  # registers the ids

env = gym.make("{env_id}")
observation, info = env.reset(seed=0)
observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
```

## Description{rest}
"""
    made["environments/index.md"] = index_of_environments()
    return made


def index_of_environments() -> str:
    """A table of the tasks, with the ids of each arm."""
    arms = list(dict.fromkeys(IDS[env_id].arm for env_id in OWN_IDS))
    rows = [
        (f"[{task.name}](../tasks/{task.__name__}.md)", f"The arm {task.summary}.",
         *(f"[{name}]({name}.md)" for name in (id_of(arm, task.name).partition("/")[2] for arm in arms)))
        for task in TASKS
    ]  # fmt: skip
    return f"""# Environments

{markdown(("task", "", *arms), rows, formatted=True)}

`Goal` marks those for hindsight replay. `gym.make("redundant_envs/" + id)` makes one,
`gym.make_vec("redundant_envs/" + id, num_envs=512)` a vector of them.
"""


def played(env_id: str) -> np.ndarray:
    """Frames of an episode with a shipped policy, run by NumPy, or with the expert of its task."""
    env = gym.make(env_id, render_mode="rgb_array")
    observation, _ = env.reset(seed=SEED)
    if policy := POLICIES.get(env_id.partition("/")[2]):
        act = load(ROOT / "policies" / policy / "policy.npz")
    else:
        expert = expert_act()
        act = lambda seen: expert(seen, env.unwrapped.core, 0)  # noqa: E731
    frames = []
    for _ in range(FRAMES):
        frames.append(env.render())
        for _ in range(EVERY):
            several = isinstance(observation, dict)
            seen = {k: v[None] for k, v in observation.items()} if several else observation[None]
            observation, _, terminated, truncated, _ = env.step(act(seen)[0])
        if terminated or truncated:
            break
    env.close()
    return np.stack(frames)


def tasks() -> dict[str, str]:
    """A page for each task, and one for the protocol of all."""
    made = {}
    for kind in TASKS:
        scene = rde.load_scene(scene_of("FourR", kind.name))
        terms = kind().reward_functions(scene)
        rows = [(f.__name__.removesuffix("_term"), f"`{inspect.getdoc(f).splitlines()[0]}`") for f in terms]
        ids = [env_id for env_id in OWN_IDS if IDS[env_id].task == kind.name]
        made[f"tasks/{kind.__name__}.md"] = f"""# {kind.__name__}

Environments: {", ".join(f"[{i.partition('/')[2]}](../environments/{i.partition('/')[2]}.md)" for i in ids)}.

## Reward

The sum of these terms in every step:

{markdown(("term", "value"), rows, formatted=True)}

{kind().reward_note()}

## Numbers

```{{eval-rst}}
.. autoclass:: {kind.__module__}.{kind.__name__}
   :no-members:
   :no-index:
```
"""
    made["tasks/Task.md"] = """# The protocol of a task

[Tutorial: a moving target](../tutorials/moving_target.md) makes one.

```{eval-rst}
.. autoclass:: redundant_envs.Task
   :members:
   :no-index:
```
"""
    return made


# ---- effects, integrators, scenes ----------------------------------------------------------------------


LINKS = re.compile(r"(?:^\[`\w+`\]\(\w+\.md\).*\n)+", re.M)
"""Lines of links to pages of effects."""
PAGE = re.compile(r"\]\((\w+\.md)\)")


def index_of_effects(folder: Path) -> str:
    """The index of a folder's effects: tables with the sentences of the pages in place of links to them, and
    a last table of the pages that have no link."""
    paths = (path for path in sorted(folder.glob("*.md")) if path.name != "README.md")
    heads = {path.name: path.read_text(encoding="utf-8").split("\n\n")[:2] for path in paths}
    text, last = (folder / "README.md").read_text(encoding="utf-8"), "## What they cost"

    def table(names: Iterable[str]) -> str:
        rows = [(f"[`{heads[name][0][2:]}`]({name})", heads[name][1]) for name in names]
        return f"{markdown(('effect', 'what it does'), rows, formatted=True)}\n"

    others = [name for name in heads if name not in PAGE.findall(text)]
    text = LINKS.sub(lambda lines: table(PAGE.findall(lines[0])), text)
    return text.replace(last, f"## Others\n\n{table(others)}\n{last}") if others else text


def bill_of_scene(name: str) -> str:
    """Operations of a step of a named scene by owner, as a table."""
    found = rde.bill(rde.load_scene(name))
    return markdown(("of", *effect_pages.HEADS), [(owner, *counts) for owner, counts in found.items()])


ABOUT = {
    "euler": "Semi-implicit: velocities first, then positions with the new velocities.",
    "rk4": "The classical method.",
    "rk8": "The twelve stages of DOP853 (Hairer, Nørsett, Wanner, Solving Ordinary Differential Equations I, "
    "2nd ed.), in steps of one length, or of 1, 2, 4, ... equal ones under a tolerance.",
    "dop853": "The same stages in steps of any length, each as long as its error allows: errors stay near "
    "rounding.",
}
"""Sentences about the methods."""


def integrators() -> str:
    """A page of all methods, with the numbers of each."""
    parts = [
        """# Integrators

A scene names one of these explicit Runge-Kutta methods, `integrator: rk8`. With a `tolerance`, steps are
chosen by the estimated error, which takes a method that estimates it. [Accuracy](../accuracy.md) measures
what they cost and how exact they are. A method of your own is a [`Tableau`](api/extend.md), registered by
`rde.register_integrator` ([how](../extending.md))."""
    ]
    rows = [(f"[`{n}`](#{n})", m.order, m.stages, "yes" if m.error5 else "no") for n, m in METHODS.items()]
    head = ("name", "order", "evaluations a step", "estimates its error")
    parts.append(markdown(head, rows, formatted=True))
    for name, method in METHODS.items():
        numbers = [
            (k + 1, f"{c:.6g}", f"{b:.6g}") for k, (c, b) in enumerate(zip(method.c, method.b, strict=True))
        ]
        parts += [f"## {name}", ABOUT.get(name, ""), markdown(("stage", "node", "weight"), numbers)]
    return "\n\n".join(parts)


def scenes(each: Callable[..., Iterable[str]]) -> dict[str, str]:
    """A page for each named scene, with its file, its arm and its bill, and a list of them."""
    made, rows = {}, []
    for name, bill in zip(scene_names(), each(bill_of_scene, scene_names()), strict=True):
        scene, file = rde.load_scene(name), config_folder("scenes") / f"{name}.yaml"
        effects = [
            f"[{type(one).__name__}](../effects/{effect_pages.page_name(one)}.md)" for one in scene.effects
        ]
        rows.append((f"[{name}]({name}.md)", scene.robot.kind, ", ".join(effects)))
        made[f"scenes/{name}.md"] = f"""# {name}

Effects: {", ".join(effects) or "none"}.

```python
import redundant_envs as rde

scene = rde.load_scene("{name}")
```

## File

```yaml
{file.read_text(encoding="utf-8").rstrip()}
```

## Arm

![The arm {scene.robot.kind}, with its angles, lengths and masses]({scene.robot.kind}.svg)

## Bill

Operations of one step, stages as often as they are evaluated, and bytes of memory:

{bill}
"""
    made["scenes/index.md"] = f"""# Named scenes

{markdown(("scene", "arm", "effects"), rows, formatted=True)}

[Scenes](../scenes.md) says how to write one, [six of them](../example_scenes.md) show effects at work.
"""
    return made


IMAGE = re.compile(r'!\[([^]]*)\]\((?!https?:)([^)]+)\)|<img src="(?!https?:)([^"]+)"[^>]*alt="([^"]*)"')
"""An image of Markdown or HTML that is a file: words and file, or file and words."""


def gallery() -> str:
    """Figures of docs/ by the page that shows them first, with captions, and the commands that make them."""
    parts: list[str] = ["# Gallery"]
    shown: set[Path] = set()
    for page in [ROOT / "README.md", *sorted(DOCS.glob("*.md")), DOCS / "site" / "start.md"]:
        text = page.read_text(encoding="utf-8")
        found = {(page.parent / (a or b)).resolve(): x or y for x, a, b, y in IMAGE.findall(text)}
        new = {path: words for path, words in found.items() if path not in shown}
        if not new:
            continue
        shown |= new.keys()
        place = PAGES.get(page.relative_to(ROOT).as_posix(), page.name)
        parts.append(f"## [{text.partition(chr(10))[0].removeprefix('# ')}]({place})")
        for path, words in new.items():
            where = path.relative_to(DOCS).as_posix()
            command = next(c for start, c in COMMANDS.items() if where.startswith(start))
            parts += [f"![{words}]({where})", f"{words}. <small>`{command}`</small>"]
    return "\n\n".join(parts)
