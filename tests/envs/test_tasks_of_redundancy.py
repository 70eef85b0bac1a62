"""Tasks in which redundancy pays: obstacles, light motors, curves and faults."""

import contextlib
import dataclasses

import gymnasium as gym
import numpy as np
import pytest
from faces import made

import redundant_envs as rde
from redundant_envs.control import holding
from redundant_envs.effects.hooks import snake_case
from redundant_envs.envs.named import meanings
from redundant_envs.envs.registration import scene_of
from redundant_envs.simulator.batch.environment import EnvironmentKernel
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.simulator.lane.episode import Episode
from redundant_envs.tasks import OWN
from redundant_envs.tasks.checks import check_task
from redundant_envs.tasks.parts.draws import first_that_fits

LANES = 512
AROUND = "redundant_envs/FourRReachAround-v0"
HANGING = np.full(4, -np.pi / 2)


def vector(name, count=LANES, seed=11, **kwargs):
    env = gym.make_vec(f"redundant_envs/{name}-v0", num_envs=count, **kwargs).unwrapped
    return env, env.reset(seed=seed)[1]


def discs(env):
    """Centres (lanes, discs, 2) and radii (lanes, discs) of this episode."""
    numbers = env.parameters
    keys = [f"keep_out_{name}" for name in "abc"]
    centres = np.stack([numbers[f"{key}.centre"].value for key in keys], axis=1)
    return centres, np.stack([numbers[f"{key}.radius"].value for key in keys], axis=1)


def gap_of(points, env):
    """Least distance of points (lanes, n, 2) from the discs, (lanes, n)."""
    centres, radii = discs(env)
    apart = np.linalg.norm(points[:, :, None] - centres[:, None], axis=-1)
    return (apart - radii[:, None]).min(-1)


def curve(info, phase):
    """Points (lanes, n, 2) of the curves of this episode at angles (lanes, n)."""
    n = {k: np.asarray(info[k])[:, None] for k in ("along", "across", "eight", "tilt_s", "tilt_c")}
    x = n["along"] * np.cos(phase)
    y = n["across"] * np.where(n["eight"] > 0.5, np.sin(2 * phase), np.sin(phase))
    turned = np.stack([x * n["tilt_c"] - y * n["tilt_s"], x * n["tilt_s"] + y * n["tilt_c"]], axis=-1)
    return turned + np.stack([info["centre_x"], info["centre_y"]], axis=-1)[:, None]


@pytest.mark.quick("FourR")
@pytest.mark.parametrize("arm", ["FourR", "RPRP", "TwoR"])
def test_goals_are_clear_of_the_discs_and_no_start_touches_one(arm):
    env, info = vector(f"{arm}ReachAround")
    free = gap_of(env.goal[:, None], env)[:, 0]
    assert (free > 0.05).mean() > 0.99  # all but those for which none of four fits
    assert (np.asarray(info["clearance"]) > 0.0).all()
    assert not info["struck"].any()
    assert np.ptp(discs(env)[1]) > 0.05


def test_curves_are_clear_of_the_discs_and_the_target_runs_along_them():
    env, info = vector("FourRTrackAround", seed=4000)  # four of whose last centres are near a disc
    every = curve(info, np.linspace(0.0, 2 * np.pi, 60)[None])
    assert (gap_of(every, env).min(-1) > 0.03 - 1e-9).all()
    drawn = env.core.task.path({name: info[name][3] for name in env.core.task.memory if name in info})
    np.testing.assert_allclose(drawn[::8], curve(info, np.linspace(0.0, 2 * np.pi, 13)[None])[3], atol=1e-12)
    with pytest.raises(ValueError, match=r"options\['goal'\] is given, .* TrackAround computes its goal"):
        env.reset(options={"goal": (0.1, 0.2)})
    start, period, wait, rise = env.goal, 3.0, 1.5, 0.4
    for step in range(1, 121):
        _, _, _, _, info = env.step(np.zeros((LANES, 4), np.float32))
        if step * 0.02 <= wait:
            np.testing.assert_array_equal(env.goal, start)
    ramp = np.clip((np.arange(120) * 0.02 - wait) / rise, 0.0, 1.0).sum() * 0.02
    phase = np.asarray(info["phase"])
    np.testing.assert_allclose(curve(info, phase[:, None])[:, 0], env.goal, atol=1e-12)
    first = phase - np.asarray(info["spin"]) * ramp
    np.testing.assert_allclose(curve(info, first[:, None])[:, 0], start, atol=1e-9)
    np.testing.assert_allclose(np.abs(info["spin"]), 2 * np.pi / period)


