"""Single numbers, arrays, tensors and compiled code agree: they run the same procedures."""

import itertools

import numpy as np
import pytest

import redundant_envs as rde
import redundant_envs.backends.numpy
import redundant_envs.backends.torch
from redundant_envs.backends.torch import torch
from redundant_envs.lane.direct import cross_interval, fields_of
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.lane.interval import Interval
from redundant_envs.studies.kinked_effects import QuadraticDrag

e = rde.effects
ARMS = {
    "4R": rde.FourR(masses=(2.0, 1.5, 1.0, 0.5), lengths=(0.3, 0.5, 0.4, 0.6)),
    "RPRP": rde.RPRP(masses=(2.0, 1.5, 1.0, 0.5), lengths=(0.3, 0.5)),
}
EFFECTS = {
    "nothing": (),
    "gravity": (e.Gravity(9.81, (0.6, -0.7)),),
    "friction": (e.ViscousFriction((0.1, 0.2, 0.3, 0.05)),),
    "drag": (QuadraticDrag(0.3),),
    "limits": (e.EffortLimits((5.0, 4.0, 3.0, 2.0)),),
    "limit spring": (e.LimitSpring("{joint}", -0.1, 0.1, 300.0, 20.0),),
    "limit spring that holds": (e.LimitSpring("{joint}", -0.1, 0.1, 300.0, 5.0),),
    "centring spring": (e.CentringSpring((80.0, 40.0), (-0.2, -0.1), (0.2, 0.3)),),
    "elastic stops": (e.Gravity(), e.PrismaticStop((-0.1, -0.1), (0.1, 0.15), 1.0)),
    "inelastic stops": (e.Gravity(), e.PrismaticStop((-0.1, None), (0.1, 0.15), 0.0)),
}
STEPS = {
    "euler": {"integrator": "euler", "substeps": 2},
    "rk4": {"integrator": "rk4", "substeps": 2},
    "rk8": {"integrator": "rk8"},
    "1e-6": {"tolerance": 1e-6},
    "1e-11": {"tolerance": 1e-11},
    "dop853": {"integrator": "dop853"},
}
OF_SLIDERS = ("centring spring", "elastic stops", "inelastic stops")
LANES = 40
SCENES = [
    (arm, effect, steps)
    for arm, effect, steps in itertools.product(ARMS, EFFECTS, STEPS)
    if arm == "RPRP" or effect not in OF_SLIDERS
    # Where a damper lets go is a kink: it takes up to 16384 steps at 1e-11, a minute without a compiler.
    # So is a rate at which drag changes its law.
    if (effect, steps) not in (("limit spring", "1e-11"), ("drag", "1e-11"))
]
SHORT = ("1e-6",)
"""Steps with which every effect is run each time; the others need two compilations more for each."""
SLOW = (("4R", "limit spring", "1e-6"),)
"""Its damper loses contact in many lanes: ten seconds without a compiler. RPRP's tests the same in two."""


def scene_of(arm, effect, steps):
    effects = [
        e.LimitSpring(ARMS[arm].joints[1], x.lower, x.upper, x.stiffness, x.damping)
        if isinstance(x, e.LimitSpring)
        else x
        for x in EFFECTS[effect]
    ]
    return rde.Scene(ARMS[arm], tuple(effects), control_dt=0.02, **STEPS[steps])


def states(scene):
    rng = np.random.default_rng(3)
    q = rng.uniform(-1.0, 1.0, (LANES, 4))
    q[:, np.array(scene.robot.prismatic)] *= 0.1
    q[:5, np.array(scene.robot.prismatic)] = 0.1  # some begin at their stops
    return q, 2.0 * rng.normal(size=(LANES, 4)), 4.0 * rng.normal(size=(LANES, 4))


def direct(scene, table, convert):
    """States after an interval, each column of the table converted."""
    dynamics = Dynamics(scene)
    names = (*dynamics.states, *dynamics.commands)
    fields = {**fields_of(dynamics), **{n: convert(x) for n, x in zip(names, table.T, strict=True)}}
    with np.errstate(all="ignore"):  # both sides of a choice are computed
        lane = cross_interval(Interval(dynamics), fields)
    return np.stack([np.broadcast_to(np.asarray(lane[s]), len(table)) for s in dynamics.states], axis=1)


@pytest.mark.parametrize(
    ("arm", "effect", "steps"),
    [s if s[2] in SHORT and s not in SLOW else pytest.param(*s, marks=pytest.mark.long) for s in SCENES],
)
def test_evaluators_agree_after_an_interval(arm, effect, steps):
    scene = scene_of(arm, effect, steps)
    q, qd, efforts = states(scene)
    batch = rde.BatchSimulator(scene, LANES)
    batch.set_state(q, qd)
    batch.advance(efforts)
    compiled = np.concatenate([batch.q, batch.qd], axis=1)
    table = np.concatenate([q, qd, efforts], axis=1)
    scale = np.abs(compiled).max()
    arrays = direct(scene, table, np.ascontiguousarray)
    tensors = direct(scene, table, lambda x: torch.tensor(np.ascontiguousarray(x)))
    singles = np.concatenate([direct(scene, row[None], lambda x: np.float64(x[0])) for row in table[:8]])
    assert np.abs(arrays - compiled).max() <= 1e-12 * scale
    assert np.abs(tensors - compiled).max() <= 1e-12 * scale
    assert np.abs(singles - compiled[:8]).max() <= 1e-12 * scale
