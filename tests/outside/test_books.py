"""Tracking the work changes no bit of a motion: random scenes, with and without it."""

import numpy as np
import pytest
from actuator_lag import ActuatorLag
from arms import ARMS
from catalogue import SoftJoint, StiffeningSpring
from humming_stop import HummingStop
from payload import Payload
from tether import Tether
from two_stage_spring import TwoStageSpring

import redundant_envs as rde

e = rde.effects
METHODS = (
    {"integrator": "rk8"}, {"tolerance": 1e-6}, {"integrator": "rk4"}, {"integrator": "dop853"},
    {"integrator": "euler", "control_dt": 0.005, "substeps": 2}, {"tolerance": 1e-9},
    {"integrator": "rk8", "substeps": 2},
)  # fmt: skip


def drawn_scene(seed):
    """An arm and a method in turn, and about half of the effects that fit it."""
    rng = np.random.default_rng(seed)
    arm, method = list(ARMS.values())[seed % len(ARMS)], METHODS[seed % len(METHODS)]
    count, sliders = len(arm.joints), len(arm.sliders())
    joint, sprung, point = (int(rng.integers(n)) for n in (count, count, arm.num_masses))
    effects = [
        e.Gravity(), e.ViscousFriction(0.2), e.EffortLimits((3.0,) * count), ActuatorLag(0.03), Payload(0.4),
        SoftJoint(), StiffeningSpring(8.0), Tether(point + 1, 0.3, -0.2, 25.0, float(rng.choice([0.0, 0.7]))),
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
