"""Numbers and tables on pages agree with each other, with the code and with the measurements."""

import contextlib
import io
import re
import shlex

import gymnasium as gym
import numpy as np
import pytest
from catalogue import IDS
from markdown import MANUAL, README, RESULTS, ROOT, blocks, prose, rows, text

from redundant_envs.events import contacts
from redundant_envs.lane import step_control
from redundant_envs.numerics import error_control
from redundant_envs.scene import ACCURACIES
from redundant_envs_train.config import WITHOUT_EFFECT
from redundant_envs_train.evidence.runs import read_groups, read_runs
from redundant_envs_train.evidence.table import brief_table, table
from redundant_envs_train.run_folder import read_config, read_scene
from redundant_envs_train.studies import strength as strength_run
from redundant_envs_train.studies.strength import ARMS, FACTORS, learner_rows, read_rows


def page(name):
    return text(ROOT / "docs" / f"{name}.md")


def test_evaluations_of_a_control_step_are_those_that_the_page_measures():
    ((*_, program),) = blocks(ROOT / "docs" / "accuracy.md", "python")
    with contextlib.redirect_stdout(io.StringIO()) as out:
        exec(program, {})
    measured = re.findall(r": ([\d.]+) evaluations per control step", out.getvalue())
    learned = {r["arm"]: r for r in rows("policy/physics.csv") if r["physics"] == "standard"}
    trained = [f"{float(learned[arm]['evaluations_per_step']):.1f}" for arm in ("RPRP", "4R")]
    for start, expected in (("random, ", measured), ("a trained policy ", trained)):
        stated = re.search(rf"^\| {start}.*? \| ([\d.]+) \| ([\d.]+) \|$", page("accuracy"), re.M)
        assert [*stated.groups()] == expected


def test_speeds_are_those_of_the_tables():
    stated = re.findall(r"^\| ([^|]+) \| ([^|]+) \|[^|]*\|$", page("speed"), re.M)
    steps, speeds = rows("throughput.csv"), rows("environments.csv")
    times = [float(r["ns_per_step_best"]) for r in steps if r["arm"] in ("RPRP", "FourR")]
    assert [v for _, v in stated if v.endswith(" ns")] == [f"{t:.{1 if t < 100 else 0}f} ns" for t in times]
    columns = ("vector_steps_per_s_best", "vector_one_rk8_step_best", "vector_renewed_actions_best")
    assert [r["env"].rpartition("/")[2] for r in speeds] == ["RPRPReach-v0", "FourRReach-v0"]
    expected = [f"{float(r[c]) / 1e6:.1f} million steps/s" for c in columns for r in speeds]
    assert [value for _, value in stated if value.endswith("steps/s")] == expected
    for row, (what, value) in zip(speeds, [x for x in stated if x[1].endswith("us per step")], strict=True):
        assert value == f"{float(row['single_us_per_step']):.1f} us per step"
        assert f"{float(row['cartpole_us_per_step']):.1f} us" in what
    (machine,) = {(r["machine"], r["date"]) for r in (*steps, *speeds)}
    assert all(word in page("speed") for word in machine)


def test_figures_of_derived_equations_are_those_of_the_study():
    measured = {
        row["arm"]: row
        for row in rows("throughput.csv")
        if row["integrator"] == "rk8" and not row["tolerance"]
    }
    said = re.findall(r"^\| `(.+?)` \| .+? \| (\d+) \| ([\d.]+) s \|$", page("extending"), re.M)
    assert len(said) == len(measured) == 4
    for arm, nanoseconds, seconds in said:
        row = measured[re.sub(r'\("(\w+)"\)', r" \1", arm)]
        assert int(nanoseconds) == round(float(row["ns_per_step_best"]))
        assert seconds == row["compile_seconds"]


def test_what_an_episode_has_drawn_is_what_the_page_says():
    told = re.search(r"^print\(info.*# what this episode has drawn: (.*)$", page("scenes"), re.M)[1]
    (program,) = (b for *_, b in blocks(ROOT / "docs" / "scenes.md", "python") if told in b)
    with contextlib.redirect_stdout(io.StringIO()) as out:
        exec(program, {})
    said, drawn = (re.findall(r"\d+\.\d+", text) for text in (told, out.getvalue()))
    assert len(said) == 2
    assert [number[: len(x)] for number, x in zip(drawn, said, strict=False)] == said


