"""A newcomer's mistakes are explained in words; correct input works from the command line, too."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
MODULE = next(
    block for block in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL) if "QuadraticDrag" in block
)
SCENE = """
robot: {type: FourR, masses: [0.5, 0.5, 0.5, 0.5], lengths: [0.25, 0.25, 0.25, 0.25]}
effects:
  - {type: Gravity}
  - {type: QuadraticDrag, coefficients: 0.1}
  - {type: EffortLimits, limits: [20, 12, 8, 4]}
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "my_effects.py").write_text(MODULE, encoding="utf-8")
    (tmp_path / "my_scene.yaml").write_text(SCENE, encoding="utf-8")
    return tmp_path


def called(folder, module, *words):
    paths = os.pathsep.join([str(ROOT), str(ROOT / "agents")])
    return subprocess.run(
        [sys.executable, "-m", module, *words],
        cwd=folder, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": paths},
    )  # fmt: skip


def test_the_command_line_knows_what_an_imported_module_registers(folder):
    words = ("--import", "my_effects", "verify", "--quick", "my_scene.yaml", "--states", "32")
    done = called(folder, "redundant_envs", *words)
    assert done.returncode == 0, done.stderr
    assert "my_scene.yaml" in done.stdout
    done = called(folder, "redundant_envs", "--import=my_effects", "scene", "my_scene.yaml", "--bill")
    assert "quadratic_drag" in done.stdout


def test_without_the_import_it_says_what_is_missing(folder):
    done = called(folder, "redundant_envs", "scene", "my_scene.yaml")
    assert done.returncode == 2
    assert "type is 'QuadraticDrag'" in done.stderr
    assert "--import MODULE before the command" in done.stderr
    (folder / "half.py").write_text("import missing_package\n", encoding="utf-8")
    for words, message in (
        (
            ("verify", "half:thing"),
            "half:thing: half imports missing_package, which is not there",
        ),
        (("verify", "not_there:thing"), "give the name of a module that lies in this folder or is installed"),
        (("--import", "not_there", "list"), "--import is 'not_there': No module named 'not_there'; give"),
        (("--import",), "--import names no module; give --import MODULE before the command"),
    ):
        done = called(folder, "redundant_envs", *words)
        assert (done.returncode, message in done.stderr) == (2, True), done.stderr


@pytest.mark.parametrize("name", [pytest.param("agents", marks=pytest.mark.long), "redundant_envs_train"])
def test_the_application_knows_it_as_well_also_where_it_is_installed_from_a_checkout(folder, name):
    pytest.importorskip("stable_baselines3", reason="the application needs the extra 'train'")
    limits = "  - {type: EffortLimits, limits: [20, 12, 8, 4]}"
    (folder / "no_limits.yaml").write_text(SCENE.replace(limits, ""), encoding="utf-8")
    run = ("train", "four_r_reach_ppo", "env_kwargs.scene=no_limits.yaml", "--out", "run")
    done = called(folder, name, "--import", "my_effects", *run)
    assert done.returncode == 2
    assert "has no EffortLimits" in done.stderr  # the effect is known, the next mistake reported
