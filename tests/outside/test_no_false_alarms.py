"""verify reports no false alarms: many arms, effects and scenes, in states of three seeds."""

import numpy as np
import pytest
from actuator_lag import ActuatorLag
from armature import Armature
from arms import ARMS
from humming_stop import HummingStop
from lag_chain import LagChain
from relative_two_r import RelativeTwoR
from tether import Tether
from three_r_by_hand import ThreeRByHand
from two_stage_spring import TwoStageSpring

import redundant_envs as rde
from redundant_envs.scene import scene_names
from redundant_envs.studies.kinked_effects import KINKED
from redundant_envs.verify import equations, forces, hints, kinematics, rest, subject_from
from redundant_envs.verify.checks import Trial, Verdict, checks_of
from tests.fuzz.drawing import drawn_scene

e = rde.effects
CHECKS = checks_of(equations, kinematics, forces, hints, rest)
SEEDS = (0, 1, 2)
STATES = 64


def chain(types):
    n = len(types)
    return rde.Chain(types, tuple(0.5 + 0.3 * (k % 3) for k in range(n)), (0.2, 0.4, 0.3)[: types.count("R")])


def scenes_of(arm):
    """An arm with everything that a check of effects examines."""
    last = len(arm.joints) - 1
    yield rde.Scene(arm, (e.Gravity(3.0, (0.6, -0.8)), Armature(0.1), Tether(1, 0.1, 0.2, 500.0, 7.0)))
    springs = TwoStageSpring(last, -0.3, 0.4, 5.0, 100.0), e.LimitSpring(arm.joints[0], -0.2, 0.3, 50.0, 2e4)
    yield rde.Scene(arm, (e.Gravity(), *springs, ActuatorLag(0.1)))
    yield rde.Scene(arm, (e.Gravity(), HummingStop(last, -0.3, 0.4, 500.0, 30.0), LagChain(0.01, 6)))
    for kinked in KINKED:
        yield rde.Scene(arm, (e.Gravity(), kinked.effect, e.ViscousFriction(0.2)))


SUBJECTS = {
    **{name: rde.load_scene(name) for name in scene_names()},
    **ARMS,
    **{types: chain(types) for types in ("R", "P", "PR", "PP", "PRP", "RPR", "RRPP")},
    "3R by hand": ThreeRByHand((2.0, 1.5, 1.0), (0.3, 0.5, 0.4)),
    "relative": RelativeTwoR,
    "a micrometre": rde.RPRP((1e-6,) * 4, (1e-6, 1e-6)),
    **{f"{name} {k}": s for name, arm in ARMS.items() for k, s in enumerate(scenes_of(arm))},
    **{f"cart {k}": s for k, s in enumerate(scenes_of(chain("PRR")))},
}


def missed(thing, seed):
    trial = Trial(subject_from("it", thing), STATES, seed=seed)
    return [(c.name, o.finding) for c in CHECKS if (o := c.run(trial)).verdict is Verdict.MISSED]


@pytest.mark.parametrize("thing", SUBJECTS.values(), ids=SUBJECTS)
def test_what_is_right_is_green_whatever_the_states(thing):
    assert [missed(thing, seed) for seed in SEEDS] == [[], [], []]


@pytest.mark.parametrize("seed", SEEDS)
def test_drawn_scenes_are_green(seed):
    rng = np.random.default_rng(seed)
    for _ in range(12):
        scene = drawn_scene(rng, calm=True)
        assert missed(scene, seed) == [], scene
