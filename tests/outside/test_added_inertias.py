"""Rotors and links with inertias move as in MuJoCo, and all quantities include them."""

import copy
import dataclasses
import pickle
from collections import Counter

import gymnasium as gym
import numpy as np
import pytest
from armature import Armature, LinkInertia
from arms import ARMS

import redundant_envs as rde
import redundant_envs.backends.numpy
from redundant_envs.backends.torch import torch
from redundant_envs.control.computed_torque import ComputedTorque
from redundant_envs.effects import Effect, Inertia
from redundant_envs.lane.direct import cross_interval, fields_of
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.lane.interval import Interval
from redundant_envs.model.energy import kinetic_energy, potential_energy
from redundant_envs.model.listing import _counts
from redundant_envs.verify import Mode, verify

e = rde.effects
ROTORS = (0.12, 0.3, 0.05, 0.02)
LINKS = (0.07, 0.02, 0.11, 0.004)


def scene_of(name, stops=None, **more):
    arm = ARMS[name]
    turning = arm.prismatic.count(False)
    own = [Armature(ROTORS[: len(arm.joints)]), LinkInertia(LINKS[:turning])]
    if stops is not None and arm.sliders():
        count = len(arm.sliders())
        own.append(e.PrismaticStop((-0.1,) * count, (0.15,) * count, stops))
    return rde.Scene(arm, (e.Gravity(), *own), **more)


def states(arm, count, spread=1.0):
    rng = np.random.default_rng(5)
    shape = (count, len(arm.joints))
    joints = rng.uniform(-spread, spread, shape)
    joints[:, np.array(arm.prismatic)] *= 0.1 / spread
    return joints @ np.linalg.inv(arm.motor_map), rng.normal(size=shape), rng.normal(size=shape)


def mujoco_model(mujoco, arm):
    """A chain of bodies with a mass point each, an inertia about the joint of each link, and armatures."""
    text, before, links = "", 0.0, iter(LINKS)
    lengths = iter(arm.lengths)
    for k, slides in enumerate(arm.prismatic):
        kind = 'type="slide" axis="1 0 0"' if slides else 'type="hinge" axis="0 0 1"'
        where = 0.0 if slides else next(lengths)
        turning = 1e-14 if slides else next(links)
        inertia = f"{0.5 * turning!r} {0.5 * turning!r} {turning!r}"
        text += (
            f'<body pos="{before!r} 0 0"><joint name="j{k}" {kind} armature="{ROTORS[k]!r}"/>'
            f'<inertial pos="{where!r} 0 0" mass="{arm.masses[k]!r}" diaginertia="{inertia}"/>'
        )
        before = where
    text += "</body>" * len(arm.joints)
    motors = "".join(f'<motor joint="j{k}"/>' for k in range(len(arm.joints)))
    return mujoco.MjModel.from_xml_string(
        '<mujoco><compiler angle="radian" inertiafromgeom="false" boundinertia="0"/>'
        '<option gravity="0 -9.81 0"><flag contact="disable"/></option>'
        f"<worldbody>{text}</worldbody><actuator>{motors}</actuator></mujoco>"
    )


@pytest.mark.parametrize("name", ARMS)
def test_accelerations_agree_with_mujoco(name):
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is in the extra 'verify'")
    arm = scene_of(name).loaded_robot
    model = mujoco_model(mujoco, arm)
    data, B = mujoco.MjData(model), arm.motor_map
    q, qd, efforts = states(arm, 100, spread=6.0)
    qdd = arm.forward_dynamics(q, qd, efforts @ B.T)
    for k in range(len(q)):
        data.qpos[:], data.qvel[:], data.ctrl[:] = q[k] @ B, qd[k] @ B, efforts[k]
        mujoco.mj_forward(model, data)
        assert np.abs(data.qacc - qdd[k] @ B).max() <= 1e-10 * (1.0 + np.abs(data.qacc).max())


