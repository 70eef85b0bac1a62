"""Laws that change where a guard changes its sign: located in time under error control."""

import dataclasses

import numpy as np
import pytest
from catalogue import RPRP, advanced, stops
from outside.guards import BrakeInBands, HalfBrake, SpeedCurve, brake, itself

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.algebra import physics, where
from redundant_envs.effects.hooks import Actuation, Effect, Force
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.simulator.lane.features import Features

FOUR_R = rde.FourR((0.5,) * 4, (0.25,) * 4)
GEAR = e.GearBacklash(0.02, 500.0, 0.02, 10.0)
LIMITS = {"FourR": (20.0, 12.0, 8.0, 4.0), "RPRP": (20.0, 32.0, 8.0, 16.0)}


def scene(arm, *effects, **how):
    sliders = (stops(arm),) if arm.sliders() else ()
    return rde.Scene(
        arm, (e.Gravity(), e.ViscousFriction(0.2), *sliders, e.EffortLimits(LIMITS[arm.kind]), *effects),
        **(how or {"tolerance": 1e-6}),
    )  # fmt: skip


def start(arm, lanes, seed):
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.5, 1.5, (lanes, 4))
    q[:, arm.sliders()] = rng.uniform(0.0, 0.3, (lanes, len(arm.sliders())))
    return q, rng.normal(0.0, 2.0, (lanes, 4)), rng.uniform(-1.0, 1.0, (lanes, 4)) * LIMITS[arm.kind]


def errors(made, state):
    """Tip errors against steps near rounding, their evaluations, and lanes that are flagged."""
    arm = made.robot
    found, status = advanced(made, *state)
    exact, sure = advanced(dataclasses.replace(made, tolerance=None, integrator="dop853"), *state)
    assert not sure.numerics.any()
    apart = arm.forward_kinematics(found.q) - arm.forward_kinematics(exact.q)
    return np.linalg.norm(apart, axis=1), status.evaluations, status.numerics != 0


@pytest.mark.long
@pytest.mark.parametrize(
    ("arm", "effect", "tolerance"),
    [
        pytest.param(
            arm, effect, tolerance, id=f"{arm.kind}-{type(effect).__name__}-{tolerance}",
            marks=[pytest.mark.long] * (arm is RPRP and (tolerance != 1e-6 or type(effect) is HalfBrake)),
        )
        for arm in (FOUR_R, RPRP) for effect in (SpeedCurve(), HalfBrake(3.0), GEAR)
        for tolerance in (1e-4, 1e-6, 1e-9)
    ],
)  # fmt: skip
def test_an_interval_in_which_a_law_changes_keeps_its_tolerance(arm, effect, tolerance):
    made = scene(arm, effect, tolerance=tolerance)
    error, _, flagged = errors(made, start(arm, 64 if effect is GEAR else 512, seed=11))
    assert not flagged.any()
    assert error.max() < tolerance


@pytest.mark.long
@pytest.mark.parametrize(
    ("effect", "lanes", "most"),
    [(SpeedCurve(), 512, 150.0), (e.TorqueSpeed(10.0, 8.0), 512, 150.0), (GEAR, 64, 1000.0)],
    ids=lambda x: type(x).__name__,
)
def test_locating_a_change_of_law_takes_few_evaluations(effect, lanes, most):
    """With watched kinks a curve of torque and speed takes 813 evaluations in such intervals, and a gear with
    backlash 41 000."""
    made, rng = scene(FOUR_R, effect), np.random.default_rng(3)
    batch, _ = advanced(made, *start(FOUR_R, lanes, 5)[:2], intervals=0)
    batch.set_state(batch.q, 0.0 * batch.qd)
    counts = []
    for _ in range(10):
        efforts = rng.uniform(-1.0, 1.0, (lanes, 4)) * LIMITS["FourR"]
        counts.append(batch.advance(efforts).evaluations.mean())
    assert np.mean(counts[3:]) <= most


@pytest.mark.long
@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-9])
def test_all_passages_of_a_guard_in_one_step_are_found(tolerance):
    """Up to three: a search that found the last of them left the others out, in 118 of 512 lanes."""
    made = scene(FOUR_R, BrakeInBands(), tolerance=tolerance)
    q, qd, efforts = start(FOUR_R, 512, seed=8)
    rng = np.random.default_rng(9)
    q[:, 0], qd[:, 0] = rng.uniform(-0.1, -0.04, 512), rng.uniform(4.0, 12.0, 512)
    error, evaluations, flagged = errors(made, (q, qd, efforts))
    assert not flagged.any()
    assert error.max() < tolerance
    assert evaluations.mean() < 400.0


