"""A package that is not installed: every feature that needs it names the extra to install."""

import importlib
import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from published_runs import published_run

import redundant_envs as rde
from redundant_envs.extras import MissingPackage, needs

ROOT = Path(__file__).parents[1]
BLOCK = """
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {blocked!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Blocked())
import os
os.chdir({folder!r})
"""
LIBRARY, AGENTS = "redundant_envs.__main__", "redundant_envs_train.__main__"
EACH = """
import contextlib, importlib, io, json
results = []
for module, arguments in {calls!r}:
    with contextlib.redirect_stderr(io.StringIO()) as err, contextlib.redirect_stdout(io.StringIO()):
        code = importlib.import_module(module).main(arguments)
    results.append((code, err.getvalue()))
print(json.dumps(results))
"""
SIMULATE = ["simulate", "--scene", "four_r_free", "--seconds", "0.1"]
RUN = "RUN"  # stands for a run folder
COMMANDS = {
    # name -> module with main, arguments, package that is missing, extra
    "figures": (LIBRARY, SIMULATE, "matplotlib", "plot"),
    "figures, pillow": (LIBRARY, SIMULATE, "PIL", "plot"),
    "clip": (LIBRARY, [*SIMULATE, "--clip", "a.gif"], "imageio", "plot"),
    "clip as MP4": (LIBRARY, [*SIMULATE, "--clip", "a.mp4"], "imageio_ffmpeg", "plot"),
    "study accuracy": (LIBRARY, ["study", "accuracy"], "matplotlib", "plot"),
    "study accuracy, pillow": (LIBRARY, ["study", "accuracy"], "PIL", "plot"),
    "train": (AGENTS, ["train", "rprp_reach_ppo"], "stable_baselines3", "train"),
    "train, torch": (AGENTS, ["train", "rprp_reach_ppo"], "torch", "train"),
    "train, matplotlib": (AGENTS, ["train", "rprp_reach_ppo"], "matplotlib", "plot"),
    "train, imageio": (AGENTS, ["train", "rprp_reach_ppo"], "imageio", "plot"),
    "train, wandb": (AGENTS, ["train", "rprp_reach_ppo", "telemetry=[wandb]"], "wandb", "wandb"),
    "train, mlflow": (AGENTS, ["train", "rprp_reach_ppo", "telemetry=[mlflow]"], "mlflow", "mlflow"),
    "train, ray": (AGENTS, ["train", "rprp_reach_ppo", "--seeds", "0", "--on", "ray"], "ray", "ray"),
    "tune": (AGENTS, ["tune", "rprp_reach_ppo"], "optuna", "tune"),
    "train, typer": (AGENTS, ["train", "rprp_reach_ppo"], "typer", "train"),
    "train, pydantic": (AGENTS, ["train", "rprp_reach_ppo"], "pydantic", "train"),
    "train, rich": (AGENTS, ["train", "rprp_reach_ppo"], "rich", "train"),
    "evaluate": (AGENTS, ["evaluate", RUN], "stable_baselines3", "train"),
    "report": (AGENTS, ["report", RUN, "--out", "out"], "stable_baselines3", "train"),
    "report, imageio": (AGENTS, ["report", RUN, "--out", "out"], "imageio", "plot"),
    "table": (AGENTS, ["table", RUN], "pydantic", "train"),
    "export": (AGENTS, ["export", RUN], "onnx", "onnx"),
    "export, runtime": (AGENTS, ["export", RUN], "onnxruntime", "onnx"),
    "curves": (AGENTS, ["curves", RUN], "matplotlib", "plot"),
    "study strength": (AGENTS, ["study", "strength"], "matplotlib", "plot"),
    "play": (AGENTS, ["play", RUN, "--clip", "a.gif"], "stable_baselines3", "train"),
    "play, window": (AGENTS, ["play", "FourRReach-v0"], "pygame", "human"),
    "play, clip": (AGENTS, ["play", "FourRReach-v0", "--clip", "a.gif"], "imageio", "plot"),
    "play, MP4": (AGENTS, ["play", "FourRReach-v0", "--clip", "a.mp4"], "imageio_ffmpeg", "plot"),
    "study stops": (AGENTS, ["study", "stops", RUN], "stable_baselines3", "train"),
    "study policy": (AGENTS, ["study", "policy"], "stable_baselines3", "train"),
    "study policy, figures": (AGENTS, ["study", "policy"], "matplotlib", "plot"),
}
ARM = "import redundant_envs as rde; arm = rde.FourR((1,) * 4, (1,) * 4);"
SCENE = f"{ARM} from redundant_envs.studies import peers; s = rde.Scene(arm); z = [[0.0] * 4];"
CALLS = {
    "symbols": (f"{ARM} arm.symbols()", "sympy", "verify"),
    "the numbers of sympy": ("import redundant_envs.backends.sympy", "sympy", "verify"),
    "make_sb3": ("import redundant_envs as rde; rde.make_sb3('RPRPReach-v0')", "stable_baselines3", "train"),
    "make_sb3, torch": ("import redundant_envs as rde; rde.make_sb3('RPRPReach-v0')", "torch", "train"),
    "the module of make_sb3": ("import redundant_envs.envs.sb3", "stable_baselines3", "train"),
    "redundant_envs_train.zoo": ("import redundant_envs_train.zoo.experiment", "rl_zoo3", "zoo"),
    "its command": ("from redundant_envs_train.zoo.__main__ import main; sys.exit(main())", "rl_zoo3", "zoo"),
    "MuJoCo": (f"{SCENE} peers.mujoco_interval(s, 'RK4', .01, (z, z, z), .02)", "mujoco", "verify"),
    "SciPy": (f"{SCENE} peers.scipy_interval(s, 'RK45', .01, .01, (z, z, z), .02)", "scipy", "verify"),
}