@pytest.mark.parametrize("name", ARMS)
def test_energies_and_inverse_dynamics_know_inertias(name):
    scene = scene_of(name)
    arm = scene.loaded_robot
    q, qd, Q = states(arm, 40)
    M = arm.mass_matrix(q)
    rotors = np.diag(ROTORS[: len(arm.joints)])
    B = arm.motor_map
    turning = [k for k, slides in enumerate(arm.prismatic) if not slides]
    links = sum(
        inertia * np.outer(b, b)
        for n, inertia in enumerate(LINKS[: len(turning)])
        for b in [B[:, turning[: n + 1]].sum(axis=1)]
    )
    np.testing.assert_allclose(
        M, ARMS[name].mass_matrix(q) + B @ rotors @ B.T + links, rtol=1e-14, atol=1e-15
    )
    energy = 0.5 * np.einsum("ni,nij,nj->n", qd, M, qd)
    np.testing.assert_allclose(kinetic_energy(scene, q, qd), energy, rtol=1e-13)
    back = arm.inverse_dynamics(q, qd, arm.forward_dynamics(q, qd, Q))
    assert np.abs(back - Q).max() < 1e-12


@pytest.mark.parametrize(
    ("name", "stops"),
    [
        ("4R", None),
        ("RRP", 0.5),
        *(pytest.param(name, None, marks=pytest.mark.long) for name in ARMS if name != "4R"),
        pytest.param("RPRP", 0.5, marks=pytest.mark.long),
    ],
)
def test_a_scene_with_inertias_is_verified(name, stops):
    assert verify(scene_of(name, stops, integrator="rk8"), 128, Mode.QUICK).misses == ()


@pytest.mark.parametrize("types", ["PR", "PPR"])
def test_the_angular_momentum_of_a_cart_counts_what_turns_and_not_what_slides(types):
    arm = rde.Chain(types, masses=(1.0, 0.7, 0.5)[: len(types)], lengths=(0.3,))
    rotors, link = Armature((9.0,) * (len(types) - 1) + (0.2,)), LinkInertia((0.1,))
    q, qd = np.full((1, len(types)), 0.3), np.zeros((1, len(types)))
    qd[0, -1] = 2.0
    bare, loaded = (rde.Scene(arm, own).loaded_robot.angular_momentum(q, qd) for own in ((), (rotors, link)))
    assert abs(loaded - bare - 2.0 * (0.2 + 0.1)) < 1e-14
    assert verify(rde.Scene(arm, (e.Gravity(), rotors, link)), 32, Mode.QUICK).misses == ()


@pytest.mark.parametrize("name", ["RPRP", pytest.param("RRP", marks=pytest.mark.long)])
def test_elastic_stops_keep_the_energy_of_rotors(name):
    scene = scene_of(name, 1.0, tolerance=1e-9)
    n = len(scene.robot.joints)
    motion = rde.simulate(scene, [0.1] * n, [1.0, 1.5, -1.0, 0.5][:n], np.linspace(0.0, 2.0, 101))
    assert len(motion.events) > 5
    total = motion.kinetic_energy + motion.potential_energy
    assert np.abs(total - total[0]).max() < 1e-8 * np.abs(total).max()


@pytest.mark.parametrize("name", ["4R", "RPRP"])
def test_evaluators_agree_with_inertias(name):
    scene = scene_of(name, 0.5, integrator="rk4")
    q, qd, efforts = states(scene.robot, 16)
    batch = rde.BatchSimulator(scene, 16)
    batch.set_state(q, qd)
    batch.advance(efforts)
    compiled = np.concatenate([batch.q, batch.qd], axis=1)
    dynamics = Dynamics(scene)
    table = np.concatenate([q, qd, efforts], axis=1).T
    for convert in (np.ascontiguousarray, lambda x: torch.tensor(np.ascontiguousarray(x))):
        names = (*dynamics.states, *dynamics.commands)
        fields = {**fields_of(dynamics), **{k: convert(x) for k, x in zip(names, table, strict=True)}}
        with np.errstate(all="ignore"):
            lane = cross_interval(Interval(dynamics), fields)
        found = np.stack([np.asarray(lane[s]) for s in dynamics.states], axis=1)
        assert np.abs(found - compiled).max() <= 1e-12 * np.abs(compiled).max()


