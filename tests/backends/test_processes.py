"""Machine code from process to process: kept, never stale, compiled once by many, through kills and forks."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import redundant_envs as rde
from redundant_envs.compiler.backends.cache import CACHE_VARIABLE, SUFFIX

pytestmark = pytest.mark.long

ROOT = Path(rde.__file__).parents[1]
MADE = """
import os
import redundant_envs as rde
scene = rde.Scene(rde.FourR((1, 1, 1, 1), (1, 1, 1, 1)), (rde.effects.ViscousFriction(0.5),), "euler")
def made():
    batch = rde.BatchSimulator(scene, 64, threads=2)
    batch.set_state((0.1, 0.2, 0.3, 0.4), (1.0, 2.0, 3.0, 4.0))
    return batch
"""
PROGRAM = f"""{MADE}
batch = made()
batch.advance()
print(batch.q[0].tolist(), batch.qd[0].tolist(), flush=True)
"""


def started(text, folder=None, root=ROOT):
    """A process that runs a program with its own package, and folder of machine code."""
    fresh = {"PYTHONDONTWRITEBYTECODE": "1"}  # Python misses an edit of equal length in the same second
    own = {CACHE_VARIABLE: str(folder)} if folder else {}
    env, pipe = {**fresh, **os.environ, "PYTHONPATH": str(root), **own}, subprocess.PIPE
    command = [sys.executable, "-c", text]
    return subprocess.Popen(command, env=env, cwd=root, stdout=pipe, stderr=pipe, text=True)


def program(*arguments):
    """The output of such a process."""
    process = started(*arguments)
    output, told = process.communicate()
    assert process.returncode == 0, told
    return output, told


ENVIRONMENT = """
import sys
import gymnasium as gym
import redundant_envs
{}
ran = set()
sys.setprofile(lambda frame, *_: ran.add(frame.f_code.co_qualname))
env = gym.make("redundant_envs/FourRReach-v0")
sys.setprofile(None)
env.reset(seed=0)
obs, reward, *_ = env.step(env.action_space.low)
simulator = env.unwrapped.core.simulator
print(obs.tolist(), reward, simulator.identity)
print("Simulator._traced" in ran, "yaml" in sys.modules, flush=True)
"""


def first_step(root, before=""):
    """The result of a first step, and whether the scene was traced and YAML was imported for it."""
    output, told = program(ENVIRONMENT.format(before), root / "cache", root)
    assert "damaged" not in told
    numbers, how = output.splitlines()
    return numbers, how


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """A copy of the package, with a folder of machine code, and its first step."""
    root = tmp_path_factory.mktemp("known")
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "redundant_envs", root / "redundant_envs", ignore=ignored)
    shutil.copytree(ROOT / "configs", root / "configs")
    numbers, how = first_step(root)
    assert how == "True True"
    return root, numbers


def test_an_environment_that_is_known_is_neither_traced_nor_read_from_yaml(environment):
    root, numbers = environment
    assert first_step(root) == (numbers, "False False")


EDITS = {
    "a function": ("redundant_envs/tasks/reach.py", "return 0.25 * tol", "return 0.75 * tol"),
    "what a function gives": ("redundant_envs/tasks/reach.py", '"goal_x goal_y"', '"goal_y goal_x"'),
    "the scene": ("configs/scenes/four_r_reach.yaml", "g: 9.81", "g: 1.62"),
    "the reader": ("redundant_envs/support/yaml_reader.py", "else float(re.sub", "else 2 * float(re.sub"),
}
"""Files, texts in them, and what replaces these."""


@pytest.fixture
def edited(environment):
    """A function that edits a file of the copy until the test ends."""
    root, _ = environment
    before = {}

    def edit(file, old, new, keep_time=False):
        path = root / file
        before[path] = path.read_text()
        times = path.stat()
        assert before[path].count(old) >= 1
        path.write_text(before[path].replace(old, new))
        if keep_time:
            assert len(old) == len(new)
            os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))

    yield edit
    for path, text in before.items():
        path.write_text(text)


@pytest.mark.parametrize("change", EDITS)
def test_no_edit_gets_an_old_environment(environment, edited, change):
    root, numbers = environment
    edited(*EDITS[change])
    assert first_step(root)[0] != numbers


REPLACEMENTS = {
    "a constant": "from redundant_envs.simulator.lane import faults; faults.LARGEST_ANGLE = 1.0",
    "a method": """
from redundant_envs.tasks import ReachTask
ReachTask.reward_functions = lambda self, scene, was=ReachTask.reward_functions: was(self, scene)[:1]
""",
    "the reader": """
