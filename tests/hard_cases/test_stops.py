"""Hard cases: stops and impacts; sliders that rest and are released; springs."""

import dataclasses
import math

import numpy as np
import pytest
from refusals import refusal

import redundant_envs as rde
from redundant_envs import effects as e

from . import measured as m
from .hard_case import at_least, at_most, hard_case
from .subject import Subject


@pytest.mark.long
@hard_case
def test_23_five_impacts_keep_the_order(subject):
    errors, motion = m.five_impacts(subject, (1e-2, 5e-3, 2.5e-3, 1e-3))
    yield at_most("the largest penetration", m.penetration(motion), 0, "m")
    yield at_most("the number of impacts less five", abs(len(motion.impacts()) - 5), 0)
    yield at_most("the tip at RK4 of 1 ms", 1e3 * errors[-1], 1e-6, "mm off")
    yield at_least("the order of RK4", min(m.orders(errors, (2.0, 2.0, 2.5))), 3.9)
    yield at_most("the energy at RK4 of 1 ms", m.energy_error(m.stopped(), motion), 1e-8, "J off")
    cost = motion.evaluations.sum() / (4 * 500)
    yield at_most("the evaluations at RK4 of 1 ms", cost, 1.05, "of those without stops")
    scene = m.stopped(tolerance=1e-12)
    motion = subject.motion(scene, *m.FIVE_IMPACTS, 25)
    yield at_most("at exact the energy", m.energy_error(scene, motion), 1e-10, "J off")


@pytest.mark.long
@hard_case
def test_24_an_impact_loses_what_restitution_says(subject):
    rng, count, dt = np.random.default_rng(3), 1000, 1e-9
    angle, other = rng.uniform(-3, 3, count), rng.uniform(-3, 3, count)
    q = np.column_stack([angle, np.full(count, 0.3), other, rng.uniform(0.05, 0.25, count)])
    qd = rng.normal(0, 2, (count, 4))
    qd[:, 1] = np.abs(qd[:, 1]) + 0.05
    M = m.UNEQUAL.mass_matrix(q)
    W = np.linalg.inv(M)[:, 1, 1]
    before = m.UNEQUAL.kinetic_energy(q, qd)
    for restitution in (0.0, 0.5, 1.0):
        name = f"at restitution {restitution:g} the"
        scene = m.stopped(m.UNEQUAL, restitution, gravity=0.0, control_dt=dt, integrator="rk4")
        after = subject.motion(scene, q, qd, 1)
        # Without gravity and efforts the motion keeps the energy; what is left is rounding.
        left = m.UNEQUAL.kinetic_energy(after.q[-1], after.qd[-1])
        lost = (1.0 - restitution**2) * qd[:, 1] ** 2 / (2.0 * W)
        off = np.abs(before - left - lost) / before
        yield at_most(f"{name} energy lost", off.max(), 1e-12, "of the kinetic energy off")
        off = np.abs(after.qd[-1, :, 1] + restitution * qd[:, 1]).max()
        yield at_most(f"{name} slider's velocity", off, 1e-6, "m/s off")
        jump = np.einsum("nij,nj->ni", M, after.qd[-1] - qd)[:, [0, 2, 3]]
        # Within the nanosecond forces change it by some 1e-7.
        yield at_most(f"{name} change of the other momenta", np.abs(jump).max(), 1e-6, "kg m/s or kg m^2/s")


@pytest.mark.long
@hard_case
def test_27_grazing_within_one_step_is_found(subject):
    subject.longest = 0.02
    v = math.sqrt(1.0 - 2.0 * 200.0 * 0.002)
    t = (1.0 - v) / 200.0
    exact = 0.3 - v * (0.02 - t) - 100.0 * (0.02 - t) ** 2
    for integrator, tolerance in (("rk4", None), ("rk8", None), ("rk8", 1e-6), ("dop853", None)):
        name = integrator if tolerance is None else "error control"
        scene = m.stopped(m.HEAVY, gravity=0.0, integrator=integrator, tolerance=tolerance)
        motion = subject.motion(scene, [0.0, 0.298, 0.0, 0.1], [0.0, 1.0, 0.0, 0.0], 1, [0, -200.0002, 0, 0])
        yield at_most(f"with {name} the number of impacts less one", abs(len(motion.impacts("r1")) - 1), 0)
        yield at_most(f"with {name} the end", abs(motion.q[-1, 0, 1] - exact), 1e-7, "m off")


