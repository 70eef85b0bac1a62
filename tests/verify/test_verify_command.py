"""verify: the words that name subjects, the table, the files, and the exit status."""

import json
import math
import sys

import numpy as np
import pytest
import yaml
from catalogue import FOUR_R, IDS

import redundant_envs as rde
from redundant_envs.__main__ import main
from redundant_envs.envs import registration
from redundant_envs.scenes.scene import scene_names
from redundant_envs.support.extras import MissingPackage
from redundant_envs.verify import Mode, Subject, promises, report, subject_from, verify
from redundant_envs.verify.accuracy import CONFIRMED, LIMIT, judge
from redundant_envs.verify.checks import Check
from redundant_envs.verify.promises import EQUAL_BITS, Finding, at_most
from redundant_envs.verify.subjects import LENGTHS, MASSES, subject_of, subjects_of

e = rde.effects

MODULE = """
from dataclasses import dataclass
import redundant_envs as rde

arm = rde.RPRP((1.0, 2.0, 3.0, 4.0), (0.5, 0.6))
scene = rde.Scene(arm, (), "rk4", 0.01)
friction = rde.effects.ViscousFriction(0.3)
stop = rde.effects.PrismaticStop((0.0, 0.0), (0.2, 0.2), 0.5)
task = rde.ReachTask(start_angle=1.0)
number = 3

@dataclass(frozen=True)
class Needy(rde.effects.Effect):
    strength: float

class Home:
    arm = arm
"""


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """A module of a user in the present folder, and a file of a scene."""
    (tmp_path / "verify_me.py").write_text(MODULE, encoding="utf-8")
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(rde.load_scene("rprp_stops").to_dict()))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield
    sys.modules.pop("verify_me", None)


def effects_of(subject):
    return [type(x).__name__ for x in subject.scene.effects]


def test_words_name_scenes_arms_environments_tasks_and_effects():
    assert [s.name for s in subjects_of([])] == scene_names()
    assert subject_of("FourR").scene.robot == rde.FourR(MASSES, LENGTHS)  # all numbers differ
    assert effects_of(subject_of("FourR")) == effects_of(subject_of("Gravity")) == ["Gravity"]
    for word in IDS:
        for name in (word, word.partition("/")[2]):
            assert subject_of(name).env_id == word
    assert subject_of("GoalReach").env_id == "redundant_envs/RPRPGoalReach-v0"


def test_a_task_is_verified_with_an_arm_that_has_a_scene_for_it(monkeypatch):
    monkeypatch.setitem(registration.PAIR_SCENES, ("the task", "Reach"), {"TwoR": "two_r_reach"})
    assert subject_from("mine", rde.ReachTask).env_id == "redundant_envs/TwoRReach-v0"


def test_objects_of_programs_modules_and_files_are_subjects(mine):
    effect = subject_from("mine", e.LimitSpring("joint3", -1.0, 1.0))
    assert (effect.name, effect.scene.robot.kind) == ("mine", "FourR")
    subject = subject_of("mine.yaml")
    assert subject == Subject("mine.yaml", rde.load_scene("rprp_stops"))
    assert subject_from("other", subject) is subject
    arm, scene, friction, stop, task, inner = subjects_of(
        [f"verify_me:{n}" for n in ("arm", "scene", "friction", "stop", "task", "Home.arm")]
    )
    assert arm.scene.robot.masses == inner.scene.robot.masses == (1.0, 2.0, 3.0, 4.0)
    assert scene.scene.integrator == "rk4"
    assert effects_of(friction) == ["Gravity", "ViscousFriction"]
    assert stop.scene.robot.kind == "RPRP"
    assert task.task["start_angle"] == 1.0