@pytest.mark.parametrize("name", ["4R", "RPRP"])
def test_lanes_have_inertias_of_their_own_and_zero_is_none(name):
    arm, rotors = ARMS[name], np.linspace(0.0, 1.0, 16)
    scene = rde.Scene(arm, (e.Gravity(), Armature(0.3)), "rk4")
    q, qd, efforts = states(arm, 16)

    def moved(scene, change=None):
        batch = rde.BatchSimulator(scene, 16)
        batch.set_state(q, qd)
        if change is not None:
            batch.set_parameters(change)
        batch.advance(efforts)
        return batch.q

    found = moved(scene, {"armature.inertias": np.repeat(rotors[:, None], 4, axis=1)})
    for lane in (3, 15):
        alike = dataclasses.replace(scene, effects=(e.Gravity(), Armature(float(rotors[lane]))))
        np.testing.assert_array_equal(found[lane], moved(alike)[lane])
    bare = rde.Scene(arm, (e.Gravity(),), "rk4")
    assert np.abs(found[0] - moved(bare)[0]).max() < 1e-13
    assert np.abs(found[15] - moved(bare)[15]).max() > 1e-4


def test_gradients_by_an_inertia_are_those_of_differences():
    scene = rde.Scene(ARMS["4R"], (e.Gravity(), Armature(0.2)), "rk8")
    step = rde.torch_step(scene)
    q, qd = torch.tensor([[0.1, 0.5, 1.0, 1.3]], dtype=torch.float64), torch.ones((1, 4), dtype=torch.float64)

    def tip(inertia):
        return step(q, qd, 0.0 * q, {"armature.inertias": inertia})[0].sum()

    inertia = torch.full((4,), 0.2, dtype=torch.float64, requires_grad=True)
    tip(inertia).backward()
    with torch.no_grad():
        step_of = 1e-5 * torch.tensor([0.0, 0.0, 1.0, 0.0], dtype=torch.float64)
        slope = (tip(inertia + step_of) - tip(inertia - step_of)) / 2e-5
    assert abs(float(inertia.grad[2] - slope)) < 1e-6 * abs(float(slope))


def test_the_bill_counts_the_mass_matrix_for_the_effect_that_needs_it():
    scene = rde.Scene(ARMS["4R"], (e.Gravity(), Armature(0.1)), "rk4")
    with_rotors, without = rde.bill(scene), rde.bill(rde.Scene(ARMS["4R"], (e.Gravity(),), "rk4"))
    assert with_rotors["armature"].divisions > 0
    assert with_rotors["arm"].additions == without["arm"].additions
    counted = sum((c for c in _counts(scene, False)[0].values()), Counter())
    for kind in ("additions", "products", "divisions", "sine_pairs"):
        assert sum(getattr(o, kind) for o in with_rotors.values()) == counted[kind]
    assert "armature" not in without
    assert "armature" in rde.listing(rde.Scene(ARMS["4R"], (Armature(0.1),), "rk4"))


def test_the_expert_holds_goals_with_rotors():
    scene = rde.load_scene("four_r_reach")
    heavy = dataclasses.replace(scene, effects=(*scene.effects, Armature((0.05, 0.03, 0.01, 0.01))))
    q, actions = np.array([[0.1, 0.4, 0.9, 1.2]]), []
    for one in (scene, heavy):
        expert = ComputedTorque(one)
        expert.begin(q, np.array([[0.8, 0.6]]))
        actions.append(expert.action(0.3, q, 0.0 * q) * expert.limits)
    arm = heavy.loaded_robot
    difference = (actions[1] - actions[0])[0]
    assert np.abs(difference).max() > 0.01
    assert arm.mass_matrix(q).shape == (1, 4, 4)


