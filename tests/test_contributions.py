"""A new effect, arm or task is the files that CONTRIBUTING.md names: tests of all have it."""

from pathlib import Path
from shutil import copytree, ignore_patterns

import pytest

from tests.mutation.copies import outcome

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[1]


@pytest.fixture
def tree(tmp_path):
    return copytree(ROOT, tmp_path / "tree", ignore=ignore_patterns(".*", "runs", "__pycache__"))


def twin(tree, file, *names):
    """Copy a file with other names in its own and in its text."""

    def renamed(text):
        for old, new in names:
            text = text.replace(old, new)
        return text

    (tree / renamed(file)).write_text(renamed((tree / file).read_text(encoding="utf-8")), encoding="utf-8")


OF_FRICTION = ("ViscousFriction", "TwinFriction"), ("viscous_friction", "twin_friction")
ORACLE = """
import redundant_envs as rde

def test_twin_friction_slows_a_slider_down():
    scene = rde.Scene(rde.Chain("P", (2.0,), ()), (rde.effects.TwinFriction(0.5),))
    assert 0.97 < rde.simulate(scene, [0.0], [1.0], [0.1]).qd[0, 0] < 0.98
"""
OF_ALL_EFFECTS = (
    "tests/effects", "tests/docs", "tests/studies", "tests/test_properties.py",
    "tests/envs/test_pictures.py", "tests/fuzz/test_fuzz.py", "tests/verify/test_verified_effects.py",
)  # fmt: skip


def test_a_new_effect_is_a_module_a_page_and_a_test(tree):
    for file in ("redundant_envs/effects/viscous_friction.py", "docs/effects/viscous_friction.md"):
        twin(tree, file, *OF_FRICTION)
    (tree / "tests" / "effects" / "test_twin_friction.py").write_text(ORACLE, encoding="utf-8")
    named = ("-k", "TwinFriction or twin_friction or every_effect or index_of_effects")
    assert outcome([*OF_ALL_EFFECTS, *named], tree).result == "green"


TASK = '''"""The reach task with another name."""

from redundant_envs.tasks.reach import ReachTask


class TwinReachTask(ReachTask):
    """The reach task."""

    name = "TwinReach"
'''


def test_a_new_arm_and_a_new_task_have_environments_that_the_tests_of_all_ids_find_sound(tree):
    twin(tree, "redundant_envs/robots/four_r.py", ("FourR", "TwinR"), ("four_r", "twin_r"))
    for scene in ("reach", "around", "reach_fault"):
        twin(tree, f"configs/scenes/four_r_{scene}.yaml", ("FourR", "TwinR"), ("four_r", "twin_r"))
    (tree / "redundant_envs" / "tasks" / "twin_reach.py").write_text(TASK, encoding="utf-8")
    of_all_ids = ["tests/envs/test_registry.py", "tests/envs/test_promises.py", "-k", "Twin"]
    assert outcome(of_all_ids, tree).result == "green"
