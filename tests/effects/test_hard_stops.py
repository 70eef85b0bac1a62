"""Hard stops of sliders and joints: impacts where and when they happen, rest, release, endless searches."""

import itertools
import math

import gymnasium as gym
import numpy as np
import pytest
from catalogue import EQUAL, FOUR_R, RPRP, advanced, assert_same_bits, by_another_account, stops

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.scenes.tableaus import METHODS

ARM = EQUAL["RPRP"]
OVER = rde.Numerics.EVENT_BUDGET


def scene(arm=ARM, restitution=1.0, lower=(0.0, 0.0), upper=(0.3, 0.3), gravity=9.81, **kwargs):
    return rde.Scene(arm, (e.Gravity(gravity), e.PrismaticStop(lower, upper, restitution)), **kwargs)


# ---- impacts -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("integrator", "substeps"), [("euler", 1), ("rk4", 3)])
def test_the_time_of_an_impact_does_not_depend_on_the_substep_it_falls_in(integrator, substeps):
    made = scene(upper=(0.4, 0.4), gravity=0.0, integrator=integrator, substeps=substeps)
    speed = 1.003  # the arm lies still and straight: slider 2 glides alone
    events = rde.simulate(made, [0.0, 0.2, 0.0, 0.2], [0.0, 0.0, 0.0, speed], [0.3]).events
    assert events[0].joint == "r2"
    assert events[0].time == pytest.approx(0.2 / speed, abs=1e-12)


@pytest.mark.long
@pytest.mark.parametrize(
    "how", [{"tolerance": 1e-9}, {"tolerance": None, "integrator": "rk4", "substeps": 3}], ids=str
)
def test_units_of_time_and_mass_change_no_bit_of_a_motion_with_impacts(how):
    """Found by fuzzing: a nanosecond was neglected, so fast sliders missed tolerances in short intervals."""
    masses, rng, n = np.array((0.33, 0.25, 0.28, 0.33)), np.random.default_rng(0), 512
    q = rng.uniform((-3.0, 0.0, -3.0, 0.0), (3.0, 0.02, 3.0, 0.02), (n, 4))
    qd, efforts = rng.normal(0.0, (5.0, 0.5, 5.0, 0.5), (n, 4)), rng.normal(0.0, 1.0, (n, 4))
    found = []
    for unit, mass in ((1.0, 1.0), (2.0**-24, 1.0), (2.0**-6, 4.0), (2.0**10, 0.25)):
        arm = rde.RPRP(mass * masses, (0.14, 0.14))
        made = scene(arm, 0.9, upper=(0.02, 0.02), gravity=0.0, control_dt=0.02 * unit, **how)
        batch, status = advanced(made, q, qd / unit, mass * efforts / unit**2)
        assert not status.numerics.any()
        assert status.events.sum() > 400
        found.append((batch.q, batch.qd * unit, status.evaluations))
    for other in found[1:]:
        assert_same_bits(found[0], other)


def test_a_hard_stop_decides_the_travel():
    springs = (e.LimitSpring("r1", -0.1, 0.5), e.LimitSpring("r2", -0.1, 0.5))
    stop = e.PrismaticStop((0.0, 0.0), (0.25, 0.25))
    for effects in ((stop,), (stop, *springs), (*springs, stop)):
        ends = rde.Scene(ARM, effects).travel()[1]
        assert ends == ("prismatic_stop.lower[0]", "prismatic_stop.upper[0]")
    made = rde.Scene(ARM, (e.PrismaticStop((None, 0.0), (0.3, None), 0.5),))
    assert made.travel() == {}


# ---- two sliders at their stops almost at once: neither order nor rest depends on the steps ----------

TRAVEL = 0.001


def slow_leavers():
    """States and efforts, (4, 4) each: a slider leaves its stop slowly, the other is about to strike."""
    angles = [[1.897, -0.235], [1.582, -0.525], [0.703, 2.787], [-1.214, 2.236]]
    at = TRAVEL - np.array([[3, 0], [6, 0], [6, 0], [0, 7]]) * np.spacing(TRAVEL)
    rates = [[-0.165, -1.6], [0.027, 0.867], [-1.08, -0.187], [1.829, 1.723]]
    speed = [[2.4e-4, -2.1e-12], [1.9e-4, -1.9e-11], [6.4e-4, -1.3e-12], [-4.9e-9, 2.9e-4]]
    q, qd = (np.stack(pairs, axis=2).reshape(4, 4) for pairs in ([angles, at], [rates, speed]))
    efforts = [[0.9, 6, 0.7, 5], [0.1, 8.1, 1.2, 5.8], [-1.3, 2.2, 0.4, 10.1], [1.5, 2.2, -0.2, 3]]
    return q, qd, np.array(efforts)