@pytest.mark.long
def test_the_default_accuracy_is_what_every_id_has():
    stated = float(re.search(r"for the scenes of all four ids it is (\S+) m", page("accuracy"))[1])
    for env_id in IDS:
        scene = gym.make(env_id).unwrapped.core.scene
        assert (scene.integrator, scene.substeps, scene.tolerance) == ("rk8", 1, stated)
    for name, tolerance in ACCURACIES.items():
        assert f'"{name}"' in page("accuracy")
        assert f"at most {tolerance:g} m".replace("1e-0", "1e-") in page("accuracy")


def test_budgets_are_those_of_the_code():
    for pattern, number in (
        (r"(\d+) impacts or more has to give the same result", error_control.CHECKED_IMPACTS),
        (r"more than (\d+) impacts", contacts.MOST_IMPACTS),
        (r"(\d\d [\d]{3}) pieces of motion", step_control.MOST_TRIALS),
    ):
        found = {m.replace(" ", "") for one in MANUAL for m in re.findall(pattern, prose(one))}
        assert found == {str(int(number))}


def test_stock_learners_are_described_with_their_own_figures():
    held = {}
    for run in read_runs([RESULTS / "baselines.jsonl" / "*_reach_plain_*"]):
        if found := re.match(r"(four_r|rprp)_reach_plain_(\w+)", run.folder.parent.name):
            held.setdefault(found.groups(), []).append(run.evaluation["hold_success"])
    for learner in ("ppo", "sac"):
        four_r, rprp = (100.0 * np.median(held[arm, learner]) for arm in ("four_r", "rprp"))
        sentence = f"stock {learner.upper()} holds {four_r:.1f} % (4R) and {rprp:.1f} % (RPRP)"
        assert sentence in re.sub(r"\s+", " ", page("learners")), sentence


def test_the_readme_says_of_the_environments_what_they_are():
    said = text(README)
    shown = re.findall(r"^\| <img [^|]*\| `(redundant_envs/\S+)` \| ([^|]+) \| ([^|]+) \|$", said, re.M)
    assert {env_id for env_id, _, _ in shown} == set(IDS)
    for env_id, observation, reward in shown:
        env = gym.make(env_id)
        core, space = env.unwrapped.core, env.observation_space
        task, arm = core.task, core.scene.robot
        assert observation == ("dictionary with goals" if "Goal" in env_id else f"{space.shape[0]} numbers")
        assert reward == ("1 at the goal, else 0" if "Goal" in env_id else "dense, 0 to 1")
        held = f"within {100 * task.goal_tolerance:g} % of the reach from the goal and slower than "
        for sentence in (
            f"every {1e3 * core.scene.control_dt:g} ms",
            f"an episode has {env.spec.max_episode_steps} steps",
            f"The arms reach {core.reach:g} m, weigh {sum(arm.masses):g} kg",
            f"for the last {task.hold_steps} steps the tip was {held}{task.hold_speed:g} reach/s",
        ):
            assert sentence in said
        assert "The arm has 4 joints for a 2-D tip position, so it is redundant." in env.unwrapped.__doc__


def test_what_an_error_costs_is_what_the_study_wrote():
    lines = page("accuracy").splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("| arm | 99 %"))
    copied = lines[start : lines.index("", start)]
    assert len(copied) >= 10
    written = text(RESULTS / "accuracy" / "accuracy.md")
    assert [row for row in copied if row not in written] == []


def test_what_error_control_costs_where_one_step_is_enough_is_what_the_study_wrote():
    ours = [r for r in rows("accuracy/accuracy.csv") if r["method"].startswith("rk8")]
    found = {(r["panel"], r["setting"]): float(r["ns_best"]) for r in ours}
    smooth = {panel for panel, _ in found if "impacts" not in panel}
    ratios = [found[panel, "tolerance 0.1 mm"] / found[panel, "1 x 20 ms"] for panel in smooth]
    assert f"costs {100 * min(ratios) - 100:.0f} to {100 * max(ratios) - 100:.0f} per cent" in page(
        "accuracy"
    )


