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


IMPACTS = {
    "few impacts, and friction": (
        rde.Chain(
            "PRP", (0.2526369086676438, 0.3174018747617982, 0.5587381237717278), (0.16367367496467186,)
        ),
        (
            e.CoulombFriction((0.040732507955337456, 0.13073932165491386, 0.1618204059290333)),
            e.PrismaticStop((-0.016367367496467188, 0.0), (0.00339080573747802, 0.004543582705902636), 0.9),
        ),
        {"control_dt": 0.0116, "tolerance": 1e-6},
        ([0.00331425068106778, -0.15795744106263587, 0.00454358195324081],
         [2.862632758872099, -5.092747639796648, 0.0]),
        [-0.2800928475579875, -0.07297613871847532, 0.5082875178777252],
        [0.15041091077517432, -0.02812005852821053],
    ),
    "two sliders, at 1e-8 m": (
        rde.RPRP((2.265881133697227, 0.7746924078532548, 2.706619869403606, 1.7565626435063744),
                 (0.5018315532685775, 0.3509276160550038)),
        (
            e.PrismaticStop(
                (0.04263795846617907, -0.08527591693235814), (0.06947793714135142, -0.06721200525063174), 0.3
            ),
        ),
        {"control_dt": 0.1198, "tolerance": 1e-8, "actuation": "generalized"},
        ([2.5378282360334676, 0.06891961052701745, 2.1881517978891565, -0.08018725795777912],
         [4.406552059251995, -0.3615474748906486, -6.51457131168767, 1.4400645745429619]),
        [2.241835389707303, 2.6289197118637295, 2.241835389707303, 2.6289197118637295],
        [-0.5938659487078797, 0.3989885548627366],
    ),
}  # fmt: skip
"""Arms, effects, scenes, states, efforts, and tips by the account of the studies."""


@pytest.mark.long
@pytest.mark.parametrize("name", IMPACTS)
def test_bounces_that_rest_leaves_out_do_not_change_which_joint_strikes_next(name):
    """An impact came after a joint had been put to rest, and before its bounces were over: they were off by
    3000, and by 5.5 tolerances."""
    arm, effects, how, start, efforts, right = IMPACTS[name]
    batch, status = advanced(rde.Scene(arm, effects, **how), *start, efforts)
    assert not status.numerics.any()
    assert np.linalg.norm(arm.forward_kinematics(batch.q)[0] - right) <= how["tolerance"]
