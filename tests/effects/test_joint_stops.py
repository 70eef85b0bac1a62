"""Hard stops of joints that turn: impacts along rows of B^T, rest and release, beside stops of sliders."""

import gymnasium as gym
import numpy as np
import pytest
from catalogue import FOUR_R, RPRP

import redundant_envs as rde
from redundant_envs import effects as e

LINK = rde.Chain("R", (2.0,), (0.5,))
INERTIA = 2.0 * 0.5**2
STEPS = pytest.mark.parametrize(
    "how", [{}, {"tolerance": 1e-9}, {"integrator": "dop853", "actuation": "generalized"}]
)
LOWER, UPPER = (-1.0, -0.8, None, -0.5), (1.5, 0.9, 0.7, 0.5)
SCENES = {
    "4R": rde.Scene(
        FOUR_R, (e.Gravity(), e.JointStop(LOWER, UPPER, 0.6)), integrator="dop853", control_dt=0.02
    ),
    "RPRP": rde.Scene(
        RPRP,
        (
            e.Gravity(), e.CoulombFriction(0.1), e.PrismaticStop((0.0, 0.05), (0.3, 0.3), 0.3),
            e.JointStop((-1.0, None, -0.7, None), (1.5, None, 0.7, None), 0.6),
        ),
        integrator="dop853", control_dt=0.02,
    ),
}  # fmt: skip


def joints(batch):
    return batch.q @ batch.scene.robot.motor_map, batch.qd @ batch.scene.robot.motor_map


def ends(scene):
    """Lower and upper ends of all joints; infinite without one."""
    low, high, numbers = np.full(4, -np.inf), np.full(4, np.inf), scene.parameters()
    for a in scene.attached.of(e.Impact):
        low[a.hook.joint], high[a.hook.joint] = (
            numbers[a.parameter(a.hook.lower)],
            numbers[a.parameter(a.hook.upper)],
        )
    return low, high


def energy(batch):
    arm = batch.scene.robot
    return arm.kinetic_energy(batch.q, batch.qd) + arm.potential_energy(batch.q)


def ulp(batch, low, high):
    """4 ulp of the coordinates and ends from which the angles of joints follow."""
    on = batch.scene.robot.motor_map.T != 0.0
    size = np.where(on, np.abs(batch.q)[:, None, :], 0.0).max(axis=2)
    for end in (low, high):
        size = np.maximum(size, np.where(np.isfinite(end), np.abs(end), 0.0))
    return 4.0 * np.spacing(size)


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
@pytest.mark.parametrize("name", SCENES)
def test_no_joint_is_beyond_its_stop_and_the_energy_book_closes(name):
    scene, n = SCENES[name], 32
    arm, (low, high), rng = scene.robot, ends(scene), np.random.default_rng(1)
    batch = rde.BatchSimulator(scene, n, track_work=True)
    start = rng.uniform(np.maximum(low, -1.0), np.minimum(high, 1.0), (n, 4))
    batch.set_state(start @ np.linalg.inv(arm.motor_map), rng.uniform(-1.0, 1.0, (n, 4)))
    begun, largest, events, rests = energy(batch), np.ones(n), 0, 0
    for _ in range(200):
        status = batch.advance(rng.uniform(-1.0, 1.0, (n, 4)) * (6.0, 4.0, 2.0, 1.0))
        assert not status.numerics.any()
        events += status.events.sum()
        phi, rate = joints(batch)
        beyond = np.maximum(low - phi, phi - high)
        assert (beyond <= ulp(batch, low, high))[:, ~np.array(arm.prismatic)].all()
        assert (beyond <= 0.0)[:, np.array(arm.prismatic)].all()
        rests += ((np.abs(beyond) <= ulp(batch, low, high)) & (rate == 0.0)).sum()
        largest = np.maximum(largest, np.maximum(np.abs(energy(batch)), np.abs(batch.work)))
    assert events > 2000
    assert rests > 1000
    assert (np.abs(energy(batch) - begun - batch.work) < 1e-11 * largest).all()