def through_a_disc(**kwargs):
    """An arm that hangs and turns through disc a, and the infos of its steps."""
    env = made("single", AROUND, **kwargs)
    numbers = {"keep_out_a.centre": (0.35, -0.6), "keep_out_a.radius": 0.1}
    env.reset(seed=0, options={"q": HANGING, "parameters": numbers, "goal": (0.0, -0.9)})
    infos = []
    for _ in range(60):
        *step, info = env.step(np.array([1.0, 0.0, 0.0, 0.0], np.float32))
        infos.append((step, info))
        if step[2]:
            break
    return infos


def test_a_touch_is_told_costs_its_steps_and_halves_what_the_goal_pays():
    infos = through_a_disc(info_keys="all")
    costs = np.array([info["cost"] for _, info in infos])
    struck = np.array([info["struck"] for _, info in infos])
    touched = int(np.argmax(struck))
    assert touched > 0
    assert (costs[:touched] == 0.0).all()
    assert (costs[touched] == 1.0) & struck[touched:].all()
    assert (costs[touched:] == 0.0).any()  # it passes the disc, and that it has struck it stays
    assert not infos[-1][1]["is_success"]
    assert not any(step[2] for step, _ in infos)
    paid = np.diff([info["return_far"] for _, info in infos])
    far = 1.0 / (1.0 + (np.array([info["distance"] for _, info in infos]) / 0.5) ** 2)
    np.testing.assert_allclose(paid, 0.22 * far[1:] * np.where(struck[1:], 0.5, 1.0), rtol=1e-9)


def test_a_touch_ends_the_episode_if_it_shall():
    infos = through_a_disc(terminate_on_touch=True)
    assert infos[-1][0][2]
    assert infos[-1][1]["struck"]
    assert infos[-1][1]["numerics"] == 0
    assert len(infos) < 60
    for env_id, own in ((AROUND, False), ("redundant_envs/FourRGoalReachAround-v0", True)):
        for asked, ends in ((None, own), (False, False), (True, True)):
            env = gym.make(env_id, terminate_on_touch=asked)
            assert env.unwrapped.core.task.terminate_on_touch == ends
    with pytest.raises(ValueError, match=r"terminate_on_touch is True, and Reach has no obstacles"):
        gym.make("redundant_envs/FourRReach-v0", terminate_on_touch=True)
    with pytest.raises(ValueError, match=r"terminate_on_touch is 1; give True or False"):
        gym.make(AROUND, task={"terminate_on_touch": 1})
    with pytest.raises(
        ValueError, match=r"terminate_on_touch is True, and task\['terminate_on_touch'\] is False"
    ):
        gym.make(AROUND, terminate_on_touch=True, task={"terminate_on_touch": False})


@pytest.mark.quick("RPRP")
@pytest.mark.parametrize("arm", ["FourR", "RPRP", "TwoR"])
def test_loads_at_rest_are_the_efforts_that_hold_the_pose(arm):
    env, info = vector(f"{arm}ReachLight")
    limits = np.array([env.scene.parameters()[unit] for unit in env.scene.action_units()])
    efforts = holding.motor_efforts(env.scene, env.q)
    expected = np.abs(efforts / limits).max(axis=1)
    sliders = env.q[:, env.scene.robot.sliders()]
    inside = ((sliders > 2e-3) & (sliders < 0.248)).all(axis=1)
    np.testing.assert_allclose(np.asarray(info["load_at_rest"])[inside], expected[inside], rtol=1e-9)
    if sliders.size:
        resting = env.q.copy()
        resting[:, env.scene.robot.sliders()] = np.where(sliders > 0.125, 0.25, 0.0)
        info = env.reset(options={"q": resting})[1]
        expected = np.abs(holding.motor_efforts(env.scene, resting) / limits).max(axis=1)
        np.testing.assert_allclose(info["load_at_rest"], expected, rtol=1e-9, atol=1e-12)


