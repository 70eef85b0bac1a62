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
import gymnasium as gym
import redundant_envs
env = gym.make("redundant_envs/FourRReach-v0")
env.reset(seed=0)
obs, reward, *_ = env.step(env.action_space.low)
simulator = env.unwrapped.core.simulator
print(obs.tolist(), reward, simulator.identity)
"""


def first_step(root):
    """The result of a first step, and whether the environment was compiled for it."""
    numbers, told = program(ENVIRONMENT, root / "cache", root)
    assert "damaged" not in told
    return numbers, "compiling" in told


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """A copy of the package, with a folder of machine code, and its first step."""
    root = tmp_path_factory.mktemp("known")
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "redundant_envs", root / "redundant_envs", ignore=ignored)
    shutil.copytree(ROOT / "configs", root / "configs")
    numbers, compiled = first_step(root)
    assert compiled
    return root, numbers


def test_an_environment_that_is_known_is_not_compiled_again(environment):
    root, numbers = environment
    assert first_step(root) == (numbers, False)


EDITS = {
    "a function": ("redundant_envs/tasks/reach.py", "return 0.25 * tol", "return 0.75 * tol"),
    "what a function gives": ("redundant_envs/tasks/reach.py", '"goal_x goal_y"', '"goal_y goal_x"'),
    "the scene": ("configs/scenes/four_r_reach.yaml", "g: 9.81", "g: 1.62"),
}
"""Files, texts in them, and what replaces these."""


@pytest.mark.parametrize("change", EDITS)
def test_no_edit_gets_an_old_environment(environment, change):
    (root, numbers), (file, old, new) = environment, EDITS[change]
    before = (root / file).read_text()
    assert old in before
    (root / file).write_text(before.replace(old, new))
    try:
        assert first_step(root)[0] != numbers
    finally:
        (root / file).write_text(before)


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
        told = ""
        while not told.endswith("now\n"):
            letter = process.stderr.read(1)
            assert letter, told  # it ended
            told += letter
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
def object_code(program):
    time.sleep(0.2)
    return slowly(program)
cache.llvm.object_code = object_code
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
