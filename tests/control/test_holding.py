"""Which goals can be held: loads by hand, the simulator, and an optimiser that must not beat the search."""

import dataclasses
import itertools

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.control.holding import holding_load, holding_poses
from redundant_envs.control.statics import effort_limits, motor_efforts, static_efforts

e = rde.effects
SCENES = ("four_r_reach", "rprp_reach")
ONE_SHORT = (pytest.param("four_r_reach", marks=pytest.mark.long), "rprp_reach")
"""For tests in which both arms run the same code, and 4R takes ten times as long."""


def changed(name, effect):
    """A reach scene in which an effect replaces the one of the same class."""
    scene = rde.load_scene(name)
    kept = tuple(x for x in scene.effects if type(x) is not type(effect))
    return dataclasses.replace(scene, effects=(*kept, effect))


def drawn_goals(count, seed, most=0.95):
    rng = np.random.default_rng(seed)
    angle, radius = rng.uniform(-np.pi, np.pi, count), np.sqrt(rng.uniform(0.01, most**2, count))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def test_goals_out_of_reach_have_no_pose_and_no_load():
    goals = np.array([[1.0001, 0.0], [0.0, 1.0], [0.0, -0.3]])
    for name in SCENES:
        q, load = holding_poses(rde.load_scene(name), goals)
        assert np.isnan(q[0]).all()
        assert load[0] == np.inf
        assert np.isfinite(q[1:]).all()
        assert holding_load(rde.load_scene(name), goals)[0] > 1.0
        assert holding_load(rde.load_scene(name), goals[:1], tolerance=0.001)[0] < 1.0
    inner = dataclasses.replace(
        rde.load_scene("four_r_reach"), robot=rde.FourR((0.5,) * 4, (0.8, 0.1, 0.1, 0.1))
    )  # it folds to 0.5 m
    assert holding_load(inner, [[0.3, 0.0], [0.0, -0.55]]).tolist() == [np.inf, pytest.approx(0.0, abs=0.9)]


def test_a_supported_slider_needs_no_motor_and_another_does():
    scene = changed("rprp_reach", e.EffortLimits((20.0, 30.0, 8.0, 1e-3)))
    # Upright at both lower stops, hanging at both upper ones, and upright at both upper ones.
    load = holding_load(scene, [[0.0, 0.5], [0.0, -1.0], [0.0, 1.0]])
    assert load == pytest.approx([0.0, 0.0, 0.5 * 9.81 / 1e-3], abs=1e-6)


@pytest.mark.parametrize("name", SCENES)
def test_an_arm_rests_in_the_simulator_where_the_account_says_so(name):
    scene = rde.load_scene(name)
    q, load = holding_poses(scene, drawn_goals(24, 5))
    motors = motor_efforts(scene, q)
    np.testing.assert_allclose((np.abs(motors) / effort_limits(scene)).max(axis=1), load, rtol=1e-12)
    if name == "rprp_reach":  # some lean on stops, and would fall without
        leaning = np.abs(motors - static_efforts(scene, q)).max(axis=1) > 1.0
        assert leaning.sum() >= 3
    batch = rde.BatchSimulator(scene, 24)
    batch.set_state(q, np.zeros((24, 4)))
    for _ in range(10):
        batch.advance(motors)
    np.testing.assert_allclose(batch.q, q, atol=1e-9)


# ---- loads ---------------------------------------------------------------------------------------


def test_loads_by_hand():
    four_r, rprp = (rde.load_scene(name) for name in SCENES)
    for scene in (four_r, rprp):
        assert holding_load(scene, [[0.0, -1.0]]) == pytest.approx([0.0], abs=1e-6)  # it hangs straight
    # Stretched along x, 0.5 kg at every quarter of a metre: the base has the largest load.
    assert holding_load(four_r, [[1.0, 0.0]]) == pytest.approx([0.5 * 9.81 * 2.5 / 20.0], abs=1e-6)
    assert holding_load(rprp, [[0.0, 1.0]]) == pytest.approx([1.5 * 9.81 / 32.0], abs=1e-6)


@pytest.mark.parametrize("name", SCENES)
def test_without_gravity_every_goal_in_reach_is_held(name):
    assert holding_load(changed(name, e.Gravity(0.0)), drawn_goals(20, 6)).tolist() == [0.0] * 20


@pytest.mark.parametrize("name", ONE_SHORT)
def test_weaker_motors_hold_fewer_goals(name):
    goals = drawn_goals(16, 7)
    load = holding_load(rde.load_scene(name), goals)
    held = []
    for factor in (1.0, 0.25, 0.125):
        weak = changed(name, e.EffortLimits(factor * effort_limits(rde.load_scene(name))))
        np.testing.assert_array_equal(holding_load(weak, goals), load / factor)
        held.append(holding_load(weak, goals) <= 1.0)
        np.testing.assert_array_equal(held[-1], load <= factor)
    for strong, weak in itertools.pairwise(held):
        assert (strong | ~weak).all()
    assert held[0].sum() > held[1].sum() > held[2].sum()


@pytest.mark.parametrize("name", ONE_SHORT)
def test_loads_do_not_depend_on_the_grid(name):
    scene, goals = rde.load_scene(name), drawn_goals(60, 8)
    np.testing.assert_allclose(
        holding_load(scene, goals), holding_poses(scene, goals, grid=49)[1], rtol=0.0, atol=1e-3
    )