def test_a_slider_does_not_lean_on_the_end_of_a_spring():
    scene = rde.load_scene("rprp_reach")
    arm, q = scene.robot, np.array([-1.5, 0.25, 0.3, 0.25])
    springs = [rde.effects.LimitSpring(arm.joints[k], 0.0, 0.25, 800.0, 10.0) for k in arm.sliders()]
    others = [effect for effect in scene.effects if not isinstance(effect, rde.effects.PrismaticStop)]
    env, _ = vector("RPRPReachLight", 1, scene=dataclasses.replace(scene, effects=(*others, *springs)))
    limits = [env.scene.parameters()[unit] for unit in env.scene.action_units()]
    efforts = np.linalg.solve(arm.motor_map, arm.gravity_forces(q))
    load = env.reset(options={"q": q[None]})[1]["load_at_rest"][0]
    assert load == pytest.approx(np.abs(efforts / limits).max(), rel=1e-9)


def test_a_goal_is_held_only_while_every_motor_is_light():
    """Without gravity an arm at its goal holds it; a motor beyond the share is heavy, and begins anew."""
    scene = rde.load_scene("four_r_reach").to_dict()
    scene["effects"] = [x for x in scene["effects"] if x["type"] != "Gravity"]
    env = made("single", "redundant_envs/FourRReachLight-v0", scene=scene)
    env.reset(seed=0)
    env.reset(seed=0, options={"q": (0.1, 0.5, 0.9, 1.2), "goal": rde.FourR((0.5,) * 4, (0.25,) * 4)
                               .forward_kinematics((0.1, 0.5, 0.9, 1.2))})  # fmt: skip
    for step in range(60):
        heavy = step == 30
        *_, info = env.step(np.array([0.0, 0.0, 0.0, 0.31 if heavy else 0.0], np.float32))
        assert info["heavy"] == heavy
        assert info["is_success"] == (24 <= step < 30), step
        assert info["cost"] == pytest.approx(0.01 if heavy else 0.0, abs=1e-6)
        if heavy:
            break


@pytest.mark.parametrize(("q", "pays"), [((2.2, 0.9, 0.9, 2.2), 0.97), ((0.0, 0.3, 0.3, 0.3), 0.37)])
def test_a_heavy_pose_pays_less_than_a_light_one_even_while_its_motors_rest(q, pays):
    """Else efforts that alternate around what holds the pose would be paid in every other step."""
    env, _ = vector("FourRReachLight", 1)
    goal = env.scene.robot.forward_kinematics(q)
    env.reset(options={"q": np.array([q]), "goal": np.array([goal])})
    reward = env.step(np.zeros((1, 4), np.float32))[1][0]
    assert reward == pytest.approx(pays, abs=0.02)


def test_a_lost_target_is_told_and_success_needs_it_never_lost():
    env, info = vector("TwoRTrack", 64)
    for step in range(70):
        *_, info = env.step(np.zeros((64, 2), np.float32))
        late = (step + 1) * 0.02 > 1.1
        np.testing.assert_array_equal(info["lost"], late & (np.asarray(info["worst"]) > 0.01))
        assert late or not info["is_success"].any()
    assert info["lost"].all()


@pytest.mark.parametrize("name", ["TwoRTrack", "FourRTrackAround"])
def test_a_fault_is_no_way_to_success(name):
    """Else an arm that has tracked for a moment would end the episode there."""
    env, _ = vector(name, 1, task={"track_tolerance": 2.0})  # no arm can lose the target
    for step in range(90):
        action = np.full((1, env.single_action_space.shape[0]), np.nan if step == 89 else 0.0, np.float32)
        *_, ended, _, info = env.step(action)
        assert info["is_success"][0] == (not ended[0] and (step + 1) * 0.02 > env.core.task.settle)
    assert ended[0]
    assert not info["lost"][0]