def pressed():
    """The same, (12, 4) each, of sliders one of which stands at a stop, and the other may strike one."""
    rng, n = np.random.default_rng(3), 100
    upper = rng.random((n, 2)) < 0.5
    stands = rng.random((n, 2)) < 0.5
    stands[:, 0] |= ~stands.any(axis=1)
    q, qd = rng.uniform(-3.0, 3.0, (n, 4)), rng.normal(size=(n, 4))
    q[:, 1::2] = np.where(upper, TRAVEL, 0.0)
    qd[:, 1::2] = np.where(stands, 0.0, np.where(upper, 1.0, -1.0) * rng.uniform(0.2, 2.0, (n, 2)))
    return q[:12], qd[:12], rng.uniform(-10.0, 10.0, (n, 4))[:12]


@pytest.mark.long
@pytest.mark.parametrize(
    ("given", "restitution", "most"), [(slow_leavers(), 0.0, 1e-11), (pressed(), 0.5, 1e-8)]
)
def test_another_account_lets_slow_sliders_leave_and_supports_pressed_ones(given, restitution, most):
    """With fixed steps a bounce below 1e-9 m is put to rest: slow ones would be off by 8e-5."""
    pytest.importorskip("scipy", reason="scipy is in the extra 'verify'")
    made = scene(rde.RPRP((0.5,) * 4, (0.25, 0.25)), restitution, upper=(TRAVEL,) * 2)
    batch, _ = advanced(made, *given)
    assert np.abs(np.stack([batch.q, batch.qd], axis=1) - by_another_account(made, *given)).max() < most


# ---- rest --------------------------------------------------------------------------------------------


@pytest.mark.quick("0.0")
@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_every_start_at_both_stops_goes_on(restitution):
    """All signs of speed and force, down to rounding: no lane bounces without end."""
    choices = itertools.product(
        (0.0, 0.3), (0.0, 0.3), (-1.0, -1e-12, -1e-15, 0.0, 1e-15, 1e-12, 1.0), (-1.0, 0.0, 1e-14, 1.0),
        (-30.0, 0.0, 30.0), (-30.0, 0.0, 30.0),
    )  # fmt: skip
    a, b, va, vb, fa, fb = np.array(list(choices)).T
    zero, efforts = np.zeros_like(a), np.column_stack([0.0 * a, fa, 0.0 * a, fb])
    q, qd = np.column_stack([zero + 0.7, a, zero - 0.4, b]), np.column_stack([zero, va, zero, vb])
    batch, status = advanced(scene(restitution=restitution, tolerance=1e-6), q, qd, efforts)
    for _ in range(3):
        assert not status.numerics.any()
        assert (np.abs(batch.q[:, [1, 3]] - 0.15) <= 0.15).all()
        status = batch.advance(efforts)


def test_a_stop_that_is_moved_away_lets_go():
    hanging = [-math.pi / 2, 0.3, -math.pi / 2, 0.3]
    batch, _ = advanced(scene(restitution=0.0, tolerance=1e-6), hanging, [0.0] * 4)
    batch.set_parameters({"prismatic_stop.upper": [0.5, 0.5]})
    for _ in range(5):
        batch.advance()
    assert batch.q[0, 1] == pytest.approx(0.3 + 0.5 * 9.81 * 0.1**2, abs=1e-9)


def test_a_slider_thrown_off_its_stop_by_the_other_is_let_go_in_the_log():
    """Slider 1 rests at its upper stop until the impact of slider 2 throws it off."""
    made = scene(gravity=0.0, tolerance=1e-9)
    times = np.linspace(0.02, 0.2, 10)
    motion = rde.simulate(made, [0.0, 0.3, 0.0, 0.1], [0.0, 0.0, 0.0, -1.0], times, [0.0, 1.0, 0.0, 0.0])
    kinds = [(x.kind, x.joint) for x in motion.events]
    hit = kinds.index(("lower impact", "r2"))
    assert ("rest", "r1") in kinds[:hit]
    assert ("release", "r1") in kinds[hit - 1 : hit + 2]  # at the same time
    assert all(str(x.speed) != "-0.0" for x in motion.events)


# ---- too many impacts, or endless searches: given up, flagged, and the state restored ----------------

FAST = [0.3, 0.1, 0.3, 0.1], [0.0, 1e5, 0.0, 0.0]


@pytest.mark.long
def test_simulate_refuses_a_motion_with_too_many_impacts():
    with pytest.raises(
        ValueError, match=r"more than 256 impacts \(1024 .*\), or 65536 pieces, in .* at t = 0 s"
    ):
        rde.simulate(scene(gravity=0.0, tolerance=1e-6), *FAST, [0.02, 0.04])


def test_the_budget_of_impacts_is_that_of_the_interval_not_of_a_substep():
    qd = [0.0, 1.5e4, 0.0, 0.0]  # some thirteen impacts in each substep
    made = scene(gravity=0.0, integrator="rk4", substeps=64)
    rates = [[0.0, 0.5, 0.0, 0.2], qd, [0.0, -0.5, 0.0, 0.0]]  # lane 1 has neighbours
    batch, status = advanced(made, [FAST[0]] * 3, rates, track_work=True)
    assert status.numerics.tolist() == [0, OVER, 0]
    assert_same_bits([batch.q[1], batch.qd[1], batch.work[1]], [FAST[0], qd, 0.0])
    assert status.events[1] == 0
    assert not any(x.lane == 1 for x in batch.events())
    alone, _ = advanced(made, [FAST[0]] * 2, rates[::2])
    assert_same_bits([batch.q[::2], batch.qd[::2]], [alone.q, alone.qd])


