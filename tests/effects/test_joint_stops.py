"""Hard stops of joints that turn: impacts along rows of B^T, rest and release, beside stops of sliders."""

import gymnasium as gym
import numpy as np
import pytest
from catalogue import FOUR_R, RPRP, advanced

import redundant_envs as rde
from redundant_envs import effects as e

LINK = rde.Chain("R", (2.0,), (0.5,))
INERTIA = 2.0 * 0.5**2
STEPS = pytest.mark.parametrize(
    "how", [{}, {"tolerance": 1e-9}, {"integrator": "dop853", "actuation": "generalized"}]
)


@pytest.mark.quick("how0")
@STEPS
def test_a_link_between_two_stops_loses_the_same_share_of_its_rate_at_each(how):
    scene = rde.Scene(LINK, (e.JointStop((-0.3,), (0.4,), 0.8),), control_dt=0.02, **how)
    motion = rde.simulate(scene, (0.1,), (1.0,), times=[5.0])
    rates = 0.8 ** np.arange(5)
    times = 0.3 + 0.7 * np.concatenate([[0.0], np.cumsum(1.0 / rates[1:4])])
    assert [event.kind for event in motion.events] == ["upper impact", "lower impact"] * 2
    np.testing.assert_allclose([event.time for event in motion.events], times, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose([event.speed for event in motion.events], rates[:4], rtol=1e-15)
    assert motion.qd[-1, 0] == pytest.approx(0.8**4, rel=1e-15)


@pytest.mark.quick("how2")
@STEPS
def test_a_link_pressed_onto_its_stop_rests_until_its_effort_turns(how):
    """The effort lags behind its command: it is 0 at T ln 2 after the command has turned."""
    lag = 0.03
    effects = (e.Lag(lag), e.JointStop((-0.3,), (0.4,), 0.0))
    batch = rde.BatchSimulator(rde.Scene(LINK, effects, control_dt=0.5, **how), 1)
    batch.set_state([[0.39]], [[0.0]])
    for _ in range(4):
        batch.advance([[3.0]])
    assert batch.q[0, 0] == 0.4
    assert batch.qd[0, 0] == 0.0
    effort = batch.z[0, 0]
    batch.advance_partly([[-3.0]], 0.02)
    assert (batch.q[0, 0], batch.qd[0, 0]) == (0.4, 0.0)
    batch.advance_partly([[-3.0]], 0.05)
    release = lag * np.log((effort + 3.0) / 3.0)
    gone = 0.07 - release
    rate = -3.0 / INERTIA * (gone - lag * (1.0 - np.exp(-gone / lag)))
    assert batch.qd[0, 0] == pytest.approx(rate, rel=1e-5 if not how else 1e-8)


@pytest.mark.long
def test_a_joint_at_rest_on_its_stop_keeps_it_while_the_arm_moves():
    """A wrist is pressed onto its stop with 2 N m, while the shoulder swings to and fro."""
    stop = e.JointStop((None,) * 4, (None, None, None, 0.5), 0.6)
    batch, seen = rde.BatchSimulator(rde.Scene(FOUR_R, (e.ViscousFriction(1.0), stop))), set()
    batch.set_state(np.array([[0.2, 0.0, 0.0, 0.5]]) @ np.linalg.inv(FOUR_R.motor_map), np.zeros((1, 4)))
    for k in range(1000):
        batch.advance([[3.0 * np.sin(0.1 * k), 0.0, 0.0, 2.0]])
        position, rate = (x[0] @ FOUR_R.motor_map for x in (batch.q, batch.qd))
        assert rate[3] == 0.0
        assert abs(position[3] - 0.5) <= 4.0 * np.spacing(np.abs(batch.q).max())
        seen.add(batch.q[0, 3])
    assert len(seen) > 900


@pytest.mark.long
def test_stops_of_sliders_alone_are_those_of_prismatic_stop():
    moved = []
    for stop in (
        e.JointStop((None, 0.0, None, 0.0), (None, 0.3, None, 0.3), 0.5),
        e.PrismaticStop((0.0, 0.0), (0.3, 0.3), 0.5),
    ):
        scene = rde.Scene(RPRP, (e.Gravity(), e.CoulombFriction(0.1), stop))
        qd = np.linspace(-3.0, 3.0, 16).reshape(4, 4)
        moved.append(advanced(scene, np.tile([0.3, 0.1, 0.2, 0.2], (4, 1)), qd, intervals=30)[0].q)
    assert np.array_equal(*moved)


@pytest.mark.long
def test_states_beyond_a_stop_are_refused_and_starts_are_inside():
    scene = rde.Scene(FOUR_R, (e.JointStop((-1.0, -0.8, None, -0.5), (1.5, 0.9, 0.7, 0.5)),))
    with pytest.raises(ValueError, match=r"is 0.901 rad; its stops are at -0.8 and 0.9 rad"):
        rde.BatchSimulator(scene).set_state([[0.3, 1.201, 1.201, 1.201]], np.zeros((1, 4)))
    narrow = rde.Scene(
        FOUR_R,
        (e.EffortLimits((5.0,) * 4), e.JointStop((0.2, 0.1, -0.2, 0.3), (0.3, 0.15, -0.1, None), 0.5)),
    )
    fresh = rde.BatchSimulator(narrow).q @ FOUR_R.motor_map
    np.testing.assert_allclose(fresh, [[0.2, 0.1, -0.1, 0.3]], rtol=0.0, atol=1e-15)
    envs = gym.make_vec("redundant_envs/FourRReach-v0", num_envs=64, scene=narrow.to_dict())
    envs.reset(seed=3)
    phi = envs.unwrapped.q @ FOUR_R.motor_map
    assert (phi >= np.array([0.2, 0.1, -0.2, 0.3]) - 1e-15).all()
    assert (phi <= np.array([0.3, 0.15, -0.1, np.inf]) + 1e-15).all()
