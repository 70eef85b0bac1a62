"""An effect of zero magnitude is as good as none, to the last bit, where its example has one."""

import dataclasses

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.envs import cost
from redundant_envs.scenes.files import config_folder
from redundant_envs.verify.checks import random_states
from studies.effects import load_study

STUDY = load_study(config_folder("studies") / "effects.yaml")
ENTRIES = {name: entry for name, entry in STUDY.entries.items() if entry.zero is not None}
HOW = {
    "one rk8 step": {"tolerance": None},
    "two": {"tolerance": None, "substeps": 2},
    "1e-6": {"tolerance": 1e-6},
}
LANES, INTERVALS = 21, 20


def motion(scene, start):
    """Bits of the states after each interval, and the evaluations that these took."""
    q, qd, efforts = start
    batch = rde.BatchSimulator(scene, LANES)
    batch.set_state(q, qd)
    found = []
    for k in range(INTERVALS):
        status = batch.advance((-1.0) ** k * efforts)
        found += [batch.q.tobytes(), batch.qd.tobytes(), status.evaluations.tobytes()]
    return found


@pytest.mark.quick("CentringSpring-one rk8 step")
@pytest.mark.parametrize("how", HOW.values(), ids=HOW)
@pytest.mark.parametrize("name", ENTRIES)
def test_a_motion_has_the_same_bits_without_an_effect_and_with_one_of_zero_magnitude(name, how):
    entry = ENTRIES[name]
    zero, without = (dataclasses.replace(s, **how) for s in cost.alone(entry.arm, entry.zero))
    q, qd, efforts = random_states(without, LANES, 0)
    start = q, qd, efforts + np.random.default_rng(0).normal(0.0, 10.0, efforts.shape)
    expected = motion(without, start)
    assert motion(zero, start) == expected
    acting = dataclasses.replace(cost.alone(entry.arm, entry.effect).scene, **how)
    assert motion(acting, start) != expected
