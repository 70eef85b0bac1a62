"""A force from outside that changes its law, on every arm: located, booked, the same on every back end."""

import dataclasses

import numpy as np
import pytest
from arms import ARMS
from two_stage_spring import TwoStageSpring, energy, pull_back

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.backends.torch import torch
from redundant_envs.effects import Effect, Force, Point
from redundant_envs.lane.direct import cross_interval, fields_of
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.lane.interval import Interval
from redundant_envs.verify import Mode, verify

LANES = 24


def scene(name, **kwargs):
    arm = ARMS[name]
    joints = range(len(arm.joints))
    springs = (TwoStageSpring(max(joints), -0.1, 0.05, 20.0, 4e3),)
    return rde.Scene(arm, (rde.effects.Gravity(), *springs), **kwargs)


def near_knees(arm):
    rng = np.random.default_rng(3)
    shape = (LANES, len(arm.joints))
    joints = rng.uniform(-0.2, 0.2, shape)
    rates = rng.normal(0.0, 2.0, shape)
    inverse = np.linalg.inv(arm.motor_map)
    return joints @ inverse, rates @ inverse, rng.normal(0.0, 3.0, shape)


def advance(made, q, qd, efforts):
    batch = rde.BatchSimulator(made, len(q))
    batch.set_state(q, qd)
    return batch, batch.advance(efforts)


@pytest.mark.parametrize("name", ARMS)
def test_its_tolerance_is_kept(name):
    q, qd, efforts = near_knees(ARMS[name])
    found, status = advance(scene(name, tolerance=1e-8), q, qd, efforts)
    fine, _ = advance(scene(name, integrator="rk4", substeps=20000), q, qd, efforts)
    tip = ARMS[name].forward_kinematics
    assert np.linalg.norm(tip(found.q) - tip(fine.q), axis=1).max() <= 1e-8
    assert (status.numerics == 0).all()
    assert status.evaluations.mean() <= 400


@pytest.mark.parametrize("name", ["4R", "RRP"])
def test_compiled_code_and_numpy_agree(name):
    q, qd, efforts = near_knees(ARMS[name])
    made = scene(name, tolerance=1e-8)
    found, _ = advance(made, q, qd, efforts)
    dynamics = Dynamics(made)
    states = np.concatenate([q, qd], axis=1).T
    given = {
        **dict(zip(dynamics.states, states, strict=True)),
        **dict(zip(dynamics.commands, efforts.T, strict=True)),
    }
    with np.errstate(all="ignore"):  # lanes that are not served are computed, too
        lane = cross_interval(Interval(dynamics), {**fields_of(dynamics), **given})
    count = dynamics.count
    np.testing.assert_allclose(
        np.stack([lane[q] for q in dynamics.states[:count]], -1), found.q, rtol=0, atol=1e-12
    )


def test_equal_steps_have_the_law_of_the_place():
    """Without error control the position selects the law at each evaluation, in torch, too."""
    q, qd, efforts = near_knees(ARMS["4R"])
    made = scene("4R", integrator="rk4", substeps=3)
    found, _ = advance(made, q, qd, efforts)
    moved, _ = rde.torch_step(made)(*map(torch.as_tensor, (q, qd, efforts)))
    np.testing.assert_allclose(moved.numpy(), found.q, rtol=0, atol=1e-13)


@pytest.mark.parametrize("name", [pytest.param("4R", marks=pytest.mark.long), "RPRP"])
def test_verify_finds_it_right_and_a_wrong_potential_wrong(name):
    assert not verify(scene(name, tolerance=1e-6), 256, Mode.QUICK).misses

    class Wrong(TwoStageSpring):
        @property
        def key(self):
            return "wrong"

        def hooks(self, arm):
            (force,) = super().hooks(arm)
            return (dataclasses.replace(force, potential=doubled),)

    joint = len(ARMS[name].joints) - 1
    wrong = rde.Scene(ARMS[name], (Wrong(joint, -0.1, 0.05, 20.0, 4e3),), tolerance=1e-6)
    assert any("wrong: at" in miss for miss in verify(wrong, 256, Mode.QUICK).misses)


@physics
def doubled(position, lower, upper, side, soft, harder):
    return 2.0 * energy(position, lower, upper, side, soft, harder)


class Badly(Effect):
    """Declares impossible switches in several ways."""

    def __init__(self, joint=1, switch=(".lower", ".upper"), bind=None):
        object.__setattr__(self, "made", (joint, switch, bind))

    def hooks(self, arm):
        joint, switch, bind = self.made
        return (Force(joint, on_side, bind or {}, switch=switch),)


@physics
def on_side(side):
    return 0.0 * side


@pytest.mark.parametrize(
    ("switch", "joint", "message"),
    [
        ((".lower", ".upper"), 1, "switch: '.lower' is not a number of this effect"),
        (".lower", 1, "switch is '.lower'; give the names of two numbers"),
        ((".lower",), 1, "give the names of two numbers"),
        ((".lower", ".upper"), Point(3), "the force acts at a Point"),
        (None, 1, "argument 'side': no quantity of FourR is called 'side'"),
    ],
)
def test_a_switch_that_cannot_be_is_refused(switch, joint, message):
    with pytest.raises(ValueError, match=message.replace(".", r"\.")):
        rde.Scene(ARMS["4R"], (Badly(joint, switch),))


def test_positions_of_a_switch_in_the_wrong_order_are_refused():
    for lower, upper in ((0.2, 0.1), (0.1, 0.1)):
        with pytest.raises(ValueError, match="the first must be below the second"):
            rde.Scene(ARMS["RPRP"], (TwoStageSpring(1, lower, upper, 20.0, 2e3),))


def test_positions_of_a_switch_in_the_wrong_order_are_refused_of_a_lane_too():
    batch = rde.BatchSimulator(rde.Scene(ARMS["RPRP"], (TwoStageSpring(1, 0.1, 0.2, 20.0, 2e3),)), 3)
    before = batch.save()["parameters"]
    for lower, upper in ((0.3, 0.2), (0.2, 0.2)):
        with pytest.raises(ValueError, match="the first must be below the second"):
            batch.set_parameters(
                {"two_stage_spring.lower": [0.1, lower], "two_stage_spring.upper": upper}, [0, 2]
            )
    np.testing.assert_array_equal(batch.save()["parameters"], before)
    batch.set_parameters({"two_stage_spring.lower": 0.15}, [2])


def test_its_functions_are_plain_python():
    assert pull_back(0.1, -0.1, 0.05, 1.0, 20.0, 4e3) == -20.0 * 0.1 - 4e3 * (0.1 - 0.05)
    assert pull_back(0.02, -0.1, 0.05, 0.0, 20.0, 4e3) == -20.0 * 0.02
