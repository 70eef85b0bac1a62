"""An arm with inertias is an arm: of any kind, copied unchanged, and refused as the robot of a scene."""

import copy
import dataclasses
import pickle

import numpy as np
import pytest
from armature import Armature, LinkInertia
from arms import ARMS
from test_added_inertias import LINKS, ROTORS, scene_of

import redundant_envs as rde
from redundant_envs.algebra import physics

e = rde.effects


@physics(gives="x1 y1")
def bob(l1, s1, c1):
    return l1 * c1, l1 * s1


@physics(gives="J11 J21")
def of_bob(l1, s1, c1):
    return -l1 * s1, l1 * c1


@physics(gives="Jdqd1 Jdqd2")
def turned(J11, J21, w):
    return -J21 * w * w, J11 * w * w


@physics(gives="M11")
def inertia_of_bob(m1, l1):
    return m1 * l1 * l1


@physics(gives="h1")
def no_bias(w):
    return 0.0 * w


@physics(gives="G1")
def weight(M11, l1, s1, c1, ax, ay, more):
    return M11 / l1 * (ay * c1 - ax * s1) + more


@physics(gives="T")
def energy(M11, w):
    return 0.5 * M11 * w * w


@dataclasses.dataclass(frozen=True)
class Pendulum(rde.Arm):
    """Its weight and energy are written with its mass matrix; it has a parameter of its own."""

    more: float

    num_masses = 1
    num_lengths = 1
    coordinates = ("theta",)
    rates = ("w",)
    joints = ("hinge",)
    prismatic = (False,)
    sincos = {"theta": ("s1", "c1")}
    functions = (bob, of_bob, turned, inertia_of_bob, no_bias, weight, energy)

    def parameter_values(self):
        return {**super().parameter_values(), "more": self.more}


def test_what_an_arm_writes_with_its_mass_matrix_is_of_its_point_masses():
    scene = rde.Scene(Pendulum((1.0,), (1.0,), 2.0), (e.Gravity(), Armature(0.5)), "rk8")
    arm = scene.loaded_robot
    assert arm.mass_matrix([0.0])[0, 0] == 1.5
    assert arm.gravity_forces([0.0])[0] == pytest.approx(11.81)
    assert arm.kinetic_energy([0.0], [1.0]) == 0.75
    assert arm.forward_dynamics([0.0], [0.0], [0.0])[0] == pytest.approx(-11.81 / 1.5)
    batch = rde.BatchSimulator(scene, 1)
    batch.set_state([0.0], [0.0])
    batch.advance()
    assert batch.qd[0, 0] == pytest.approx(-11.81 / 1.5 * scene.control_dt, rel=1e-3)


def test_momentum_is_kept_without_torques_at_the_base():
    scene = rde.Scene(ARMS["4R"], (Armature(ROTORS), LinkInertia(LINKS)), "dop853")
    motion = rde.simulate(scene, [0.1, 0.8, 1.5, 2.0], [1.0, -1.0, 2.0, -2.0], np.linspace(0.0, 1.0, 11))
    arm = scene.loaded_robot
    momentum = np.einsum("nij,nj->n", arm.mass_matrix(motion.q), motion.qd)
    assert np.ptp(momentum) < 1e-9
    np.testing.assert_allclose(arm.angular_momentum(motion.q, motion.qd), momentum, rtol=1e-12)


def test_a_loaded_arm_is_copied_as_it_is_and_is_no_robot_of_a_scene():
    arm = scene_of("4R").loaded_robot
    assert arm == scene_of("4R").loaded_robot
    heavier = dataclasses.replace(arm, masses=(3.0,) * 4)
    for one in (arm, heavier):
        for other in (copy.copy(one), copy.deepcopy(one), pickle.loads(pickle.dumps(one))):
            assert other == one
            np.testing.assert_array_equal(other.mass_matrix([0.3] * 4), one.mass_matrix([0.3] * 4))
    with pytest.raises(ValueError, match="robot is a FourR with the inertias of another scene's effects"):
        rde.Scene(arm, (e.Gravity(),))
