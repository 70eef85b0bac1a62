"""Hard cases: masses and lengths of very different size, stretched and folded arms, sliders at the axis."""

import numpy as np
from hard_case import at_least, at_most, hard_case
from measured import (
    GRAVITY,
    LAB,
    SLIDING,
    STATE_A,
    acceleration_error,
    energy_error,
    fine_end,
    refusals,
    tip_error,
)

import redundant_envs as rde
from redundant_envs.verify.checks import random_states

RELATIVE = "of the largest acceleration"


@hard_case("1")
def test_01_the_straight_arm(subject):
    q, qd = STATE_A
    error = acceleration_error(subject, LAB, q, qd, (0.5, -0.2, 0.1, 0.3), 9.81)
    yield at_most("the error of qdd", error, 1e-14, RELATIVE)
    # After 1 s, by collocation of order 16 in 34 digits.
    end = (-2.2941618162353746, -2.4834802323820511, -2.7634110527282831, -2.7308771419242488)
    for tolerance, bound in ((1e-6, 1e-5), (1e-12, 1e-10)):
        motion = subject.motion(rde.Scene(LAB, (GRAVITY,), tolerance=tolerance), q, qd, 50)
        off = 1e3 * tip_error(LAB, motion.q[-1, 0], end)
        yield at_most(f"at tolerance {tolerance:g} m the tip after 1 s", off, bound, "mm off")
    goal = np.array([1.5, 0.9])
    pose = subject.pose_at(rde.Scene(LAB), q, goal)
    distance = np.linalg.norm(LAB.forward_kinematics(pose) - goal)
    yield at_most("a pose 1.75 m from the base, sought from there,", distance, 1e-6, "m off")


@hard_case("2")
def test_02_the_folded_arm(subject):
    q, qd = (0.0, np.pi, 0.0, np.pi), (1.0, -2.0, 3.0, -4.0)
    error = acceleration_error(subject, LAB, q, qd, (0.1,) * 4, 9.81)
    yield at_most("the error of qdd", error, 1e-14, RELATIVE)
    yield at_most("manipulability", LAB.manipulability(np.array(q)), 1e-15)
    goal = np.array([0.3, 0.6])
    pose = subject.pose_at(rde.Scene(LAB), q, goal)
    distance = np.linalg.norm(LAB.forward_kinematics(pose) - goal)
    yield at_most("a pose 0.67 m from the base, sought from there,", distance, 1e-6, "m off")


LIGHT = rde.FourR((1e-12, 1e-12, 1e-12, 1.0), (0.5,) * 4)


@hard_case("3")
def test_03_three_vanishing_masses(subject):
    q, qd = (0.3, 1.2, -2.0, 0.8), (1.0, -2.0, 3.0, -4.0)
    for g in (0.0, 9.81):
        error = acceleration_error(subject, LIGHT, q, qd, (0.1,) * 4, g)
        yield at_most(f"with g = {g:g} the error of qdd", error, 1e-14, RELATIVE)


@hard_case("4")
def test_04_three_vanishing_masses_nearly_straight(subject):
    q, qd = (0.3, 0.3001, 0.2999, 0.30005), (1.0, -2.0, 3.0, -4.0)
    error = acceleration_error(subject, LIGHT, q, qd, (0.1,) * 4)
    # Half an ulp of one torque moves qdd by 2.6e-10: the numbers given have no more digits.
    yield at_most("the error of qdd", error, 2e-10, RELATIVE)


@hard_case("5")
def test_05_a_vanishing_tip(subject):
    arm = rde.FourR((1.0, 1.0, 1.0, 1e-12), (0.5,) * 4)
    q, qd = (0.3, 1.2, -2.0, 0.8), (1.0, -2.0, 3.0, -4.0)
    error = acceleration_error(subject, arm, q, qd, (0.1, 0.1, 0.1, 1e-12))
    yield at_most("the error of qdd", error, 1e-14, RELATIVE)


@hard_case("6")
def test_06_links_of_a_micrometre(subject):
    arm = rde.FourR((1.0,) * 4, (1.0, 1e-6, 1.0, 1e-6))
    q, qd = (0.3, 1.2, -2.0, 0.8), (1.0, -2.0, 3.0, -4.0)
    error = acceleration_error(subject, arm, q, qd, (0.1, 1e-7, 0.1, 1e-7))
    yield at_most("the error of qdd", error, 1e-14, RELATIVE)
    scene = rde.Scene(arm, (GRAVITY,), tolerance=1e-6)
    motion = subject.motion(scene, q, qd, 1)
    told = motion.evaluations[0, 0] >= 24 or motion.numerics[0] != 0
    yield at_least("intervals with more steps, or a flag,", told, 1)
    fine = fine_end(scene, q, qd, 16384)
    off = 0.0 if motion.numerics[0] else tip_error(arm, motion.q[-1], fine.q)
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


