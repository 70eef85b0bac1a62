"""What users may not give: refused by one short message, in every kind of environment; nothing changes."""

import copy
import itertools

import gymnasium as gym
import numpy as np
import pytest
from faces import FACES, FOUR_R, MODES, actions, begin, drawing, flat, made, refused, running
from gymnasium.error import ResetNeeded

import redundant_envs as rde
from redundant_envs.model import memory

GOAL_ID = "redundant_envs/RPRPGoalReach-v0"
SCENE = rde.load_scene("rprp_reach").to_dict()
NAN, HUGE = float("nan"), 10**400


def changed(**changes):
    return {"scene": {**SCENE, **changes}}


BARE = {k: v for k, v in SCENE.items() if k not in ("integrator", "substeps", "tolerance")}
VECTORS = ("next_step", "sb3")
MODE = changed(
    effects=[*SCENE["effects"], {"type": "JointVelocity", "gain": 9.0, "limits": 9.0, "speeds": 1.0}]
)
ARGUMENTS = [
    ("scene is 'nowhere'; .*rprp_reach", {"scene": "nowhere"}, FACES),
    ("no EffortLimits", {"scene": {"robot": SCENE["robot"]}}, FACES),
    ("'r1'; add a PrismaticStop", changed(effects=[{"type": "EffortLimits", "limits": 1.0}]), FACES),
    (r"effects\[0\].type is 'Gravitas'; valid: .*Gravity", changed(effects=[{"type": "Gravitas"}]), FACES),
    ("render_mode is 'ansi'", {"render_mode": "ansi"}, FACES),
    ("on_bad_action is 'ignore'.*terminate", {"on_bad_action": "ignore"}, FACES),
    ("'goal_tolerence'.*goal_tolerance", {"task": {"goal_tolerence": 1}}, FACES),
    ("task is 5; give a mapping", {"task": 5}, FACES),
    ("ReachTask.hold_steps is 1.5; give a whole number", {"task": {"hold_steps": 1.5}}, FACES),
    ("ReachTask.goal_tolerance is -1.0; it must be positive", {"task": {"goal_tolerance": -1}}, FACES),
    ("accuracy is 'fine'.*standard.*exact.*metres", {"accuracy": "fine"}, FACES),
    ("accuracy is .*one or the other", {"accuracy": "exact", "scene": {**BARE, "integrator": "rk4"}}, FACES),
    ("action is 'torque'; choose effort, joint_position, .*None", {"action": "torque"}, FACES),
    ("action is 'tip_velocity', .* has .* 'joint_velocity'", {"action": "tip_velocity", **MODE}, FACES),
    ("action is 'effort', .*; leave action out, or the effect", {"action": "effort", **MODE}, FACES),
    ("decide_every is 0; give a whole number of at least 1", {"decide_every": 0}, FACES),
    ("decide_every is 1001; give at most 1000", {"decide_every": 1001}, FACES),
    ("num_envs is 0", {"count": 0}, VECTORS),
    ("autoreset_mode is 'sometimes'", {}, ("sometimes",)),
    ("make_sb3 has no argument 'efects'; valid: scene", {"efects": 1}, ("sb3",)),
    ("monitor is 'yes'; give True or False", {"monitor": "yes"}, ("sb3",)),
    ("env_id is 'Nope-v0'; valid: ", {"env_id": "Nope-v0"}, ("sb3",)),
    ("env_id is .*; give an id", {"env_id": rde.ReachTask}, ("sb3",)),
]


@pytest.mark.filterwarnings("ignore:.*render_mode")  # Gymnasium warns before our error
@pytest.mark.parametrize(("words", "kwargs", "kinds"), ARGUMENTS, ids=[words for words, *_ in ARGUMENTS])
def test_arguments_of_make(words, kwargs, kinds):
    for kind in kinds:
        with pytest.raises(ValueError, match=words) as error:
            made(kind, **kwargs)
        assert "\n" not in str(error.value)


def test_a_limit_of_steps_is_a_whole_number():
    for kind, limit in itertools.product(
        VECTORS, (float("inf"), NAN, [1], "100", 1.5, 0, -2, True, HUGE, np.array([3]), 1j)
    ):
        with pytest.raises(ValueError, match=r"^max_episode_steps is .*; give a whole number") as error:
            made(kind, max_episode_steps=limit)
        assert len(str(error.value)) < 300
    for allowed in (None, -1, 1, 5.0, np.int64(7), 2**53):
        made("sb3", max_episode_steps=allowed).reset()


