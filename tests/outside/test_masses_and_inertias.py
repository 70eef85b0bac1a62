"""Loads, rotors and links with inertia: a loaded arm is, to the bit, a heavier one."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest
from arms import ARMS, LINKS, ROTORS, e, inertias, states, stops
from catalogue import COPIES, advanced

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.control.computed_torque import ComputedTorque
from redundant_envs.control.holding import static_efforts
from redundant_envs.model.energy import kinetic_energy, potential_energy

LOAD = 0.7


def heavier(arm, load=LOAD):
    return dataclasses.replace(arm, masses=(*arm.masses[:-1], arm.masses[-1] + load))


def scenes(name, load=LOAD, **more):
    """The arm with the load, and the arm that is heavier by it."""
    arm, effects = ARMS[name], [e.Gravity(), e.Tether(2, (0.3, 0.1), 200.0, 2.0), *stops(ARMS[name])]
    if arm.sliders():
        effects.append(e.LimitSpring(arm.joints[arm.sliders()[0]], -0.05, 0.05, 500.0, 5.0))
    loaded = rde.Scene(arm, (*effects, e.Payload(load)), **more)
    return loaded, rde.Scene(heavier(arm, load), tuple(effects), **more)


def with_inertias(name):
    return rde.Scene(ARMS[name], (e.Gravity(), *inertias(ARMS[name])))


def motion(scene, change=None):
    batch, _ = advanced(scene, *states(scene.robot, 16, seed=2), change, intervals=5, track_work=True)
    return np.concatenate([batch.q, batch.qd, batch.work[:, None]], axis=1)


# ---- loads ---------------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_load_moves_as_a_heavier_arm():
    loaded, heavy = scenes("RRP", tolerance=1e-6)
    np.testing.assert_array_equal(motion(loaded), motion(heavy))


@pytest.mark.long
def test_lanes_have_loads_and_masses_of_their_own():
    loads, arm = np.linspace(0.0, 2.0, 16), ARMS["4R"]
    found = motion(scenes("4R", load=0.0, integrator="rk4")[0], {"payload.mass": loads})
    for lane in (0, 15):
        heavy = scenes("4R", load=loads[lane], integrator="rk4")[1]
        np.testing.assert_array_equal(found[lane], motion(heavy)[lane])
    masses = (*arm.masses[:-1], 0.2)
    loaded, heavy = scenes("4R", load=0.3)
    light = dataclasses.replace(heavy, robot=heavier(dataclasses.replace(arm, masses=masses), 0.3))
    np.testing.assert_array_equal(motion(loaded, {"masses": masses}), motion(light))


def test_energies_and_statics_know_the_load():
    loaded, heavy = scenes("RRP")
    q, qd, _ = states(loaded.robot, 20)
    np.testing.assert_array_equal(kinetic_energy(loaded, q, qd), kinetic_energy(heavy, q, qd))
    np.testing.assert_array_equal(potential_energy(loaded, q), potential_energy(heavy, q))
    np.testing.assert_array_equal(static_efforts(loaded, q), static_efforts(heavy, q))


def test_computed_torque_carries_a_load_and_turns_rotors():
    scene = rde.load_scene("four_r_reach")
    others = {
        "loaded": dataclasses.replace(scene, effects=(*scene.effects, e.Payload(0.1))),
        "heavy": dataclasses.replace(scene, robot=heavier(scene.robot, 0.1)),
        "rotors": dataclasses.replace(scene, effects=(*scene.effects, e.Armature((0.05, 0.03, 0.01, 0.01)))),
        "bare": scene,
    }
    q, actions = np.array([[0.1, 0.4, 0.9, 1.2]]), {}
    for name, one in others.items():
        expert = ComputedTorque(one)
        expert.begin(q, np.array([[0.8, 0.6]]))
        actions[name] = expert.action(0.3, q, 0.0 * q) * expert.limits
    np.testing.assert_array_equal(actions["loaded"], actions["heavy"])
    assert np.abs(actions["rotors"] - actions["bare"]).max() > 0.01


@pytest.mark.long
def test_a_load_is_a_parameter_of_an_episode_and_zero_is_nothing():
    bare, action = rde.load_scene("four_r_reach"), np.full(4, 0.4, np.float32)
    loaded = dataclasses.replace(bare, effects=(*bare.effects, e.Payload(0.0)))
    envs = [gym.make("redundant_envs/FourRReach-v0", scene=s.to_dict()) for s in (bare, loaded)]
    seen = [(env.reset(seed=3)[0], env.step(action)[0]) for env in envs]
    np.testing.assert_array_equal(*seen)
    env = envs[1].unwrapped
    first, _ = env.reset(seed=3, options={"parameters": {"payload.mass": 1.0}})
    np.testing.assert_array_equal(first, seen[1][0])
    assert np.abs(env.step(action)[0] - seen[1][1]).max() > 1e-3
    with pytest.raises(ValueError, match="another scene"):
        envs[0].unwrapped.set_state(env.get_state())


# ---- inertias ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ARMS)
def test_energies_and_inverse_dynamics_know_inertias(name):
    scene = with_inertias(name)
    arm, B = scene.loaded_robot, scene.robot.motor_map
    q, qd, Q = states(arm, 40)
    M = arm.mass_matrix(q)
    turning = [k for k, slides in enumerate(arm.prismatic) if not slides]
    links = [B[:, turning[: n + 1]].sum(axis=1) for n in range(len(turning))]
    expected = ARMS[name].mass_matrix(q) + B @ np.diag(ROTORS[: len(arm.joints)]) @ B.T
    expected = expected + sum(inertia * np.outer(b, b) for inertia, b in zip(LINKS, links, strict=False))
    np.testing.assert_allclose(M, expected, rtol=1e-14, atol=1e-15)
    energy = 0.5 * np.einsum("ni,nij,nj->n", qd, M, qd)
    np.testing.assert_allclose(kinetic_energy(scene, q, qd), energy, rtol=1e-13)
    back = arm.inverse_dynamics(q, qd, arm.forward_dynamics(q, qd, Q))
    assert np.abs(back - Q).max() < 1e-11


def test_lanes_have_inertias_of_their_own_and_zero_is_none():
    arm, rotors = ARMS["RPRP"], np.linspace(0.0, 1.0, 16)

    def moved(*effects, change=None):
        return advanced(rde.Scene(arm, (e.Gravity(), *effects), "rk4"), *states(arm, 16), change)[0].q

    found = moved(e.Armature(0.3), change={"armature.inertias": np.repeat(rotors[:, None], 4, axis=1)})
    for lane in (3, 15):
        np.testing.assert_array_equal(found[lane], moved(e.Armature(float(rotors[lane])))[lane])
    assert np.abs(found[0] - moved()[0]).max() < 1e-13
    assert np.abs(found[15] - moved()[15]).max() > 1e-4


def test_the_bill_counts_the_mass_matrix_for_the_effect_that_needs_it():
    without, bill = (
        rde.bill(rde.Scene(ARMS["4R"], (e.Gravity(), *x), "rk4")) for x in ((), (e.Armature(0.1),))
    )
    assert bill["armature"].divisions > 0
    assert bill["arm"].additions == without["arm"].additions


# ---- arms with inertias are arms -----------------------------------------------------------------------


bob = physics(gives="x1 y1")(lambda l1, s1, c1: (l1 * c1, l1 * s1))
weight = physics(gives="G1")(lambda M11, l1, s1, c1, ax, ay, more: M11 / l1 * (ay * c1 - ax * s1) + more)
energy = physics(gives="T")(lambda M11, w1: 0.5 * M11 * w1 * w1)


@dataclasses.dataclass(frozen=True)
class Pendulum(rde.Arm):
    """Its weight and energy are written with its mass matrix; it has a parameter of its own."""

    more: float

    joint_types = "R"
    functions = (bob, weight, energy)

    def parameter_values(self):
        return {**super().parameter_values(), "more": self.more}


def test_what_an_arm_writes_with_its_mass_matrix_is_of_its_point_masses():
    scene = rde.Scene(Pendulum((1.0,), (1.0,), 2.0), (e.Gravity(), e.Armature(0.5)), "rk8")
    arm = scene.loaded_robot
    assert arm.mass_matrix([0.0])[0, 0] == 1.5
    assert arm.gravity_forces([0.0])[0] == pytest.approx(11.81)
    assert arm.kinetic_energy([0.0], [1.0]) == 0.75
    assert arm.forward_dynamics([0.0], [0.0], [0.0])[0] == pytest.approx(-11.81 / 1.5)
    batch, _ = advanced(scene, *np.zeros((3, 1, 1)))
    assert batch.qd[0, 0] == pytest.approx(-11.81 / 1.5 * scene.control_dt, rel=1e-3)


def test_a_loaded_arm_is_copied_as_it_is_and_is_no_robot_of_a_scene():
    scene = with_inertias("4R")
    assert rde.Scene.from_dict(scene.to_dict()) == scene
    arm = scene.loaded_robot
    for one in (arm, dataclasses.replace(arm, masses=(3.0,) * 4)):
        for copied in COPIES.values():
            assert copied(one) == one
            np.testing.assert_array_equal(copied(one).mass_matrix([0.3] * 4), one.mass_matrix([0.3] * 4))
    with pytest.raises(ValueError, match="robot is a FourR with the inertias of another scene's effects"):
        rde.Scene(arm, (e.Gravity(),))
