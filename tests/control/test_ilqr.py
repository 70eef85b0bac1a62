"""iLQR: efforts in a box, costs and their derivatives, and goals that computed torque misses."""

import dataclasses
import itertools

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.control import ComputedTorque, ReachCost, ilqr_plan, pose_at
from redundant_envs.control.box_lqr import box_minimum
from redundant_envs.control.holding import effort_limits
from redundant_envs.control.linearisation import unlimited
from studies.strength import weakened

FOUR_R, RPRP = (rde.load_scene(name) for name in ("four_r_reach", "rprp_reach"))
WEAK = {name: rde.Scene.from_dict(weakened(name, 0.5)) for name in ("four_r_reach", "rprp_reach")}


def test_the_minimum_in_a_box_is_that_of_all_sets_of_limits():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(50, 3, 3))
    h, g = root @ root.swapaxes(-1, -2) + 0.1 * np.eye(3), 3.0 * rng.normal(size=(50, 3))
    low, high = -rng.uniform(0.0, 1.0, (50, 3)), rng.uniform(0.0, 1.0, (50, 3))
    x, free = box_minimum(h, g, low, high)
    assert ((x >= low) & (x <= high)).all()
    slope = g + (h @ x[..., None])[..., 0]  # of a convex problem these conditions are enough
    np.testing.assert_allclose(slope[free], 0.0, atol=1e-6)
    assert ((x == low) & (slope > 0.0) | (x == high) & (slope < 0.0))[~free].all()
    assert 0.2 < free.mean() < 0.8


@pytest.mark.parametrize("moving", [False, True])
def test_the_cost_has_the_derivatives_it_says(moving):
    """By positions at rest alone: how the tip's velocity turns with the arm is left out."""
    rng = np.random.default_rng(1)
    cost = ReachCost(RPRP.robot, np.array([[0.5, 0.2], [-0.3, 0.4]]), hold=2)
    states, actions = 0.3 * rng.normal(size=(4, 2, 8)), rng.normal(size=(3, 2, 4))
    states[..., 4:] *= moving
    lx, lxx, lu, luu = cost.expansion(states, actions)
    for values, slope, entries in ((states, lx, range(4 * moving, 4 + 4 * moving)), (actions, lu, range(4))):
        for k, entry in itertools.product(range(len(values)), entries):
            costs = []
            for step in (1e-6, -1e-6):
                values[k, :, entry] += step
                costs.append(cost.value(states, actions))
                values[k, :, entry] -= step
            np.testing.assert_allclose(slope[k, :, entry], (costs[0] - costs[1]) / 2e-6, rtol=1e-5, atol=1e-6)
    assert (np.linalg.eigvalsh(lxx) > -1e-9).all()
    assert (luu == 2.0 * cost.effort * np.eye(4)).all()


def actions_to(scene, q, goals, intervals=100):
    """Actions of computed torque, and the end of its motion."""
    controller, limits, batch = (
        ComputedTorque(scene, pose=pose_at),
        effort_limits(scene),
        rde.BatchSimulator(scene, len(q)),
    )
    controller.begin(q, goals)
    batch.set_state(q, 0.0 * q)
    actions = []
    for k in range(intervals):
        actions.append(controller.action(k * scene.control_dt, batch.q, batch.qd).astype(float))
        batch.advance(actions[-1] * limits)
    return np.stack(actions), batch


def missed_goals(name, count):
    """Starts and goals whose computed torque ends farther than the tolerance of the task."""
    scene, rng = WEAK[name], np.random.default_rng(3)
    q = rng.uniform(-1.0, 1.0, (60, 4))
    q[:, scene.robot.sliders()] = 0.125
    angle, radius = rng.uniform(-3.0, 3.0, 60), rng.uniform(0.5, 0.85, 60)
    goals = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    _, batch = actions_to(scene, q, goals)
    far = np.linalg.norm(scene.robot.forward_kinematics(batch.q) - goals, axis=1) > 0.05
    return scene, q[far][:count], goals[far][:count]


@pytest.mark.quick("four_r_reach")
@pytest.mark.parametrize("name", WEAK)
def test_it_rests_at_goals_that_computed_torque_misses(name):
    scene, q, goals = missed_goals(name, 4)
    robot, limits, cost = scene.robot, effort_limits(scene), ReachCost(scene.robot, goals, 15)
    first, _ = actions_to(scene, q, goals)
    begun, plan = (ilqr_plan(scene, cost, q, 0.0 * q, first, rounds) for rounds in (0, 12))
    assert (plan.cost <= begun.cost).all()
    assert np.median(plan.cost / begun.cost) < 0.3
    assert np.abs(plan.actions).max() <= 1.0
    batch = rde.BatchSimulator(scene, len(q))
    batch.set_state(q, 0.0 * q)
    for k in range(100):
        batch.advance(limits * plan.action(k, batch.q, batch.qd))
    np.testing.assert_allclose(batch.q, plan.states[-1][:, :4], atol=1e-6)
    tip, speed = robot.forward_kinematics(batch.q), robot.jacobian(batch.q) @ batch.qd[..., None]
    resting = (np.linalg.norm(tip - goals, axis=1) < 0.02) & (np.linalg.norm(speed[..., 0], axis=1) < 0.1)
    assert resting.sum() >= 2


def test_the_feedback_keeps_a_disturbed_arm_on_its_motion():
    q, goals = np.array([[0.5, 0.1, -0.4, 0.1]]), np.array([[0.5, 0.4]])
    scene = WEAK["rprp_reach"]
    first, _ = actions_to(scene, q, goals)
    plan = ilqr_plan(scene, ReachCost(scene.robot, goals, 15), q, 0.0 * q, first, 5)
    ends = []
    for gain in (0.0, 1.0):
        batch, followed = rde.BatchSimulator(scene, 1), plan._replace(gains=gain * plan.gains)
        batch.set_state(q + np.array([0.05, 0.0, -0.1, 0.0]), 0.0 * q)
        for k in range(100):
            batch.advance(effort_limits(scene) * followed.action(k, batch.q, batch.qd))
        ends.append(np.linalg.norm(scene.robot.forward_kinematics(batch.q) - goals))
    assert ends[1] < 0.02 < ends[0]


def test_other_scenes_and_starts_are_refused():
    cost, q = ReachCost(FOUR_R.robot, np.zeros((1, 2)), 5), np.zeros((1, 4))
    with pytest.raises(ValueError, match="EffortLimits"):
        ilqr_plan(rde.Scene(FOUR_R.robot), cost, q, q, np.zeros((10, 1, 4)))
    with pytest.raises(ValueError, match=r"shape \(10, 2, 4\); give \(T, 1, 4\)"):
        ilqr_plan(FOUR_R, cost, q, q, np.zeros((10, 2, 4)))
    with pytest.raises(ValueError, match=r"from -1 to 1"):
        ilqr_plan(FOUR_R, cost, q, q, np.full((10, 1, 4), 1.5))
    with pytest.raises(ValueError, match=r"states .* give"):
        unlimited(
            dataclasses.replace(
                FOUR_R, effects=(*FOUR_R.effects, rde.effects.LuGre(100.0, 1.0, 0.1, 0.1, 0.2))
            )
        )
    with pytest.raises(ValueError, match="1 of 1 lanes"):
        ilqr_plan(RPRP, ReachCost(RPRP.robot, np.full((1, 2), np.nan), 5), q, q, np.zeros((10, 1, 4)))
