"""Hard cases: masses and lengths of very different size, singular poses, chaos, speed, long runs."""

import gymnasium as gym
import numpy as np
import pytest
from refusals import refusal

import redundant_envs as rde
from redundant_envs.verify.checks import random_states

from . import measured as m
from .hard_case import at_least, at_most, hard_case


def pose(subject, start, goal):
    """The figure of a pose of the lab arm with its tip at a goal, sought from a singular one."""
    found = m.LAB.forward_kinematics(subject.pose_at(rde.Scene(m.LAB), start, np.array(goal)))
    what = f"a pose {np.hypot(*goal):.2f} m from the base, sought from there,"
    return at_most(what, np.linalg.norm(found - goal), 1e-6, "m off")


def more_steps(motion, prefix=""):
    """The figure of an interval that its usual steps would miss."""
    told = motion.evaluations[0, 0] >= 24 or motion.numerics[0] != 0
    return at_least(f"{prefix}intervals with more steps, or a flag,", told, 1)


@hard_case
def test_01_the_straight_arm(subject):
    q, qd = (0.0,) * 4, (0.0,) * 4
    yield m.accelerations(subject, m.LAB, q, qd, (0.5, -0.2, 0.1, 0.3), 9.81)
    # After 1 s, by collocation of order 16 in 34 digits.
    end = (-2.2941618162353746, -2.4834802323820511, -2.7634110527282831, -2.7308771419242488)
    for tolerance, bound in ((1e-6, 1e-5), (1e-12, 1e-10)):
        motion = subject.motion(rde.Scene(m.LAB, (m.GRAVITY,), tolerance=tolerance), q, qd, 50)
        off = 1e3 * m.tip_error(m.LAB, motion.q[-1, 0], end)
        yield at_most(f"at tolerance {tolerance:g} m the tip after 1 s", off, bound, "mm off")
    yield pose(subject, q, (1.5, 0.9))


@hard_case
def test_02_the_folded_arm(subject):
    q, qd = (0.0, np.pi, 0.0, np.pi), (1.0, -2.0, 3.0, -4.0)
    yield m.accelerations(subject, m.LAB, q, qd, (0.1,) * 4, 9.81)
    yield at_most("manipulability", m.LAB.manipulability(np.array(q)), 1e-15)
    yield pose(subject, q, (0.3, 0.6))


LIGHT = rde.FourR((1e-12, 1e-12, 1e-12, 1.0), (0.5,) * 4)


@hard_case
def test_03_three_vanishing_masses(subject):
    q, qd = (0.3, 1.2, -2.0, 0.8), (1.0, -2.0, 3.0, -4.0)
    for g in (0.0, 9.81):
        yield m.accelerations(subject, LIGHT, q, qd, (0.1,) * 4, g, prefix=f"with g = {g:g} ")


@hard_case
def test_04_three_vanishing_masses_nearly_straight(subject):
    q, qd = (0.3, 0.3001, 0.2999, 0.30005), (1.0, -2.0, 3.0, -4.0)
    # Half an ulp of one torque moves qdd by 2.6e-10: the numbers given have no more digits.
    yield m.accelerations(subject, LIGHT, q, qd, (0.1,) * 4, most=2e-10)


@hard_case
def test_05_a_vanishing_tip(subject):
    arm = rde.FourR((1.0, 1.0, 1.0, 1e-12), (0.5,) * 4)
    q, qd = (0.3, 1.2, -2.0, 0.8), (1.0, -2.0, 3.0, -4.0)
    yield m.accelerations(subject, arm, q, qd, (0.1, 0.1, 0.1, 1e-12))


@hard_case
def test_06_links_of_a_micrometre(subject):
    arm = rde.FourR((1.0,) * 4, (1.0, 1e-6, 1.0, 1e-6))
    q, qd = (0.3, 1.2, -2.0, 0.8), (1.0, -2.0, 3.0, -4.0)
    yield m.accelerations(subject, arm, q, qd, (0.1, 1e-7, 0.1, 1e-7))
    scene = rde.Scene(arm, (m.GRAVITY,), tolerance=1e-6)
    motion = subject.motion(scene, q, qd, 1)
    yield more_steps(motion)
    fine = m.fine_end(scene, q, qd, 16384)
    off = 0.0 if motion.numerics[0] else m.tip_error(arm, motion.q[-1], fine.q)
    yield at_most("an unflagged tip after 20 ms", off, 1e-6, "m off")


