"""Run folders: made by one command, read in their own scene from anywhere, named if they are damaged."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from unittest.mock import Mock

import imageio.v2 as imageio
import numpy as np
import pytest
import yaml
from run_folders import POLICIES, REFUSALS, RPRP, change, kept, readers, says, write_run, write_scene_file
from short_trainings import SMALL, assert_same_policy, small_config

import redundant_envs as rde
from redundant_envs import __main__ as library
from redundant_envs.compiler.backends import llvm
from redundant_envs_train import play, report, run_folder
from redundant_envs_train.__main__ import main
from redundant_envs_train.config import load
from redundant_envs_train.evidence import curves
from redundant_envs_train.evidence import table as tables
from redundant_envs_train.evidence.runs import read_groups
from redundant_envs_train.report import summary
from redundant_envs_train.rollout import (
    EVALUATION_SEED,
    EpisodeEnds,
    expert_act,
    random_act,
    run_episodes,
)  # fmt: skip
from redundant_envs_train.run_folder import read_evaluation
from redundant_envs_train.training import many
from redundant_envs_train.training.pool import seeds_of, stop_request
from redundant_envs_train.training.train import train
from redundant_envs_train.training.watch import Watch
from studies import stops

pytestmark = pytest.mark.usefixtures("no_drawing")


def data(folder, name="evaluation.json"):
    return json.loads((Path(folder) / name).read_text())


def test_a_run_explains_itself(home, refused):
    folder = home / "run"
    result, facts = data(folder), data(folder, "training.json")
    assert result.keys() == run_folder.Evaluation.model_fields.keys()
    assert (result["episodes"], result["env_steps"], facts["stopped"]) == (5, 1024, False)
    assert sum(facts["split"].values()) == pytest.approx(1.0, abs=0.002)
    for name in ("config.yaml", "scene.yaml", "policy.zip", "monitor.csv", "clip.gif", "report.md"):
        assert (folder / name).stat().st_size > 0
    verdict, *pictures = (folder / "report.md").read_text().split("\n\n")[1:5]
    held = round(5 * result["hold_success"])
    assert verdict.startswith(f"**Verdict.** The policy held {held} of 5 goals (95 % interval ")
    shown = [folder / picture.partition("(")[2][:-1] for picture in pictures]
    assert [path.name for path in shown] == ["learning_curve.png", "evaluation.png", "clip.gif"]
    assert min(path.stat().st_size for path in shown) > 1000
    assert yaml.safe_load((folder / "config.yaml").read_text()) == load(folder / "config.yaml").to_dict()
    refused(["train", "rprp_reach_ppo", "--out", folder], "is not empty")


@pytest.mark.long
def test_a_run_with_a_mode_of_actions_is_compared_with_the_expert_in_efforts(tmp_path):
    modes = {"action": "joint_velocity", "decide_every": 5, "max_episode_steps": 40}
    train(small_config("ppo", env_kwargs=modes), tmp_path)
    found = report.evaluate(tmp_path).result
    plain = run_episodes(RPRP, expert_act(), 5, EVALUATION_SEED, max_episode_steps=40)
    assert found["expert_mean_return"] == plain.returns.mean()
    assert not {"effort", "smoothness"} & found["better"].keys()  # of other units
    assert not run_folder.difference(tmp_path)


@pytest.mark.long
def test_a_policy_is_evaluated_where_the_expert_refuses_the_scene(tmp_path):
    scene = rde.load_scene("rprp_reach").to_dict()
    scene["effects"].append({"type": "MotorLoss", "joint": 1, "at": 0.3})
    name = "redundant_envs/RPRPReachFault-v0"
    train(small_config("ppo", env=name, env_kwargs={"scene": scene, "max_episode_steps": 40}), tmp_path)
    found = report.evaluate(tmp_path).result
    assert (found["hold_success"], found["expert_hold_success"]) == (0.0, None)
    assert "the expert of ReachFault refuses its scene: effects has the faults [MotorLoss(" in summary(found)


@pytest.mark.quick("150")
@pytest.mark.parametrize("decide_every", [1, 5, 150])
def test_clips_keep_time(decide_every, monkeypatch, tmp_path):
    written = []
    monkeypatch.setattr(play, "write_clip", lambda path, frames, rate: written.append(len(frames) / rate))
    play.clip(tmp_path / "clip.gif", RPRP, random_act(0), 1, 0, decide_every=decide_every)
    assert written == [pytest.approx(2.0, rel=0.11)]  # s, of an episode


@pytest.mark.quick("3")
@pytest.mark.parametrize("decide_every", [3, 5])
def test_measures_of_a_motion_do_not_depend_on_how_long_a_decision_lasts(decide_every):
    def measures(decide_every, mode, command):
        act = turned(command, command)
        task = {"goal_tolerance": 0.9, "hold_speed": 10.0}  # some goals are held from a step of the motion on
        kwargs = {"action": mode, "decide_every": decide_every, "task": task}
        found = run_episodes("redundant_envs/FourRReach-v0", act, 40, EVALUATION_SEED, **kwargs)
        assert found.hold.mean() > 0.0
        return found.effort, found.smoothness, found.time_to_hold

    def turned(*commands):
        return lambda obs, core, step: np.full(
            (core.num_envs, len(core.actions)), commands[step % 2], np.float32
        )

    shaken = run_episodes(RPRP, turned(0.1, -0.1), 4, 0, decide_every=decide_every)
    np.testing.assert_allclose(shaken.smoothness, 0.2, rtol=1e-6)
    for mode, command in (("effort", 0.2), ("joint_position", 0.1)):
        one, other = measures(decide_every, mode, command), measures(1, mode, command)
        np.testing.assert_allclose(one, other, rtol=1e-12)
        assert len({*other[2][other[2] > 0.0].tolist()}) > 3


def test_a_verdict_is_about_all_measures_and_what_differs_beyond_chance():
    def ends(hold, shift):
        ones = np.ones(100)
        return EpisodeEnds(
            hold, hold, 0.01 + shift * ones, 80.0 + shift * np.arange(100), ~hold, np.where(hold, 0, 4), ones,
            ones, np.where(hold, 0.5 + shift, np.nan), 0.2 * ones, 0.1 - shift * ones,
        )  # fmt: skip

    found = report.better(ends(np.arange(100) > 0, 0.001), ends(np.arange(100) >= 0, 0.0))
    assert found == {
        "hold_success": None, "touch_success": None, "median_distance": False, "time_to_hold": False,
        "effort": None, "smoothness": True, "mean_return": True,
    }  # fmt: skip
    none = report.better(ends(np.arange(100) < 0, 0.0), ends(np.arange(100) >= 0, 0.0))
    assert "time_to_hold" not in none  # there is no median


@pytest.mark.parametrize(
    ("counts", "words"),
    [
        ({"restless": 1}, "Missed 1 goal: the tip arrived but was still moving."),
        ({"passed": 1, "missed_by_both": 1}, "arrived and left. Computed torque missed 1 of them, too."),
        ({"hold_success": 0.997, "restless": 1, "stopped": 1, "faults": {"SPEED_BOUND": 1}},
         "Missed 3 goals: in 1 the tip arrived but was still moving, in 1 a fault ended the episode "
         "(SPEED_BOUND: 1), in 1 the tip never got there."),
        ({"hold_success": 0.98, "restless": None, "passed": None, "failures": {"the tip left": 18}},
         "Missed 20 goals: in 18 the tip left, in 2 the time ended before."),
        ({"hold_success": 1.0, "expert_hold_success": 1.0},
         "seed 0, held 1000 of 1000 goals (95 % interval 99.4 to 100.0 %). Computed torque held 1000, too."),
        ({"restless": 1, "expert_hold_success": 0.9, "better": {"hold_success": True}},
         "held 900, fewer beyond chance. Missed 1 goal: the tip arrived but was still moving."),
        ({"env": RPRP.replace("Reach", "Track"), "hold_success": 0.0, "expert_hold_success": 0.002,
          "better": {"hold_success": None}, "failures": {"the tip lost the target": 1000}},
         "followed 0 of 1000 targets (95 % interval 99.4 to 100.0 %). The expert of Track followed 2; chance "
         "may explain that. Missed 1000 targets: the tip lost the target."),
    ],
)  # fmt: skip
def test_a_verdict_counts_goals_compares_the_expert_and_says_why_goals_were_missed(counts, words):
    result = {
        "env": RPRP, "algo": "sac", "seed": 0, "episodes": 1000, "hold_success": 0.999,
        "interval": [0.994, 1.0], "restless": 0, "passed": 0, "stopped": 0, "missed_by_both": 0, "faults": {},
        "expert_hold_success": None, "better": {},
    }  # fmt: skip
    assert summary(result | counts).endswith(words)


def test_what_a_task_does_not_tell_is_said_and_neither_compared_nor_drawn(tmp_path, call):
    curve = [(k, 1.0 + k, "nan", "nan", 8.0 * k - 9.0) for k in (1, 2)]
    untold = [name for name in run_folder.Evaluation.model_fields if name.startswith("expert_")]
    facts = dict.fromkeys([*untold, "interval", "hold_success", "touch_success", "median_distance"])
    facts |= {"mean_return": -3.0, "metrics": {"highest": 0.87}, "stopped": 0, "better": {}}
    folder = write_run(tmp_path / "run", curve=curve, settings={"curve_episodes": 5}, **facts)
    told = summary(read_evaluation(folder))
    assert "seed 0, returned -3.0 on average over 1000 episodes. The task" in told
    assert "| highest | 0.87 | - |" in report.table_of(read_evaluation(folder))
    assert "tells no is_success" in told
    assert "It has no goal, which computed torque needs: the policy is compared with nothing." in told
    out, _ = call("table", folder, "--out", tmp_path / "a.jsonl")
    assert "tells no success: the mean return of PPO is -3." in out
    assert curves.known_measures(same := read_groups([tmp_path / "a.jsonl"])) == ["return"]
    assert curves.finding(same) == "return of PPO from -1 to 7"
    change(folder / "evaluation.json", hold_success=0.5)  # an interval belongs to it
    with says("evaluation.json", "interval is None, and hold_success is 0.5"):
        read_evaluation(folder)


def test_resume_of_a_finished_run_recommends_what_works(run, refused, call, monkeypatch):
    monkeypatch.chdir(run)
    write_scene_file(Path(), 0.3)
    error = refused(["resume", "."], "is finished and has no checkpoint")
    (go_on,) = re.findall(r"with: python -m agents (.*)$", error.strip())
    out, _ = call(*go_on.replace("NEW_FOLDER", "more").split())
    assert Path(out.splitlines()[-1]) == Path("more", "report.md")  # as make train promises
    assert data("more", "training.json")["env_steps"] == 1024


def test_a_clip_has_as_many_frames_as_memory_has_room_for(tmp_path, monkeypatch, call):
    monkeypatch.setattr(play, "LARGEST_CLIP", 3 * 480 * 480 * 3 + 1)
    words = ["play", "FourRReach-v0", "--actions", "zero", "--episodes", 9, "--clip", tmp_path / "a.gif"]
    assert "a.gif shows 3 frames alone" in call(*words)[1]
    assert len(imageio.mimread(tmp_path / "a.gif")) == 3


def test_an_evaluation_is_of_the_scene_of_the_run_whatever_became_of_the_file(run, call):
    own = data(run)
    write_scene_file(Path(), 8.0)
    _, err = call("evaluate", run, "--out", "again")
    assert data("again") == own
    assert "scene.yaml differs from the scene 'mine.yaml'" in err
    for name in ("evaluation.json", "episodes.csv", "report.md"):
        (run / name).unlink()
    call("report", run, "--force")  # it evaluates a run that has no evaluation; the pictures are there
    assert data(run) == own
    assert "Simulated in the run's own scene" in (run / "report.md").read_text()
    Path("mine.yaml").rename(run / "scene.yaml")  # the test can fail: friction changes the evaluation
    call("evaluate", run, "--out", "other")
    assert data("other")["expert_mean_return"] != own["expert_mean_return"]


def test_many_seeds_do_not_go_on_in_another_scene_or_with_other_settings(run, refused):
    shutil.copytree(run, "many/seed0")
    words = ["train", "rprp_reach_ppo", *SMALL, "env_kwargs.scene=mine.yaml", "--seeds", 0, "--out", "many"]
    write_scene_file(Path(), 8.0)
    refused(words, "many/seed0 holds another run (many/seed0/scene.yaml differs")
    refused([*words, "ppo.gamma=0.5"], "many/seed0 holds another run (of another configuration")


@pytest.mark.long
@pytest.mark.parametrize("exported", [False, True])
def test_reading_changes_nothing(exported, run, tmp_path, monkeypatch, call, refused):
    """Neither in a run, whose scene file has changed, nor in an exported policy, which has no results."""
    monkeypatch.setattr(stops, "DRAWS", 1)
    if exported:
        run = Path(shutil.copytree(POLICIES / "RPRPReach-v0-ppo", tmp_path / "shipped"))
        change(run / "config.yaml", evaluation_episodes=20, env_kwargs={"max_episode_steps": 20})
        refused(["report", run], "is an exported policy; give --out FOLDER")
    else:
        write_scene_file(Path(), 8.0)
    before = kept(run)
    for name, words in readers(run, tmp_path).items():
        if exported and name in {"export", "table", "table out", "curves"}:
            refused(words, "is an exported policy")
        elif exported or name not in {"export", "stops"}:  # of registered environments
            _, error = call(*words)
            assert exported or name == "report" or "scene.yaml differs from the scene 'mine.yaml'" in error
        assert kept(run) == before, name
    assert ("![learning_curve]" in (tmp_path / "b" / "report.md").read_text()) == (not exported)


def test_what_is_there_is_replaced_only_when_asked(run, call, refused):
    before = kept(run)
    for words in (["report", run], ["evaluate", run, "--out", run], ["report", run, "--out", run]):
        refused(words, "--force")
    assert kept(run) == before
    for command in ("evaluate", "report"):
        call(command, run, "--force")
    after = kept(run)
    changed = {path.name for path in after if after[path][1] != before[path][1] and path.is_file()}
    assert {"evaluation.json", "episodes.csv", "report.md", "clip.gif"} <= changed
    assert not changed & {"policy.zip", "config.yaml", "scene.yaml", "training.json", "selection.csv"}
    for name in ("evaluation.json", "episodes.csv"):
        assert after[run / name][0] == before[run / name][0]  # to the same numbers


def test_a_stopped_training_is_a_run_and_goes_on_in_its_own_scene(home, tmp_path, monkeypatch, call, refused):
    monkeypatch.chdir(tmp_path)
    write_scene_file(tmp_path, 0.3)
    points, point, folder, whole = [], Watch.point, Path("run"), home / "run"

    def stop_at_first(self):
        points.append(self.num_timesteps)
        write_scene_file(tmp_path, 8.0)  # while it runs
        if len(points) == 1:
            signal.raise_signal(signal.SIGTERM)
        return point(self)

    monkeypatch.setattr(Watch, "point", stop_at_first)
    words = ["train", "rprp_reach_ppo", *SMALL, "env_kwargs.scene=mine.yaml", "--out", folder]
    _, message = call(*words, status=130)
    assert "stopped after" in message
    assert f"Go on with: python -m agents resume {folder}" in message
    assert data(folder, "training.json")["stopped"] is True
    assert not list(folder.glob("*.part"))
    (tmp_path / "mine.yaml").unlink()
    call("report", folder)  # of the policy so far
    told = (folder / "report.md").read_text()
    assert "Its training was stopped after 0.000" in told.split("\n\n")[1]
    assert data(folder)["env_steps"] == data(folder, "training.json")["env_steps"] > 0
    refused(["table", folder], "was stopped")  # half a training is no result
    call("resume", folder)
    assert_same_policy(folder, whole)
    again, own = data(folder), data(whole)
    assert (again["hold_success"], again["mean_return"]) == (own["hold_success"], own["mean_return"])


@pytest.mark.parametrize("name", [n for n in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, n)])
def test_a_second_request_interrupts_at_once(name, interrupts):
    with stop_request() as stop:
        signal.raise_signal(getattr(signal, name))
        assert stop.is_set()
        with pytest.raises(KeyboardInterrupt):
            interrupts()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


CLOSED = """
import fcntl, sys, termios, time
from redundant_envs_train.training.pool import stop_request
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
with stop_request() as stop:
    print("begun", flush=True)
    while not stop.is_set():
        time.sleep(0.01)
    print("saves", flush=True)
    sys.exit(7)
