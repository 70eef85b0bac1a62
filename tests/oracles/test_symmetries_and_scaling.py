"""Oracles O10 and O11: units and mirrors."""

from dataclasses import replace

import numpy as np
from oracle_cases import ANGLES, EVERY, G, assert_within, exact, largest, motion, states

import redundant_envs as rde
from redundant_envs.effects import Gravity, PrismaticStop

COUNT = 100


def fixed(robot, method, g=G):
    return rde.Scene(robot, (Gravity(g),), method, control_dt=0.01)


def bits(q, qd):
    return np.hstack([q, qd]).view(np.int64)


@EVERY
def test_o10_units_of_mass_change_no_bit(robot):
    """m -> 4 m with Q -> 4 Q leaves the path bitwise equal, under error control and across impacts."""
    q, qd = states(robot, COUNT)
    efforts = np.random.default_rng(3).uniform(-5.0, 5.0, (COUNT, 4))
    heavy, scene = {"masses": 4.0 * np.array(robot.masses)}, exact(robot)
    if robot.kind == "RPRP":
        stops = PrismaticStop((-0.3, -0.3), (0.3, 0.3), 0.7)
        scene = replace(scene, effects=(*scene.effects, stops))
    path, scaled = motion(scene, q, qd, 0.2, efforts), motion(scene, q, qd, 0.2, 4.0 * efforts, heavy)
    assert (bits(*path) == bits(*scaled)).all()


@EVERY
def test_o11_mirrors_and_turns_are_symmetries(robot):
    """g = 0: theta -> -theta bitwise, theta + alpha and theta + 2 pi to rounding; g: theta -> pi - theta.

    The last rounds the start by 4e-16 rad, which grows to 1.5e-14 in a typical motion of 0.2 s and a little
    more in the worst of 100.
    """
    angles = ANGLES[robot.kind]
    sign = np.where(angles, -1.0, 1.0)
    q, qd = states(robot, COUNT, speed=1.0)
    efforts = np.random.default_rng(3).uniform(-2.0, 2.0, (COUNT, 4))
    different, found = {}, {"alpha": 0.0, "2 pi": 0.0}
    for scene in (fixed(robot, "rk4", 0.0), fixed(robot, "rk8", 0.0), exact(robot, 0.0)):
        path = motion(scene, q, qd, 0.2, efforts)
        mirrored = motion(scene, sign * q, sign * qd, 0.2, sign * efforts)
        back = [sign * x for x in mirrored]
        different[scene.integrator, scene.tolerance] = np.count_nonzero(bits(*path) != bits(*back))
        for name, turn in (("alpha", 0.7), ("2 pi", 2.0 * np.pi)):
            turned = motion(scene, q + turn * angles, qd, 0.2, efforts)
            error = max(largest(turned[0] - turn * angles - path[0]), largest(turned[1] - path[1]))
            found[name] = max(found[name], error)
    scene = exact(robot)
    path = motion(scene, q, qd, 0.2, efforts)
    mirrored = motion(scene, np.pi * angles + sign * q, sign * qd, 0.2, sign * efforts)
    back = np.pi * angles + sign * mirrored[0], sign * mirrored[1]
    found["pi - theta"] = max(largest(x - y) for x, y in zip(back, path, strict=True))
    assert_within(dict.fromkeys(different, 0), different)
    assert_within({"alpha": 2e-14, "2 pi": 3e-14, "pi - theta": 8e-14}, found)
