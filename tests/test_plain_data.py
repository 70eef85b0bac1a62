"""Plain data of programs: whatever it holds, one short ValueError, at once."""

import math
import time

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from refusals import ANYTHING, refusal, short

import redundant_envs as rde

e = rde.effects


def loop():
    data = {"robot": {}}
    data["robot"]["self"] = data
    return data


def deep():
    data = []
    for _ in range(100_000):
        data = [data]
    return data


def with_scene(**changes):
    return {"robot": {"type": "FourR", "masses": [1] * 4, "lengths": [1] * 4}, **changes}


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (loop(), "nested more than"),
        (with_scene(effects=deep()), "nested more than"),
        (with_scene(effects=[0] * 10_000_000), "more than 3000 values"),
        (with_scene(robot=5), "robot is 5; give a mapping"),
        (with_scene(effects="Gravity"), "effects is 'Gravity'"),
        (with_scene(effects={"type": "Gravity"}), "effects is {'type': 'Gravity'}"),
        (with_scene(effects=[None]), "effects[0] is None"),
        (with_scene(effects=[{"type": 5}]), "effects[0].type is 5"),
        (with_scene(integrator=["rk8"]), "integrator is ['rk8']"),
        (with_scene(actuation=np.zeros(3)), "actuation is array"),
        (with_scene(substeps=2**70), "substeps is 1180591620717411303424; give a whole number from 1 to"),
        (with_scene(substeps=10**5000), "substeps is an integer of 16610 bits"),
        (with_scene(substeps=1.5), "substeps is 1.5; give a whole number"),
        (with_scene(control_dt=10**400), "control_dt is an integer of"),
        (with_scene(control_dt=1e300), "control_dt is 1e+300 s; it must lie in"),
        (with_scene(control_dt=1e-300), "control_dt is 1e-300 s; it must lie in"),
        (with_scene(tolerance=True), "tolerance is True"),
        ({1: 2}, "unknown key 1"),
        ({("a", "b"): 2}, "unknown key ('a', 'b')"),
        (5, "scene is 5; give a mapping"),
    ],
    ids=lambda v: v if isinstance(v, str) else "",
)
def test_bad_plain_data_is_one_short_error(data, words):
    start = time.process_time()
    message = refusal(rde.Scene.from_dict, data)
    assert time.process_time() - start < 1.0
    assert words in message
    assert short(message)


@pytest.mark.parametrize(
    "masses",
    [np.ones((4, 1)), np.array(1.0), {1: 1, 2: 1, 3: 1, 4: 1}, {1, 2, 3, 4}, "1111", 5, None,
     np.array(["1"] * 4), iter([1, 1, 1, 1]), [1, 10**400, 1, 1], (1, math.nan, 1, 1),
     (object(), 1, 1, 1)],
)  # fmt: skip
def test_what_is_no_sequence_of_finite_numbers_is_refused_by_name(masses):
    message = refusal(rde.RPRP, masses, (0.5, 0.5))
    assert message.startswith("masses")
    assert short(message)


EFFECTS = [
    (e.Gravity(), "give a sequence, effects=(Gravity(g=9.81"),
    (5, "effects is 5; give a sequence"),
    ("Gravity", "effects is 'Gravity'; give a sequence"),
    (["Gravity"], "effects[0] is 'Gravity'; give an effect, such as Gravity()"),
    ([e.Gravity], "effects[0] is <class"),
    ([e.LimitSpring("r1", 0.0, 1.0)], "coordinate is 'r1'; FourR has joint1, joint2, joint3, joint4"),
    ([e.LimitSpring(["joint1"], 0.0, 1.0)], "coordinate is ['joint1']; FourR has joint1"),
]


@pytest.mark.parametrize(("effects", "words"), EFFECTS, ids=lambda v: v if isinstance(v, str) else "")
def test_bad_effects_say_what_to_write(effects, words):
    assert words in refusal(rde.Scene, rde.FourR((1,) * 4, (1,) * 4), effects)


TASKS = [
    (5, "task is 5; give a mapping"),
    ([("inner", 0.1)], "task is [('inner', 0.1)]; give a mapping"),
    ({"hold_steps": 1.5}, "ReachTask.hold_steps is 1.5; give a whole number"),
    ({"hold_steps": 2**70}, "ReachTask.hold_steps is 1.1805916207174113e+21; it must lie in 1 to 1e+09"),
    ({5: 1}, "unknown key 5"),
    ({"inner": "small"}, "ReachTask.inner is 'small'; give a finite number"),
    ({"goal_tolerance": 1e200}, "ReachTask.goal_tolerance is 1e+200"),
    ({"rate_scale": 5e-324}, "ReachTask.rate_scale is 5e-324"),
    ({"speed_bound": 10**400}, "ReachTask.speed_bound is an integer of"),
]


@pytest.mark.filterwarnings("ignore:.*render_mode")
@pytest.mark.parametrize(("task", "words"), TASKS, ids=lambda v: v if isinstance(v, str) else "")
def test_a_bad_task_says_what_to_write(task, words):
    env_id = "redundant_envs/RPRPReach-v0"
    assert words in refusal(lambda: gym.make(env_id, task=task))
    assert words in refusal(lambda: gym.make_vec(env_id, num_envs=2, task=task))
    assert words in refusal(lambda: rde.make_sb3(env_id, 2, task=task))


# ---- anything at all -----------------------------------------------------------------------------

NUMBERS = st.one_of(st.integers(), st.floats(), st.integers(min_value=10**400), st.booleans())
PLAIN = st.recursive(
    st.one_of(st.none(), NUMBERS, st.text(max_size=5), st.sampled_from(["FourR", "RPRP", "Gravity", "rk8"])),
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=10,
)
FOUR = st.lists(NUMBERS, min_size=4, max_size=4)
FIELDS = ("g", "down", "coordinate", "lower", "upper", "stiffness", "limits", "coefficients", "restitution")
ARM = st.fixed_dictionaries(
    {"type": st.sampled_from(["FourR", "RPRP"]) | PLAIN, "masses": FOUR | PLAIN},
    optional={"lengths": FOUR | PLAIN},
)
EFFECT = st.fixed_dictionaries(
    {"type": st.sampled_from(sorted(e.REGISTRY)) | PLAIN}, optional=dict.fromkeys(FIELDS, PLAIN)
)
SCENE = st.fixed_dictionaries(
    {"robot": ARM | PLAIN},
    optional={
        "effects": st.lists(EFFECT | PLAIN, max_size=3) | PLAIN,
        **dict.fromkeys(("integrator", "control_dt", "substeps", "tolerance", "actuation", "x"), PLAIN),
    },
)


@ANYTHING
@given(SCENE | PLAIN)
def test_plain_data_makes_a_scene_or_a_value_error(data):
    assert short(refusal(rde.Scene.from_dict, data) or "")
