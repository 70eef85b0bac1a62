"""A package that is not installed: every feature that needs it names the extra to install."""

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from published_runs import published_run

ROOT = Path(__file__).parents[1]
PROGRAM = """
import contextlib, importlib, io, json, sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {blocked!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Blocked())
sys.path.insert(0, {root!r})
import redundant_envs
assert all(hasattr(redundant_envs, name) for name in redundant_envs.__all__ if name != "make_sb3")
told = []
for call in {calls!r}:
    with contextlib.redirect_stderr(io.StringIO()) as err, contextlib.redirect_stdout(io.StringIO()):
        try:
            if "import" in call:
                exec(call, {{}})
            module, *words = call.split()
            told.append([importlib.import_module(f"{{module}}.__main__").main(words), err.getvalue()])
        except ImportError as error:
            told.append([type(error).__name__, str(error)])
        except SystemExit as end:
            told.append([end.code, err.getvalue()])
print(json.dumps(told))
"""
SIMULATE = "redundant_envs simulate --scene four_r_free --seconds 0.1"
AGENTS = "redundant_envs_train"
TRAIN, PLAY = f"{AGENTS} train rprp_reach_ppo", f"{AGENTS} play FourRReach-v0"
DATASET = f"{AGENTS} dataset random --env RPRPReach-v0 --out x"
MAKE = "import redundant_envs as rde; rde.make_sb3('RPRPReach-v0')"
ARM = "import redundant_envs as rde; arm = rde.FourR((1,) * 4, (1,) * 4);"
LINEAR = f"{ARM} from redundant_envs.control.linearisation import from_torch; from_torch(rde.Scene(arm))"
SCENE = f"{ARM} from studies import peers; s = rde.Scene(arm); z = [[0.0] * 4];"
MISSING = {
    "matplotlib": ("plot", [SIMULATE, "studies accuracy", f"{AGENTS} curves RUN"]),
    "PIL": ("plot", [SIMULATE]),
    "imageio": ("plot", [f"{SIMULATE} --clip a.gif", f"{PLAY} --clip a.gif"]),
    "imageio_ffmpeg": ("plot", [f"{SIMULATE} --clip a.mp4"]),
    "stable_baselines3": (
        "train", [TRAIN, f"{AGENTS} evaluate RUN", "studies policy", "studies stops RUN", MAKE],
    ),
    "torch": ("train", [TRAIN, MAKE, LINEAR]),
    "typer": ("train", [TRAIN]),
    "pydantic": ("train", [f"{AGENTS} table RUN"]),
    "rich": ("train", [TRAIN]),
    "wandb": ("wandb", [f"{TRAIN} telemetry=[wandb]"]),
    "mlflow": ("mlflow", [f"{TRAIN} telemetry=[mlflow]"]),
    "ray": ("ray", [f"{TRAIN} --seeds 0 --on ray"]),
    "optuna": ("tune", [f"{AGENTS} tune rprp_reach_ppo"]),
    "onnx": ("onnx", [f"{AGENTS} export RUN"]),
    "onnxruntime": ("onnx", [f"{AGENTS} export RUN"]),
    "minari": ("datasets", [DATASET]),
    "h5py": ("datasets", [DATASET]),
    "pygame": ("human", [PLAY]),
    "sympy": ("verify", [f"{ARM} arm.symbols()", "import redundant_envs.compiler.backends.sympy"]),
    "casadi": ("casadi", ["redundant_envs export four_r_reach --format casadi --out a.casadi"]),
    "mujoco": ("verify", [f"{SCENE} peers.mujoco_model(s, 'RK4', .01)"]),
    "scipy": ("verify", [f"{SCENE} peers.scipy_motion(s, 'RK45', .01, (z, z, z), .02)"]),
}  # fmt: skip
"""Package: the extra that has it; commands and programs that need it. RUN stands for a run folder."""
TOGETHER = [
    ("sympy", "mujoco", "scipy", "casadi", "minari"),
    ("wandb", "mlflow", "ray", "optuna", "onnxruntime", "pygame", "h5py"),
    *((one,) for one in ("matplotlib", "imageio", "stable_baselines3", "PIL", "imageio_ffmpeg", "typer")),
    *((one,) for one in ("pydantic", "rich", "onnx", "torch")),
]
"""Packages that are away in one process."""


@pytest.mark.long
@pytest.mark.parametrize("packages", TOGETHER, ids=str)
def test_what_needs_a_package_names_the_extra_in_one_line_and_the_rest_works(packages, tmp_path):
    run = str(published_run("rprp_reach_ppo/seed130", tmp_path / "run"))
    calls = [(p, call.replace("RUN", run)) for p in packages for call in MISSING[p][1]]
    program = PROGRAM.format(blocked=packages, root=str(ROOT), calls=[call for _, call in calls])
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for (package, call), (code, text) in zip(calls, json.loads(done.stdout), strict=True):
        assert code == (2 if "main()" in call or "import" not in call else "MissingPackage"), (call, text)
        (line,) = (line for line in text.splitlines() if "pip install" in line)
        extra = MISSING[package][0]
        assert f"{package} is not installed; install it in a clone of redundant-envs with: " in line, call
        assert f"pip install '.[{extra}]'" in line, call
        assert "Traceback" not in text, call
        if call == SIMULATE:  # keeps its numbers
            assert "four_r_free.csv is written" in text
            assert (tmp_path / "runs" / "simulate" / "four_r_free.csv").stat().st_size > 100


def test_the_extras_have_what_they_are_named_for():
    data = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    extras = data["project"]["optional-dependencies"]
    named = {package: extra for package, (extra, _) in MISSING.items()} | {"moviepy": "plot"}
    for package, extra in named.items():
        name = {"PIL": "pillow"}.get(package, package).replace("_", "-")
        assert any(d.replace("_", "-").startswith(f"{name}>=") for d in extras[extra]), (package, extra)