@pytest.mark.parametrize("effect", ["MotorBrake", "MotorLoss"])
def test_faults_are_observed_once_they_have_happened(effect):
    scene = rde.load_scene("four_r_reach_fault").to_dict()
    name = snake_case(effect)
    for entry in scene["effects"]:
        if entry["type"] == "MotorBrake":
            entry["type"] = effect
            if effect == "MotorLoss":
                del entry["grip"]
    scene["randomize"] = {f"{name}.{k.partition('.')[2]}": v for k, v in scene["randomize"].items()}
    env, info = vector("FourRReachFault", 32, scene=scene)
    joint = env.parameters[f"{name}.joint"].value.astype(int)
    at = env.parameters[f"{name}.at"].value
    assert set(joint) == {0, 1, 2, 3}
    for step in range(27):
        obs, *_, info = env.step(np.zeros((32, 4), np.float32))
        happened = (step + 1) * 0.02 >= at - 1e-12
        np.testing.assert_array_equal(info["failed"], happened)
        np.testing.assert_array_equal(obs[:, -4:], np.eye(4)[joint] * happened[:, None])
    assert info["failed"].all()


def test_the_first_candidate_that_fits_is_taken_else_the_last():
    take = first_that_fits(("x", "y"), [("x1", "y1"), ("x2", "y2"), ("x3", "y3")], ["fits1", "fits2"])
    points = (1.0, 10.0, 2.0, 20.0, 3.0, 30.0)
    for fits, k in (((1.0, 1.0), 1.0), ((0.0, 0.5), 2.0), ((-1.0, 0.0), 3.0)):
        assert take(*fits, *points) == (k, 10.0 * k)


CURVES, DISCS = ("Track", "TrackAround"), ("ReachAround", "TrackAround")
REFUSED = [
    (CURVES, {"largest": 0.05}, r"smallest is 0\.1, largest is 0\.05; smallest must be at most largest"),
    (CURVES, {"period": 1e-310}, r"period is 1e-310; it must lie in 0\.001 to 1e\+09"),
    (CURVES, {"track_tolerance": 1e300}, r"track_tolerance is 1e\+300; it must lie in 1e-09 to 2"),
    (DISCS, {"clear_margin": 1e-300}, r"clear_margin is 1e-300; it must lie in 1e-09 to 2"),
    (DISCS, {"bend": 1e300}, r"bend is 1e\+300; it must"),
    (
        DISCS,
        {"hang_low": 1.0, "hang_high": -1.0},
        r"hang_low is 1, hang_high is -1; hang_low must be at most",
    ),
    (DISCS, {"goal_margin": 1e300}, r"goal_margin is 1e\+300; it must"),
    (CURVES[1:], {"near": 0.66}, r"near is 0\.66, far is 0\.65; near must be at most far"),
    (CURVES[1:], {"near": 5.0}, r"near is 5\.0; it must"),
]


@pytest.mark.parametrize(
    ("name", "numbers", "said"), [(n, numbers, said) for names, numbers, said in REFUSED for n in names]
)
def test_curves_margins_and_starts_that_cannot_be_drawn(name, numbers, said):
    with pytest.raises(ValueError, match=rf"Task\.{said}"):
        OWN[name](**numbers)


@pytest.mark.quick("ReachFault-FourR")
@pytest.mark.parametrize("arm", ["FourR", "RPRP", "TwoR"])
@pytest.mark.parametrize("name", [name for name in OWN if "Track" not in name])
def test_a_step_that_a_fault_undoes_does_not_complete_a_hold(arm, name):
    kwargs = {"task": {"hold_speed": 10.0}, "on_bad_action": "terminate"}  # the arm falls within the step
    env = gym.make(f"redundant_envs/{arm}{name}-v0", **kwargs).unwrapped
    held = {}
    for action in (0.0, np.nan):
        env.reset(seed=3)
        env.reset(seed=3, options={"goal": env.tip + 1e-4, "qd": np.zeros(len(env.core.actions))})
        env.core.memory.write(["hold"], [[env.core.task.hold_steps - 1]], np.array([0]))
        *_, held[action == 0.0] = env.step(np.full(env.action_space.shape, action, np.float32))
    assert held[True]["is_success"]
    assert not held[False]["is_success"]
    assert held[False]["numerics"] == rde.Numerics.BAD_ACTION


