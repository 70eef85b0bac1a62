"""A newcomer's mistakes are explained in words; correct input works from the command line, too."""

import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.effects import Effect, Force, Inertia, State

ROOT = Path(__file__).parents[2]
ARM = rde.FourR((1.0,) * 4, (0.5,) * 4)
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
    assert "its effects need EffortLimits" in done.stderr  # the effect is known, the next mistake reported


@physics
def nothing(phi1):
    return 0.0 * phi1


def scene_with(**members):
    return rde.Scene(ARM, (dataclass(frozen=True)(type("Mine", (Effect,), members))(),))


def test_a_number_with_the_name_of_what_every_effect_has_is_refused_where_it_is_written():
    for name in ("static", "of_joints", "parameters", "travel", "key"):
        with pytest.raises(ValueError, match=f"Mine has a number '{name}', as every effect has; rename it"):
            type("Mine", (Effect,), {"__annotations__": {name: float}, name: 1.0})


def test_entries_that_no_hook_uses_are_refused():
    @dataclass(frozen=True)
    class Rotor(Effect):
        inertia: tuple[float, ...]

        def hooks(self, arm):
            return tuple(Inertia((k,), f".inertia[{k}]") for k in range(len(arm.joints)))

    rde.Scene(ARM, (Rotor((0.1,) * 4),))
    with pytest.raises(
        ValueError, match=r"inertia has 5 entries, of which no hook uses inertia\[4\]; give 4"
    ):
        rde.Scene(ARM, (Rotor((0.1,) * 5),))
    with pytest.raises(ValueError, match=r"inertia is \[0.1, 0.1\]; give a number or a tuple of them"):
        rde.Scene(ARM, (Rotor([0.1, 0.1]),))


def test_a_state_that_is_no_tuple_and_missing_hooks_are_named():
    state = State("z", "", derivative=nothing)
    with pytest.raises(ValueError, match=r"hook 0: states is State\(.*; give a tuple, such as \(State"):
        scene_with(hooks=lambda self, arm: (Force(0, nothing, states=state),))
    with pytest.raises(
        NotImplementedError, match=r"does not say where it attaches; write a method hooks\(self, arm\)"
    ):
        scene_with(hook=lambda self, arm: ())


@pytest.mark.parametrize(
    "call",
    [
        lambda scene: rde.simulate(scene, np.zeros(4), np.zeros(4), [1.0]),
        rde.BatchSimulator, rde.bill, rde.listing, rde.torch_step,
    ],
    ids=["simulate", "BatchSimulator", "bill", "listing", "torch_step"],
)  # fmt: skip
def test_the_name_of_a_scene_is_not_the_scene(call):
    with pytest.raises(
        ValueError, match=r"scene is 'four_r_free'; give a Scene, such as rde.load_scene makes"
    ):
        call("four_r_free")


def test_shapes_and_times_of_a_simulation_are_named():
    scene = rde.Scene(ARM, ())
    with pytest.raises(ValueError, match=r"q has shape \(3,\); the last axis must have 4"):
        rde.simulate(scene, (0, 0, 0), (0,) * 4, [1.0])
    with pytest.raises(ValueError, match=r"qd has shape \(5,\); the last axis must have 4"):
        rde.simulate(scene, (0,) * 4, (0,) * 5, [1.0])
    with pytest.raises(ValueError, match=r"q and qd have shapes \(2, 4\) and \(3, 4\), .* equal ones"):
        rde.simulate(scene, np.zeros((2, 4)), np.zeros((3, 4)), [1.0])
    with pytest.raises(ValueError, match=r"times must be .* increasing; they are \[1.0, 0.5\]"):
        rde.simulate(scene, (0,) * 4, (0,) * 4, [1.0, 0.5])