@pytest.mark.parametrize("task", ["Reach", "GoalReach"])
@pytest.mark.parametrize(("arm", "other"), [("RPRP", "FourR"), ("FourR", "RPRP")])
def test_an_id_refuses_a_scene_of_another_arm(arm, other, task):
    name = "four_r_reach" if other == "FourR" else "rprp_reach"
    env_id, fitting = (f"redundant_envs/{kind}{task}-v0" for kind in (arm, other))
    for kind, scene in itertools.product(FACES, (name, rde.load_scene(name).to_dict())):
        with pytest.raises(ValueError, match=f"scene has the arm {other}; {env_id} .* {fitting} ") as error:
            made(kind, env_id, scene=scene)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize("count", [10**9, 10**20])
def test_more_environments_than_the_machine_holds_are_refused_by_their_number(count, monkeypatch):
    monkeypatch.setattr(memory, "memory_of_machine", lambda: 8 * 10**9)
    for make in (
        lambda: rde.BatchSimulator(rde.load_scene("four_r_reach"), count),
        lambda: gym.make_vec(FOUR_R, num_envs=count),
        lambda: rde.make_sb3(FOUR_R, count),
    ):
        words = rf"num_envs is {count}; each takes \d+ bytes.*8 GB: give at most \d+"
        with pytest.raises(ValueError, match=words):
            make()


def number(**parameters):
    return {"parameters": {name.replace("__", "."): value for name, value in parameters.items()}}


OPTIONS = [
    (5, "options is 5; give a mapping"),
    ({5: 1}, "options has the unknown key 5"),
    ({"pose": 1}, "'pose'; valid: q, qd, goal"),
    ({"q": (0, 0.1, 0)}, r"q.*\(3,\).*\(4,\)"),
    ({"q": (0, NAN, 0, 0)}, "q.* non-finite"),
    ({"q": (1e30, 0.1, 0, 0.1)}, r"'q'.* 1e\+30.* 1e\+06"),
    ({"q": (0, 0.3, 0, 0)}, r"options\['q'\]: r1 is 0.3 m; its stops are at 0 and 0.25 m"),
    ({"q": (0, 0.24, 0, 0), "parameters": {"prismatic_stop.upper": (0.05, 0.2)}}, "r1 is 0.24 m.* 0.05 m"),
    ({"goal": 0.3}, r"'goal'\] is 0.3; give \(2,\)"),
    ({"goal": (3.0, 0.0)}, "goal.* 3 m from the base; the arm reaches 1 m"),
    ({"parameters": 5}, "parameters is 5; give a mapping"),
    ({"parameters": {"m4": 1, "masses[3]": 2}}, r"parameters set m4 twice, by 'm4' and 'masses\[3\]'"),
    (number(mass=1), "'mass'.*masses"),
    (number(m1=-5.0), "masses has the entry -5.0; it must be positive"),
    (number(masses=(1, 1, 1, 1e-13)), "masses spans a ratio"),
    (number(prismatic_stop__upper=(-3, 1)), "PrismaticStop.*upper.* -3"),
    (number(inner=0.96), "inner must be below outer"),
    (number(speed_bound=np.inf), "speed_bound has non-finite entries"),
    (number(hold_speed="fast"), "hold_speed is 'fast'; give real numbers"),
]


@pytest.mark.parametrize(("options", "words"), OPTIONS, ids=[words for _, words in OPTIONS])
def test_options_of_a_reset(face, options, words):
    env = running(face)
    refused(env, lambda env: begin(env, options, seed=8), words)
    if face == "next_step" and isinstance(options, dict):
        masked = {**options, "reset_mask": np.array([True, False, True])}
        refused(env, lambda env: env.reset(seed=[5, 6, 7], options=masked), words)


def test_goal_environments_keep_what_their_reward_depends_on(face):
    env = running(face, GOAL_ID)
    for name, value in {"lengths": (0.4, 0.4), "prismatic_stop.upper": 0.2, "goal_tolerance": 0.1}.items():
        options = {"parameters": {name: value}}
        words = f"parameter is '{name}'; goal environments keep travel, lengths, goal_tolerance.*task="
        refused(env, lambda env, options=options: begin(env, options), words)


