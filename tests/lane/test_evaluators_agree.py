"""Single numbers, arrays, tensors and compiled code agree, through events, too."""

import numpy as np
import pytest
from catalogue import SCENES, names

import redundant_envs as rde
import redundant_envs.backends.numpy
import redundant_envs.backends.torch
from redundant_envs.backends.torch import torch
from redundant_envs.lane.direct import cross_interval, fields_of
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.lane.interval import Interval
from redundant_envs.verify.checks import random_states

LANES, SINGLES = 40, 6
SHORT = ("stops rk8, half elastic", "stops 1e-6, inelastic", "RP every effect 1e-6", "RPRP users' play 1e-6")
EVERY = names("4R all*", "RPRP *rk8", "RPRP *1e-6", "RP *", "stops *", "*dop853")
"""Others need two compilations and many evaluations without a compiler, for the same procedures."""


def direct(scene, table, convert):
    """States after an interval, each column of the table converted."""
    dynamics = Dynamics(scene)
    of_motion = dynamics.states[: 2 * dynamics.count]
    fields = fields_of(dynamics) | dynamics.effect_states.initial
    columns = zip((*of_motion, *dynamics.commands), table.T, strict=True)
    fields |= {n: convert(np.ascontiguousarray(x)) for n, x in columns}
    with np.errstate(all="ignore"):  # both sides of a choice are computed
        lane = cross_interval(Interval(dynamics), fields)
    return np.stack([np.broadcast_to(np.asarray(lane[s]), len(table)) for s in of_motion], axis=1)


@pytest.mark.parametrize(
    "name", [*SHORT, *(pytest.param(n, marks=pytest.mark.long) for n in EVERY if n not in SHORT)]
)
def test_evaluators_agree_after_an_interval(name):
    scene = SCENES[name]
    q, qd, efforts = random_states(scene, LANES, 3)
    batch = rde.BatchSimulator(scene, LANES)
    batch.set_state(q, qd)
    few = batch.advance(efforts).evaluations < 600  # others take minutes without a compiler
    compiled, table = np.hstack([batch.q, batch.qd])[few], np.hstack([q, qd, efforts])[few]
    assert few.mean() > 0.5
    rows = [direct(scene, row[None], lambda x: np.float64(x[0])) for row in table[:SINGLES]]
    for found in (direct(scene, table, np.array), direct(scene, table, torch.tensor), np.concatenate(rows)):
        assert np.abs(found - compiled[: len(found)]).max() <= 1e-12 * np.abs(compiled).max()
