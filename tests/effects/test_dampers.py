"""Dampers that grow with depth: steps are short enough for them where an estimate does not see them."""

import dataclasses

import numpy as np
import pytest
from lanes_of_numbers import constants

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.algebra import physics
from redundant_envs.effects.hooks import Force, Point
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.lane.interval import Interval
from redundant_envs.lane.memory import Lane

ARM = rde.RPRP((0.2, 0.2, 0.2, 0.1), (0.3, 0.3))
DEEP = [-0.37828245, 0.15684442, 0.323228, 0.02206704], [-0.60305308, 0.12256787, -0.0091403, 0.18936389]


class Undeclared(e.LimitSpring):
    """A spring that does not declare its damping."""

    def hooks(self, arm):
        return tuple(dataclasses.replace(hook, damping=None) for hook in super().hooks(arm))


def errors(kind, tolerance):
    """Of the tip after an interval of four time constants of a damper, in units of the tolerance."""
    rng, count = np.random.default_rng(0), 4096
    q, qd = (np.array(x) * (1.0 + 1e-2 * rng.normal(size=(count, 4))) for x in DEEP)

    def end(spring, **how):
        scene = rde.Scene(ARM, (e.Gravity(), spring("r2", -100.0, 0.0, 20.8, 375.0)), control_dt=0.05, **how)
        batch = rde.BatchSimulator(scene, count)
        batch.set_state(q, qd)
        status = batch.advance()
        assert (status.numerics == 0).all()
        return ARM.forward_kinematics(batch.q)

    found = end(kind, tolerance=tolerance)
    reference = end(e.LimitSpring, integrator="rk8", substeps=2000)
    return np.linalg.norm(found - reference, axis=1) / tolerance


@pytest.mark.parametrize("tolerance", [1e-5, 1e-6, 1e-8])
def test_the_tolerance_is_kept_deep_in_a_strong_damper(tolerance):
    off = errors(e.LimitSpring, tolerance)
    assert off.max() <= 1.0


def test_a_damper_asks_for_steps_where_its_joint_is_deep_in_it():
    dynamics = Dynamics(rde.Scene(ARM, (e.LimitSpring("r2", -100.0, 0.0, 20.8, 375.0),), tolerance=1e-6))
    known = constants(dynamics, float) | {"interval": 0.05} | dict.fromkeys(dynamics.states, 0.0)

    def steps(depth):
        lane = Lane(Interval(dynamics).layout(), {**known, "r2": depth}.__getitem__)
        return Interval(dynamics).step.least_steps(lane)

    assert steps(-0.1) < 1.0
    assert steps(0.1) > 0.05 * 0.5 * 375.0 * 0.1 * known["most_mobility4"] > 5.0


def test_a_spring_without_damping_costs_what_it_did():
    scene = rde.Scene(ARM, (e.Gravity(), e.LimitSpring("r2", -100.0, 0.0, 1000.0)), tolerance=1e-6)
    told = dataclasses.replace(scene, effects=(e.Gravity(), Undeclared("r2", -100.0, 0.0, 1000.0)))
    rng, ends = np.random.default_rng(1), []
    q, qd = rng.uniform(-0.1, 0.2, (512, 4)), rng.normal(size=(512, 4))
    for made in (scene, told):
        batch = rde.BatchSimulator(made, 512)
        batch.set_state(q, qd)
        status = batch.advance()
        ends.append(np.column_stack([batch.q, batch.qd, status.evaluations]))
    np.testing.assert_array_equal(*ends)


# ---- from outside ----------------------------------------------------------------------------------------


@physics
def drag(rate, drag):
    return -drag * rate * abs(rate)


@physics
def slope(rate, drag):
    return 2.0 * drag * abs(rate)


@dataclasses.dataclass(frozen=True)
class Drag(e.Effect):
    """Quadratic in the rate of a joint."""

    drag: float = 1.0
    bind: dict = dataclasses.field(default_factory=lambda: {"rate": "phid1", "drag": ".drag"})
    joint: int = 0
    static = ("bind", "joint")

    def hooks(self, arm):
        return (Force(self.joint, drag, self.bind, damping=slope),)


def test_a_damping_that_depends_on_a_rate_needs_steps_from_the_first_interval_on():
    scene = rde.Scene(ARM, (Drag(5.0),), tolerance=1e-3, control_dt=0.02)
    mobility = Dynamics(scene).prepare(Dynamics(scene).parameters)["most_mobility1"]
    batch = rde.BatchSimulator(scene, 2)
    batch.set_state(np.zeros((2, 4)), [[0.01, 0.0, 0.0, 0.0], [4.0, 0.0, 0.0, 0.0]])
    calm, fast = batch.advance().evaluations / 12
    assert calm == 1
    assert fast >= 2.0 * 5.0 * 4.0 * mobility * 0.02 > 2


@pytest.mark.parametrize(
    ("effect", "words"),
    [
        (
            Drag(1.0, {"rate": "phid2", "drag": ".drag"}),
            "parameters and the position and rate of its own joint",
        ),
        (
            Drag(1.0, {"rate": "tip_vx", "drag": ".drag"}),
            "parameters and the position and rate of its own joint",
        ),
    ],
)
def test_a_damping_may_depend_on_the_motion_of_its_own_joint_alone(effect, words):
    with pytest.raises(ValueError, match=words):
        rde.Scene(ARM, (effect,))


@physics
def drag_at_point(rate_x, rate_y, drag):
    return -drag * rate_x, -drag * rate_y


@physics
def slope_at_point(rate_x, drag):
    return drag * abs(rate_x)


class AtTip(Drag):
    def hooks(self, arm):
        bind = {"rate_x": "vx4", "rate_y": "vy4", "drag": ".drag"}
        return (Force(Point(3), drag_at_point, bind, damping=slope_at_point),)


def test_the_damping_of_a_force_at_a_point_depends_on_parameters_alone():
    with pytest.raises(ValueError, match="it may depend on parameters alone"):
        rde.Scene(ARM, (AtTip(),))