ONES, HALVES = (1.0,) * 4, (0.5,) * 4
IMPOSSIBLE = [
    ("masses[1]", "FourR", (1.0, 0.0, 1.0, 1.0), HALVES),
    ("lengths[2]", "FourR", ONES, (0.5, 0.5, 0.0, 0.5)),
    ("masses[0]", "FourR", (float("nan"), 1.0, 1.0, 1.0), HALVES),
    ("masses[3]", "FourR", (1.0, 1.0, 1.0, -1.0), HALVES),
    ("lengths[0]", "RPRP", ONES, (float("inf"), 0.5)),
    ("lengths[1]", "RPRP", ONES, (0.5, -0.5)),
    ("masses[2]", "RPRP", (1.0, 1.0, 0.0, 1.0), (0.5, 0.5)),
]


@hard_case
def test_07_impossible_parameters_are_refused_by_name(subject):
    named = sum(field in str(refusal(subject.arm, *arm)) for field, *arm in IMPOSSIBLE)
    yield at_least("the number of refusals that name the field", named, len(IMPOSSIBLE))


@hard_case
def test_08_a_slider_through_its_axis(subject):
    q, qd = (0.3, 0.1, -0.4, -0.5), (1.0, 0.8, -2.0, -0.6)
    yield m.accelerations(subject, m.SLIDING, q, qd, (0.1,) * 4, 9.81)
    scene = rde.Scene(m.SLIDING, (m.GRAVITY,), tolerance=1e-12)
    start = (0.3, 0.1, -0.4, -0.4), (1.0, 0.8, -2.0, -2.0)
    motion = subject.motion(scene, *start, 10)
    passed = motion.q[0, 0, 3] > -0.5 > motion.q[-1, 0, 3]
    yield at_least("passes", passed, 1)
    yield at_most("the energy over the pass", m.energy_error(scene, motion), 1e-11, "J off")


@hard_case
def test_09_light_sliders_near_their_axes(subject):
    qd = (1.0, 0.8, -2.0, -0.6)
    for link, masses, q in (
        (2, (1.0, 1.0, 1e-9, 1.0), (0.3, 0.1, -0.4, -0.5 + 1e-6)),
        (1, (1e-9, 1.0, 1.0, 1.0), (0.3, -0.5 + 1e-6, -0.4, 0.1)),
    ):
        arm, prefix = rde.RPRP(masses, (0.5, 0.5)), f"at the axis of link {link} "
        yield m.accelerations(subject, arm, q, qd, (0.1,) * 4, prefix=prefix)
        scene = rde.Scene(arm, (m.GRAVITY,), tolerance=1e-6)
        yield more_steps(subject.motion(scene, q, qd, 1), prefix)


@hard_case
def test_10_a_polar_fly_by_is_a_straight_line(subject):
    arm = rde.RPRP((1e-12, 1.0, 1e-12, 1e-12), (0.5, 0.5))
    scene = rde.Scene(arm, (), tolerance=1e-6)
    for b in (0.1, 0.01, 0.001):
        radius, angle = np.hypot(1.0, b), np.arctan2(b, -1.0)
        q, qd = (angle, radius - 0.5, 0.0, 0.0), (-b / radius**2, -1.0 / radius, 0.0, 0.0)
        motion = subject.motion(scene, q, qd, 100)
        off = np.abs(arm.points(motion.q[-1, 0])[1] - (1.0, b)).max()
        yield at_most(f"passing at {b:g} m the end of the line", off, 1e-6, "m off")
        yield at_most(f"passing at {b:g} m flagged intervals", motion.numerics[0], 0)


@pytest.mark.long
@hard_case
def test_44_the_tolerance_is_kept_with_nearly_vanishing_links(subject):
    arm, tolerance = rde.FourR((1.0,) * 4, (1.0, 1e-5, 1.0, 1e-5)), 1e-6
    scene = rde.Scene(arm, (m.GRAVITY,), tolerance=tolerance)
    q, qd, _ = random_states(scene, 512, 0)
    motion = subject.motion(scene, q, qd, 1)
    ends = [arm.forward_kinematics(m.fine_end(scene, q, qd, count).q) for count in (2048, 4096)]
    judged = np.linalg.norm(ends[0] - ends[1], axis=1) <= 0.1 * tolerance
    yield at_least("the number of intervals that two references agree in", judged.sum(), 300)
    error = np.linalg.norm(arm.forward_kinematics(motion.q[-1]) - ends[1], axis=1)
    flagged = motion.numerics != 0
    off = np.mean(~(error <= tolerance)[judged & ~flagged])
    yield at_most("the share of unflagged intervals off by more than the tolerance", off, 1e-3)
    yield at_most("the share of flagged intervals", np.mean(flagged[judged]), 4e-3)


