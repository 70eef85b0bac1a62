"""The cache of compiled modules: damage is found, homes may be missing, forked processes do not hang."""

import os
import shutil
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import pytest

import redundant_envs as rde
from redundant_envs.evaluators import checksums, cpu
from redundant_envs.evaluators.assemble import assemble

ROOT = Path(rde.__file__).parents[1]
SCENE = rde.Scene(rde.FourR((1, 1, 1, 1), (1, 1, 1, 1)), (rde.effects.ViscousFriction(0.5),), "euler")
TEXT = assemble(SCENE).text
KEY = cpu.module_key(TEXT)
PROGRAM = """
import redundant_envs as rde
scene = rde.Scene(rde.FourR((1, 1, 1, 1), (1, 1, 1, 1)), (rde.effects.ViscousFriction(0.5),), "euler")
batch = rde.BatchSimulator(scene, 32, threads=2)
batch.set_state((0.1, 0.2, 0.3, 0.4), (1.0, 2.0, 3.0, 4.0))
batch.advance()
print(batch.q[0].tolist(), flush=True)
"""


def program(text=PROGRAM, **environment):
    env = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    return subprocess.run([sys.executable, "-c", text], env=env, capture_output=True, text=True, timeout=90)


def load(cache, monkeypatch):
    """The kernels from a cache, and what was told."""
    monkeypatch.setenv(cpu.CACHE_VARIABLE, str(cache))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        kernels = cpu._load(KEY, TEXT, "a test")
    assert set(kernels) == {"advance"}
    return [str(w.message) for w in told]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A cache with one module."""
    cache = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as monkeypatch:
        assert load(cache, monkeypatch) == []
    return cache


@pytest.fixture
def cache(whole, tmp_path, capsys):
    """A cache of one's own; caches may be moved."""
    shutil.copytree(whole, tmp_path / "cache")
    capsys.readouterr()
    return tmp_path / "cache"


def file_of(cache, kind):
    (found,) = (cache / KEY).rglob(kind)
    return found