@pytest.mark.long
@hard_case
def test_27b_an_apex_at_the_stop_changes_no_energy(subject):
    scene = m.stopped(m.HEAVY, gravity=0.0, tolerance=1e-6)
    gaps = 0.0025 * (1.0 + np.array([0.0, 1e-14, -1e-14, 1e-12, -1e-12, 4e-7, -4e-7]))
    q = np.tile([0.0, 0.3, 0.0, 0.1], (len(gaps), 1))
    q[:, 1] -= gaps
    motion = subject.motion(scene, q, [0.0, 1.0, 0.0, 0.0], 1, [0, -200.0002, 0, 0])
    most = max(len(motion.impacts("r1", lane)) for lane in range(len(gaps)))
    yield at_most("the largest number of impacts", most, 1)
    x, v = motion.q[..., 1], motion.qd[..., 1]
    total = 0.5 * v**2 + 200.0 * x  # of the mass of 1 kg
    yield at_most("the energy", np.abs(total[1] - total[0]).max(), 1e-9, "J off")


@pytest.mark.long
@hard_case
def test_28_both_sliders_at_once_do_not_know_their_order(subject):
    scene = m.stopped(restitution=0.7, gravity=0.0, tolerance=1e-9)
    q = np.array([[0.4, 0.299 + 1e-15, 0.4, 0.299], [0.4, 0.299, 0.4, 0.299 + 1e-15]])
    motion = subject.motion(scene, q, [0.0, 1.0, 0.0, 1.0], 1)
    yield at_most("the largest penetration", m.penetration(motion), 0, "m")
    yield at_most("the fastest slider after it", motion.qd[-1][:, [1, 3]].max(), 0, "m/s outwards")
    gain = (m.energy(scene, motion.q[-1], motion.qd[-1]) - m.energy(scene, motion.q[0], motion.qd[0])).max()
    yield at_most("the energy gained", gain, 0, "J")
    differ = np.abs(motion.q[-1, 0] - motion.q[-1, 1]).max()
    yield at_most("the difference that the order makes", differ, 1e-12, "rad or m")
    impulses = np.einsum("ij,nj->ni", m.SLIDING.mass_matrix(q[0]), motion.qd[-1] - motion.qd[0])
    yield at_most("the momenta off the sliders", np.abs(impulses[:, [0, 2]]).max(), 1e-9, "kg m^2/s changed")


@pytest.mark.long
@hard_case
def test_29_many_bounces_in_one_step(subject):
    subject.longest = 0.02
    ways = {"rk4": {"integrator": "rk4"}, "rk8": {}, "error control": {"tolerance": 1e-6}}
    for name, more in ways.items():
        scene = m.stopped(gravity=0.0, **more)
        motion = subject.motion(scene, [0.3, 0.1, 0.3, 0.1], [0.0, 50.0, 0.0, 0.0], 1)
        yield at_least(f"with {name} the number of impacts", len(motion.impacts()), 3)
        before = m.energy(scene, motion.q[0], motion.qd[0])[0]
        yield at_most(
            f"with {name} the energy", m.energy_error(scene, motion) / before, 1e-9, "of itself off"
        )
        yield at_most(f"with {name} the penetration", m.penetration(motion), 0, "m")


@pytest.mark.long
@hard_case
def test_30_stops_do_not_pass_their_sliders(subject):
    batch = rde.BatchSimulator(m.stopped(), 3, track_work=True)
    inside = np.tile([0.0, 0.1, 0.0, 0.1], (3, 1))
    batch.set_state(inside, np.zeros(4))
    outside = inside.copy()
    outside[1, 3] = 0.3000001
    attempts = (
        lambda: batch.set_state(outside, np.zeros(4)),
        lambda: batch.set_parameters({"prismatic_stop.upper": [0.05, 0.3]}, index=[2]),
        lambda: batch.set_parameters({"prismatic_stop.lower": [0.0, 0.2]}, index=[0]),
        lambda: rde.simulate(m.stopped(), outside[1], np.zeros(4), [0.02]),
    )
    refused = sum("stops are at" in str(refusal(attempt)) for attempt in attempts)
    yield at_least("the number of refusals that name slider and stops", refused, 4)
    yield at_most("the largest change of a state by them", np.abs(batch.q - inside).max(), 0)


