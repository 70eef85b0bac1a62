"""A case of a simulator is judged by ``verify``, at the states that its motion passes.

What ``verify`` does not judge of a scene is here: flags, budgets, the order of effects, thousands of lanes,
and ``torch_step``.
"""

import dataclasses
import re

import numpy as np

import redundant_envs as rde
from redundant_envs.compiler.backends.torch import number
from redundant_envs.effects.hooks import Actuation, Friction, Impact, Sensing
from redundant_envs.model.torch_step import torch_step
from redundant_envs.scenes.tableaus import METHODS
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.verify import Subject, Verdict, accuracy, bits, conservation, evaluators, impacts
from redundant_envs.verify.checks import Sample, check, checks_of, enough, ratio
from redundant_envs.verify.promises import EQUAL_BITS, NotApplicable, at_most

from .cases import Violation

MAX_TRIALS, MAX_MORE, MAX_ADAPTIVE = 65536, 18, 1_000_002
"""Most steps of an interval, more for each substep, and the most for dop853."""
MOST = 96
"""States of a case that are judged."""
STEPS, NUDGE, STEADY = 96, 1e-13, 1e-11
"""Equal steps of the motions of two orders of effects. Lanes are compared whose ends change by less than the
third number if their rates change by the second at the start: others magnify rounding."""


def reordered(scene, rng):
    """The scene with its effects in a random order, in which those that do not commute keep theirs: links of
    one chain of motors or sensors."""

    def places(effect):
        hooks = effect.hooks(scene.robot)
        links = {(h.link, h.joint) for h in hooks if isinstance(h, Actuation)}
        return links | {(h.reading, h.joint) for h in hooks if isinstance(h, Sensing)}

    left, chosen = [(e, places(e)) for e in scene.effects], []
    while left:
        free = [k for k, (_, own) in enumerate(left) if not any(own & before for _, before in left[:k])]
        chosen.append(left.pop(rng.choice(free))[0])
    return dataclasses.replace(scene, effects=tuple(chosen))


@check("effects commute", at_most(1e-9))
def effects_commute(trial):
    """Effects in another order give the same motion to rounding, in equal steps."""
    scene, (q, qd, efforts) = trial.scene, trial.states
    if len(scene.effects) < 2:
        raise NotApplicable("there is one order")
    equal = dataclasses.replace(scene, integrator="rk8", tolerance=None, substeps=STEPS)
    other = reordered(equal, np.random.default_rng(len(scene.effects)))
    motions = (equal, qd), (equal, qd * (1.0 + NUDGE)), (other, qd)
    ends = [conservation.moved(motion, q, rates, efforts) for motion, rates in motions]
    own, nudged, found = (np.stack([end.q, end.qd], axis=1) for end in ends)
    size = np.abs(own).max(axis=2, keepdims=True)
    steady = ends[0].good & (ratio(nudged - own, size) < STEADY).all(axis=(1, 2))
    enough(steady, "every interval magnifies rounding", 1e-9)
    gaps = np.where(steady[:, None, None], ratio(found - own, size), 0.0)
    order = ", ".join(e.key for e in other.effects)
    return trial.finding(gaps.max(axis=1), f"another motion, by {{:.1e}}, in the order {order}")


MANY, MAX_EVALUATIONS = 4096, 1e6
"""Lanes of a simulator that has as many as those of learners have, and most evaluations of an interval of so
many."""


@check("thousands have the same bits", EQUAL_BITS)
def thousands(trial):
    """Each of 4096 lanes has the bits that it has among few, noise included."""
    few, many = bits.LANES, np.arange(MANY) % len(bits.LANES)
    status = bits.batch_of(trial, few).advance(trial.states[2][few % trial.count])
    if status.evaluations.mean() * MANY > MAX_EVALUATIONS:
        raise NotApplicable("it takes too many steps")
    found = bits.run(trial, bits.batch_of(trial, many, threads=2), many)
    return bits.differing(trial, found, "among thousands", many)