def run(program: str, package: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """A program without one package."""
    here = f"sys.path.insert(0, {str(ROOT)!r})\n"
    text = BLOCK.format(blocked=(package,), folder=str(folder)) + here + program
    command = [sys.executable, "-c", text]
    return subprocess.run(command, check=False, capture_output=True, text=True, timeout=120)


def words(package, extra):
    return f"{package} is not installed; install it with: pip install 'redundant-envs[{extra}]'"


PACKAGES = list(dict.fromkeys(package for _, _, package, _ in COMMANDS.values()))


@pytest.mark.parametrize(
    "package", [p if p in PACKAGES[:3] else pytest.param(p, marks=pytest.mark.long) for p in PACKAGES]
)
def test_commands_name_the_extra_in_one_line(package, tmp_path):
    of_package = {name: command for name, command in COMMANDS.items() if command[2] == package}
    folder = str(published_run("rprp_reach_ppo/seed130", tmp_path / "run"))
    calls = [(main, [folder if a == RUN else a for a in given]) for main, given, *_ in of_package.values()]
    done = run(EACH.format(calls=calls), package, tmp_path)
    assert done.returncode == 0, done.stderr
    for (name, (*_, extra)), (code, err) in zip(of_package.items(), json.loads(done.stdout), strict=True):
        assert code == 2, (name, err)
        (line,) = (line for line in err.splitlines() if "pip install" in line)
        assert words(package, extra) in line, name
        assert "Traceback" not in err, name


@pytest.mark.parametrize("name", CALLS)
def test_calls_name_the_extra(name, tmp_path):
    program, package, extra = CALLS[name]
    done = run(program, package, tmp_path)
    assert done.returncode == (2 if "sys.exit" in program else 1)
    before = "error: " if "sys.exit" in program else "redundant_envs.extras.MissingPackage: "
    assert done.stderr.splitlines()[-1] == before + words(package, extra)


def test_simulate_keeps_its_numbers_without_matplotlib(tmp_path):
    done = run(f"from {LIBRARY} import main; sys.exit(main({SIMULATE}))", "matplotlib", tmp_path)
    assert "four_r_free.csv is written" in done.stderr
    assert (tmp_path / "runs" / "simulate" / "four_r_free.csv").stat().st_size > 100


@pytest.mark.parametrize("package", ["stable_baselines3", "torch", "matplotlib"])
def test_all_names_can_be_imported_without_an_extra(package, tmp_path):
    program = (
        "from redundant_envs import *; import redundant_envs as rde\n"
        "assert all(name in globals() for name in rde.__all__) and BatchSimulator and load_scene\n"
        "assert 'make_sb3' in dir(rde)"
    )
    done = run(program, package, tmp_path)
    assert done.returncode == 0, done.stderr


def test_a_package_that_is_there_but_broken_tells_why():
    with pytest.raises(MissingPackage, match=r"libGL is lost; install it with: .*\[plot\]"), needs("plot"):
        raise ImportError("libGL is lost")


def test_the_extras_have_what_they_are_named_for():
    data = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    extras = data["project"]["optional-dependencies"]
    pypi = {"PIL": "pillow", "imageio_ffmpeg": "imageio-ffmpeg", "stable_baselines3": "stable-baselines3"}
    for *_, package, extra in (*COMMANDS.values(), *CALLS.values()):
        assert any(d.startswith(f"{pypi.get(package, package)}>=") for d in extras[extra]), (package, extra)


@pytest.mark.filterwarnings("ignore:rich is experimental")
def test_progress_bars_of_stable_baselines3_work_with_the_extra_train():
    """They need tqdm and rich, which stable-baselines3 itself does not install."""
    ppo = importlib.import_module("stable_baselines3").PPO
    model = ppo("MlpPolicy", rde.make_sb3("RPRPReach-v0", 4), n_steps=8, batch_size=8, device="cpu")
    assert model.learn(64, progress_bar=True).num_timesteps == 64
