"""Every public module works as the first import of a program."""

import subprocess
import sys

import pytest

PROGRAM = """
import importlib, sys, traceback
for name in ("__main__", "algebra", "effects", "robots.arm", "scenes.scene", "tasks.reach", "envs.check"):
    for module in [m for m in sys.modules if m.partition(".")[0] == "redundant_envs"]:
        del sys.modules[module]
    try:
        importlib.import_module(f"redundant_envs.{name}")
        from redundant_envs.scenes.scene import load_scene
        load_scene("rprp_reach")
    except Exception:
        print(name, traceback.format_exc())
"""


@pytest.mark.long
def test_a_module_works_as_the_first_import():
    run = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True)
    assert (run.returncode, run.stdout) == (0, ""), run.stderr
