"""Oracles O10 to O12: units, mirrors and the direction of time."""

from dataclasses import replace

import numpy as np
import pytest
from oracle_cases import ANGLES, EVERY, LAB, G, assert_within, exact, largest, motion, states

import redundant_envs as rde
from redundant_envs.effects import Gravity, PrismaticStop

COUNT = 100


def fixed(robot, method, g=G):
    return rde.Scene(robot, (Gravity(g),), method, control_dt=0.01)


def bits(q, qd):
    return np.hstack([q, qd]).view(np.int64)


@EVERY
def test_o10_units_of_mass_length_and_time_change_no_bit(robot):
    """m -> 4 m with Q -> 4 Q, and l -> 4 l with t -> 2 t, leave the path bitwise equal.

    Masses under error control and, on the RPRP arm, across impacts, too; lengths with equal steps, because
    a tolerance in metres is not scaled.
    """
    angles = ANGLES[robot.kind]
    q, qd = states(robot, COUNT)
    efforts = np.random.default_rng(3).uniform(-5.0, 5.0, (COUNT, 4))
    heavy = {"masses": 4.0 * np.array(robot.masses)}
    made = [fixed(robot, "rk4"), fixed(robot, "rk8"), exact(robot)]
    if robot.kind == "RPRP":
        stops = PrismaticStop((-0.3, -0.3), (0.3, 0.3), 0.7)
        made.append(replace(made[2], effects=(*made[2].effects, stops)))
    different = {}
    for scene in made:
        path = motion(scene, q, qd, 0.2, efforts)
        scaled = motion(scene, q, qd, 0.2, 4.0 * efforts, heavy)
        name = f"mass, {scene.integrator}, {scene.tolerance}, {len(scene.effects)} effects"
        different[name] = np.count_nonzero(bits(*path) != bits(*scaled))
    long = {"lengths": 4.0 * np.array(robot.lengths)}
    to_q, to_qd, to_Q = np.where(angles, 1.0, 4.0), np.where(angles, 0.5, 2.0), np.where(angles, 4.0, 1.0)
    for scene in made[:2]:
        path = motion(scene, q, qd, 0.2, efforts)
        scaled = motion(scene, q * to_q, qd * to_qd, 0.4, efforts * to_Q, long, duration=0.02)
        again = scaled[0] / to_q, scaled[1] / to_qd
        different[f"length, {scene.integrator}"] = np.count_nonzero(bits(*path) != bits(*again))
    assert_within(dict.fromkeys(different, 0), different)


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


@pytest.mark.parametrize("name", LAB)
def test_o12_motions_run_backwards_to_their_start(name):
    """2 s forward, velocities reversed, 2 s again, from the horizontal at rest.

    A Gauss method is symmetric: it returns to the digits of its solver even with steps so long that it is
    1e-9 (RPRP) or 6e-11 (4R, 1 s) from the motion. The compiled methods are not, and return to their errors.
    """
    pytest.importorskip("mpmath", reason="mpmath is in the extra 'verify'")
    from gauss import solve

    arm, seconds = LAB[name], 2.0
    q0 = np.array([0.0, 0.1, 0.0, 0.1]) * (name == "RPRP")
    found = {}
    for method, substeps in (("rk8", 4), ("rk4", 20)):
        scene = rde.Scene(arm, (Gravity(G),), method, control_dt=0.02, substeps=substeps)
        q, qd = motion(scene, q0, np.zeros(4), seconds)
        q, qd = motion(scene, q, -qd, seconds)
        found[method] = max(largest(q - q0), largest(qd))
    scene, (seconds, steps) = exact(arm), {"RPRP": (2.0, 10), "FourR": (1.0, 20)}[name]
    q, qd = solve(scene, q0, [0.0] * 4, seconds, steps, digits=16)
    truth = motion(scene, q0, np.zeros(4), seconds)[0][0]
    found["gauss, forward"] = largest(np.array(q, float) - truth)
    q, qd = solve(scene, q, [-v for v in qd], seconds, steps, digits=16)
    found["gauss"] = max(float(abs(x - x0)) for x, x0 in zip((*q, *qd), (*q0, *[0.0] * 4), strict=True))
    bounds = {
        "RPRP": {"rk8": 2e-14, "rk4": 1e-12, "gauss, forward": 1e-8, "gauss": 1e-14},
        "FourR": {"rk8": 5e-13, "rk4": 4e-9, "gauss, forward": 3e-10, "gauss": 5e-16},
    }
    assert found["gauss, forward"] > 1e3 * found["gauss"]
    assert_within(bounds[name], found)
