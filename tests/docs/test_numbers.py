"""Numbers on several pages agree with each other, with the code and with the measurements."""

import contextlib
import csv
import io
import re

import gymnasium as gym
import numpy as np
import pytest
from markdown import MANUAL, PAGES, ROOT, blocks, prose, text

from redundant_envs.envs.registration import id_of
from redundant_envs.events import contacts
from redundant_envs.lane import step_control
from redundant_envs.numerics import error_control
from redundant_envs.scene import ACCURACIES

SHIPPED = [id_of(arm, task) for arm in ("RPRP", "FourR") for task in ("Reach", "GoalReach")]
"""Ids of the package itself; other tests may have registered more."""
RESULTS = ROOT / "docs" / "results"
ACCURACY, SPEED = (text(ROOT / "docs" / f"{name}.md") for name in ("accuracy", "speed"))


def rows(name):
    with (RESULTS / name).open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_evaluations_of_a_control_step_are_those_that_the_page_measures():
    ((_, program),) = blocks(ROOT / "docs" / "accuracy.md", "python")
    with contextlib.redirect_stdout(io.StringIO()) as out:
        exec(program, {})
    measured = re.findall(r": ([\d.]+) evaluations per control step", out.getvalue())
    stated = re.search(r"^\| random, .*? \| ([\d.]+) \| ([\d.]+) \|$", ACCURACY, re.M)
    assert stated.groups() == tuple(measured)
    found = {
        row["arm"]: float(row["evaluations_per_step"])
        for row in rows("policy/physics.csv")
        if row["physics"] == "standard"
    }
    assert re.search(r"^\| a trained policy .*? \| ([\d.]+) \| ([\d.]+) \|$", ACCURACY, re.M).groups() == (
        f"{found['RPRP']:.1f}", f"{found['4R']:.1f}"
    )  # fmt: skip


def test_an_rk8_step_costs_as_many_rk4_steps_on_every_page():
    ratios = []
    for name in ("throughput.csv", "throughput_zen4.csv"):
        cost = {
            (r["arm"], r["integrator"]): float(r["ns_per_step_best"])
            for r in rows(name)
            if not r["tolerance"]
        }
        ratios += [cost[arm, "rk8"] / cost[arm, "rk4"] for arm in ("RPRP", "FourR")]
    cost = {(r["panel"], r["method"]): float(r["ns_best"]) for r in rows("accuracy/accuracy.csv")
            if r["setting"] == "1 x 20 ms"}  # fmt: skip
    smooth = {panel for panel, _ in cost if "impacts" not in panel}
    assert len(smooth) == 3
    ratios += [cost[panel, "rk8"] / cost[panel, "rk4"] for panel in smooth]
    stated = [
        m
        for page in MANUAL
        for m in re.findall(r"rk8 step costs ([\w.]+(?: to [\w.]+)?) rk4 steps", text(page))
    ]
    assert len(stated) == 2
    assert set(stated) == {f"{min(ratios):.1f} to {max(ratios):.1f}"}


def test_speeds_are_those_of_the_tables():
    stated = re.findall(r"^\| ([^|]+) \| ([^|]+) \|[^|]*\|$", SPEED, re.M)
    steps = rows("throughput.csv")
    expected = [
        f"{float(r['ns_per_step_best']):.{1 if float(r['ns_per_step_best']) < 100 else 0}f} ns" for r in steps
    ]
    assert [value for _, value in stated if value.endswith(" ns")] == expected
    columns = ("vector_steps_per_s_best", "vector_one_rk8_step_best", "vector_renewed_actions_best")
    speeds = rows("environments.csv")
    assert [r["env"].rpartition("/")[2] for r in speeds] == ["RPRPReach-v0", "FourRReach-v0"]
    expected = [f"{float(r[c]) / 1e6:.1f} million steps/s" for c in columns for r in speeds]
    assert [value for _, value in stated if value.endswith("steps/s")] == expected
    for row, (what, value) in zip(speeds, [x for x in stated if x[1].endswith("us per step")], strict=True):
        assert value == f"{float(row['single_us_per_step']):.1f} us per step"
        assert f"{float(row['cartpole_us_per_step']):.1f} us" in what
    machines = {
        (r["machine"], r["date"]) for name in ("throughput.csv", "environments.csv") for r in rows(name)
    }
    assert len(machines) == 1
    assert all(word in SPEED for word in machines.pop())