@pytest.mark.long
@hard_case
def test_43_an_impact_before_another_event_is_found(subject):
    subject.longest = 0.02
    scene = m.stopped(restitution=0.5, gravity=0.0, upper=(0.3, 0.05))
    state, efforts = ((0.0, 0.1, 0.0, 0.0497), (0.0, 0.0, 0.0, 1.0)), [0, 0, 0, -250.0]
    fine = m.fine_end(scene, *state, 160, efforts=[efforts])
    for tolerance in (1e-6, 1e-12, None):
        name = "one step" if tolerance is None else f"{tolerance:g} m"
        motion = subject.motion(dataclasses.replace(scene, tolerance=tolerance), *state, 1, efforts)
        kinds = [x.kind for x in motion.impacts("r2")]
        missed = kinds != ["upper impact", "lower impact"]
        yield at_most(f"with {name} the number of wrong lists of impacts", missed, 0)
        yield at_most(f"with {name} the end", np.abs(motion.q[-1] - fine.q).max(), 1e-12, "rad or m off")
    rng, count = np.random.default_rng(43), 100
    q = np.column_stack([rng.uniform(-3, 3, count), rng.uniform(0.005, 0.045, count)] * 2)
    q[:, 3] = rng.uniform(0.005, 0.045, count)
    qd = rng.normal(0, (3.0, 0.5, 3.0, 0.5), (count, 4))
    efforts = rng.uniform(-1, 1, (count, 4)) * (30.0, 100.0, 30.0, 100.0)
    told = [
        one.motion(m.stopped(upper=(0.05, 0.05), **more), q, qd, 1, efforts)
        for one, more in ((subject, {"tolerance": 1e-6}), (Subject(), {"substeps": 160}))
    ]
    counts = [[len(motion.impacts(lane=i)) for i in range(count)] for motion in told]
    differing = np.count_nonzero(np.subtract(*counts))
    yield at_most("the number of 100 random intervals with other impacts than fine steps find", differing, 0)
    off = np.abs(told[0].q[-1] - told[1].q[-1]).max()
    yield at_most("the largest error of their ends", off, 1e-6, "rad or m")


@hard_case
def test_47_what_is_given_up_never_began(subject):
    stop = e.PrismaticStop((0.0, None), (None, None), 0.97)
    scene = rde.Scene(m.SLIDING, (e.Gravity(0.0), stop), "rk4", substeps=4)
    batch = rde.BatchSimulator(scene, 3, track_work=True)
    q, qd = np.tile([0.0, 0.2, 0.0, 0.2], (3, 1)), np.zeros((3, 4))
    batch.set_state(q, qd)
    # Ever faster bounces of lane 1: 25 in the first substep, too many in the second.
    efforts = np.zeros((3, 4))
    efforts[1, 1] = -4e7
    status = batch.advance(efforts)
    wrong = int((status.numerics != [0, rde.Numerics.EVENT_BUDGET, 0]).sum())
    yield at_most("the number of lanes with a wrong flag", wrong, 0)
    moved = np.abs(np.r_[batch.q[1] - q[1], batch.qd[1] - qd[1]]).max()
    yield at_most("the change of the state that was given up", moved, 0)
    alone = m.fine_end(scene, q[0], qd[0], 4)
    states = np.hstack([batch.q, batch.qd])[[0, 2]]
    differing = np.count_nonzero(states != np.hstack([alone.q, alone.qd]))
    yield at_most("the count of changed numbers of its neighbours", differing, 0)


@hard_case
def test_25_bounces_come_to_rest_on_time(subject):
    arm = rde.RPRP((1.0, 1.0, 1.0, 1e-12), (0.5, 0.5))
    subject.longest = 0.02
    hanging = [-math.pi / 2, 0.3, -math.pi / 2, 0.0]  # link 1 lies on its own stop: only the ball moves
    for restitution, seconds in ((0.5, 11.0), (0.9, 15.0)):
        stop = e.PrismaticStop((None, None), (0.3, 0.3), restitution)
        scene = rde.Scene(arm, (m.GRAVITY, stop), control_dt=0.02, tolerance=1e-9)
        motion = subject.motion(scene, hanging, 0.0, round(seconds / 0.02))
        exact = math.sqrt(2.0 * 0.3 / 9.81) * (1.0 + restitution) / (1.0 - restitution)
        last = motion.impacts("r2")[-1]
        recorded = last.time + 2.0 * restitution * last.speed / (9.81 * (1.0 - restitution))
        name = f"at restitution {restitution:g} the"
        yield at_most(f"{name} time of rest", abs(recorded - exact), 1e-7, "s off")
        late = math.ceil(exact / 0.02) + 1
        moved = np.count_nonzero(motion.q[late:, 0, 3] != 0.3) + np.count_nonzero(motion.qd[late:, 0, 3])
        yield at_most(f"{name} number of intervals after it that end off the stop", moved, 0)


@pytest.mark.long
@hard_case
def test_26_a_pressed_slider_is_let_go_on_time(subject):
    subject.longest = 5e-3
    stop, lag = e.PrismaticStop((0.0, 0.0), (0.3, 0.3), 0.3), 7.3e-3
    for tolerance in (1e-6, 1e-12):
        scene = rde.Scene(m.SLIDING, (stop, rde.effects.Lag(lag)), control_dt=0.02, tolerance=tolerance)
        force = np.array([0.0, 10.0, 0.0, 0.0])
        motion = subject.motion(scene, [0, 0, 0, 0.1], 0.0, 251, lambda k, u=force: u if k == 250 else -u)
        pressed = motion.q[:251, 0, 1]
        yield at_most(f"at {tolerance:g} m the drift in 5 s", np.abs(pressed).max(), 0, "m")
        releases = [x.time for x in motion.events if x.kind == "release" and x.joint == "r1" and x.time > 0.0]
        yield at_most(f"at {tolerance:g} m the number of releases less one", abs(len(releases) - 1), 0)
        off = abs(releases[0] - 5.0 - lag * math.log(2.0)) if releases else math.nan
        # A tolerance in metres says little about a force: 1e-8 s of it move the tip by 1e-20 m.
        bound = 1e-8 if tolerance == 1e-6 else 1e-10
        yield at_most(f"at {tolerance:g} m the time of release", off, bound, "s off")