def test_refused_options_of_stable_baselines3_are_forgotten_and_seeds_wait_on():
    env, twin = running("sb3"), running("sb3")
    with pytest.raises(ValueError, match="goal"):
        begin(env, [{"goal": (0.1, 0.2)}, {}, {"goal": (9.0, 9.0)}], seed=8)
    np.testing.assert_array_equal(env.reset(), begin(twin, seed=8))


def test_a_refused_first_reset_leaves_no_seed():
    env, vector = made("single"), made("next_step")
    with pytest.raises(ValueError, match="goal"):
        env.reset(seed=4, options={"goal": (9.0, 9.0)})
    assert env._np_random is env.core.generators[0] is None
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(4, np.float32))
    with pytest.raises(ValueError, match="leaves environments out of the first reset"):
        vector.reset(options={"reset_mask": np.array([True, False, True])})


@pytest.mark.parametrize("seed", [1.5, True, np.True_, -1, np.int64(-3), "7", np.float64(2.0), 1j])
def test_seeds(face, seed):
    env = running(face)
    refused(env, lambda env: begin(env, seed=seed), r"seed is .*whole number of at least 0")
    assert face != "sb3" or env._seeds == [None] * 3


CALLS = [
    ("single", {"options": {"reset_mask": [True]}}, "reset_mask.* belongs to vector"),
    ("next_step", {"options": {"reset_mask": np.zeros(3, bool)}}, "give .3,. bool with at least one True"),
    ("next_step", {"options": {"reset_mask": [1, 0, 1]}}, "reset_mask.* dtype int64"),
    ("next_step", {"options": number(hold_steps=[3, 0, 5])}, "ReachTask.hold_steps is 0.0; it must be pos"),
    ("sb3", {"options": {"reset_mask": 5}}, "unknown key 'reset_mask'"),
    ("sb3", {"options": [{}, {}]}, "options has 2 entries; give one per environment, 3"),
    ("sb3", {"options": number(masses=np.ones((2, 4)))}, r"masses has shape .*; give \(4,\) or \(3, 4\)"),
    ("next_step", {"seed": [1, True, 3]}, r"seed\[1\] is True"),
    ("next_step", {"seed": (1, 2)}, "one per environment, 3"),
    ("next_step", {"seed": np.array([1.0, 2.0, 3.0])}, r"seed\[0\] is"),
    ("next_step", {"seed": {1, 2, 3}}, "seed is"),
]


@pytest.mark.parametrize(("kind", "given", "words"), CALLS, ids=[words for *_, words in CALLS])
def test_options_and_seeds_of_some_kinds_of_environments(kind, given, words):
    refused(running(kind), lambda env: begin(env, **given), words)


def test_the_action_of_a_lane_that_begins_anew_is_ignored():
    env = running("next_step", on_bad_action="raise", max_episode_steps=3)
    bad = np.full((3, 4), NAN, np.float32)
    for action in actions(env, 2):
        env.step(action)
    env.step(bad)
    refused(env, lambda env: env.step(bad), "non-finite")


def test_goals_of_compute_reward():
    env = made("single", GOAL_ID)
    for shapes in (((5, 2), (4, 2)), ((5, 3), (5, 3)), (3, 2)):
        with pytest.raises(ValueError, match="goals have shapes"):
            env.compute_reward(*map(np.zeros, shapes), {})
    with pytest.raises(ValueError, match="compute_reward belongs to the goal environments"):
        made("sb3").compute_reward(np.zeros(2), np.zeros(2), {})


def test_a_step_needs_an_episode(kind):
    """Neither an environment without a reset, nor the state of one, has an episode."""
    env = made(kind)
    for _ in range(2):
        with pytest.raises(ResetNeeded, match="step was called before reset"):
            env.step(actions(env, 1)[0])
        unbegun = env.get_state()
        begin(env)
        env.step(actions(env, 1)[0])
        env.set_state(unbegun)


def test_pictures_need_a_reset_and_a_mode():
    env = made("single", render_mode="rgb_array")
    with pytest.raises(ResetNeeded, match="before reset"):
        env.render()
    with pytest.raises(ValueError, match="render needs render_mode"):
        running("next_step").render()


