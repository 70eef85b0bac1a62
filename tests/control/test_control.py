"""Poses at goals, efforts at rest, goals that can be held, and the expert that reaches nearly all of them."""

import dataclasses

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.control import holding_load, holding_poses, motor_efforts, static_efforts
from redundant_envs.control.computed_torque import ComputedTorque
from redundant_envs.control.holding import effort_limits, goal_poses, num_sheets, slider_travel
from redundant_envs.control.poses import lightest_pose, pose_at
from redundant_envs_train.rollout import expert_act, run_episodes

e = rde.effects
SCENES = {name: rde.load_scene(name) for name in ("four_r_reach", "rprp_reach", "two_r_reach")}
FOUR_R, RPRP, TWO_R = SCENES.values()
UNEQUAL = {
    "four_r_reach": rde.FourR((0.7, 0.2, 0.4, 0.9), (0.3, 0.5, 0.1, 0.25)),
    "rprp_reach": rde.RPRP((0.7, 0.2, 0.4, 0.9), (0.3, 0.15)),
    "two_r_reach": rde.TwoR((0.7, 0.2), (0.5, 0.45)),
}
every_scene = pytest.mark.parametrize("name", SCENES)


def changed(name, *effects, robot=None):
    """A reach scene in which effects replace those of the same class, or are added."""
    scene = SCENES[name]
    kept = tuple(x for x in scene.effects if not isinstance(x, tuple(map(type, effects))))
    return dataclasses.replace(scene, effects=(*kept, *effects), robot=robot or scene.robot)


def drawn_goals(count, seed, most=0.95):
    rng = np.random.default_rng(seed)
    angle, radius = rng.uniform(-np.pi, np.pi, count), np.sqrt(rng.uniform(0.01, most**2, count))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


# ---- poses at a goal: each has its tip there, and the set is complete --------------------------------


@pytest.mark.long
@every_scene
def test_every_parameter_gives_a_pose_at_the_goal_and_every_pose_is_near_one(name):
    arm, travel = UNEQUAL[name], slider_travel(SCENES[name])
    rng, joints = np.random.default_rng(1), len(arm.joints)
    psi = rng.uniform(0.0, np.pi, (400, 2))
    psi[::7, 0], psi[1::7, 1], psi[2::7, 0], psi[3::7, 1] = 0.0, 0.0, np.pi, np.pi
    psi = psi[:, : joints - 2]
    goals = np.concatenate([drawn_goals(397, 2, 0.8), [[0.0, 0.0], [0.25, 0.0], [0.0, -0.25]]])
    for sheet in range(num_sheets(arm)):
        q = goal_poses(arm, travel, goals, psi, np.full(400, sheet))
        reached = np.isfinite(q).all(axis=1)
        assert reached.mean() > 0.9
        np.testing.assert_allclose(arm.forward_kinematics(q[reached]), goals[reached], atol=1e-14)
        for joint, (low, high) in travel.items():
            assert ((q[reached, joint] >= low) & (q[reached, joint] <= high)).all()
    q = rng.uniform(-np.pi, np.pi, (15, joints))
    for joint, (low, high) in travel.items():
        q[:, joint] = rng.uniform(low, high, 15)
        q[joint::5, joint], q[joint + 1 :: 5, joint] = low, high  # stops are met exactly
    x = np.linspace(0.0, np.pi, 121)
    psi = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1)[..., : joints - 2]
    sheets = np.arange(num_sheets(arm))[:, None, None]
    turning = [k for k in range(joints) if k not in travel]
    for pose, goal in zip(q, arm.forward_kinematics(q), strict=True):
        gap = np.abs(goal_poses(arm, travel, goal, psi, sheets) - pose)
        for joint in travel:
            gap[..., joint][(pose[joint] in travel[joint]) & (gap[..., joint] > 0.0)] = np.inf
        gap[..., turning] = np.abs((gap[..., turning] + np.pi) % (2.0 * np.pi) - np.pi)
        assert gap.max(axis=-1).min() < 0.15


def test_static_efforts_are_inverse_dynamics_at_rest():
    for name, arm in UNEQUAL.items():
        q = np.random.default_rng(4).normal(size=(50, len(arm.joints)))
        scene = changed(name, e.Gravity(9.0), robot=arm)
        forces = arm.inverse_dynamics(q, 0 * q, 0 * q, g=9.0)
        np.testing.assert_allclose(static_efforts(scene, q) @ arm.motor_map.T, forces, atol=1e-12)
        np.testing.assert_allclose(static_efforts(scene, q[3]), static_efforts(scene, q)[3], rtol=1e-15)