BETWEEN = [0.755, 0.0, 0.702, 0.42]


@pytest.mark.quick("euler-1")
@pytest.mark.parametrize(("integrator", "substeps"), [("euler", 1), ("rk8", 50)])
def test_fixed_steps_that_a_damper_makes_unstable_are_given_up_before_long(integrator, substeps):
    """Found by fuzzing: every trial step ended beyond a stop, 1e7 times in an interval."""
    arm = rde.RPRP((5e-7, 1.3e-5, 5e5, 1.3e-3), (0.14, 0.65))
    effects = e.PrismaticStop((0.0, -0.08), (0.04, 0.42), 0.5), e.ViscousFriction((1.8e5, 1e5, 1.6e5, 1.4e5))
    made = rde.Scene(arm, effects, integrator=integrator, substeps=substeps, control_dt=0.002)
    batch, status = advanced(made, [BETWEEN, [0.7, 0.02, 0.7, 0.3]], [[1.0, 0.0, -3.6, 0.07], [0.0] * 4])
    assert (status.evaluations <= METHODS[integrator].stages * (65536 + 18 * substeps)).all()
    assert status.numerics[0] & ~(OVER | rde.Numerics.NON_FINITE) == 0
    if status.numerics[0] == OVER:
        np.testing.assert_array_equal(batch.q[0], BETWEEN)


@pytest.mark.parametrize(
    ("substeps", "q", "qd", "efforts", "impacts"),
    [
        # a slider that is near its stop in each substep
        (20_000, [0.0, 0.3 - 1e-9, 0.0, 0.3 - 1e-9], [0.0] * 4, [[0.0, 1e-7, 0.0, -1e-7]], 0),
        # more pieces of motion than an interval usually may have; the last ones have an impact
        (70_000, [0.0, 0.1, 0.0, 0.1], [0.0, 10.4, 0.0, 0.0], None, 1),
    ],
)
def test_a_budget_of_trial_steps_grows_with_the_substeps(substeps, q, qd, efforts, impacts):
    made = scene(gravity=0.0, integrator="rk4", substeps=substeps)
    _, status = advanced(made, q, qd, efforts)
    assert status.numerics.tolist() == [0]
    assert status.events[0] >= impacts
    assert status.evaluations[0] >= 4 * substeps


def test_a_log_of_events_that_is_full_says_so():
    made = scene(gravity=0.0, tolerance=1e-6)
    batch, _ = advanced(made, [FAST[0]] * 2, np.zeros((2, 4)), track_work=True)
    batch._memory.write(("logged",), 256.0, np.array([1]))
    with pytest.raises(ValueError, match="environment 1 had 256 events or more"):
        batch.events()


# ---- joints that turn: impacts along rows of B^T, rest and release -----------------------------------

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
    scene = rde.Scene(LINK, effects, control_dt=0.5, **how)
    batch, _ = advanced(scene, [[0.39]], [[0.0]], [[3.0]], intervals=4)
    assert (batch.q[0, 0], batch.qd[0, 0]) == (0.4, 0.0)
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
    q, qd = np.tile([0.3, 0.1, 0.2, 0.2], (4, 1)), np.linspace(-3.0, 3.0, 16).reshape(4, 4)
    one, other = (
        advanced(rde.Scene(RPRP, (e.Gravity(), e.CoulombFriction(0.1), stop)), q, qd, intervals=30)[0]
        for stop in (e.JointStop((None, 0.0, None, 0.0), (None, 0.3, None, 0.3), 0.5), stops(RPRP))
    )
    assert np.array_equal(one.q, other.q)


@pytest.mark.long
def test_states_beyond_a_stop_are_refused_and_starts_are_inside():
    scene = rde.Scene(FOUR_R, (e.JointStop((-1.0, -0.8, None, -0.5), (1.5, 0.9, 0.7, 0.5)),))
    with pytest.raises(ValueError, match=r"is 0.901 rad; its stops are at -0.8 and 0.9 rad"):
        rde.BatchSimulator(scene).set_state([[0.3, 1.201, 1.201, 1.201]], np.zeros((1, 4)))
    narrow = rde.Scene(
        FOUR_R, (e.EffortLimits((5.0,) * 4), e.JointStop((0.2, 0.1, -0.2, 0.3), (0.3, 0.15, -0.1, None), 0.5))
    )
    fresh = rde.BatchSimulator(narrow).q @ FOUR_R.motor_map
    np.testing.assert_allclose(fresh, [[0.2, 0.1, -0.1, 0.3]], rtol=0.0, atol=1e-15)
    envs = gym.make_vec("redundant_envs/FourRReach-v0", num_envs=64, scene=narrow.to_dict())
    envs.reset(seed=3)
    phi = envs.unwrapped.q @ FOUR_R.motor_map
    assert (phi >= np.array([0.2, 0.1, -0.2, 0.3]) - 1e-15).all()
    assert (phi <= np.array([0.3, 0.15, -0.1, np.inf]) + 1e-15).all()
