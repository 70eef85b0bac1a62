"""Tables of pages are those that programs wrote or that the code has now."""

import itertools
import re
import runpy
import shlex

import pytest
import yaml
from catalogue import IDS
from markdown import README, ROOT, blocks, text
from published_runs import RESULTS, rows

from redundant_envs.envs.registration import id_of
from redundant_envs.scenes.scene import ACCURACIES
from redundant_envs.tasks import REGISTRY as TASKS
from redundant_envs_train.evidence.runs import read_runs
from redundant_envs_train.evidence.table import results_table
from studies import results
from studies import strength as strength_run
from studies.environments import tasks_table
from studies.ilqr import ilqr_table
from studies.modes import modes_table
from studies.poses import poses_table
from studies.redundancy import redundancy_table
from studies.strength import learner_rows, read_rows


def page(name):
    return text(ROOT / "docs" / f"{name}.md")


def test_evaluations_of_a_control_step_are_those_that_the_page_measures(capsys):
    ((*_, program),) = blocks(ROOT / "docs" / "accuracy.md", "python")
    exec(program, {})
    measured = re.findall(r": ([\d.]+) evaluations per control step", capsys.readouterr().out)
    learned = {r["arm"]: r for r in rows(RESULTS / "policy" / "physics.csv") if r["physics"] == "standard"}
    trained = [f"{float(learned[arm]['evaluations_per_step']):.1f}" for arm in ("RPRP", "4R")]
    for start, expected in (("random, ", measured), ("a trained policy ", trained)):
        stated = re.search(rf"^\| {start}.*? \| ([\d.]+) \| ([\d.]+) \|$", page("accuracy"), re.M)
        assert [*stated.groups()] == expected


def test_speeds_are_those_of_the_tables():
    stated = re.findall(r"^\| ([^|]+) \| ([^|]+) \|[^|]*\|$", page("speed"), re.M)
    steps, speeds = (rows(RESULTS / f"{name}.csv") for name in ("throughput", "environments"))
    times = [float(r["ns_per_step_best"]) for r in steps if r["arm"] in ("RPRP", "FourR")]
    assert [v for _, v in stated if v.endswith(" ns")] == [f"{t:.{1 if t < 100 else 0}f} ns" for t in times]
    columns = ("vector_steps_per_s_best", "vector_one_rk8_step_best", "vector_renewed_actions_best")
    expected = [f"{float(r[c]) / 1e6:.1f} million steps/s" for c in columns for r in speeds]
    assert [value for _, value in stated if value.endswith("steps/s")] == expected
    for row, (what, value) in zip(speeds, [x for x in stated if x[1].endswith("us per step")], strict=True):
        assert value == f"{float(row['single_us_per_step']):.1f} us per step"
        assert f"{float(row['cartpole_us_per_step']):.1f} us" in what


def test_the_speeds_of_tasks_are_those_that_the_study_wrote():
    assert tasks_table(rows(RESULTS / "task_speeds.csv")) in page("speed")


def test_the_accuracies_and_the_environments_are_those_of_the_code():
    stated = dict(re.findall(r'^\| `"(\w+)"` \| (\S+) m \|$', page("accuracy"), re.M))
    assert {name: float(tolerance) for name, tolerance in stated.items()} == ACCURACIES
    listed = re.findall(r"^\| ((?:`\w+`,? )+)\| [^|]+ \| ([\d, ]+) \|$", text(README), re.M)
    steps = {
        name: int(length)
        for names, lengths in listed
        for name, length in zip(re.findall(r"\w+", names), lengths.split(", "), strict=True)
    }
    assert {id_of(arm, task) for arm in ("RPRP", "FourR", "TwoR") for task in steps} == set(IDS)
    assert steps == {task: TASKS[task].steps for task in steps}


def test_what_an_error_costs_is_what_the_study_wrote():
    copied = page("accuracy").partition("\n| arm | 99 %")[2].partition("\n\n")[0].splitlines()[2:]
    assert len(copied) >= 8
    written = text(RESULTS / "accuracy" / "accuracy.md")
    assert [row for row in copied if row not in written] == []