@hard_case
def test_45_heavy_tips_at_speed(subject):
    rng = np.random.default_rng(11)
    for kind, lengths in (("FourR", 4), ("RPRP", 2)):
        worst = 0.0
        for _ in range(10):
            arm = getattr(rde, kind)((1e-6, 1e-6, 1e-6, 1.0), tuple(rng.uniform(0.3, 0.7, lengths)))
            q, qd = rng.uniform(-1.5, 1.5, 4), rng.normal(0.0, 3.0, 4)
            worst = np.fmax(worst, m.acceleration_error(subject, arm, q, qd, np.zeros(4)))
        yield at_most(f"{kind}: the error of qdd", worst, 1e-14, "of the largest acceleration")


WEIGHT = 9.81 * (0.5 + 1.0 + 1.5 + 2.0)
"""Energy scale of the lab arm, J: its masses lifted to their full height."""


@hard_case
def test_11_chaos_keeps_its_energy(subject):
    for name, tolerance, bound in (("exact", 1e-12, 1e-9), ("standard", 1e-6, 1e-3)):
        scene = rde.Scene(m.LAB, (m.GRAVITY,), tolerance=tolerance)
        motion = subject.motion(scene, *m.STATE_B, 1000)
        error = m.energy_error(scene, motion)
        yield at_most(f"at {name} the energy within 20 s", error, bound, "J off")
        if name == "standard":
            rate = error / (WEIGHT * 20.0)
            yield at_most("at standard the energy rate", rate, 1e-6, "of 49 J per second")


@hard_case
def test_12_chaos_at_twice_the_speed(subject):
    scene = rde.Scene(m.LAB, (m.GRAVITY,), tolerance=1e-12)
    q, qd = m.STATE_B
    motion = subject.motion(scene, q, 2.0 * np.array(qd), 250)
    error = m.energy_error(scene, motion) / m.energy(scene, motion.q[0], motion.qd[0])[0]
    yield at_most("the energy within 5 s", error, 1e-11, "of itself off")
    yield at_least("the most evaluations of an interval", motion.evaluations.max(), 24)


@hard_case
def test_48_a_link_that_turns_once_between_looks(subject):
    arm = rde.FourR((1.0, 1.0, 1.0, 1e-9), (0.5,) * 4)
    q, qd = (-1.6, -1.5, -1.7, 0.0), (0.0, 0.0, 0.0, 2.0 * np.pi / 0.005)
    scene = rde.Scene(arm, (m.GRAVITY,), tolerance=1e-6)
    motion, fine = subject.motion(scene, q, qd, 1), m.fine_end(scene, q, qd, 1024)
    yield at_most("the tip after 20 ms", m.tip_error(arm, motion.q[-1], fine.q), 1e-6, "m off")
    yield at_least("the evaluations of the interval", motion.evaluations[0, 0], 12 * 64)


def growing_mode():
    """The fastest mode of the upright lab arm: its rate, 1/s, and its shape, largest entry 1."""
    mass, up = m.LAB.mass_matrix(np.full(4, np.pi / 2)), np.diag(9.81 * 0.5 * np.array([4.0, 3.0, 2.0, 1.0]))
    half = np.linalg.cholesky(mass)
    values, vectors = np.linalg.eigh(np.linalg.solve(half, np.linalg.solve(half, up).T))
    shape = np.linalg.solve(half.T, vectors[:, -1])
    return np.sqrt(values[-1]), shape / shape[np.argmax(np.abs(shape))]


@hard_case
def test_13_the_upright_arm_falls_at_its_rate(subject):
    rate, shape = growing_mode()
    exact = np.sqrt(9.395070912301 * 9.81 / 0.5)  # the largest zero of the Laguerre polynomial L_4
    scene = rde.Scene(m.LAB, (m.GRAVITY,), tolerance=1e-6)
    motion = subject.motion(scene, np.pi / 2 + 1e-8 * shape, 1e-8 * rate * shape, 42)
    deviation = np.abs(motion.q[:, 0] - np.pi / 2).max(axis=1)
    grown = np.log(deviation[-1] / deviation[0]) / 0.84
    yield at_least("the deviation after 0.84 s", deviation[-1], 5e-4, "rad")
    yield at_most("the rate of growth", abs(grown / exact - 1.0), 1e-6, "of itself off")