"""


@pytest.mark.skipif(os.name == "nt", reason="Windows sends no signal when a terminal is closed")
def test_a_closed_terminal_is_a_request_and_what_is_written_there_no_error():
    ours, theirs = os.openpty()
    streams = dict.fromkeys(("stdin", "stdout", "stderr"), theirs)
    child = subprocess.Popen([sys.executable, "-c", CLOSED], start_new_session=True, **streams)
    os.close(theirs)
    assert os.read(ours, 5) == b"begun"
    os.close(ours)
    assert child.wait(60) == 7


def test_ctrl_c_elsewhere_is_one_line(monkeypatch, capsys):
    interrupted = Mock(side_effect=KeyboardInterrupt)
    monkeypatch.setattr(tables, "results_table", interrupted)
    assert main(["table", "anything"]) == 130
    monkeypatch.setattr(library, "list_names", interrupted)
    assert library.main(["list"]) == 130
    assert capsys.readouterr().err.split() == ["stopped", "stopped"]


@pytest.mark.parametrize("case", REFUSALS["damages"], ids=lambda case: f"{case['file']} {case['is'][:30]}")
def test_a_missing_or_damaged_file_is_named_with_the_command_that_makes_it(case, run, tmp_path, refused):
    path = run / case["file"]
    content = path.read_bytes()
    if case["is"] == "missing":
        path.unlink()
    elif case["is"] == "cut":
        path.write_bytes(content[: content.rindex(b",") if path.suffix == ".csv" else len(content) // 2 - 1])
    else:
        path.write_text(case["is"] * case.get("times", 1))
    for command in case["readers"]:
        refused(readers(run, tmp_path)[command], path.name, case["says"])


VALUES = [(field, value) for field, values in REFUSALS["evaluation"].items() for value in values]


@pytest.mark.parametrize(("field", "value"), VALUES)
def test_a_value_that_no_evaluation_has_is_refused_by_file_and_field(field, value, tmp_path):
    folder = write_run(tmp_path / "run")
    change(folder / "evaluation.json", **{field: value})
    with says(f"{folder}/evaluation.json is damaged", field, "make it again"):
        read_evaluation(folder)


def test_a_place_for_results_that_cannot_be_is_told_before_anything_begins(tmp_path, refused):
    (tmp_path / "file").write_text("mine")
    (tmp_path / "link").symlink_to("nowhere")
    for out, word in (
        (tmp_path / "file", "is a file"), (tmp_path / "file" / "x", "is below the file"),
        (tmp_path / "link", "is a broken link"), (tmp_path / "link" / "x", "is below the broken link"),
    ):  # fmt: skip
        for seeds in ([], ["--seeds", "0..1"]):
            refused(["train", "rprp_reach_ppo", *seeds, "--out", out], f"error: out is {out}, which {word}")
    assert (tmp_path / "file").read_text() == "mine"


def test_a_command_can_be_pasted_although_its_folder_has_a_space(tmp_path, refused):
    folder = write_run(tmp_path / "my run")
    (folder / "evaluation.json").unlink()
    refused(["table", folder], f"python -m agents evaluate '{folder}' --force")


@pytest.mark.parametrize("case", REFUSALS["seeds"], ids=lambda case: case["given"])
def test_seeds_are_read_as_they_are_written(case):
    if "read" in case:
        assert seeds_of(case["given"]) == case["read"]
    else:
        with says("seeds is"):
            seeds_of(case["given"])


WAITS = """
import pathlib, time
from redundant_envs_train import report
from redundant_envs_train.training.watch import Watch