@pytest.mark.long
@hard_case
def test_31_a_stiff_spring_is_seen_before_it_is_touched(subject):
    springs = [e.LimitSpring(joint, 0.0, 0.3, 1e6) for joint in ("r1", "r2")]
    scene = rde.Scene(m.SLIDING, springs, control_dt=0.02, tolerance=1e-6)
    # Straight, and at rest but for the last slider: nothing turns.
    state = [0.0, 0.1, 0.0, 0.2925], [0.0, 0.0, 0.0, 1.0]
    motion = subject.motion(scene, *state, 5)
    # A tolerance bounds errors of the tip. The energy in a stiff spring depends on digits beyond it.
    finer = dataclasses.replace(scene, tolerance=1e-7)
    yield at_most(
        "at tolerance 1e-07 m the energy over the bounce",
        m.energy_error(finer, subject.motion(finer, *state, 5)), 1e-6, "J off",
    )  # fmt: skip
    fine = m.fine_end(scene, *state, 20000, 5)
    yield at_most("the tip after 5 intervals", m.tip_error(m.SLIDING, motion.q[-1], fine.q), 1e-6, "m off")
    # Turned back by a force, it is in the spring for 2 ms around 7.5 ms. The tip is light, and stays behind.
    springs[1] = e.LimitSpring("r2", 0.0, 0.3, 1e-6)
    scene = rde.Scene(m.HEAVY, springs, control_dt=0.02, tolerance=1e-6)
    state, force = ((0.0, 0.3 - 0.00737, 0.0, 0.1), (0.0, 2.0, 0.0, 0.0)), [0.0, -2.0 / 0.0075, 0.0, 0.0]
    motion = subject.motion(scene, *state, 1, force)
    off = np.abs(motion.q[-1] - m.fine_end(scene, *state, 20000, efforts=[force]).q).max()
    yield at_most("struck within an interval the slider after it", off, 1e-7, "m off")


@hard_case
def test_32_the_printed_spring_has_its_two_frequencies(subject):
    spring = e.CentringSpring((400.0, 200.0), (0.0, 0.0), (0.5, 0.4))
    scene = rde.Scene(m.UNEQUAL, (spring,), tolerance=1e-12)
    mass = np.array([[3.0, 0.5], [0.5, 0.5]])
    # K x = w^2 M x of two sliders along one line; no torque turns the links.
    values, shapes = np.linalg.eig(np.linalg.solve(mass, np.diag([800.0, 400.0])))
    for value, shape in zip(values, shapes.T, strict=True):
        w, amplitude = math.sqrt(value), 0.05 * shape / np.abs(shape).max()
        q = [0.0, 0.25 + amplitude[0], 0.0, 0.2 + amplitude[1]]
        motion = subject.motion(scene, q, 0.0, 500)
        x = (motion.q[-1, 0, [1, 3]] - (0.25, 0.2)) @ amplitude
        v = motion.qd[-1, 0, [1, 3]] @ amplitude
        phase = math.atan2(-v / w, x)
        off = (phase - 10.0 * w + math.pi) % (2.0 * math.pi) - math.pi
        yield at_most(f"the frequency of {w:.4g} rad/s", abs(off) / (10.0 * w), 1e-10, "of itself off")


@pytest.mark.long
@hard_case
def test_49_a_step_follows_a_damper_that_it_is_deep_in(subject):
    arm = rde.RPRP((0.2, 0.2, 0.2, 0.1), (0.3, 0.3))
    effects = (m.GRAVITY, e.LimitSpring("r2", -100.0, 0.0, 20.8, 375.0))
    near = 1.0 + 1e-2 * np.random.default_rng(0).normal(size=(2, 256, 4))
    q, qd = [-0.378, 0.157, 0.323, 0.0221] * near[0], [-0.603, 0.123, -0.00914, 0.189] * near[1]
    scene = rde.Scene(arm, effects, control_dt=0.05, tolerance=1e-6)
    off = m.tip_error(arm, subject.motion(scene, q, qd, 1).q[-1], m.fine_end(scene, q, qd, 2000).q)
    yield at_most("the tip of 256 starts after an interval", off, 1e-6, "m off")