def test_an_ended_episode_is_said_to_have_ended_whatever_the_action():
    env = running("disabled", max_episode_steps=1)
    for action in (np.full((3, 4), NAN), np.zeros(2), "left"):
        refused(env, lambda env, action=action: env.step(action), r"environments \[0, 1, 2\] have ended")


OTHERS = {
    "effects": changed(effects=[{"type": "Gravity", "g": 1.6}, *SCENE["effects"][1:]]),
    "randomize": {"scene": drawing({"masses": {"uniform": [0.3, 0.7]}}, "rprp_reach")},
    "task.goal_tolerance is 0.05 there and 0.02 here": {"task": {"goal_tolerance": 0.05}},
    "max_episode_steps is 50.0 there": {"max_episode_steps": 50},
    "of another scene": {"env_id": FOUR_R},
}


@pytest.mark.parametrize(("words", "kwargs"), OTHERS.items(), ids=OTHERS)
def test_states_of_another_scene(words, kwargs):
    env, other = running("next_step"), running("next_step", **kwargs)
    refused(env, lambda env: env.set_state(other.get_state()), words)
    refused(other, lambda other: other.set_state(env.get_state()), "another scene")


def test_states_of_another_kind_or_number_of_environments():
    envs = [running("single"), running("next_step", count=1), running("sb3", count=1)]
    envs += [running(mode, count=3) for mode in MODES] + [running("next_step", count=9)]
    said = {}
    for a, b in itertools.permutations(range(len(envs)), 2):
        if b == 0 and a != 2:  # vectors take the state of a single environment
            continue
        said[a, b] = refused(envs[a], lambda env, b=b: env.set_state(envs[b].get_state()), "state")
    assert "num_envs is 3 there and 9 here" in said[6, 3]
    assert "autoreset_mode is same_step there and next_step here" in said[3, 4]


def tampered(env, name, value):
    """A state of an environment in which the first lane has another number."""
    twin = copy.deepcopy(env)
    twin.core.memory.write((name,), value, np.array([0]))
    return twin.get_state()


CHANGES = {
    r"is 0.5; use the mapping": lambda s: 0.5,
    r"has the keys states, parameters, ": lambda s: {k: v for k, v in s.items() if k != "keys"},
    r"\['simulator'\] is": lambda s: {**s, "simulator": "0123"},
    r"\['states'\] has a .* not finite": lambda s: {**s, "states": s["states"] + np.nan},
    r"belongs to the scene": lambda s: {**s, "parameters": 2.0 * s["parameters"]},
    r"\['keys'\] .*int64": lambda s: {**s, "keys": s["keys"].astype(np.int64)},
    r"\['generators'\] is \[5": lambda s: {**s, "generators": [5] * len(s["generators"])},
    r"\['generators'\] is None": lambda s: {**s, "generators": None},
}
IMPOSSIBLE = {
    "r1": (0.3, "r1 is 0.3 m; its stops are at"),
    "m1": (-1.0, "masses has the entry -1.0; it must be positive"),
    "viscous_friction.coefficients[0]": (-0.1, "must not be negative"),
    "steps": (np.nan, "has a steps that is not finite"),
    "theta1": (np.inf, "has a theta1 that is not finite"),
    "hold_steps": (-1.0, "ReachTask.hold_steps is -1.0; it must be positive"),
}


@pytest.mark.parametrize(("words", "change"), CHANGES.items(), ids=CHANGES)
def test_what_is_no_state(face, words, change):
    refused(running(face), lambda env: env.set_state(change(env.get_state())), f"state.*{words}")


@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_states_with_numbers_that_no_motion_has(face, name):
    value, words = IMPOSSIBLE[name]
    refused(running(face), lambda env: env.set_state(tampered(env, name, value)), words)


def test_actions_are_not_kept_for_the_second_half_of_a_step():
    env = running("sb3", on_bad_action="raise")
    twin = copy.deepcopy(env)
    for one in (env, twin):
        one.step_async(np.full((3, 4), 0.2, np.float32))
    with pytest.raises(ValueError, match="non-finite"):
        env.step_async(np.full((3, 4), NAN, np.float32))
    assert flat(env.step_wait()) == flat(twin.step_wait())