def test_the_default_accuracy_is_what_every_id_has():
    stated = float(re.search(r"for the scenes of all four ids it is (\S+) m", ACCURACY)[1])
    for env_id in SHIPPED:
        scene = gym.make(env_id).unwrapped.core.scene
        assert (scene.integrator, scene.substeps, scene.tolerance) == ("rk8", 1, stated)
    for name, tolerance in ACCURACIES.items():
        assert f'"{name}"' in ACCURACY
        assert f"at most {tolerance:g} m".replace("1e-0", "1e-") in ACCURACY


def test_budgets_are_those_of_the_code():
    budgets = {
        r"(\d+) impacts or more has to give the same result": error_control.CHECKED_IMPACTS,
        r"more than (\d+) impacts": contacts.MOST_IMPACTS,
        r"(\d\d [\d]{3}) pieces of motion": step_control.MOST_TRIALS,
    }
    for pattern, number in budgets.items():
        found = [m for page in MANUAL for m in re.findall(pattern, prose(page))]
        assert found, pattern
        assert {int(m.replace(" ", "")) for m in found} == {int(number)}, pattern


def test_stock_learners_are_described_with_their_own_figures():
    held = {}
    for row in rows("baselines.csv"):
        if found := re.match(r"(four_r|rprp)_reach_plain_(\w+)/", row["run"]):
            arm, learner = found.groups()
            held.setdefault((learner, arm), []).append(float(row["evaluation.hold_success"]))
    page = text(ROOT / "docs" / "learners.md")
    for learner in ("ppo", "sac"):
        four_r, rprp = (100.0 * np.median(held[learner, arm]) for arm in ("four_r", "rprp"))
        sentence = f"stock {learner.upper()} holds {four_r:.1f} % (4R) and {rprp:.1f} % (RPRP)"
        assert sentence in re.sub(r"\s+", " ", page), sentence


@pytest.mark.parametrize("word", ["numba", "no other environment"])
def test_pages_do_not_say_what_is_not_so(word):
    pages = [page for page in PAGES if "decisions" not in page.parts and "results" not in page.parts]
    assert not [page for page in pages if word in text(page)]


def test_the_readme_says_of_the_environments_what_they_are():
    page = text(ROOT / "README.md")
    shown = re.findall(r"^\| <img [^|]*\| `(redundant_envs/\S+)` \| ([^|]+) \| ([^|]+) \|$", page, re.M)
    assert {env_id for env_id, _, _ in shown} == set(SHIPPED)
    for env_id, observation, reward in shown:
        env = gym.make(env_id)
        core, space = env.unwrapped.core, env.observation_space
        assert observation == ("dictionary with goals" if "Goal" in env_id else f"{space.shape[0]} numbers")
        assert reward == ("1 at the goal, else 0" if "Goal" in env_id else "dense, 0 to 1")
        assert f"every {1e3 * core.scene.control_dt:g} ms" in page
        assert f"an episode has {env.spec.max_episode_steps} steps" in page
        task, arm = core.task, core.scene.robot
        assert f"The arms reach {core.reach:g} m, weigh {sum(arm.masses):g} kg" in page
        held = f"within {100 * task.goal_tolerance:g} % of the reach from the goal and slower than "
        assert f"for the last {task.hold_steps} steps the tip was {held}{task.hold_speed:g} reach/s" in page
        assert "The arm has 4 joints for a 2-D tip position, so it is redundant." in env.unwrapped.__doc__
