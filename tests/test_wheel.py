"""The wheel: with core dependencies only, with those of training, and to a type checker; first imports."""

import email
import json
import os
import re
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

import redundant_envs

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[1]
PROGRAM = """
import importlib.util, sys
import gymnasium as gym
import redundant_envs as rde
from redundant_envs.envs.registration import ids
from redundant_envs.scenes.scene import scene_names
assert "site-packages" in rde.__file__, rde.__file__
for env_id in ids():
    env = gym.make(env_id, render_mode="rgb_array")
    env.reset(seed=0)
    env.step(env.action_space.sample())
    env.render()
scenes = [rde.load_scene(name) for name in scene_names()]
for module in ("agents", "numba"):
    assert importlib.util.find_spec(module) is None
print(len(ids()), len(scenes))
"""
USER = """
import numpy as np
import redundant_envs as rde

arm = rde.FourR(masses=(2, 1.5, 1, 0.5), lengths=(0.3, 0.5, 0.4, 0.6))
scene = rde.Scene(arm, effects=(rde.effects.Gravity(),), tolerance=1e-6)
motion = rde.simulate(scene, q=(0.3, 0.2, -0.4, 0.1), qd=(0, 0, 0, 0), times=[0.5, 1.0])
energy: float = float(motion.kinetic_energy[-1])
batch = rde.BatchSimulator(scene, num_envs=2)
flags = batch.advance(np.zeros((2, 4))).numerics
mass = arm.mass_matrix(np.zeros(4))
reveal_type(rde.load_scene("rprp_reach"))
WRONG
"""


PIP = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]


def program(home: Path, name: str) -> str:
    """A program of a virtual environment."""
    return str(home / ("Scripts" if sys.platform == "win32" else "bin") / name)


def call(*command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a program in a folder, away from this checkout."""
    clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "MYPYPATH")}
    return subprocess.run(command, check=False, capture_output=True, text=True, cwd=folder, env=clean)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel of this checkout."""
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run([*PIP, "wheel", "--no-deps", "--wheel-dir", str(folder), str(ROOT)], check=True)
    (found,) = folder.glob("*.whl")
    return found


@pytest.fixture(scope="module")
def core(wheel, tmp_path_factory):
    """An environment with the wheel and its core dependencies, without a pip, which would take seconds."""
    home = tmp_path_factory.mktemp("core") / "venv"
    venv.create(home)
    install = [*PIP, "--python", program(home, "python"), "install", "--no-compile"]
    subprocess.run([*install, "--constraint", str(ROOT / "constraints.txt"), str(wheel)], check=True)
    return home


def test_wheel_with_core_dependencies_only(core, tmp_path):
    done = call(program(core, "python"), "-c", PROGRAM, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[0] == "4"


def test_commands_work_without_the_studies_and_the_extras(core, tmp_path):
    for words, status, said in (
        ("redundant-envs --version", 0, f"redundant-envs {redundant_envs.__version__}\n"),
        ("redundant-envs-train --version", 0, f"redundant-envs {redundant_envs.__version__}\n"),
        ("redundant-envs list", 0, "rprp_reach"),
        ("redundant-envs verify --quick --states 64 four_r_reach", 0, ""),
        ("redundant-envs wasm four_r_reach --out made", 0, "kernel.js"),
        ("redundant-envs-train train rprp_reach_ppo", 2, "pip install '.[train]'"),
    ):
        name, *rest = words.split()
        done = call(program(core, name), *rest, folder=tmp_path)
        assert done.returncode == status, done.stderr
        assert said in (done.stderr if status else done.stdout)


def test_a_wheel_trains_from_an_empty_folder(wheel, tmp_path):
    packages, empty = tmp_path / "packages", tmp_path / "empty"
    empty.mkdir()
    subprocess.run([*PIP, "install", "--no-deps", "--target", str(packages), str(wheel)], check=True)
    begin = f"import sys; sys.path.insert(0, {str(packages)!r}); import redundant_envs_train.__main__ as m; "
    begin += "print(m.__file__, file=sys.stderr); sys.exit(m.main(sys.argv[1:]))"
    small = "num_envs=64 ppo.n_steps=16 ppo.batch_size=512 total_steps=2048 curve_episodes=10"
    small += " evaluation_episodes=10 env_kwargs.max_episode_steps=20 --out run"
    done = call(sys.executable, "-c", begin, "train", "rprp_reach_ppo", *small.split(), folder=empty)
    assert done.returncode == 0, done.stderr
    assert Path(done.stderr.splitlines()[0]).is_relative_to(packages)
    assert "`redundant-envs-train train run/config.yaml`" in (empty / "run" / "report.md").read_text()
    assert json.loads((empty / "run" / "evaluation.json").read_text())["episodes"] == 10


def test_users_programs_are_type_checked_against_the_wheel(core, tmp_path):
    command = [sys.executable, "-m", "mypy", "--strict", "--python-executable", program(core, "python")]

    def checked(wrong):
        (tmp_path / "user.py").write_text(USER.replace("WRONG", wrong))
        return call(*command, "user.py", folder=tmp_path)

    right, bad = checked(""), checked("rde.Scene(arm, substeps='two')")
    assert right.returncode == 0, right.stdout
    assert "Any" not in right.stdout
    assert bad.returncode == 1
    assert '"substeps" to "Scene"' in bad.stdout


def test_the_wheel_tells_what_it_is(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        (place,) = (name for name in names if name.endswith("METADATA"))
        about = email.message_from_bytes(archive.read(place))
    wanted = {
        path.relative_to(folder).as_posix()
        for folder in (ROOT, ROOT / "agents")
        for path in folder.glob("redundant_envs*/**/*")
        if path.is_file() and path.suffix != ".pyc"
    }
    assert wanted - {*names} == set()
    roots = {name.partition("/")[0].partition("-")[0] for name in names}
    assert roots == {"redundant_envs", "redundant_envs_train"}
    core = {re.match(r"[\w-]+", d)[0] for d in about.get_all("Requires-Dist") if "extra ==" not in d}
    assert core == {"numpy", "llvmlite", "gymnasium", "pyyaml"}
    assert "Typing :: Typed" in about.get_all("Classifier", [])
    assert about["License-Expression"] == "MIT"


FIRST_IMPORTS = """
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


def test_a_module_works_as_the_first_import():
    run = subprocess.run([sys.executable, "-c", FIRST_IMPORTS], capture_output=True, text=True)
    assert (run.returncode, run.stdout) == (0, ""), run.stderr