@check("torch_step agrees", evaluators.AGREE)
def torch_step_agrees(trial):
    """The differentiable interval is that of compiled code."""
    scene, lanes, _, started = trial.shared(evaluators.compiled)
    if scene.attached.of(Impact, Friction) or scene.integrator == "dop853":
        raise NotApplicable("torch_step has no derivative of it")

    def tensor(names):
        return number(np.stack([started[n][lanes] for n in names], axis=1)) if names else None

    dynamics = Dynamics(scene)
    effects = tensor(tuple(dynamics.effect_states)), tensor(dynamics.draw_fields)
    q, qd, *_ = torch_step(scene)(*(number(x[lanes]) for x in trial.states), None, *effects)
    return evaluators.agreement(trial, np.hstack([q, qd]), "torch_step")


OWN = (effects_commute, thousands, torch_step_agrees)


OF_VERIFY = {
    re.sub(r"\W+", "_", one.name): one
    for one in (
        accuracy.tolerance_kept, conservation.energy_book, impacts.inside, *checks_of(bits), *OWN,
        evaluators.arrays, evaluators.singles,
    )
}  # fmt: skip
"""Checks whose promise holds for every scene and state that can be drawn, by the names of their promises."""
FLAGS = "flags_and_budgets"


def wrongly_told(scene, start, end, status):
    """Lanes whose flags are not those of their state, which moved although they were given up, or which took
    more evaluations than the documented budgets of an interval."""
    finite, numerics = np.isfinite(end).all(axis=1), status.numerics
    wrong = (finite != status.finite) | (finite == ((numerics & rde.Numerics.NON_FINITE) > 0))
    wrong |= ((numerics & rde.Numerics.EVENT_BUDGET) > 0) & (start != end).any(axis=1)
    adaptive = MAX_ADAPTIVE if scene.integrator == "dop853" else MAX_MORE * scene.substeps
    parts = 1 + len(scene.attached.instants)
    return wrong | (status.evaluations > METHODS[scene.integrator].stages * (MAX_TRIALS + adaptive) * parts)


def violations_of(case, tally, names):
    """Play a case of a simulator, and judge its scene by some promises in the states that it passed without a
    flag."""
    scene, (start, *others) = rde.Scene.from_dict(case["scene"]), (call["rows"] for call in case["calls"])
    batch = rde.BatchSimulator(scene, case["num_envs"], case["threads"], track_work=True)
    batch.set_state(start["q"], start["qd"])
    passed, found = [], []
    for k, rows in enumerate(others, 1):
        before, efforts = np.hstack([batch.q, batch.qd]), np.array(rows["efforts"])
        status = batch.advance(efforts)
        tally["intervals"] += len(before)
        for lane in np.flatnonzero(wrongly_told(scene, before, np.hstack([batch.q, batch.qd]), status)):
            told = {name: x[lane].item() for name, x in status._asdict().items()}
            found.append(Violation(FLAGS, k, lane, f"{batch.q[lane]}, {batch.qd[lane]}: {told}"))
        good = (status.numerics == 0) & np.isfinite(efforts).all(axis=1)
        passed.append(np.hstack([before, efforts])[good])
    if FLAGS not in names:
        found = []
    states = tuple(np.split(np.concatenate(passed)[:MOST], 3, axis=1))
    if not len(states[0]):
        return found
    trial = Sample(Subject("drawn", scene), len(states[0]), chosen=states)
    for name in [one for one in OF_VERIFY if one in names]:
        outcome = OF_VERIFY[name].run(trial)
        tally[f"{name} {outcome.verdict.value}"] += 1
        # The energy balance is infinite where too few motions are simulated well enough to be judged.
        if outcome.verdict is Verdict.MISSED and not np.isinf(outcome.finding.found):
            found.append(Violation(name, -1, -1, f"{outcome.finding.words} ({outcome.finding.where})"))
    return found