class Never(e.Effect):
    def hooks(self, arm):
        raise ValueError("never")


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("nowhere", "'nowhere' is nothing that verify knows; give a scene .*four_r_free.*module:object"),
        ("nowhere.yaml", "there is no such file"),
        ("ViscousFriction", "has no default of coefficients; name one that has its numbers"),
        ("no_module:arm", "No module named 'no_module'"),
        ("verify_me:nothing", "has no 'nothing'; verify takes .*arm, scene, friction"),
        ("verify_me:number", "verify_me:number is 3; verify takes an arm, a scene"),
        (Never(), "Never fits no arm; RPRP: never"),
    ],
)
def test_what_names_nothing_that_can_be_verified_is_refused_with_what_is_allowed(word, said, mine):
    with pytest.raises(ValueError, match=said):
        subject_of(word) if isinstance(word, str) else subject_from("Never", word)


def test_what_is_no_number_keeps_no_promise():
    for promise, kept in ((at_most(1.0), 1.0), (promises.at_least(1.0), 2.0), (EQUAL_BITS, 0.0)):
        assert promise.holds(kept)
        assert not promise.holds(math.nan)
    assert not EQUAL_BITS.holds(1.0)


def test_a_miss_is_judged_by_references_that_agree_in_lanes_without_a_flag():
    off = LIMIT * np.array([0.9, 1.1, 1.1, np.nan, 1.1, 1.1])  # of the tolerance
    other = CONFIRMED * np.array([0.9, 0.9, 1.1, 0.9, np.nan, 0.9])
    tips, *references = (np.outer(1e-6 * x, [1.0, 0.0]) for x in (off, 0.0 * np.ones(6), other))
    judged, missed, error = judge(tips, references, 1e-6, np.arange(6) < 5)
    assert judged.tolist() == [True, True, False, True, False, False]
    assert missed.tolist() == [False, True, False, True, False, False]
    np.testing.assert_allclose(error[:3], off[:3])


METRE = at_most(1.0, "m")


def checks(*measures):
    return tuple(Check(f"check {k}", "tests", METRE, Mode.QUICK, m) for k, m in enumerate(measures))


def raising(error):
    def measure(trial):
        raise error

    return measure


FOUND = {
    "kept": lambda trial: Finding(0.5, "state 1"),
    "missed": lambda trial: Finding(2.0, "state 2", "too much"),
    "not applicable": raising(promises.NotApplicable("there is none")),
    "missing package": raising(MissingPackage("mujoco is not installed")),
    "error": raising(ValueError("not to be had")),
    "mistake": raising(TypeError("not callable")),
}
MEASURED = Check("measured", "tests", promises.nothing("m"), Mode.QUICK, lambda _: Finding(9.0, "", "look"))


def test_reasons_and_errors_stand_in_the_table():
    found = verify(FOUR_R, 4, checks=(*checks(*FOUND.values()), MEASURED))
    verdicts = [o.verdict.value for o in found.outcomes]
    told = ["kept", "MISSED", "not applicable", "not applicable", "MISSED", "MISSED", "measured"]
    assert verdicts == told
    assert "look" in report.notes(found.outcomes)
    assert found.misses == (
        "check 1: too much",
        "check 4: it could not be measured: not to be had",
        "check 5: it could not be measured: TypeError: not callable",
    )
    text = report.text_table(found.outcomes)
    assert "not applicable, there is none: check 2" in text
    assert "not applicable, mujoco is not installed: check 3" in text


def test_a_miss_exits_with_1_in_words_and_files(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(report, "CHECKS", checks(FOUND["kept"], FOUND["missed"]))
    found = tmp_path / "runs" / "found.json"
    assert main(["verify", "FourR", "four_r_free", "--json", str(found)]) == 1
    out, err = capsys.readouterr()
    assert "FourR: MISSED: check 1: too much" in out
    assert "2 promises kept, 2 missed" in out
    assert "verify 1/2: FourR: check 1" in err
    assert "2 broken promises" in err
    data = json.loads(found.read_text(encoding="utf-8"))
    assert data["good"] is False
    assert data["subjects"][0]["outcomes"][1] == {
        "check": "check 1", "family": "tests", "verdict": "MISSED", "found": 2.0, "bound": 1.0,
        "relation": "at most", "unit": "m", "where": "state 2", "words": "too much",
    }  # fmt: skip
