"""A minute of fuzzing: a fixed seed and a fresh one; failures once found are played again."""

import secrets
import time
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from redundant_envs.backends import cache

from . import cases
from .drawing import drawn_scene, own_effects
from .drawing_calls import drawn
from .minimising import minimised
from .running import judged, run

HERE = Path(__file__).parent
OUT = HERE.parents[1] / "runs" / "fuzz"
pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning")  # NumPy warns of overflows


@pytest.fixture(autouse=True)
def kernels_of_its_own(monkeypatch):
    """Fresh structures would drive the kernels of other tests out of their folder."""
    folder = HERE.parents[1] / ".pytest_cache" / "fuzz_kernels"
    monkeypatch.setenv(cache.CACHE_VARIABLE, str(folder))


def fuzzed(seed, numbers, seconds):
    """Nothing fails in the cases of a seed; a failure names its file."""
    tally, files = run(seed, numbers, time.monotonic() + seconds, OUT, lambda *_: None, seconds=15.0)
    told = "\n".join(f"python -m tests.fuzz --replay {path}" for path in files)
    assert not files, f"seed {seed}: {tally.failures}; each failure is a file:\n{told}"
    return tally


def test_cases_of_a_fixed_seed():
    tally = fuzzed(0, iter(range(12)), 60.0)
    assert tally.intervals > 100


def test_cases_of_a_fresh_seed():
    seed = secrets.randbelow(2**31)
    print(f"fuzz: seed {seed}")
    fuzzed(seed, count(), 16.0)


def test_mended_failures_stay_mended():
    for path in sorted((HERE / "found").glob("*.json")):
        assert judged(cases.read(path)) == [], path.name


# ---- drawing, files, making small -----------------------------------------------------------------------


def test_a_case_is_its_seed_and_number_and_its_file(tmp_path):
    for number in range(6):
        case = drawn(3, number)
        assert drawn(3, number) == case
        cases.write(case, tmp_path / "case.json")
        assert cases.read(tmp_path / "case.json") == case
    assert drawn(4, 0) != drawn(3, 0)


def test_numbers_of_a_case_keep_all_digits():
    table = np.array([[np.nan, np.inf, -np.inf, 5e-324], [-0.0, 1e300, 0.1 + 0.2, -1.0]])
    again = cases.numbers(cases.plain(table))
    np.testing.assert_array_equal(again, table)
    np.testing.assert_array_equal(np.signbit(again), np.signbit(table))


def test_every_effect_and_every_way_to_step_is_drawn():
    rng = np.random.default_rng(0)
    scenes = [drawn_scene(rng) for _ in range(400)]
    assert {type(e).__name__ for s in scenes for e in s.effects} == set(own_effects())
    assert {s.integrator for s in scenes} == {"euler", "rk4", "rk8", "dop853"}
    assert {s.tolerance is None for s in scenes} == {True, False}
    assert {s.actuation for s in scenes} == {"joint", "generalized"}
    assert max(max(s.robot.masses) / min(s.robot.masses) for s in scenes) > 1e10
    assert max(max(s.robot.lengths) / min(s.robot.lengths) for s in scenes) > 1e5
    assert min(len(s.effects) for s in scenes) <= 1


def test_lanes_of_a_case_take_their_rows_along():
    case = {"num_envs": 3, "calls": [
        {"call": "set_state", "q": [[0.0], [1.0], [2.0]], "qd": [[3.0], [4.0], [5.0]]},
        {"call": "set_parameters", "lanes": [2, 0], "parameters": {"g": [[7.0], [8.0]], "m": 1.0},
         "of_lanes": ["g"]},
        {"call": "set_state", "lanes": [1], "q": [[9.0]], "qd": [[9.0]]},
    ]}  # fmt: skip
    made = cases.with_lanes(case, [2, 0])
    assert made["num_envs"] == 2
    assert made["calls"][0]["q"] == [[2.0], [0.0]]
    assert made["calls"][1] == {
        "call": "set_parameters", "lanes": [0, 1], "parameters": {"g": [[7.0], [8.0]], "m": 1.0},
        "of_lanes": ["g"],
    }  # fmt: skip
    assert len(made["calls"]) == 2


def test_a_failing_case_is_made_small():
    """To the one lane, the one call and the one effect that it needs."""
    case = next(c for c in (drawn(5, n) for n in range(0, 100, 5)) if c["num_envs"] > 8)
    case["scene"]["effects"] = [{"type": "Gravity", "g": 1.0, "down": [0.0, -1.0]},
                                {"type": "ViscousFriction", "coefficients": [0.0] * 4}]  # fmt: skip
    case["calls"] += [{"call": "copy"}, {"call": "save"}]
    case["calls"][0]["q"][4][0] = 77.0

    def fails(c):
        effects = [e["type"] for e in c["scene"]["effects"]]
        return (
            any(row[0] == 77.0 for row in c["calls"][0]["q"])
            and "ViscousFriction" in effects
            and any(call["call"] == "copy" for call in c["calls"])
        )

    small = minimised(case, fails)
    assert small["num_envs"] == 1
    assert [e["type"] for e in small["scene"]["effects"]] == ["ViscousFriction"]
    assert [call["call"] for call in small["calls"]] == ["set_state", "copy"]
    assert small["threads"] == 1