def test_springs_and_tilted_gravity_are_part_of_the_efforts():
    spring = e.CentringSpring((30.0, 50.0), (0.0, 0.0), (0.25, 0.25))
    q = np.array([[0.0, 0.2, np.pi / 2, 0.1]])
    scene = changed("rprp_reach", spring, e.Gravity(10.0, (-1.0, 0.0)))
    # Gravity along -x: 1.5 kg pull slider 1 in, and link 2 turns back by 10 (0.5 0.25 + 0.5 0.35) N m.
    # The springs pull to 0.125 m: 60 N/m over 0.075 m inwards, 100 N/m over 0.025 m outwards.
    np.testing.assert_allclose(static_efforts(scene, q), [[-3.0, 15.0 + 4.5, -3.0, -2.5]], atol=1e-12)


def test_a_stop_pushes_and_never_pulls():
    up, down, weight, tip = np.pi / 2, -np.pi / 2, 1.5 * 9.81, 0.5 * 9.81
    q = [[up, 0.0, up, 0.0], [up, 0.25, up, 0.25], [down, 0.0, down, 0.0], [down, 0.25, down, 0.25],
         [up, 0.1, down, 0.1], [up, 0.0, down, 0.0]]  # fmt: skip
    expected = [[0, 0], [weight, tip], [-weight, -tip], [0, 0], [weight, -tip], [0, -tip]]
    np.testing.assert_allclose(motor_efforts(RPRP, np.array(q))[:, [1, 3]], expected, atol=1e-12)


# ---- goals that can be held: loads by hand, and the simulator ----------------------------------------


@pytest.mark.long
def test_goals_out_of_reach_have_no_pose_and_no_load():
    goals = np.array([[1.0001, 0.0], [0.0, 1.0], [0.0, -0.3]])
    for scene in SCENES.values():
        q, load = holding_poses(scene, goals)
        assert np.isnan(q[0]).all()
        assert load[0] == np.inf
        assert np.isfinite(q[1:]).all()
        assert holding_load(scene, goals[:1], tolerance=0.001)[0] < 1.0
        assert holding_load(scene, np.zeros((0, 2))).shape == (0,)


@pytest.mark.long
def test_loads_by_hand():
    for scene in SCENES.values():
        assert holding_load(scene, [[0.0, -1.0]]) == pytest.approx([0.0], abs=1e-6)  # it hangs straight
    # Stretched along x, 0.5 kg at every quarter of a metre: the base has the largest load.
    assert holding_load(FOUR_R, [[1.0, 0.0]]) == pytest.approx([0.5 * 9.81 * 2.5 / 20.0], abs=1e-6)
    assert holding_load(RPRP, [[0.0, 1.0]]) == pytest.approx([1.5 * 9.81 / 32.0], abs=1e-6)
    assert holding_load(TWO_R, [[1.0, 0.0]]) == pytest.approx([(0.5 + 0.75) * 9.81 / 20.0], abs=1e-6)
    # Link 2 hangs, and the base carries both masses; where link 1 does, the elbow has 0.46 of its limit.
    assert holding_load(TWO_R, [[0.5, -0.5]]) == pytest.approx([1.75 * 0.5 * 9.81 / 20.0], abs=1e-6)
    # Upright at both lower stops, hanging at both upper ones, and upright at both upper ones.
    weak = changed("rprp_reach", e.EffortLimits((20.0, 30.0, 8.0, 1e-3)))
    load = holding_load(weak, [[0.0, 0.5], [0.0, -1.0], [0.0, 1.0]])
    assert load == pytest.approx([0.0, 0.0, 0.5 * 9.81 / 1e-3], abs=1e-6)


@pytest.mark.long
@every_scene
def test_an_arm_rests_in_the_simulator_where_the_account_says_so(name):
    scene = SCENES[name]
    q, load = holding_poses(scene, drawn_goals(24, 5))
    motors = motor_efforts(scene, q)
    np.testing.assert_allclose((np.abs(motors) / effort_limits(scene)).max(axis=1), load, rtol=1e-12)
    if name == "rprp_reach":  # some lean on stops, and would fall without
        assert (np.abs(motors - static_efforts(scene, q)).max(axis=1) > 1.0).sum() >= 3
    batch = rde.BatchSimulator(scene, 24)
    batch.set_state(q, np.zeros_like(q))
    for _ in range(10):
        batch.advance(motors)
    np.testing.assert_allclose(batch.q, q, atol=1e-9)
    assert holding_load(changed(name, e.Gravity(0.0)), drawn_goals(20, 6)).tolist() == [0.0] * 20


