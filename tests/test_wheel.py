"""The wheel, in an empty environment with core dependencies only, makes every id and every scene."""

import os
import subprocess
import sys
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROGRAM = """
import sys
import gymnasium as gym
import redundant_envs as rde
from redundant_envs.envs.registration import ids
from redundant_envs.scene import scene_names
assert "site-packages" in rde.__file__, rde.__file__
for env_id in ids():
    env = gym.make(env_id, render_mode="rgb_array")
    env.reset(seed=0)
    env.step(env.action_space.sample())
    env.render()
    gym.make_vec(env_id, num_envs=3).reset(seed=0)
names = scene_names()
assert "rprp_reach" in names
for name in names:
    rde.BatchSimulator(rde.load_scene(name)).advance()
for module in ("torch", "stable_baselines3", "matplotlib", "scipy", "pygame", "mujoco"):
    assert module not in sys.modules
print(len(ids()), len(names))
"""


@pytest.mark.filterwarnings("ignore")
def test_wheel_with_core_dependencies_only(tmp_path):
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, "wheel", "--no-deps", "--wheel-dir", str(tmp_path), str(ROOT)], check=True)
    (wheel,) = tmp_path.glob("*.whl")
    home = tmp_path / "venv"
    venv.create(home, with_pip=True)
    python = home / ("Scripts" if sys.platform == "win32" else "bin") / "python"
    constraints = ROOT / "constraints.txt"
    subprocess.run(
        [python, "-m", "pip", "--quiet", "install", "--constraint", constraints, wheel], check=True
    )
    clean = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(
        [python, "-c", PROGRAM], check=False, capture_output=True, text=True, cwd=tmp_path, env=clean
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[0] == "4"