def test_a_scene_with_inertias_is_data_copied_and_pickled():
    scene = scene_of("RPRP", 0.5)
    q, qd, _ = states(scene.robot, 3)
    here = scene.loaded_robot.mass_matrix(q)
    for other in (
        pickle.loads(pickle.dumps(scene)),
        copy.deepcopy(scene),
        rde.Scene.from_dict(scene.to_dict()),
    ):
        assert other == scene
        np.testing.assert_array_equal(other.loaded_robot.mass_matrix(q), here)
        np.testing.assert_array_equal(kinetic_energy(other, q, qd), kinetic_energy(scene, q, qd))
    assert potential_energy(scene, q).shape == (3,)
    batch = rde.BatchSimulator(scene, 3)
    for k, other in enumerate((batch, copy.deepcopy(batch), pickle.loads(pickle.dumps(batch)))):
        other.set_state(np.clip(q, -0.1, 0.15), qd)
        other.advance()
        np.testing.assert_array_equal(other.q, batch.q, err_msg=str(k))


def test_inertias_of_an_environment_are_parameters_of_an_episode():
    scene = rde.load_scene("four_r_reach")
    light = dataclasses.replace(scene, effects=(*scene.effects, Armature(0.0)))
    env = gym.make("redundant_envs/FourRReach-v0", scene=light.to_dict())
    tips = []
    for inertia in (0.0, 0.5):
        env.reset(seed=3, options={"parameters": {"armature.inertias": inertia}})
        for _ in range(10):
            env.step(np.full(4, 0.5, np.float32))
        tips.append(env.unwrapped.tip)
    assert np.abs(tips[0] - tips[1]).max() > 1e-3


def test_a_negative_inertia_is_refused_where_it_is_made_and_where_it_is_set():
    @dataclasses.dataclass(frozen=True)
    class Careless(Effect):
        kg: float = 0.1

        def hooks(self, arm):
            return (Inertia((0,), ".kg"),)

    with pytest.raises(ValueError, match=r"careless.kg is -0.5; give 0 to 45000 kg m\^2, a million times"):
        rde.Scene(ARMS["RPRP"], (Careless(-0.5),))
    batch = rde.BatchSimulator(rde.Scene(ARMS["RPRP"], (Careless(),)), 2)
    with pytest.raises(ValueError, match=r"careless.kg is -0.1; give 0 to 45000 kg m\^2"):
        batch.set_parameters({"careless.kg": [0.1, -0.1]})
    with pytest.raises(ValueError, match=r"careless.kg is 1e\+06; give 0 to 45000 kg m\^2.* hide the arm"):
        batch.set_parameters({"careless.kg": 1e6})
    with pytest.raises(ValueError, match=r"careless.kg is 0.1; give 0 to 0.045 kg m\^2"):
        batch.set_parameters({"masses": [2.0, 1.5, 1.0, 5e-7]})


@pytest.mark.parametrize(
    ("joints", "inertia", "message"),
    [
        (1, ".inertia", r"joints is 1; give a tuple"),
        ((), ".inertia", r"joints is \(\); give a tuple"),
        ((1, 1), ".inertia", r"each once"),
        ((7,), ".inertia", r"joint is 7; give 0 to 3"),
        ((0, 1), ".inertia", r"which turn and slide"),
        ((0,), "inertia", r"'inertia' is not a number of this effect; it has .inertia"),
    ],
)
def test_an_inertia_that_does_not_fit_is_refused(joints, inertia, message):
    @dataclasses.dataclass(frozen=True)
    class Odd(Effect):
        inertia: float = 0.1

        def hooks(self, arm):
            return (Inertia(joints, inertia_name),)

    inertia_name = inertia
    with pytest.raises(ValueError, match=message):
        rde.Scene(ARMS["RPRP"], (Odd(),))