@pytest.mark.long
def test_a_guard_that_never_changes_its_sign_costs_no_step():
    state = start(FOUR_R, 64, seed=2)
    counts = [
        advanced(scene(FOUR_R, *effects), *state)[1].evaluations
        for effects in ((), (SpeedCurve(stall=1e3, free=1e4),))
    ]
    np.testing.assert_array_equal(*counts)


def test_at_fixed_steps_the_sign_at_each_stage_selects_the_law():
    """A force with a guard at the position then is the same as one that compares it."""

    @physics
    def compared(rate, position, level):
        return brake(rate, position, level, where(position >= 0.0, 1.0, -1.0))

    class Compared(HalfBrake):
        def hooks(self, arm):
            return (Force(0, compared, {"rate": "phid1", "position": "phi1", "level": ".level"}),)

    state = start(FOUR_R, 32, seed=4)
    one, other = (advanced(scene(FOUR_R, x, integrator="rk4"), *state)[0] for x in (HalfBrake(), Compared()))
    assert np.array_equal(one.q, other.q)
    assert not Features(Dynamics(one.scene)).guards


@pytest.mark.long
def test_a_lane_with_guards_does_not_depend_on_its_neighbours_and_can_be_saved():
    made, (q, qd, efforts) = scene(RPRP, SpeedCurve(), GEAR), start(RPRP, 24, seed=6)
    whole, _ = advanced(made, q, qd, efforts, intervals=2)
    alone, _ = advanced(made, q[7:8], qd[7:8], efforts[7:8])
    kept = rde.BatchSimulator(made, 1)
    kept.restore(alone.save())
    kept.advance(efforts[7:8])
    assert np.array_equal(kept.q[0], whole.q[7])
    assert np.array_equal(kept.z[0], whole.z[7])


def test_torch_and_numpy_take_the_same_laws():
    torch = pytest.importorskip("torch")
    made, (q, qd, efforts) = scene(FOUR_R, SpeedCurve(), integrator="rk8"), start(FOUR_R, 8, seed=7)
    step = rde.torch_step(made)
    moved, _ = step(*(torch.tensor(x) for x in (q, qd, efforts)))
    found, _ = advanced(made, q, qd, efforts)
    np.testing.assert_allclose(moved.numpy(), found.q, rtol=0.0, atol=1e-12)


@pytest.mark.long
def test_a_motor_tells_the_effort_behind_the_law_that_holds():
    made = scene(FOUR_R, SpeedCurve(stall=2.0))
    motion = rde.simulate(made, np.zeros(4), np.zeros(4), [0.0, 0.01, 0.02], efforts=(5.0, 1.0, -5.0, 0.5))
    np.testing.assert_allclose(motion.efforts[0], (2.0, 1.0, -2.0, 0.5))


five = physics(lambda x: (x, x, x, x, x))
uses_side = physics(lambda x, side: x * side)
REFUSED = {
    "a fifth value": (Force(0, itself, {"position": "phi1"}, guard=five), "five|returns 5 values"),
    "a third kink": (Force(0, itself, {"position": "phi1"}, kink=five), "five|it may return 2 at most"),
    "a side without a guard": (Force(0, uses_side, {"x": "phi1"}), "side"),
    "a side of a guard in the guard": (
        Force(0, uses_side, {"x": "phi1"}, guard=physics(lambda x, side: x * side)), "side",
    ),
    "a second side of a guard with one value": (
        Actuation(0, physics(lambda x, side2: x * side2), {"x": "phi1"}, guard=physics(lambda x: x)), "side2",
    ),
    "laws by side without a guard": (
        Actuation(0, physics(lambda x: x), {"x": "command1"}, by_side=uses_side), "by_side is given without",
    ),
    "a side where others are by side": (
        Actuation(0, uses_side, {"x": "command1"}, guard=physics(lambda x: x), by_side=uses_side), "side",
    ),
    "switch and guard": (
        Force(0, uses_side, {"x": "phi1"}, switch=(".low", ".high"), guard=physics(lambda x: x)),
        "switch and guard",
    ),
    "a guard of a potential that follows from the rate": (
        Force(
            0, uses_side, {"x": "phi1", "v": "phid1"}, potential=physics(lambda x: x * x),
            guard=physics(lambda v: v),
        ),
        "depends on side",
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", REFUSED)
def test_guards_that_say_nothing_are_refused(what):
    hook, message = REFUSED[what]
    odd = type("Odd", (Effect,), {"hooks": lambda self, arm: (hook,), "parameters": lambda self: NUMBERS})
    with pytest.raises(ValueError, match=message):
        rde.Scene(FOUR_R, (odd(),))


NUMBERS = {"low": -1.0, "high": 1.0}