@pytest.mark.quick("RPRPReach-v0")
@pytest.mark.parametrize("env_id", ["RPRPReach-v0", "FourRReach-v0", "TwoRReach-v0"])
def test_the_expert_holds_the_goals(env_id):
    outcome = run_episodes(env_id, expert_act(), 1000, seed=3_000_000)
    assert outcome.hold.mean() >= 0.995
    assert np.median(outcome.distance) < 1e-4


@pytest.mark.long
@every_scene
def test_the_lightest_pose_is_within_half_a_turn_and_loads_no_motor_more(name):
    scene = SCENES[name]
    limits, turning = effort_limits(scene), ~np.array(scene.robot.prismatic)
    start = np.random.default_rng(1).uniform(-9, 9, (24, len(turning)))
    goal = drawn_goals(24, 1, 0.9)
    start[:, ~turning] = 0.1
    pose, other = lightest_pose(scene, start, goal), pose_at(scene, start, goal)
    np.testing.assert_allclose(scene.robot.forward_kinematics(pose), goal, atol=1e-9)
    assert np.abs(((pose - start) @ scene.robot.motor_map)[:, turning]).max() <= np.pi + 1e-9
    light, heavy = ((np.abs(motor_efforts(scene, q)) / limits).max(axis=1) for q in (pose, other))
    assert (light <= heavy + 1e-6).all()
    assert np.median(light) < (0.8 if len(turning) > 2 else 0.9) * np.median(heavy)  # 2R has two poses alone
    beyond = np.tile((5.0, 0.0), (24, 1))  # the arm stretches towards it
    np.testing.assert_array_equal(lightest_pose(scene, start, beyond), pose_at(scene, start, beyond))


def test_the_plan_ends_in_the_pose_that_is_chosen():
    """Of two ways to a goal, elbow up and elbow down, it takes the requested one."""
    start, end = np.array([[0.3, -0.2, 0.1, 0.4]]), np.array([[0.5, 0.1, -0.3, 0.2]])
    controller = ComputedTorque(FOUR_R, pose=lambda scene, q, goal: end)
    controller.begin(start, np.array([[0.6, 0.1]]))
    batch = rde.BatchSimulator(FOUR_R, 1)
    batch.set_state(start, np.zeros((1, 4)))
    for k in range(120):
        batch.advance(effort_limits(FOUR_R) * controller.action(k * FOUR_R.control_dt, batch.q, batch.qd))
    np.testing.assert_allclose(batch.q, end, atol=1e-3)


BARE = rde.Scene(UNEQUAL["four_r_reach"])
LONG = rde.Scene(rde.Chain("RRRRR", (1.0,) * 5, (0.2,) * 5))
TILTED = rde.Scene(BARE.robot, (e.EffortLimits(1.0), e.Gravity(9.81, (0.5, -0.5))))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (BARE, "EffortLimits.limits .*None.* positive"),
        (changed("four_r_reach", e.EffortLimits((1, 0, 1, 1))), "EffortLimits.limits .*0.0.* positive"),
        (changed("four_r_reach", e.LimitSpring("joint2", -2, 2)), r"effects\[3\].*LimitSpring.* leave"),
        (changed("rprp_reach", e.PrismaticStop((0, 0), (None, 1))), "PrismaticStop.*'r1'.* give ends"),
        (changed("rprp_reach", e.PrismaticStop((0, -0.3), (1, 1))), "'r2'.* -0.3.* -0.25"),
        (dataclasses.replace(RPRP, actuation="generalized"), "actuation.* joint"),
        (lambda: holding_poses(LONG, [[0.5, 0.0]]), "Chain has 5 joints; give an arm of 2 to 4"),
        (lambda: holding_poses(RPRP, [0.5, 0.0]), r"goals .*\(2,\).* \(n, 2\)"),
        (lambda: holding_poses(RPRP, [[0.5, np.nan]]), "goals .*finite"),
        (lambda: holding_poses(RPRP, [[0.5, 0.0]], -0.1), "tolerance is -0.1"),
        (lambda: ComputedTorque(BARE), "EffortLimits"),
        (lambda: ComputedTorque(TILTED), "along x"),
    ],
)
def test_scenes_it_cannot_account_for_and_other_arguments_are_refused(given, words):
    def accounted():
        return effort_limits(given), slider_travel(given), static_efforts(given, np.zeros(4))

    with pytest.raises(ValueError, match=words):
        (accounted if isinstance(given, rde.Scene) else given)()