from redundant_envs.support import yaml_reader as yaml
yaml.parsed = lambda text, where, read=yaml.parsed: read(text.replace("9.81", "1.62"), where)
""",
}
"""Code that replaces a part of the package before its first scene is made."""


@pytest.mark.parametrize("part", REPLACEMENTS)
def test_what_a_process_replaced_neither_meets_nor_leaves_an_old_environment(environment, part):
    root, numbers = environment
    assert first_step(root, REPLACEMENTS[part])[0] != numbers
    assert first_step(root) == (numbers, "False False")


def test_a_file_edited_after_its_import_leaves_no_old_environment_behind(environment, edited):
    root, numbers = environment
    file, old, new = EDITS["what a function gives"]
    edited(file, old, old)
    late = (
        "import pathlib; from redundant_envs.tasks import reach; path = pathlib.Path(reach.__file__)\n"
        f"path.write_text(path.read_text().replace({old!r}, {new!r}))"
    )
    assert first_step(root, late) == (numbers, "True False")
    assert first_step(root)[0] != numbers


def test_old_bytecode_leaves_no_old_environment_behind(environment, edited, monkeypatch):
    root, numbers = environment
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "")
    monkeypatch.setenv("PYTHONPYCACHEPREFIX", str(root / "bytecode"))
    assert first_step(root) == (numbers, "False False")
    edited(*EDITS["a function"], keep_time=True)
    assert first_step(root) == (numbers, "True False")  # by Python's own bytecode of the file
    shutil.rmtree(root / "bytecode")
    assert first_step(root)[0] != numbers


def test_of_processes_that_start_at_once_one_compiles(tmp_path):
    processes = [started(PROGRAM, tmp_path) for _ in range(3)]
    results = [p.communicate() for p in processes]
    assert len({output for output, _ in results}) == 1
    assert sum("compiling" in told for _, told in results) == 1
    assert all(p.returncode == 0 for p in processes)


def test_processes_killed_while_they_compile_or_write_leave_nothing_that_hurts(tmp_path):
    for moment in ("cache.llvm.object_code", "os.replace"):
        slow = f"""
import os, sys, time
import redundant_envs.compiler.backends.cache as cache
def wait(*_, **__):
    print("now", file=sys.stderr, flush=True)
    while True:
        time.sleep(1)
{moment} = wait
"""
        process = started(slow + PROGRAM, tmp_path)
        assert any(line.endswith("now\n") for line in process.stderr)  # otherwise it ended
        process.send_signal(signal.SIGKILL)
        process.communicate()
        assert not list(tmp_path.glob(f"*{SUFFIX}"))
    first, told = program(PROGRAM, tmp_path)
    assert told.count("compiling") == 1
    assert "damaged" not in told
    assert program(PROGRAM, tmp_path) == (first, "")


SIMULATES = f"""{MADE}
def agree(*pair):
    one, other = (batch.advance() and batch.q for batch in pair)
    assert (one == other).all()
batch, twin = made(), made()
agree(batch, twin)
pid = os.fork()
agree(batch, twin)
agree(made(), made())
if not pid:
    os._exit(0)
print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))
"""
COMPILES = """
import os, threading, time
import redundant_envs as rde
from redundant_envs.compiler.backends import cache
slowly = cache.llvm.object_code
cache.llvm.object_code = lambda program: time.sleep(0.2) or slowly(program)
def compile(kind):
    rde.BatchSimulator(rde.Scene(rde.FourR((1,) * 4, (1,) * 4), (), kind)).advance()
worker = threading.Thread(target=compile, args=("rk8",))
worker.start()
while cache._lock.acquire(blocking=False):
    cache._lock.release()
    time.sleep(0.001)
pid = os.fork()
if not pid:
    compile("euler")
    compile("rk8")
    os._exit(0)
print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))
worker.join()
"""
WORKERS = f"""{MADE}
import gymnasium as gym
made().advance()
make = lambda: gym.make("redundant_envs/FourRReach-v0")
make().reset(seed=0)
env = gym.vector.AsyncVectorEnv([make] * 2, context="fork")
env.reset(seed=0)
env.step(env.action_space.sample())
env.close()
print(0)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
@pytest.mark.parametrize("text", [SIMULATES, COMPILES, WORKERS], ids=["simulates", "compiles", "workers"])
def test_a_process_forked_while_threads_simulate_or_compile_goes_on(text, tmp_path):
    output, told = program(text, tmp_path)
    assert output == "0\n", told
