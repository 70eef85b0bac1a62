"""Every public module works as the first import of a program."""

import subprocess
import sys

import pytest

LOAD = (
    "from redundant_envs.scenes.scene import load_scene; load_scene('rprp_reach'); load_scene('four_r_free')"
)
SYMPY = "sympy.Symbol('x')"
MODULES = ("__main__", "algebra", "effects", "robots.arm", "tasks.reach", "model.batch", "envs.check")
FIRST = {
    **{name: f"import redundant_envs.{name}; {LOAD}" for name in MODULES},
    "scene": LOAD,
    "symbols, also if one was tried before": (
        "import contextlib, sympy; from redundant_envs.algebra import sqrt\n"
        f"with contextlib.suppress(TypeError): sqrt({SYMPY})\n"
        f"import redundant_envs.compiler.backends.sympy; assert str(sqrt({SYMPY})) == 'sqrt(x)'"
    ),
}
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