@pytest.mark.long
def test_an_impact_gives_momentum_to_its_own_joint_alone():
    """M dqd = b_j lambda, with the rate of the joint reversed: e of it."""
    scene, n = SCENES["4R"], 48
    rng, b = np.random.default_rng(2), FOUR_R.motor_map
    joint = rng.integers(0, 4, n)
    end = np.array(UPPER)[joint]
    phi, rate = rng.uniform(-0.4, 0.4, (n, 4)), rng.uniform(-0.2, 0.2, (n, 4))
    phi[range(n), joint], rate[range(n), joint] = end, rng.uniform(0.5, 1.5, n)
    q, qd = phi @ np.linalg.inv(b), rate @ np.linalg.inv(b)
    after = []
    for seconds in (1e-10, 2e-10):
        batch = rde.BatchSimulator(scene, n)
        batch.set_state(q, qd)
        batch.advance_partly(None, seconds)
        after.append(batch.qd)
    jump = 2.0 * after[0] - after[1] - qd
    push = np.einsum("nij,nj->ni", FOUR_R.mass_matrix(q), jump) @ np.linalg.inv(b).T
    np.testing.assert_allclose((jump @ b)[range(n), joint], -1.6 * rate[range(n), joint], rtol=1e-8)
    others = push.copy()
    others[range(n), joint] = 0.0
    assert np.abs(others).max() < 1e-8 * np.abs(push).max()


@pytest.mark.long
def test_a_joint_at_rest_on_its_stop_keeps_it_while_the_arm_moves():
    """A wrist is pressed onto its stop with 2 N m, while the shoulder swings to and fro."""
    stop = e.JointStop((None,) * 4, (None, None, None, 0.5), 0.6)
    scene = rde.Scene(FOUR_R, (e.ViscousFriction(1.0), stop))
    batch = rde.BatchSimulator(scene, 1)
    batch.set_state(np.array([[0.2, 0.0, 0.0, 0.5]]) @ np.linalg.inv(FOUR_R.motor_map), np.zeros((1, 4)))
    seen = set()
    for k in range(1000):
        batch.advance([[3.0 * np.sin(0.1 * k), 0.0, 0.0, 2.0]])
        phi, rate = joints(batch)
        assert rate[0, 3] == 0.0
        assert abs(phi[0, 3] - 0.5) <= ulp(batch, *ends(scene))[0, 3]
        seen.add(batch.q[0, 3])
    assert len(seen) > 900


@pytest.mark.long
def test_lanes_do_not_depend_on_each_other():
    scene, n = SCENES["RPRP"], 11
    rng = np.random.default_rng(4)
    q = np.concatenate([rng.uniform(-0.5, 0.5, (n, 1)), np.full((n, 3), 0.1)], axis=1)
    qd, efforts = rng.uniform(-3.0, 3.0, (n, 4)), rng.uniform(-4.0, 4.0, (20, n, 4))

    def moved(lanes):
        batch = rde.BatchSimulator(scene, len(lanes))
        batch.set_state(q[lanes], qd[lanes])
        for effort in efforts:
            batch.advance(effort[lanes])
        return np.concatenate([batch.q, batch.qd], axis=1)

    together = moved([*range(n)])
    assert np.array_equal(np.concatenate([moved([7]), moved([3])]), together[[7, 3]])


@pytest.mark.long
def test_stops_of_sliders_alone_are_those_of_prismatic_stop():
    for effects in ((), (e.CoulombFriction(0.1),)):
        ends = [
            e.JointStop((None, 0.0, None, 0.0), (None, 0.3, None, 0.3), 0.5),
            e.PrismaticStop((0.0, 0.0), (0.3, 0.3), 0.5),
        ]
        moved = []
        for stop in ends:
            batch = rde.BatchSimulator(rde.Scene(RPRP, (e.Gravity(), *effects, stop)), 4)
            batch.set_state(np.tile([0.3, 0.1, 0.2, 0.2], (4, 1)), np.linspace(-3.0, 3.0, 16).reshape(4, 4))
            for _ in range(30):
                batch.advance(np.zeros((4, 4)))
            moved.append(batch.q)
        assert np.array_equal(*moved)