@pytest.mark.parametrize(("name", "source"), [("learners", "runs"), ("strength", "weak")])
def test_the_tables_of_learners_are_made_from_the_tables_of_runs(name, source):
    table = results_table([RESULTS / f"{source}.jsonl"])
    made = [line for line in table.splitlines() if line.startswith("| ")]
    assert len(made) >= 8
    assert [row for row in made if row not in page(name)] == []
    remake = runpy.run_path(str(ROOT / "docs" / "figures" / "remake.py"))
    assert remake["brief_table"]([RESULTS / "redundancy_runs.jsonl"]) in page("redundancy")
    assert remake["brief_table"]([RESULTS / "baselines.jsonl"]) in page("learners")
    assert remake["readme_table"]() in text(README)


@pytest.mark.parametrize("name", ["learners", "redundancy", "strength", "action_modes", "README"])
def test_the_intervals_of_all_tables_are_on_the_page_of_results_that_pages_name(name):
    assert "results/README.md" in (text(README) if name == "README" else page(name))
    if name == "README":
        assert results.page() == page("results/README"), "run python -m studies.results"


def test_a_rate_has_the_interval_of_its_goals_and_is_below_100_percent_unless_all_are_held():
    assert results.cell(0.5, 1000) == "50.0 % [46.9 to 53.1]"
    assert results.cell(0.9995, 1000).startswith("99.9 % [")
    assert results.cell(1.0, 20) == "100.0 % [83.9 to 100.0]"


def test_the_table_of_strengths_is_what_the_study_wrote():
    found = read_rows(RESULTS / "strength" / "strength.csv")
    assert strength_run.strength_table(found) in page("strength")
    (command,) = re.findall("^python -m studies strength --seeds none --runs .*", page("strength"), re.M)
    kept = [ROOT / place for place in shlex.split(command) if "docs/results" in place]
    assert sorted(map(str, learner_rows(kept))) == sorted(str(row) for row in found if row.seeds)


def test_the_table_of_experts_is_what_the_study_wrote():
    assert redundancy_table(rows(RESULTS / "redundancy.csv")) in page("redundancy")


def test_the_table_of_what_was_tried_is_what_the_study_of_poses_wrote():
    assert poses_table(rows(RESULTS / "tried.csv")) in page("results/tried")


def test_the_table_of_modes_is_what_the_study_wrote():
    assert modes_table(rows(RESULTS / "modes.csv")) in page("action_modes")


def test_what_modes_cost_a_learner_is_in_the_tables_of_runs():
    for mode in ("effort", "joint_velocity", "joint_position", "tip_velocity", "tip_and_posture"):
        cells = []
        for learner, seed in (("ppo", 320), ("sac", 310)):
            place = RESULTS / "mode_runs.jsonl" / f"modes_{learner}" / mode / f"seed{seed}"
            if (learner, mode) == ("ppo", "effort"):
                place = RESULTS / "redundancy_runs.jsonl" / "four_r_reach_around_ppo" / f"seed{seed}"
            (run,) = read_runs([place])
            assert run.settings["env_kwargs"].get("action", "effort") == mode
            touched = run.evaluation["failures"].get("a link touched an obstacle", 0)
            cells += [f"{100 * run.evaluation['hold_success']:.1f} %", str(touched)]
        assert f'| `"{mode}"` | {" | ".join(cells)} |' in page("action_modes")


def test_the_table_of_ilqr_is_what_the_study_wrote():
    assert ilqr_table(rows(RESULTS / "ilqr.csv")) in page("strength")


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


def test_the_sentences_of_claims_are_on_their_pages():
    claims = runpy.run_path(str(ROOT / "docs" / "claims.py"))
    for claim in itertools.chain(*yaml.safe_load(text(ROOT / "docs" / "claims.yaml")).values()):
        assert claims["stated"](claim)
