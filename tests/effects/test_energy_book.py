"""The energy balance: kinetic + potential - work is constant, for all effects and all declarations."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from sample_effects import (
    EVERY,
    FOUR_R,
    Q0,
    QD0,
    SoftJoint,
    StiffeningSpring,
    TipDrag,
    all_effects,
)

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.effects import Gravity
from redundant_envs.effects.hooks import Effect, Force
from redundant_envs.model.energy import kinetic_energy, potential_energy

USERS = (StiffeningSpring(8.0), TipDrag(0.3), SoftJoint())


ENGAGED = {
    # limits that the whole motion lies beyond: the same springs without their kinks
    "RPRP": {
        "limit_spring.r1.lower": -4.0, "limit_spring.r1.upper": -2.0,
        "limit_spring.r2.lower": 2.0, "limit_spring.r2.upper": 3.0,
        "limit_spring.r1.stiffness": 20.0, "limit_spring.r2.stiffness": 20.0,
        "limit_spring.r1.damping": 0.5,
    },
    "FourR": {
        "limit_spring.joint1.lower": -19.0, "limit_spring.joint1.upper": -9.0,
        "limit_spring.joint2.lower": 9.0, "limit_spring.joint2.upper": 19.0,
        "limit_spring.joint1.stiffness": 2.0, "limit_spring.joint2.stiffness": 2.0,
        "limit_spring.joint2.damping": 0.05,
    },
}  # fmt: skip


@EVERY
@pytest.mark.parametrize("actuation", ["joint", "generalized"])
def test_energy_book_closes(robot, actuation):
    """Kinetic + potential - work is constant with every effect and three of a user's at once.

    Lane 0 stays beyond its limits, where all is smooth; lane 1 crosses them, and each crossing
    costs the fixed step a little.
    """
    found = (*all_effects(robot), *USERS)
    scene = rde.Scene(robot, found, "rk8", control_dt=0.001, actuation=actuation)
    engaged = []
    for effect in found:
        own = {
            k.rsplit(".", 1)[1]: v
            for k, v in ENGAGED[robot.kind].items()
            if k.rsplit(".", 1)[0] == effect.key
        }
        engaged.append(replace(effect, **own))
    scenes = (replace(scene, effects=tuple(engaged)), scene)
    batch = rde.BatchSimulator(scene, 2, track_work=True)
    batch.set_parameters(ENGAGED[robot.kind], index=[0])
    batch.set_state(Q0, QD0)
    parts = []
    for k in range(1001):
        if k % 50 == 0:
            q, qd, work = batch.q, batch.qd, batch.work
            T = robot.kinetic_energy(q, qd)
            U = [potential_energy(s, q[i]) for i, s in enumerate(scenes)]
            parts.append((T, U, work))
        batch.advance((3.0, -0.7, 0.4, 0.5))
    T, U, work = (np.array(x) for x in zip(*parts, strict=True))
    scale = T.max(axis=0) + np.ptp(U, axis=0)
    drift = np.abs(T + U - work - (T + U - work)[0]).max(axis=0) / scale
    assert drift[0] <= 1e-9
    assert drift[1] <= 1e-5
    assert (np.ptp(work, axis=0) > 0.01 * scale).all()
    assert (np.ptp(U, axis=0) > 0.05 * scale).all()


@EVERY
def test_energy_is_kept_without_dissipation(robot):
    """Gravity, springs and no work: the balance has no work at all."""
    springs = (Gravity(9.81), StiffeningSpring(8.0))
    found = rde.simulate(rde.Scene(robot, springs, control_dt=0.002), Q0, QD0, np.linspace(0, 1, 6))
    energy = found.kinetic_energy + found.potential_energy
    assert (found.work == 0.0).all()
    assert np.abs(energy - energy[0]).max() <= 1e-11 * np.abs(found.kinetic_energy).max()


@physics
def _pull_to_zero(position):
    return -position


@physics
def _pull_energy(position):
    return 0.5 * position**2


@physics
def _pull_and_drag(gap, rate):
    return -gap - rate


@dataclass(frozen=True)
class OwnNames(Effect):
    """Its conservative part needs a quantity that the force itself does not use."""

    def hooks(self, arm):
        bind = {"gap": "theta32", "rate": "phid3", "position": "phi3"}
        return (Force(2, _pull_and_drag, bind, _pull_energy, _pull_to_zero),)


def test_the_conservative_part_may_need_quantities_of_its_own():
    scene = rde.Scene(rde.FourR((2, 1.5, 1, 0.5), (1, 0.8, 0.6, 0.4)), (OwnNames(),))
    motion = rde.simulate(scene, (0.1, 0.2, 0.5, 0.4), (0, 0, 0, 0), np.linspace(0, 1, 11))
    book = motion.kinetic_energy + motion.potential_energy - motion.work
    np.testing.assert_allclose(book, book[0], atol=1e-9)


@physics
def spring(x, k):
    return -k * x


@physics
def damped(x, rate, k):
    return -k * (x + rate)


@physics
def energy(x, k):
    return 0.5 * k * x**2


BIND = {"x": "phi2", "k": ".k"}


@dataclass(frozen=True)
class Spring(Effect):
    """Only a potential is declared."""

    k: float = 8.0

    def hooks(self, arm):
        return (Force(1, spring, BIND, potential=energy),)


@dataclass(frozen=True)
class Damped(Effect):
    """A force only part of which has a potential."""

    k: float = 8.0

    def hooks(self, arm):
        return (Force(1, damped, {**BIND, "rate": "phid2"}, potential=energy, conservative=spring),)


@pytest.mark.parametrize(("effect", "works"), [(Spring(), False), (Damped(), True)], ids=["whole", "part"])
def test_a_force_is_booked_as_potential_as_far_as_it_is_conservative(effect, works):
    """The rest counts as work: a force that is entirely the slope of its potential does no work at all."""
    scene = rde.Scene(FOUR_R, (effect,), tolerance=1e-9)
    motion = rde.simulate(scene, Q0, QD0, np.linspace(0.0, 1.0, 21)[1:])
    start = kinetic_energy(scene, Q0, QD0) + potential_energy(scene, Q0)
    assert np.abs(motion.kinetic_energy + motion.potential_energy - motion.work - start).max() < 1e-8
    assert (motion.work < -0.1).all() if works else (motion.work == 0.0).all()