@hard_case
def test_14_the_upright_arm_stands(subject):
    motion = subject.motion(
        rde.Scene(m.LAB, (m.GRAVITY,), tolerance=1e-6), np.full((19, 4), np.pi / 2), 0.0, 25
    )
    off = np.abs(motion.q[-1] - np.pi / 2).max()
    yield at_most("the deviation after 0.5 s", off, 1e-12, "rad")
    differing = (motion.q[-1] != motion.q[-1, 0]).any(axis=1)
    yield at_most("the number of lanes that differ from the first", differing.sum(), 0)


@pytest.mark.long
@hard_case
def test_15_bang_bang_efforts_lose_no_lane(subject):
    lanes, intervals = 200, 200
    table = np.random.default_rng(5).choice((-60.0, 60.0), (intervals, lanes, 4))
    scene = rde.Scene(m.LAB, (m.GRAVITY,), tolerance=1e-6, actuation="generalized")
    motion = subject.motion(scene, np.zeros((lanes, 4)), 0.0, intervals, lambda k: table[k])
    yield at_most("the number of 200 lanes that are not finite", (~motion.finite).sum(), 0)
    yield at_most("the mean cost", motion.evaluations.mean() / 12, 20, "RK8 steps per interval")


@hard_case
def test_17_spinning_up_ends_with_a_flag_and_no_gain(subject):
    scene = rde.load_scene("four_r_reach").to_dict()
    scene["effects"] = [x for x in scene["effects"] if x["type"] != "ViscousFriction"]
    env = gym.make("redundant_envs/FourRReach-v0", scene=scene, max_episode_steps=500)
    flagged = finite = 0
    most = -np.inf
    for seed in range(10):
        env.reset(seed=seed)
        total, over = 0.0, False
        while not over:
            obs, reward, terminated, truncated, info = env.step(np.ones(4, np.float32))
            total, over = total + reward, terminated or truncated
            finite += not (np.isfinite(obs).all() and np.isfinite(total))
        flagged += bool(terminated and info["numerics"] & rde.Numerics.SPEED_BOUND)
        most = max(most, total)
    yield at_least("the number of 10 episodes that end at the speed bound", flagged, 10)
    yield at_most("the number of steps with numbers that are not finite", finite, 0)
    yield at_most("the largest return of those ends", most, 1e-9)


@pytest.mark.long
@hard_case
def test_20_a_long_spin_keeps_its_angle(subject):
    scene = rde.Scene(m.LAB, (), integrator="rk4", control_dt=5.0, substeps=1000)
    motion = subject.motion(scene, np.zeros(4), 100.0, 1257)
    yield at_most("the angle after 6285 s", np.abs(motion.q[-1] - 628500.0).max(), 1e-9, "rad off")
    yield at_most("the rate", np.abs(motion.qd[-1] - 100.0).max(), 0, "rad/s off")
    # 0.5 rad per step is a float. Other sums are rounded, to the same side for as long as their exponent
    # stays: by 1.26e6 times half of 1.2e-10 rad at most.
    rate = 31.9 * np.pi
    motion = subject.motion(scene, np.zeros(4), rate, 1257)
    off = np.abs(motion.q[-1] / (1257 * 5 * rate) - 1.0).max()
    yield at_most("at 100.2 rad/s, whose sums are rounded, the angle", off, 1.2e-10, "of itself off")


@pytest.mark.long
@hard_case
def test_21_energy_drifts_as_the_method_does(subject):
    q = np.random.default_rng(21).uniform(-np.pi, np.pi, (8, 4))
    for name, step, bound in (("rk4", 1e-3, 1e-3), ("rk8", 2.5e-3, 1e-7)):
        scene = rde.Scene(m.LAB, (m.GRAVITY,), name, control_dt=10.0, substeps=round(10.0 / step))
        motion = subject.motion(scene, q, 0.0, 100)
        off = np.abs(
            m.energy(scene, motion.q[-1], motion.qd[-1]) - m.energy(scene, motion.q[0], motion.qd[0])
        )
        what = f"with {name.upper()} of {1e3 * step:g} ms the median energy"
        yield at_most(what, np.median(off), bound, "J off")


@pytest.mark.long
@hard_case
def test_22_the_time_is_a_product(subject):
    instants = subject.instants(10000, 1e-3)
    off = np.abs(instants - np.arange(10000) * 1e-3).max()
    yield at_most("the largest difference to n dt in 10 s", off, 0, "s")