@pytest.mark.long
def test_states_beyond_a_stop_are_refused_and_starts_are_inside():
    scene = SCENES["4R"]
    batch = rde.BatchSimulator(scene, 1)
    with pytest.raises(ValueError, match=r"is 0.901 rad; its stops are at -0.8 and 0.9 rad"):
        batch.set_state([[0.3, 1.201, 1.201, 1.201]], np.zeros((1, 4)))
    narrow = rde.Scene(
        FOUR_R,
        (e.EffortLimits((5.0,) * 4), e.JointStop((0.2, 0.1, -0.2, 0.3), (0.3, 0.15, -0.1, None), 0.5)),
    )
    fresh, _ = joints(rde.BatchSimulator(narrow, 1))
    np.testing.assert_allclose(fresh, [[0.2, 0.1, -0.1, 0.3]], rtol=0.0, atol=1e-15)
    envs = gym.make_vec("redundant_envs/FourRReach-v0", num_envs=64, scene=narrow.to_dict())
    envs.reset(seed=3)
    phi = envs.unwrapped.q @ FOUR_R.motor_map
    assert (phi >= np.array([0.2, 0.1, -0.2, 0.3]) - 1e-15).all()
    assert (phi <= np.array([0.3, 0.15, -0.1, np.inf]) + 1e-15).all()


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        (((0.1, 0.2), (1.0,)), r"lower has 2 entries and upper 1; give as many"),
        (((0.3,), (0.1,)), r"JointStop.lower\[0\]"),
        (((None,), (np.inf,)), "have no end of any joint; give one"),
        ((0.1, 0.2), "lower is 0.1; give an end for each joint"),
        (((0.1,), (float("nan"),)), r"JointStop.upper\[0\]"),
    ],
)
def test_impossible_numbers_are_refused(arguments, match):
    with pytest.raises(ValueError, match=match):
        e.JointStop(*arguments)


def test_another_number_of_joints_is_refused():
    with pytest.raises(ValueError, match=r"lower has 1 entries; .* has 4 joints: give an end, or None"):
        rde.Scene(FOUR_R, (e.JointStop((0.1,), (0.2,)),))


IMPACTS = {
    "150 impacts of two joints in turn": (
        rde.Chain("PRR", (0.93570767, 0.09052804, 0.33780294), (0.16131276, 0.12802083)),
        (
            e.CentringSpring((37.3913052,), (-0.02893336,), (-0.00783374,)),
            e.JointStop((-0.02893336,) * 3, (0.203147555, 0.249404853, -0.022265936), 0.5),
        ),
        {"control_dt": 0.083, "tolerance": 1e-6},
        ([0.203147555, -0.02893336, -0.051199296], [0.0, 1.63044479, -5.33186601]),
        [1.81819243, 0.37270138, -0.01205528], None,
    ),
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
"""Arms, effects, scenes, states, efforts, and tips by the account of the studies, which knows no springs."""


@pytest.mark.long
@pytest.mark.parametrize("name", IMPACTS)
def test_bounces_that_rest_leaves_out_do_not_change_which_joint_strikes_next(name):
    """An impact came after a joint had been put to rest, and before its bounces were over: they were off by
    2.6, by 3000, and by 5.5 tolerances."""
    arm, effects, how, (q, qd), efforts, right = IMPACTS[name]
    tips = []
    for tolerance in (how["tolerance"], 1e-9):
        batch = rde.BatchSimulator(rde.Scene(arm, effects, **how | {"tolerance": tolerance}), 1)
        batch.set_state([q], [qd])
        assert not batch.advance([efforts]).numerics.any()
        tips.append(arm.forward_kinematics(batch.q)[0])
    assert np.linalg.norm(tips[0] - (tips[1] if right is None else right)) <= how["tolerance"]
