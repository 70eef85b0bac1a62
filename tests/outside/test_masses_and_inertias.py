"""Loads, rotors and links with inertia: a loaded arm is, to the bit, a heavier one."""

import dataclasses

import numpy as np
import pytest
from arms import ARMS, LINKS, ROTORS, e, inertias, states
from catalogue import COPIES, advanced

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.control.computed_torque import ComputedTorque
from redundant_envs.control.holding import static_efforts
from redundant_envs.model.energy import kinetic_energy, potential_energy


def heavier(arm, load):
    return dataclasses.replace(arm, masses=(*arm.masses[:-1], arm.masses[-1] + load))


def scenes(name, load=0.7, **more):
    """The arm with the load, and the arm that is heavier by it."""
    arm = ARMS[name]
    effects = e.Gravity(), e.Tether(2, (0.3, 0.1), 200.0, 2.0), e.LimitSpring(arm.joints[-1], -0.05, 0.05)
    loaded = rde.Scene(arm, (*effects, e.Payload(load)), **more)
    return loaded, rde.Scene(heavier(arm, load), effects, **more)


def motion(scene, change=None):
    batch, _ = advanced(scene, *states(scene.robot, 16, seed=2), change, intervals=5, track_work=True)
    return np.concatenate([batch.q, batch.qd, batch.work[:, None]], axis=1)


# ---- loads ---------------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_load_moves_as_a_heavier_arm_also_where_each_lane_has_its_own():
    np.testing.assert_array_equal(*map(motion, scenes("RRP", tolerance=1e-6)))
    loads = np.linspace(0.0, 2.0, 16)
    found = motion(scenes("4R", load=0.0, integrator="rk4")[0], {"payload.mass": loads})
    for lane in (0, 15):
        heavy = scenes("4R", load=loads[lane], integrator="rk4")[1]
        np.testing.assert_array_equal(found[lane], motion(heavy)[lane])


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


# ---- inertias ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ARMS)
def test_energies_and_inverse_dynamics_know_inertias(name):
    scene = rde.Scene(ARMS[name], (e.Gravity(), *inertias(ARMS[name])))
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
    arm = rde.Scene(ARMS["4R"], (e.Gravity(), *inertias(ARMS["4R"]))).loaded_robot
    for copied in COPIES.values():
        assert copied(arm) == arm
        np.testing.assert_array_equal(copied(arm).mass_matrix([0.3] * 4), arm.mass_matrix([0.3] * 4))
    with pytest.raises(ValueError, match="robot is a FourR with added inertias"):
        rde.Scene(arm, (e.Gravity(),))