@hard_case("7")
def test_07_impossible_parameters_are_refused_by_name(subject):
    named = sum(refusals(field, lambda arm=arm: subject.arm(*arm)) for field, *arm in IMPOSSIBLE)
    yield at_least("the number of refusals that name the field", named, len(IMPOSSIBLE))


@hard_case("8")
def test_08_a_slider_through_its_axis(subject):
    q, qd = (0.3, 0.1, -0.4, -0.5), (1.0, 0.8, -2.0, -0.6)
    error = acceleration_error(subject, SLIDING, q, qd, (0.1,) * 4, 9.81)
    yield at_most("the error of qdd", error, 1e-14, RELATIVE)
    scene = rde.Scene(SLIDING, (GRAVITY,), tolerance=1e-12)
    start = (0.3, 0.1, -0.4, -0.4), (1.0, 0.8, -2.0, -2.0)
    motion = subject.motion(scene, *start, 10)
    passed = motion.q[0, 0, 3] > -0.5 > motion.q[-1, 0, 3]
    yield at_least("passes", passed, 1)
    yield at_most("the energy over the pass", energy_error(scene, motion), 1e-11, "J off")


@hard_case("9")
def test_09_light_sliders_near_their_axes(subject):
    for masses, q in (
        ((1.0, 1.0, 1e-9, 1.0), (0.3, 0.1, -0.4, -0.5 + 1e-6)),
        ((1e-9, 1.0, 1.0, 1.0), (0.3, -0.5 + 1e-6, -0.4, 0.1)),
    ):
        arm = rde.RPRP(masses, (0.5, 0.5))
        link = 2 if masses[2] < 1.0 else 1
        error = acceleration_error(subject, arm, q, (1.0, 0.8, -2.0, -0.6), (0.1,) * 4)
        yield at_most(f"at the axis of link {link} the error of qdd", error, 1e-14, RELATIVE)
        scene = rde.Scene(arm, (GRAVITY,), tolerance=1e-6)
        motion = subject.motion(scene, q, (1.0, 0.8, -2.0, -0.6), 1)
        told = motion.evaluations[0, 0] >= 24 or motion.numerics[0] != 0
        yield at_least(f"at the axis of link {link} intervals with more steps, or a flag,", told, 1)


@hard_case("10")
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


@hard_case("44")
def test_44_the_tolerance_is_kept_with_nearly_vanishing_links(subject):
    arm, tolerance = rde.FourR((1.0,) * 4, (1.0, 1e-5, 1.0, 1e-5)), 1e-6
    scene = rde.Scene(arm, (GRAVITY,), tolerance=tolerance)
    q, qd, _ = random_states(scene, 512, 0)
    motion = subject.motion(scene, q, qd, 1)
    ends = [arm.forward_kinematics(fine_end(scene, q, qd, count).q) for count in (2048, 4096)]
    judged = np.linalg.norm(ends[0] - ends[1], axis=1) <= 0.1 * tolerance
    yield at_least("the number of intervals that two references agree in", judged.sum(), 300)
    error = np.linalg.norm(arm.forward_kinematics(motion.q[-1]) - ends[1], axis=1)
    flagged = motion.numerics != 0
    off = np.mean(~(error <= tolerance)[judged & ~flagged])
    yield at_most("the share of unflagged intervals off by more than the tolerance", off, 1e-3)
    yield at_most("the share of flagged intervals", np.mean(flagged[judged]), 4e-3)


@hard_case("45")
def test_45_heavy_tips_at_speed(subject):
    rng = np.random.default_rng(11)
    for kind, lengths in (("FourR", 4), ("RPRP", 2)):
        worst = 0.0
        for _ in range(10):
            arm = getattr(rde, kind)((1e-6, 1e-6, 1e-6, 1.0), tuple(rng.uniform(0.3, 0.7, lengths)))
            q, qd = rng.uniform(-1.5, 1.5, 4), rng.normal(0.0, 3.0, 4)
            worst = np.fmax(worst, acceleration_error(subject, arm, q, qd, np.zeros(4)))
        yield at_most(f"{kind}: the error of qdd", worst, 1e-14, RELATIVE)
