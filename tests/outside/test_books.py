"""Tracking the work changes no bit of a motion: random scenes, with and without it.

``python tests/outside/test_books.py SEED COUNT`` searches on, from other seeds.
"""

import sys
from dataclasses import dataclass

import numpy as np
import pytest
from actuator_lag import ActuatorLag
from arms import ARMS
from humming_stop import HummingStop
from payload import Payload
from tether import Tether
from two_stage_spring import TwoStageSpring

import redundant_envs as rde
from redundant_envs.algebra import physics

e = rde.effects
METHODS = (
    {"integrator": "rk8"},
    {"tolerance": 1e-6},
    {"integrator": "rk4"},
    {"integrator": "dop853"},
    {"integrator": "euler", "control_dt": 0.005, "substeps": 2},
    {"tolerance": 1e-9},
    {"integrator": "rk8", "substeps": 2},
)


@physics
def soft(position, rate, k, c):
    return -k * position - c * rate


@physics
def soft_spring(position, k):
    return -k * position


@physics
def soft_energy(position, k):
    return 0.5 * k * position**2


@dataclass(frozen=True)
class SoftJoint(e.Effect):
    """Spring and damper of joint 1 in one force: the spring alone has a potential."""

    k: float = 3.0
    c: float = 0.4

    def hooks(self, arm):
        bind = {"position": "phi1", "rate": "phid1", "k": ".k", "c": ".c"}
        return (e.Force(0, soft, bind, soft_energy, soft_spring),)


@physics
def stiffening(position, k):
    return -k * position**3


@physics
def stiffening_energy(position, k):
    return 0.25 * k * position**4


@dataclass(frozen=True)
class StiffeningSpring(e.Effect):
    """A spring of the third power on the last joint: all of its force has a potential."""

    k: float = 8.0

    def hooks(self, arm):
        last = len(arm.joints)
        bind = {"position": f"phi{last}", "k": ".k"}
        return (e.Force(last - 1, stiffening, bind, stiffening_energy),)


def drawn_scene(seed):
    """An arm and a method in turn, and about half of the effects that fit it."""
    rng = np.random.default_rng(seed)
    arm, method = list(ARMS.values())[seed % len(ARMS)], METHODS[seed % len(METHODS)]
    count, sliders = len(arm.joints), len(arm.sliders())
    joint, sprung, point = (int(rng.integers(n)) for n in (count, count, arm.num_masses))
    effects = [
        e.Gravity(), e.ViscousFriction(0.2), e.EffortLimits((3.0,) * count), ActuatorLag(0.03), Payload(0.4),
        SoftJoint(), StiffeningSpring(), Tether(point + 1, 0.3, -0.2, 25.0, float(rng.choice([0.0, 0.7]))),
        e.LimitSpring(arm.joints[sprung], -0.3, 0.3, 60.0, 2.0), TwoStageSpring(joint, -0.2, 0.3, 4.0, 30.0),
        HummingStop(joint, -0.3, 0.3, 50.0, 9.0),
    ]  # fmt: skip
    if sliders:
        effects += [
            e.CentringSpring((20.0,) * sliders, (-0.1,) * sliders, (0.2,) * sliders),
            e.PrismaticStop((-0.2,) * sliders, (0.2,) * sliders, float(rng.choice([0.0, 0.5, 1.0]))),
        ]
    chosen = [effect for effect in effects if rng.random() < 0.55]
    actuation = str(rng.choice(["joint", "generalized"]))
    return rde.Scene(arm, chosen, **{"tolerance": None, "actuation": actuation, **method})


def motion(scene, seed, track_work, lanes=32):
    """Tables of states and of the status of each interval."""
    rng, count = np.random.default_rng(seed), len(scene.robot.joints)
    q, qd = rng.uniform(-1.0, 1.0, (lanes, count)), rng.normal(0.0, 2.0, (lanes, count))
    q[:, scene.robot.sliders()] *= 0.2
    batch = rde.BatchSimulator(scene, lanes, track_work=track_work)
    batch.set_state(q, qd)
    tables = []
    for _ in range(5):
        status = batch.advance(rng.uniform(-5.0, 5.0, (lanes, count)))
        tables += [batch.q, batch.qd, *map(np.asarray, status)]
    return tables


def changed(seed):
    """Whether tracking the work changes a bit of a random scene."""
    scene = drawn_scene(seed)
    pairs = zip(motion(scene, seed, False), motion(scene, seed, True), strict=True)
    return not all(np.array_equal(bare, booked, equal_nan=True) for bare, booked in pairs)


@pytest.mark.parametrize(
    "seed", [*range(14), *(pytest.param(k, marks=pytest.mark.long) for k in range(7, 35))]
)
def test_the_book_of_the_work_changes_no_bit_of_a_motion(seed):
    assert not changed(seed)


def test_a_simulated_motion_is_that_of_a_batch_without_a_book():
    q, qd = [-0.2, 0.15, -0.4, 0.1], [0.5, -0.6, 0.9, 0.8]
    spring, tether = e.LimitSpring("r1", 0.0, 0.1, 400.0, 3.0), Tether(4, 0.3, 0.1, 25.0, 0.7)
    for arm in (ARMS["RPRP"], ARMS["4R"]):
        effects = (e.Gravity(), SoftJoint(), tether, *([spring] if "r1" in arm.joints else []))
        scene = rde.Scene(arm, effects, tolerance=1e-6)
        found = rde.simulate(scene, q, qd, np.arange(11) * scene.control_dt, efforts=[1.0, 2.0, -1.0, 0.5])
        batch = rde.BatchSimulator(scene)
        batch.set_state(q, qd)
        for k in range(11):
            assert np.array_equal(found.q[k], batch.q[0])
            assert np.array_equal(found.qd[k], batch.qd[0])
            batch.advance([1.0, 2.0, -1.0, 0.5])


if __name__ == "__main__":
    first, count = (int(x) for x in (*sys.argv[1:], "0", "100")[:2])
    found = [seed for seed in range(first, first + count) if changed(seed)]
    print(f"the book changes bits of {len(found)} of {count} scenes: seeds {found}")
    sys.exit(bool(found))
