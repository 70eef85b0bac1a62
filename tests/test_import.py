"""Every public module works as the first import of a program."""

import subprocess
import sys

import pytest

LOAD = "from redundant_envs.scene import load_scene; load_scene('rprp_reach'); load_scene('four_r_free')"
PLAIN = "{'robot': {'type': 'FourR', 'masses': [1] * 4, 'lengths': [1] * 4}}"
FIRST = {
    "scene": LOAD,
    "plain data": f"from redundant_envs.scene import Scene; Scene.from_dict({PLAIN})",
    "algebra": f"from redundant_envs.algebra import physics; {LOAD}",
    "effects": f"from redundant_envs.effects import Gravity; {LOAD}",
    "robots": f"from redundant_envs.robots.parameters import Arm; {LOAD}",
    "tasks": f"from redundant_envs.tasks.reach import ReachTask; {LOAD}",
    "integrators": f"from redundant_envs.integrators.tableaus import METHODS; {LOAD}",
    "evaluators": f"from redundant_envs.evaluators import source; {LOAD}",
    "model": f"from redundant_envs.model.batch import BatchSimulator; {LOAD}",
    "control": f"from redundant_envs.control import computed_torque; {LOAD}",
    "environments": f"from redundant_envs.envs.check import check_vec_env; {LOAD}",
    "study": "from redundant_envs.studies.accuracy_config import load_study; from pathlib import Path; "
    "load_study(Path('configs/studies/accuracy.yaml'))",
    "command line": "from redundant_envs.__main__ import main; assert main(['scene', 'rprp_reach']) == 0",
}


@pytest.mark.parametrize("code", FIRST.values(), ids=FIRST)
def test_a_submodule_knows_the_arms_as_the_first_import(code):
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


def test_an_unknown_arm_lists_the_arms_as_the_first_import():
    code = "from redundant_envs.scene import Scene; Scene.from_dict({'robot': {'type': 'Delta'}})"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "valid: FourR, RPRP" in run.stderr