@pytest.mark.parametrize("name", ["ReachAround", "TrackAround", "GoalReachAround"])
def test_a_task_without_what_it_needs_says_what_to_add(name):
    with pytest.raises(
        ValueError,
        match=rf"the task {name} needs obstacles; add KeepOut\(",
    ):
        gym.make(f"redundant_envs/FourR{name}-v0", scene="four_r_reach")
    with pytest.raises(
        ValueError,
        match=r"the task ReachFault needs a fault; add MotorBrake\(",
    ):
        gym.make("redundant_envs/FourRReachFault-v0", scene="four_r_reach")
    scene = rde.load_scene("four_r_reach").to_dict()
    scene["effects"].append({"type": "DCMotor", **rde.effects.DCMotor.example.numbers})
    with pytest.raises(ValueError, match=r"the task ReachLight counts efforts, and the motors .* take V, V"):
        gym.make("redundant_envs/FourRReachLight-v0", scene=scene)


@pytest.mark.parametrize("name", sorted(OWN))
def test_a_page_says_whether_a_reset_sets_the_goal(name):
    env = gym.make(f"redundant_envs/TwoR{name}-v0").unwrapped
    sets = "sets `q`, `qd`, `goal` and `parameters` exactly" in type(env).__doc__
    refused = pytest.raises(ValueError, match=r"options\['goal'\] is given")
    with contextlib.nullcontext() if sets else refused:
        env.reset(seed=0, options={"goal": [0.6, 0.0]})


def test_distances_from_obstacles_are_names_of_the_engine():
    task = type("NearTask", (OWN["ReachAround"],), {"memory": (*OWN["ReachAround"].memory, "near1")})()
    with pytest.raises(ValueError, match="memory has 'near1', a name of the engine"):
        check_task(task, rde.load_scene("four_r_around"))


@pytest.mark.long
def test_discs_with_contact_and_half_planes_are_obstacles_of_the_same_tasks():
    scene = rde.load_scene("four_r_around")
    e = rde.effects
    walls = e.Disc((0.55, 0.1), 0.1, along_links=True), e.HalfPlane((0.0, -1.2), along_links=True)
    kept = [x for x in scene.effects if not isinstance(x, e.KeepOut)]
    data = dataclasses.replace(scene, effects=(*kept, *walls), randomize=None).to_dict()
    env, info = vector("FourRReachAround", 8, scene=data)
    assert env.single_observation_space.shape == (20 + 3 + 2 * 4 + 1,)
    for _ in range(5):
        *_, info = env.step(np.zeros((8, 4), np.float32))
    assert (np.asarray(info["clearance"]) <= 0.21).all()  # the floor is 0.2 m below the tip that hangs


@pytest.mark.parametrize("name", sorted(OWN))
def test_numbers_of_tasks_have_units_and_sentences_and_something_reads_them(name):
    task, sentences = OWN[name](), meanings(OWN[name])
    assert {*task.numbers()} <= sentences.keys()
    assert {*task.numbers()} <= {*task.units, *task.static}
    kernel = EnvironmentKernel(Episode(Dynamics(rde.load_scene(scene_of("FourR", name))), task), 8)
    layout, read = kernel.blocks.layout, set().union(kernel.blocks.read, *kernel.blocks.reads.values())
    assert not [number for number in task.parameters() if layout.row_of(number) not in read]
    for number in task.unused:
        with pytest.raises(ValueError, match=rf"\.{number} is 0.625; it means nothing in this task"):
            OWN[name](**{number: 0.625})
        with pytest.raises(ValueError, match=f"the unknown key '{number}'"):
            gym.make(f"redundant_envs/FourR{name}-v0", task={number: 0.625})