def test_the_tables_of_learners_are_made_from_the_tables_of_runs():
    for name, source in (("learners", "runs"), ("learners", "baselines"), ("strength", "weak")):
        made = [line for line in table([RESULTS / f"{source}.jsonl"]).splitlines() if line.startswith("| ")]
        assert len(made) >= 8
        assert [row for row in made if row not in page(name)] == []


def test_the_results_of_the_readme_are_those_of_the_table_of_runs():
    brief = brief_table([RESULTS / "runs.jsonl"])
    assert brief.count("\n") >= 7
    again = "the table of results is not that of docs/results/runs.jsonl; run python docs/figures/remake.py"
    assert f"-->\n{brief}\n<!--" in text(README), again


def test_later_seeds_are_those_of_their_table_and_hold_as_many_goals():
    assert brief_table([RESULTS / "runs_200.jsonl"]) in page("learners")
    held = {}
    for run in read_runs([RESULTS / "runs_200.jsonl"]):
        held.setdefault(run.folder.parent.name, {})[run.seed] = run.evaluation["hold_success"]
    assert len(held) == 6
    for preset, found in held.items():
        assert sorted(found) == list(range(200, 210))
        worst, median = (0.98, 0.993) if preset.endswith("her") else (0.99, 0.997)
        assert min(found.values()) >= worst
        assert np.median(list(found.values())) >= median


def test_the_table_of_strengths_is_what_the_study_wrote():
    found = read_rows(RESULTS / "strength" / "strength.csv")
    assert {(row.arm, row.factor) for row in found} >= {(a, f) for a in ARMS for f in FACTORS}
    assert strength_run.table(found) in page("strength")
    (command,) = re.findall("^python -m agents study strength --seeds none --runs .*", page("strength"), re.M)
    kept = [ROOT / place for place in shlex.split(command) if "docs/results" in place]
    assert sorted(map(str, learner_rows(kept))) == sorted(str(row) for row in found if row.seeds)


ABLATIONS = {
    "": "all parts",
    ".average=0": "without the average",
    ".smoothness=0": "without the smoothness term",
    ".policy_delay=1": "with an actor step for every critic step (`sac.policy_delay=1`)",
    ".activation=tanh": "with tanh instead of SiLU",
}


def test_the_ablations_are_those_of_the_table_of_runs():
    for setting, name in ABLATIONS.items():
        cells = []
        for arm in ("four_r", "rprp"):
            (run,) = read_runs([RESULTS / "ablations.jsonl" / f"{arm}_sac{setting}" / "seed0"])
            missed = round((1 - run.evaluation["hold_success"]) * run.evaluation["episodes"])
            restless = f"{run.evaluation['restless']} of {missed}" if missed else "-"
            cells += [f"{100 * run.evaluation['hold_success']:.1f} %", restless]
        assert f"| {name} | {' | '.join(cells)} |" in page("learners")


@pytest.mark.parametrize(("name", "runs", "policies"), [("ablations", 10, 10), ("strength/runs", 34, 18)])
def test_a_row_of_a_study_has_the_policy_of_its_lowest_seed(name, runs, policies):
    groups = read_groups([RESULTS / f"{name}.jsonl"])
    assert sum(len(same.runs) for same in groups) == runs
    first = [same.runs[0] for same in groups if len(same.runs) < 10]  # PPO of full strength has none
    lowest = {RESULTS / name / run.folder.relative_to(RESULTS / f"{name}.jsonl"): run for run in first}
    assert {path.parent for path in (RESULTS / name).rglob("policy.zip")} == lowest.keys()
    assert len(lowest) == policies
    for folder, run in lowest.items():
        config = {k: v for k, v in read_config(folder).to_dict().items() if k not in WITHOUT_EFFECT}
        assert config == {**run.settings, "seed": run.seed}
        assert read_scene(folder).to_dict() == run.scene


def test_results_stay_small():
    sizes = [path.stat().st_size for path in RESULTS.rglob("*") if path.is_file()]
    assert (len(sizes) <= 150, sum(sizes) <= 6_000_000) == (True, True)
