"""Make the pictures of the README and of docs/ again, and the README's results: python docs/figures/remake.py

It takes a minute, trains nothing and measures nothing. Clips and thumbnails show the policies in policies/;
figures are drawn from the tables in docs/results. Those of docs/hard_cases.md are drawn by
``python -m tests.hard_cases --pictures``.
"""

import csv
import re
from pathlib import Path

import gymnasium as gym
from PIL import Image

from redundant_envs.__main__ import main
from redundant_envs.envs.schematic import save_schematic
from redundant_envs.figures import save_figure
from redundant_envs.studies import estimates
from redundant_envs_train.evidence.curves import curves
from redundant_envs_train.evidence.table import brief_table
from redundant_envs_train.play import batched, play
from redundant_envs_train.policies import load_policy
from redundant_envs_train.rollout import policy_act
from redundant_envs_train.run_folder import own_config
from redundant_envs_train.studies.strength import figure, read_rows

ROOT = Path(__file__).resolve().parents[2]
FIGURES, RESULTS, POLICIES = ROOT / "docs" / "figures", ROOT / "docs" / "results", ROOT / "policies"
CLIPS = {"rprp_reach": "RPRPReach-v0-sac", "four_r_reach": "FourRReach-v0-sac"}
"""Clip -> policy."""
THUMBNAILS = {
    "rprp_reach": ("RPRPReach-v0-sac", 4), "rprp_goal_reach": ("RPRPGoalReach-v0-her", 6),
    "four_r_reach": ("FourRReach-v0-sac", 4), "four_r_goal_reach": ("FourRGoalReach-v0-her", 6),
}  # fmt: skip
"""Thumbnail -> policy and seed."""
MOMENT = 18
"""Control steps of the episode that a thumbnail shows the last of."""
SIDE = 160
CURVES = {"": "runs", "_weak": "weak", "_baselines": "baselines"}
"""End of a figure's name -> table of runs."""


def thumbnail(name: str, policy: str, seed: int) -> None:
    """A small picture of an arm on its way to the goal."""
    folder = POLICIES / policy
    config = own_config(folder)
    act = policy_act(load_policy(folder, config, trust=False))
    env = gym.make(config.env, render_mode="rgb_array", **config.env_kwargs)
    unwrapped = env.unwrapped
    obs, _ = env.reset(seed=seed)
    for step in range(MOMENT):
        obs, *_ = env.step(act(batched(obs), unwrapped.core, step)[0])
        env.render()
    picture = Image.fromarray(unwrapped._renderer.draw(0, written=False)).resize((SIDE, SIDE), Image.LANCZOS)
    picture.save(FIGURES / f"{name}.png", optimize=True)
    env.close()


def clips() -> None:
    """Both arms under their policies."""
    for name, policy in CLIPS.items():
        play(str(POLICIES / policy), None, FIGURES / f"{name}.gif", episodes=3, seed=1)


def results(readme: Path) -> None:
    """Write the table of results between its marks."""
    table = brief_table([RESULTS / "runs.csv"])
    text = readme.read_text(encoding="utf-8")
    marked = re.compile(r"(<!-- results: .*? -->\n).*?(<!-- end of results -->)", re.S)
    readme.write_text(marked.sub(rf"\g<1>{table}\n\g<2>", text), encoding="utf-8")


if __name__ == "__main__":
    results(ROOT / "README.md")
    clips()
    for name, (policy, seed) in THUMBNAILS.items():
        thumbnail(name, policy, seed)
    for name, runs in CURVES.items():
        curves([RESULTS / f"{runs}.csv"], FIGURES / f"learning_curves{name}.png")
    save_figure(figure(read_rows(RESULTS / "strength" / "strength.csv")), FIGURES / "strength.png")
    with (RESULTS / "estimates.csv").open(encoding="utf-8") as file:
        save_figure(estimates.figure(list(csv.DictReader(file))), FIGURES / "estimates.png")
    save_schematic(FIGURES / "arms.svg")
    main(["study", "accuracy", "--redraw", str(RESULTS / "accuracy")])