plain, begun = Watch._on_step, pathlib.Path("begun")

def on_step(self):
    if self.config.seed == 4 and self.num_timesteps == 512 and not begun.exists():
        begun.touch()
        while not self.stop.is_set():
            time.sleep(0.01)
            self._show()
    return plain(self)

Watch._on_step = on_step
report.clip, report.draw_curves = (lambda *given, **more: None), (lambda *given: None)
"""
"""A module of workers: reports have no pictures, and seed 4 goes on only after a request to stop."""


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGINT for one process")
def test_seeds_in_a_process_are_stopped_in_order_and_go_on_to_the_runs_they_are_alone(
    tmp_path, monkeypatch, call, refused, interrupts
):
    monkeypatch.setattr(llvm, "EFFORT", 3)  # that of processes that are no test: a checkpoint has its code
    monkeypatch.chdir(tmp_path)
    Path("waits.py").write_text(WAITS)
    words = ["train", "rprp_reach_ppo", *SMALL, "--out", "runs", "--processes"]
    four, five, six = (Path("runs") / f"seed{seed}" for seed in (4, 5, 6))

    def interrupt():
        end = time.monotonic() + 120.0
        while not Path("begun").is_file() and time.monotonic() < end:
            time.sleep(0.05)
        interrupts()

    monkeypatch.setattr(many, "IMPORTED", ["waits"])
    user = threading.Thread(target=interrupt)
    user.start()
    _, error = call(*words, 1, "--seeds", "5,4", status=130)
    user.join()
    assert error.splitlines()[-1] == "stopped; the same command with the same --out goes on"
    assert [data(folder, "training.json")["stopped"] for folder in (four, five)] == [True, False]
    before = kept(five)
    six.mkdir()
    (six / "mine").touch()
    refused([*words, 2, "--seeds", "4..6"], "1 of 3 runs failed; the same command goes on: seed6: run folder")
    assert kept(five) == before  # it is finished, and stays
    train(load("rprp_reach_ppo", [*SMALL, "seed=4"]), Path("alone"))
    assert_same_policy(Path("alone"), four)
    (five / "report.md").unlink()  # and no more is missing
    change(four / "training.json", stopped=True, env_steps=5)  # without a checkpoint: it begins anew
    assert "| RPRPReach-v0 | PPO | 2 |" in call(*words, 2, "--seeds", "4,5")[0]
    assert (five / "report.md").is_file()
    assert data(four, "training.json")["env_steps"] == 1024
