"""Fuzzing with a fixed seed; failures once found are played again. ``make fuzz`` draws fresh seeds."""

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.compiler.backends import cache
from studies.drawing import drawn_arm, own_effects

from .cases import plain, read, write
from .drawing import AUTORESETS, drawn, drawn_scene, drawn_vector
from .running import judged, run

HERE = Path(__file__).parent
OUT = HERE.parents[1] / "runs" / "fuzz"
pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning")  # NumPy warns of overflows


@pytest.fixture
def kernels_of_its_own(monkeypatch):
    """Fresh structures would drive the kernels of other tests out of their folder."""
    folder = HERE.parents[1] / ".pytest_cache" / "fuzz_kernels"
    monkeypatch.setenv(cache.CACHE_VARIABLE, str(folder))


@pytest.mark.long
@pytest.mark.usefixtures("kernels_of_its_own")
def test_cases_of_a_fixed_seed():
    tally, files = run(0, (1, 2, 3, 4, 7, 9, 12), math.inf, OUT)
    told = "\n".join(f"python -m tests.fuzz --replay {path}" for path in files)
    assert not files, f"{tally}; each failure is a file:\n{told}"
    assert tally["intervals"] > 100


@pytest.mark.long
def test_the_command_counts_what_it_did(tmp_path):
    command = [sys.executable, "-m", "tests.fuzz", "--minutes", "0", "--seed", "1", "--out", tmp_path]
    subprocess.run(command, cwd=HERE.parents[1], check=True, capture_output=True)
    found = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert found == {"seed": 1, "minutes": 0.0, "files": []}


@pytest.mark.long
@pytest.mark.usefixtures("kernels_of_its_own")
@pytest.mark.parametrize("path", sorted((HERE / "found").glob("*.json")), ids=lambda path: path.stem)
def test_mended_failures_stay_mended(path):
    assert judged(read(path)) == []


FACES = {"goal": {"goal": True, "on_bad_action": "raise", "autoreset_mode": "next_step"}} | {
    mode: {"goal": False, "on_bad_action": "terminate", "autoreset_mode": mode} for mode in AUTORESETS
}


@pytest.mark.quick("goal-0", "next_step-0")
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("face", FACES)
def test_no_order_of_calls_breaks_a_promise(face, seed):
    """Of a scene of the package, which is compiled once."""
    fixed = FACES[face] | {"num_envs": 3, "threads": 1, "max_episode_steps": 6}
    case = plain(drawn_vector(np.random.default_rng(seed), rde.load_scene("rprp_reach"), 20, **fixed))
    assert judged(case) == [], case


def test_a_case_is_its_seed_and_number_and_its_file(tmp_path):
    for number in range(6):
        texts = [repr(drawn(3, number)) for _ in range(2)]
        write(drawn(3, number), tmp_path / "case.json")
        assert {*texts, repr(read(tmp_path / "case.json"))} == {texts[0]}
    assert drawn(4, 0) != drawn(3, 0)


@pytest.mark.long
def test_every_effect_and_every_way_to_step_is_drawn():
    rng = np.random.default_rng(0)
    scenes = [drawn_scene(rng) for _ in range(120)]
    assert {type(e).__name__ for s in scenes for e in s.effects} == set(own_effects())
    assert {s.integrator for s in scenes} == {"euler", "rk4", "rk8", "dop853"}
    assert {s.tolerance is None for s in scenes} == {True, False}
    assert {s.actuation for s in scenes} == {"joint", "generalized"}
    arms = [drawn_arm(rng) for _ in range(1000)]
    assert max(max(arm.masses) / min(arm.masses) for arm in arms) > 1e10
    assert max(max(arm.lengths) / min(arm.lengths) for arm in arms) > 1e5
