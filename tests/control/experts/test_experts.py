"""The experts of the tasks: what they know, what they plan, and that their episodes end well."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.control import ComputedTorque
from redundant_envs.control.experts import baseline_of, expert_of
from redundant_envs.control.experts.reach_fault import ReachFault
from redundant_envs.control.experts.targets import targets_of
from redundant_envs.control.nominal import NominalModel
from redundant_envs.control.reachable_values import ReachableValues
from redundant_envs.envs.face import numbers_of
from redundant_envs.envs.registration import TASKS, scene_of
from redundant_envs.tasks import REGISTRY
from redundant_envs_train.rollout import expert_act, run_episodes

AROUND, LIGHT, FAULT = "ReachAround", "ReachLight", "ReachFault"
TRACK, TRACK_AROUND = "Track", "TrackAround"


def test_a_task_that_names_no_expert_has_computed_torque():
    scenes = {name: rde.load_scene(scene_of("FourR", name)) for name in TASKS}
    kinds = {name: type(expert_of(REGISTRY[name](), scene)) for name, scene in scenes.items()}
    assert kinds["Reach"] is ComputedTorque
    own = {name: kind.__name__ for name, kind in kinds.items() if kind is not ComputedTorque}
    assert own == {name: name for name in (AROUND, LIGHT, FAULT, TRACK, TRACK_AROUND)} | {
        "GoalReachAround": AROUND
    }


@pytest.mark.parametrize("place", ["justaname", "redundant_envs:Nobody", ""])
def test_a_task_whose_expert_cannot_be_imported_is_named(place):
    lost = type("LostTask", (rde.ReachTask,), {"name": "Lost", "expert": place})()
    with pytest.raises(
        ValueError, match=rf"LostTask.expert is '{place}', .*; give it as 'package.module:Class'"
    ):
        expert_of(lost, rde.load_scene("four_r_reach"))


@pytest.mark.quick("FourR-ReachAround-0.95-0.8", "FourR-ReachFault-0.9-0.7")
@pytest.mark.parametrize(
    ("arm", "task", "least", "most"),
    [  # the least success of the expert, and the largest of the baseline
        ("FourR", AROUND, 0.95, 0.8), ("RPRP", AROUND, 0.95, 0.85), ("TwoR", AROUND, 0.6, 0.9),
        ("FourR", LIGHT, 0.9, 0.6), ("RPRP", LIGHT, 0.8, 0.4), ("TwoR", LIGHT, 0.1, 0.5),
        ("FourR", TRACK, 0.95, 1.0), ("RPRP", TRACK, 0.95, 1.0),
        ("FourR", TRACK_AROUND, 0.95, 0.9), ("RPRP", TRACK_AROUND, 0.9, 0.8),
        ("FourR", FAULT, 0.9, 0.7), ("RPRP", FAULT, 0.8, 0.5),
    ],
)  # fmt: skip
def test_the_expert_succeeds_where_the_baseline_often_fails(arm, task, least, most):
    hold, near = (
        run_episodes(f"{arm}{task}-v0", act, 40, seed=3_000_000).hold.mean()
        for act in (expert_act(), expert_act(baseline_of))
    )
    assert hold >= least
    assert near <= most


@pytest.mark.quick("FourR-Track-given1-0.95")
@pytest.mark.parametrize(
    ("arm", "task", "given", "least"),
    [
        ("FourR", TRACK, {"max_episode_steps": 400}, 0.95),
        ("FourR", TRACK, {"task": {"wait": 1e-300}}, 0.95),
        ("FourR", TRACK, {"task": {"wait": 1e308, "rise": 1e-300}}, 0.95),  # longer than the episode
        ("TwoR", TRACK_AROUND, {"max_episode_steps": 400}, 0.6),
        ("FourR", TRACK_AROUND, {"max_episode_steps": 400, "task": {"wait": 0.01}}, 0.8),
        ("FourR", AROUND, {"max_episode_steps": 100}, 0.9),
        ("FourR", LIGHT, {"max_episode_steps": 70}, 0.95),
        ("FourR", LIGHT, {"task": {"hold_steps": 50}}, 0.95),
        ("FourR", FAULT, {"max_episode_steps": 90}, 0.9),
        ("FourR", "Reach", {"task": {"hold_steps": 50}}, 0.95),
        *((arm, "Reach", {"action": "joint_velocity", "decide_every": 5}, 0.95) for arm in ("FourR", "RPRP")),
        *((arm, AROUND, {"action": "joint_velocity", "decide_every": 5}, 0.85) for arm in ("FourR", "RPRP")),
        ("FourR", TRACK, {"action": "joint_velocity"}, 0.8),
        ("FourR", FAULT, {"action": "joint_velocity", "decide_every": 5}, 0.9),
    ],
)  # fmt: skip
def test_the_expert_plans_for_the_numbers_of_its_episodes(arm, task, given, least):
    assert run_episodes(f"{arm}{task}-v0", expert_act(), 40, seed=10, **given).hold.mean() >= least


def test_an_episode_that_is_too_long_for_a_table_is_refused():
    with pytest.raises(ValueError, match=r"max_episode_steps is 20000; Track .* at most 10000 .*give fewer"):
        run_episodes("FourRTrack-v0", expert_act(), 1, seed=10, max_episode_steps=20_000)


@pytest.mark.long
def test_targets_that_wait_differently_are_planned_each_for_itself():
    env = begun("FourRTrack-v0", 3)
    env.reset(options={"parameters": {"wait": np.array([0.01, 0.9, 9.0])}})
    numbers, expert = numbers_of(env.core), expert_of(env.core.task, env.scene)
    together = expert.plan(env.q @ expert.model.b, env.goal, numbers)
    for k in range(3):
        some = {name: x[[k]] for name, x in numbers.items()}
        alone = expert.plan(env.q[[k]] @ expert.model.b, env.goal[[k]], some)
        np.testing.assert_allclose(together.phi[[k]], alone.phi, atol=1e-9)


def begun(env_id, count):
    env = gym.make_vec(f"redundant_envs/{env_id}", num_envs=count).unwrapped
    env.reset(seed=5)
    return env


def test_targets_are_where_the_task_moves_its_goal():
    env = begun("FourRTrack-v0", 6)
    targets = targets_of(numbers_of(env.core), env.scene.control_dt, 120)
    for k in range(121):
        np.testing.assert_allclose(env.goal, targets[:, k], atol=1e-12)
        env.step(np.zeros((6, 4), np.float32))
    assert np.ptp(targets, axis=1).min() > 0.02


@pytest.mark.parametrize("env_id", ["RPRPTrack-v0", "FourRReachAround-v0"])
def test_episodes_that_begin_later_are_planned_as_those_that_begin_together(env_id):
    env = begun(env_id, 5)
    q, goal, numbers = env.q, env.goal, numbers_of(env.core)
    together, later = (expert_of(env.core.task, env.scene) for _ in range(2))
    together.begin(q, goal, None, numbers)
    other, some = np.array([0, 0, 0, 3, 0]), np.array([4, 1, 2])
    for index, lanes in ((None, other), (some, some)):
        later.begin(q[lanes], goal[lanes], index, {name: x[lanes] for name, x in numbers.items()})
    for t in (0.1, 0.5, 0.9):
        actions = (expert.action(np.full(5, t), q, 0.0 * q) for expert in (together, later))
        np.testing.assert_allclose(*actions, atol=1e-6)


def test_other_faults_than_one_brake_are_refused():
    loss = rde.effects.MotorLoss(joint=1.0, at=0.1)
    scene = rde.load_scene("four_r_reach_fault")
    for effects in (scene.effects[:-1], (*scene.effects[:-1], loss)):
        with pytest.raises(ValueError, match=r"one MotorBrake alone"):
            ReachFault(dataclasses.replace(scene, effects=effects, randomize=None))


def test_after_a_brake_the_plan_moves_the_other_joints_to_the_goal():
    scene, rng = rde.load_scene("four_r_reach_fault"), np.random.default_rng(3)
    model, expert = NominalModel(scene), ReachFault(scene)
    q, goal = rng.uniform(-1, 1, (4, 4)), np.array([[0.4, 0.2], [-0.3, 0.3], [0.2, -0.5], [0.5, 0.1]])
    joints, at = np.arange(4.0), np.array([0.1, 0.2, 0.3, 9.0])
    expert.begin(q, goal, None, {"motor_brake.joint": joints, "motor_brake.at": at})
    first = expert.following.motion.phi.copy()
    phi, k = first[np.arange(4), 10], 10  # where the arms are 0.2 s later
    expert.action(np.full(4, k * scene.control_dt), phi @ model.inverse, 0.0 * q)
    second = expert.following.motion.phi
    np.testing.assert_array_equal(second[2:], first[2:])  # their brakes are still open
    for lane in (0, 1):
        np.testing.assert_allclose(second[lane, :, lane], phi[lane, lane], atol=1e-12)
        assert np.abs(second[lane, -1] - phi[lane]).max() > 0.05
    np.testing.assert_allclose(model.tip(second[:, -1]), goal, atol=5e-3)


def test_values_of_joints_are_those_of_poses_that_count():
    model = NominalModel(rde.load_scene("rprp_reach"))
    poses = np.array([[[0.1, 0.02, -3.0, 0.25], [2.0, 0.1, 1.0, 0.2]]] * 2)
    values = ReachableValues(model, poses, np.array([[True, False], [True, True]]))
    turned = np.array([[0.1 + 4 * np.pi, 0.02, -3.0 + 2 * np.pi, 0.25], [2.0, 0.1, 1.0, 0.2]])
    assert values.include(np.stack([turned, turned])).all(axis=-1).tolist() == [[True, False], [True, True]]
    assert not values.include(np.tile([0.3, 0.05, 0.0, 0.1], (2, 1))).any()
