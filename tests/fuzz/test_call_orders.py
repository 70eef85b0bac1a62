"""Calls in any order for every face of the package's own scenes, whose structures are compiled once."""

import pytest

import redundant_envs as rde

from .drawing_calls import AUTORESETS, drawn
from .running import judged

COMMON = {"num_envs": 3, "max_episode_steps": 6, "task": {}, "autoreset_mode": "next_step", "goal": False}
FACES = {
    "simulator": {"face": "simulator", "num_envs": 3},
    "env": COMMON | {"face": "env", "on_bad_action": "raise"},
    "sb3": COMMON | {"face": "sb3", "on_bad_action": "terminate"},
    "goal": COMMON | {"face": "vector", "goal": True, "on_bad_action": "terminate"},
    **{m: COMMON | {"face": "vector", "autoreset_mode": m, "on_bad_action": "terminate"} for m in AUTORESETS},
}


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("face", FACES)
def test_no_order_of_calls_breaks_a_promise(face, seed):
    case = drawn(seed, 0, rde.load_scene("rprp_reach"), 20, **FACES[face])
    assert judged(case) == [], case