KINDS = (cpu.MODULE, cpu.CODE, checksums.FILE, "*.nbi", "*.nbc")
DAMAGES = {
    "empty": lambda p: p.write_bytes(b""),
    "cut": lambda p: p.write_bytes(p.read_bytes()[: p.stat().st_size // 2]),
    "one byte short": lambda p: p.write_bytes(p.read_bytes()[:-1]),
    "zeroed": lambda p: p.write_bytes(bytes(p.stat().st_size)),
    "one byte": lambda p: p.write_bytes(p.read_bytes()[:-9] + b"?" + p.read_bytes()[-8:]),
    "gone": lambda p: p.unlink(),
    "a folder": lambda p: (p.unlink(), p.mkdir()),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_file_is_found_told_once_and_compiled_anew(cache, kind, damage, monkeypatch, capsys):
    assert load(cache, monkeypatch) == []
    assert "compiling" not in capsys.readouterr().err
    damage(file_of(cache, kind))
    (told,) = load(cache, monkeypatch)
    assert KEY in told
    assert "damaged or left unfinished" in told
    assert "compiling" in capsys.readouterr().err
    assert load(cache, monkeypatch) == []
    assert "compiling" not in capsys.readouterr().err


def test_a_module_altered_together_with_its_checksum_is_not_run(cache, monkeypatch):
    module = file_of(cache, cpu.MODULE)
    module.write_text(f"raise SystemExit('altered')\n{module.read_text()}")
    file_of(cache, checksums.FILE).unlink()
    checksums.write_checksums(cache / KEY)
    (told,) = load(cache, monkeypatch)
    assert "damaged" in told
    assert "altered" not in module.read_text()


CHECKSUMS = {
    "brackets in brackets": lambda p: p.write_text("[" * 200_000),
    "a list": lambda p: p.write_text("[]"),
    "no checksums": lambda p: p.write_text(f'{{"{cpu.MODULE}": null, "{cpu.CODE}": 3}}'),
    "too large": lambda p: p.write_text(p.read_text() + " " * checksums.LARGEST),
    "a pipe": lambda p: (p.unlink(), os.mkfifo(p)),
    "a link to itself": lambda p: (p.unlink(), p.symlink_to(p)),
}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
@pytest.mark.parametrize("damage", CHECKSUMS.values(), ids=CHECKSUMS)
def test_checksums_that_are_none_are_damage(cache, damage):
    folder = cache / KEY
    text = file_of(cache, cpu.MODULE).read_text()
    assert checksums.is_whole(folder, (cpu.MODULE, cpu.CODE), text)
    damage(folder / checksums.FILE)
    assert not checksums.is_whole(folder, (cpu.MODULE, cpu.CODE), text)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
@pytest.mark.parametrize("kind", KINDS)
def test_a_pipe_in_the_place_of_a_file_keeps_nobody_waiting(cache, kind, monkeypatch):
    path = file_of(cache, kind)
    path.unlink()
    os.mkfifo(path)
    (told,) = load(cache, monkeypatch)
    assert "damaged" in told
    assert load(cache, monkeypatch) == []


@pytest.mark.parametrize("kind", ["file", "empty folder", "folder of something else", "broken link"])
def test_something_else_in_the_place_of_a_module_is_replaced(tmp_path, kind, monkeypatch):
    place = tmp_path / KEY
    if kind == "file":
        place.write_text("?")
    elif kind == "broken link":
        place.symlink_to(tmp_path / "nowhere")
    else:
        place.mkdir()
    if kind == "folder of something else":
        (place / "deep").mkdir()
        (place / "deep" / "file").write_text("?")
    (told,) = load(tmp_path, monkeypatch)
    assert "damaged or left unfinished" in told
    assert load(tmp_path, monkeypatch) == []


def test_a_cache_that_cannot_keep_a_module_leaves_it_in_memory(cache, monkeypatch, capsys):
    shutil.rmtree(cache)
    cache.mkdir()
    (cache / f"{KEY}.lock").mkdir()
    (told,) = load(cache, monkeypatch)
    assert "kept in memory only" in told
    (cache / f"{KEY}.lock").rmdir()
    monkeypatch.setattr(cpu, "write_checksums", lambda folder: (_ for _ in ()).throw(OSError("no room left")))
    cpu._warned.clear()
    (told,) = load(cache, monkeypatch)
    assert "no room left" in told


@pytest.mark.parametrize(
    "delay", [*(pytest.param(t, marks=pytest.mark.long) for t in (0.0, 0.3)), "files"], ids=str
)
def test_a_process_killed_while_it_compiles_leaves_nothing_that_hurts(tmp_path, delay):
    env = {**os.environ, "PYTHONPATH": str(ROOT), cpu.CACHE_VARIABLE: str(tmp_path)}
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM], env=env, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL
    )
    begun = b""
    while b"compiling" not in begun:
        begun += process.stderr.read(1)
    if delay == "files":
        while not list(tmp_path.rglob("*.nb*")) and process.poll() is None:
            time.sleep(0.001)
    else:
        time.sleep(delay)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    first, second = (
        program(**{cpu.CACHE_VARIABLE: str(tmp_path)}),
        program(**{cpu.CACHE_VARIABLE: str(tmp_path)}),
    )
    assert first.returncode == second.returncode == 0, first.stderr
    assert first.stdout == second.stdout != ""
    if first.stderr:  # the killed process may have been faster
        assert first.stderr.count("left unfinished") == 1
        assert "compiling" in first.stderr
    assert second.stderr == ""


def test_what_numba_is_told_of_its_own_cache_moves_nothing(tmp_path):
    settings = {cpu.CACHE_VARIABLE: str(tmp_path / "ours"), "NUMBA_CACHE_DIR": str(tmp_path / "numbas")}
    assert program(**settings).returncode == 0
    assert len(list((tmp_path / "ours" / KEY).rglob("*.nbc"))) == 1
    assert not list(tmp_path.glob("numbas/**/*.nbc"))
    assert program(**settings).stderr == ""


@pytest.mark.long
def test_another_setting_of_numba_is_another_module(tmp_path):
    """Numba would else compile into a folder that is complete, and its checksums were no longer true."""
    kept = {cpu.CACHE_VARIABLE: str(tmp_path)}
    for count, setting in enumerate(({}, {"NUMBA_CPU_NAME": "generic"}, {"NUMBA_OPT": "1"}), 1):
        assert program(**kept, **setting).stderr.count("compiling") == 1
        assert len(list(tmp_path.glob("*/" + cpu.MODULE))) == count
        for again in ({}, setting):
            assert program(**kept, **again).stderr == ""


@pytest.mark.parametrize("name", cpu.SETTINGS)
def test_the_key_of_a_module_tells_settings_of_numba_apart(name, monkeypatch):
    from numba import config

    monkeypatch.setattr(config, name, "another")
    assert cpu.module_key(TEXT) != KEY


# ---- where the cache is ----------------------------------------------------------------------------


@pytest.fixture
def homeless(monkeypatch):
    """No HOME, and a user whom nobody knows."""
    import pwd

    for name in ("HOME", "XDG_CACHE_HOME", cpu.CACHE_VARIABLE):
        monkeypatch.delenv(name, raising=False)

    def unknown(user):
        raise KeyError(user)

    monkeypatch.setattr(pwd, "getpwuid", unknown)
    monkeypatch.setattr(pwd, "getpwnam", unknown)
    cpu._warned.clear()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems have other places")
def test_where_the_cache_is(homeless, tmp_path, monkeypatch):
    with pytest.warns(UserWarning, match=f"kept in memory only: ~.*set {cpu.CACHE_VARIABLE}"):
        assert cpu.cache_folder() is None
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cpu.cache_folder() == tmp_path / "xdg" / "redundant-envs"
    monkeypatch.setenv("XDG_CACHE_HOME", "")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cpu.cache_folder() == tmp_path / ".cache" / "redundant-envs"
    monkeypatch.setenv(cpu.CACHE_VARIABLE, "~/own")
    assert cpu.cache_folder() == tmp_path / "own"
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(cpu.CACHE_VARIABLE, "here")
    assert cpu.cache_folder() == tmp_path / "here"
    monkeypatch.setenv(cpu.CACHE_VARIABLE, "~nobody_of_this_name/cache")
    with pytest.warns(UserWarning, match="kept in memory only"):
        assert cpu.cache_folder() is None


def test_a_program_runs_without_any_environment():
    text = f"""
import sys, pwd
def unknown(user):
    raise KeyError(user)
pwd.getpwuid = unknown
sys.path.insert(0, {str(ROOT)!r})
{PROGRAM}
"""
    command = [sys.executable, "-c", text]
    done = subprocess.run(command, env={}, capture_output=True, text=True, timeout=90)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("kept in memory only") == 1
    assert done.stdout


# ---- fork ------------------------------------------------------------------------------------------

needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
USED = """
scene = rde.Scene(rde.FourR((1, 1, 1, 1), (1, 1, 1, 1)), (rde.effects.ViscousFriction(0.5),), "euler")
def made():
    batch = rde.BatchSimulator(scene, 64, threads=2)
    batch.set_state(np.linspace(0, 1, 256).reshape(64, 4), np.ones((64, 4)))
    return batch
"""


@needs_fork
@pytest.mark.parametrize("leave", ["os._exit(0)", "sys.exit(0)"])
def test_a_simulator_with_threads_goes_on_in_a_forked_process(leave):
    body = f"""
def wait(pid):
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0
{USED}
batch, twin = made(), made()
for _ in range(3):
    batch.advance(), twin.advance()
pid = os.fork()
if not pid:
    import copy
    batch.advance()
    twin.advance()
    assert (batch.q == twin.q).all()
    another = copy.deepcopy(batch)
    another.advance(), batch.advance(), made().advance()
    assert (batch.q == another.q).all()
    inner = os.fork()
    if not inner:
        batch.advance(), another.advance()
        assert (batch.q == another.q).all()
        {leave}
    wait(inner)
    {leave}
wait(pid)
batch.advance(), twin.advance()
assert (batch.q == twin.q).all()
print("done")
"""
    done = program("import os, sys\nimport numpy as np\nimport redundant_envs as rde\n" + body)
    assert done.stdout == "done\n", done.stderr


@needs_fork
def test_a_process_forked_while_another_thread_compiles_can_compile(tmp_path):
    text = """
import os, sys, threading, time
import redundant_envs as rde
arm = rde.FourR((1,) * 4, (1,) * 4)
def compile(kind):
    rde.BatchSimulator(rde.Scene(arm, (rde.effects.Gravity(),), kind)).advance()
worker = threading.Thread(target=compile, args=("rk8",))
worker.start()
from redundant_envs.evaluators import cpu
while cpu._lock.acquire(blocking=False):
    cpu._lock.release()
    time.sleep(0.001)
pid = os.fork()
if not pid:
    compile("euler")
    compile("rk8")
    os._exit(0)
status = os.waitpid(pid, 0)[1]
worker.join()
compile("rk4")
print(os.waitstatus_to_exitcode(status))
"""
    done = program(text, **{cpu.CACHE_VARIABLE: str(tmp_path)})
    assert done.stdout == "0\n", done.stderr
    assert done.stderr.count("compiling") == 3


@needs_fork
def test_workers_forked_from_a_process_with_threads_step(tmp_path):
    text = (
        USED.replace("\nscene", "import numpy as np\nimport redundant_envs as rde\nscene")
        + """
import gymnasium as gym
made().advance()
make = lambda: gym.make("redundant_envs/FourRReach-v0")
make().reset(seed=0)
env = gym.vector.AsyncVectorEnv([make] * 2, context="fork")
env.reset(seed=0)
env.step(env.action_space.sample())
env.close()
print("done")
"""
    )
    assert program(text).stdout == "done\n"
