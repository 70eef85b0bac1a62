"""Every public module works as the first import of a program."""

import subprocess
import sys

import pytest

LOAD = (
    "from redundant_envs.scenes.scene import load_scene; load_scene('rprp_reach'); load_scene('four_r_free')"
)
SYMPY = "sympy.Symbol('x')"
FIRST = {
    "scene": LOAD,
    "study": (
        "import pathlib; from studies.accuracy_config import load_study\n"
        "load_study(pathlib.Path('configs/studies/accuracy.yaml'))"
    ),
    "an unknown arm": (
        "from redundant_envs.scenes.scene import Scene\n"
        "try: Scene.from_dict({'robot': {'type': 'Delta'}})\n"
        "except ValueError as error: assert 'valid: Chain, FourR, RPRP' in str(error)"
    ),
    "functions of effects, on arrays": (
        "import numpy as np; from redundant_envs.effects import limit_spring; "
        "x = np.array([-0.5, 0.0, 0.5]); f = limit_spring.force(x, 0.0, -0.2, 0.3, 100.0, 0.0, np.sign(x)); "
        "assert np.allclose(f, [30.0, 0.0, -20.0])"
    ),
    "the public name of the dialect": (
        "import redundant_envs.algebra as public; from redundant_envs.language import algebra; "
        "from redundant_envs.algebra import physics; assert public is algebra"
    ),
    "symbols, also if one was tried before": (
        "import contextlib, sympy; from redundant_envs.algebra import sqrt\n"
        f"with contextlib.suppress(TypeError): sqrt({SYMPY})\n"
        f"import redundant_envs.compiler.backends.sympy; assert str(sqrt({SYMPY})) == 'sqrt(x)'"
    ),
}
MODULES = (
    "__main__ algebra effects robots.arm tasks.reach language.quantities compiler.tracing.number model.batch "
    "envs.check"
)
FIRST |= {name: f"import redundant_envs.{name}; {LOAD}" for name in MODULES.split()}
EACH = """
import sys, traceback
for name, program in {programs!r}.items():
    for module in [m for m in sys.modules if m.partition(".")[0] == "redundant_envs"]:
        del sys.modules[module]
    try:
        exec(program, {{}})
    except Exception:
        print(name, traceback.format_exc())
"""


@pytest.mark.long
def test_a_module_works_as_the_first_import():
    pytest.importorskip("sympy", reason="sympy is in the extra 'verify'")
    program = [sys.executable, "-c", EACH.format(programs=FIRST)]
    run = subprocess.run(program, capture_output=True, text=True)
    assert (run.returncode, run.stdout) == (0, ""), run.stderr


def test_the_name_of_the_first_core_says_what_took_its_place():
    import redundant_envs

    with pytest.raises(AttributeError, match=r"rde\.listing\(scene\).*rde\.bill\(scene\)"):
        redundant_envs.evaluators  # noqa: B018
    assert {"listing", "bill"} <= set(redundant_envs.__all__)
    assert "evaluators" not in dir(redundant_envs)
