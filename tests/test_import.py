"""Every public module works as the first import of a program."""

import subprocess
import sys

import pytest

LOAD = "from redundant_envs.scene import load_scene; load_scene('rprp_reach'); load_scene('four_r_free')"
PLAIN = "{'robot': {'type': 'FourR', 'masses': [1] * 4, 'lengths': [1] * 4}}"
STUDY = "load_study(pathlib.Path('configs/studies/accuracy.yaml'))"
SYMPY = "sympy.Symbol('x')"
FIRST = {
    "scene": LOAD,
    "plain data": f"from redundant_envs.scene import Scene; Scene.from_dict({PLAIN})",
    "study": f"import pathlib; from redundant_envs.studies.accuracy_config import load_study; {STUDY}",
    "command line": "from redundant_envs.__main__ import main; assert main(['scene', 'rprp_reach']) == 0",
    "an unknown arm": (
        "from redundant_envs.scene import Scene\n"
        "try: Scene.from_dict({'robot': {'type': 'Delta'}})\n"
        "except ValueError as error: assert 'valid: Chain, FourR, RPRP' in str(error)"
    ),
    "functions of effects, on arrays": (
        "import numpy as np; from redundant_envs.effects import limit_spring; "
        "x = np.array([-0.5, 0.0, 0.5]); f = limit_spring.force(x, 0.0, -0.2, 0.3, 100.0, 0.0, np.sign(x)); "
        "assert np.allclose(f, [30.0, 0.0, -20.0])"
    ),
    "symbols, also if one was tried before": (
        "import contextlib, sympy; from redundant_envs.algebra import sqrt\n"
        f"with contextlib.suppress(TypeError): sqrt({SYMPY})\n"
        f"import redundant_envs.backends.sympy; assert str(sqrt({SYMPY})) == 'sqrt(x)'"
    ),
}
MODULES = """
algebra effects robots.arm tasks.reach numerics.tableaus quantities dialect tracing.number backends.numpy
backends.llvm lane.interval model.listing model.batch control envs.check
"""
FIRST |= {name: f"import redundant_envs.{name}; {LOAD}" for name in MODULES.split()}


@pytest.mark.parametrize("name", FIRST)
def test_a_module_works_as_the_first_import(name):
    if "sympy" in FIRST[name]:
        pytest.importorskip("sympy", reason="sympy is in the extra 'verify'")
    run = subprocess.run([sys.executable, "-c", FIRST[name]], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


def test_the_name_of_the_first_core_says_what_took_its_place():
    import redundant_envs

    with pytest.raises(AttributeError, match=r"rde\.listing\(scene\).*rde\.bill\(scene\)"):
        redundant_envs.evaluators  # noqa: B018
    assert {"listing", "bill"} <= set(redundant_envs.__all__)
    assert "evaluators" not in dir(redundant_envs)
