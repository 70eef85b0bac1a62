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
    "robots": f"from redundant_envs.robots.arm import Arm; {LOAD}",
    "tasks": f"from redundant_envs.tasks.reach import ReachTask; {LOAD}",
    "numerics": f"from redundant_envs.numerics.tableaus import METHODS; {LOAD}",
    "quantities": f"from redundant_envs.quantities import Quantities; {LOAD}",
    "dialect": f"from redundant_envs.dialect import check; {LOAD}",
    "tracing": f"from redundant_envs.tracing.number import Number; {LOAD}",
    "numpy": f"import redundant_envs.backends.numpy; {LOAD}",
    "compiler": f"from redundant_envs.backends.llvm import object_code; {LOAD}",
    "simulator": f"from redundant_envs.lane.interval import Interval; {LOAD}",
    "listing": f"from redundant_envs.model.listing import bill; {LOAD}",
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
    assert "valid: Chain, FourR, RPRP" in run.stderr


def test_functions_of_effects_take_arrays_as_the_first_import():
    code = (
        "import numpy as np; from redundant_envs.effects import limit_spring; "
        "x = np.array([-0.5, 0.0, 0.5]); f = limit_spring.force(x, 0.0, -0.2, 0.3, 100.0, 0.0, np.sign(x)); "
        "assert np.allclose(f, [30.0, 0.0, -20.0])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


def test_symbols_are_numbers_also_if_one_was_tried_before():
    pytest.importorskip("sympy", reason="sympy is in the extra 'verify'")
    code = (
        "import contextlib, sympy; from redundant_envs.algebra import sqrt\n"
        "with contextlib.suppress(TypeError): sqrt(sympy.Symbol('x'))\n"
        "import redundant_envs.backends.sympy; assert str(sqrt(sympy.Symbol('x'))) == 'sqrt(x)'"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


def test_the_name_of_the_first_core_says_what_took_its_place():
    import redundant_envs

    with pytest.raises(AttributeError, match=r"rde\.listing\(scene\).*rde\.bill\(scene\)"):
        redundant_envs.evaluators  # noqa: B018
    assert {"listing", "bill"} <= set(redundant_envs.__all__)
    assert "evaluators" not in dir(redundant_envs)