@pytest.mark.parametrize("name", ONE_SHORT)
def test_a_tolerance_finds_the_best_point_near_the_goal(name):
    scene, goals = rde.load_scene(name), drawn_goals(12, 9)
    q, load = holding_poses(scene, goals, tolerance=0.05)
    distance = np.linalg.norm(scene.robot.forward_kinematics(q) - goals, axis=1)
    assert (distance <= 0.05 + 1e-12).all()
    exact = holding_load(scene, goals)
    assert (load < exact - 1e-3).mean() > 0.7
    rng = np.random.default_rng(10)
    for turn in rng.uniform(-np.pi, np.pi, 8):
        step = 0.05 * np.sqrt(rng.random()) * np.array([np.cos(turn), np.sin(turn)])
        assert (load <= holding_load(scene, goals + step) + 1e-3).all()


# ---- an independent optimiser --------------------------------------------------------------------


def four_r_efforts(x, g=9.81):
    """Moments of the masses beyond each joint, 0.5 kg and 0.25 m each."""
    points = 0.25 * np.cumsum(np.cos(x))
    joints = np.concatenate([[0.0], points[:3]])
    return np.array([0.5 * g * (points[k:] - joints[k]).sum() for k in range(4)])


def rprp_efforts(x, g=9.81):
    theta1, r1, theta2, r2 = x
    elbow = (0.25 + r1) * np.cos(theta1)
    beyond = 0.5 * g * (0.5 + r2) * np.cos(theta2)  # masses 3 and 4 about the second joint
    base = 0.5 * g * (0.25 * np.cos(theta1) + 3.0 * elbow) + beyond
    return np.array([base, 1.5 * g * np.sin(theta1), beyond, 0.5 * g * np.sin(theta2)])


def four_r_tip(x):
    return 0.25 * np.array([np.cos(x).sum(), np.sin(x).sum()])


def rprp_tip(x):
    a, b = 0.25 + x[1], 0.25 + x[3]
    return np.array([a * np.cos(x[0]) + b * np.cos(x[2]), a * np.sin(x[0]) + b * np.sin(x[2])])


STOPS = {"free": (None, (1, -1)), "lower": (0.0, (-1,)), "upper": (0.25, (1,))}
"""For a slider: its position, and the signs of the motor efforts that the stop does not take over."""


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "efforts", "tip", "cases", "starts"),
    [
        ("four_r_reach", four_r_efforts, four_r_tip, [("free", "free")], 40),
        ("rprp_reach", rprp_efforts, rprp_tip, list(itertools.product(STOPS, repeat=2)), 6),
    ],
)
def test_an_optimiser_does_not_beat_the_search(name, efforts, tip, cases, starts):
    """SLSQP from random poses minimises the load at the goal, each slider free or at one of its stops."""
    from scipy.optimize import minimize

    scene, rng = rde.load_scene(name), np.random.default_rng(11)
    limits, goals = effort_limits(scene), drawn_goals(6, 12)
    found = np.full(6, np.inf)
    for (i, goal), (first, second) in itertools.product(enumerate(goals), cases):
        place = [None, STOPS[first][0], None, STOPS[second][0]]
        signs = [(1, -1), STOPS[first][1], (1, -1), STOPS[second][1]]
        rows = [(k, sign / limits[k]) for k in range(4) for sign in signs[k]]
        joints, scales = [k for k, _ in rows], np.array([scale for _, scale in rows])
        free = [k for k in range(4) if place[k] is None]
        pose = np.array([0.0 if x is None else x for x in place])
        ends = [(0.0, 0.25) if scene.robot.prismatic[k] else (-7.0, 7.0) for k in free]

        def full(v, pose=pose, free=free):
            x = pose.copy()
            x[free] = v[:-1]
            return x

        def loads(v, full=full, joints=joints, scales=scales):
            return efforts(full(v))[joints] * scales

        constraints = [
            {"type": "eq", "fun": lambda v, full=full, goal=goal: tip(full(v)) - goal},
            {"type": "ineq", "fun": lambda v, loads=loads: v[-1] - loads(v)},
        ]
        for _ in range(starts):
            start = np.append([rng.uniform(max(low, -3.0), min(high, 3.0)) for low, high in ends], 1.0)
            bounds = [*ends, (0.0, 9.0)]
            v = minimize(lambda v: v[-1], start, bounds=bounds, constraints=constraints, method="SLSQP").x
            inside = all(low <= x <= high for x, (low, high) in zip(v[:-1], ends, strict=True))
            if inside and np.abs(tip(full(v)) - goal).max() < 1e-8:
                found[i] = min(found[i], max(loads(v).max(), 0.0))
    least = holding_load(scene, goals)
    assert (least <= found + 1e-3).all()
    assert (found <= least + 1e-3).sum() >= 5  # the optimiser is a serious one


# ---- refusals ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (([0.5, 0.0],), ["goals", "(2,)", "(n, 2)"]),
        (([[0.5, np.nan]],), ["goals", "finite"]),
        (([[0.5, 0.0]], -0.1), ["tolerance", "-0.1"]),
        (([[0.5, 0.0]], 0.0, 2), ["grid", "2", "3"]),
    ],
)
def test_arguments_that_say_nothing_are_refused(arguments, words):
    with pytest.raises(ValueError) as error:
        holding_poses(rde.load_scene("rprp_reach"), *arguments)
    for word in words:
        assert word in str(error.value)


def test_no_goals_give_no_loads():
    assert holding_load(rde.load_scene("rprp_reach"), np.zeros((0, 2))).shape == (0,)
