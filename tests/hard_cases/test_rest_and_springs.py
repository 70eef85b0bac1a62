"""Hard cases: sliders that come to rest and are released, springs, friction that does not exist yet."""

import math

import numpy as np
import places  # noqa: F401
from actuator_lag import ActuatorLag
from hard_case import at_most, hard_case
from measured import GRAVITY, HEAVY, SLIDING, UNEQUAL, energy_error, fine_end, tip_error

import redundant_envs as rde
from redundant_envs import effects as e


@hard_case("25")
def test_25_bounces_come_to_rest_on_time(subject):
    arm = rde.RPRP((1.0, 1.0, 1.0, 1e-12), (0.5, 0.5))
    subject.longest = 0.02
    hanging = [-math.pi / 2, 0.3, -math.pi / 2, 0.0]  # link 1 lies on its own stop: only the ball moves
    for restitution, seconds in ((0.5, 11.0), (0.9, 15.0)):
        stop = e.PrismaticStop((None, None), (0.3, 0.3), restitution)
        scene = rde.Scene(arm, (GRAVITY, stop), control_dt=0.02, tolerance=1e-9)
        motion = subject.motion(scene, hanging, 0.0, round(seconds / 0.02))
        exact = math.sqrt(2.0 * 0.3 / 9.81) * (1.0 + restitution) / (1.0 - restitution)
        last = motion.impacts("r2")[-1]
        recorded = last.time + 2.0 * restitution * last.speed / (9.81 * (1.0 - restitution))
        name = f"at restitution {restitution:g} the"
        yield at_most(f"{name} time of rest", abs(recorded - exact), 1e-7, "s off")
        late = math.ceil(exact / 0.02) + 1
        moved = np.count_nonzero(motion.q[late:, 0, 3] != 0.3) + np.count_nonzero(motion.qd[late:, 0, 3])
        yield at_most(f"{name} number of intervals after it that end off the stop", moved, 0)


@hard_case("26")
def test_26_a_pressed_slider_is_let_go_on_time(subject):
    stop, lag = e.PrismaticStop((0.0, 0.0), (0.3, 0.3), 0.3), 7.3e-3
    for tolerance in (1e-6, 1e-12):
        scene = rde.Scene(SLIDING, (stop, ActuatorLag(lag)), control_dt=0.02, tolerance=tolerance)
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


@hard_case("31")
def test_31_a_stiff_spring_is_seen_before_it_is_touched(subject):
    springs = [e.LimitSpring(joint, 0.0, 0.3, 1e6) for joint in ("r1", "r2")]
    scene = rde.Scene(SLIDING, springs, control_dt=0.02, tolerance=1e-6)
    # Straight, and at rest but for the last slider: nothing turns.
    state = [0.0, 0.1, 0.0, 0.2925], [0.0, 0.0, 0.0, 1.0]
    motion = subject.motion(scene, *state, 5)
    yield at_most("the energy over the bounce", energy_error(scene, motion), 1e-6, "J off")
    fine = fine_end(scene, *state, 20000, 5)
    yield at_most("the tip after 5 intervals", tip_error(SLIDING, motion.q[-1], fine.q), 1e-6, "m off")
    # Turned back by a force, it is in the spring for 2 ms around 7.5 ms. The tip is light, and stays behind.
    scene = rde.Scene(HEAVY, springs[:1], control_dt=0.02, tolerance=1e-6)
    state, force = ((0.0, 0.3 - 0.00737, 0.0, 0.1), (0.0, 2.0, 0.0, 0.0)), [0.0, -2.0 / 0.0075, 0.0, 0.0]
    motion = subject.motion(scene, *state, 1, force)
    off = np.abs(motion.q[-1] - fine_end(scene, *state, 20000, efforts=[force]).q).max()
    yield at_most("struck within an interval the slider after it", off, 1e-7, "m off")


@hard_case("32")
def test_32_the_printed_spring_has_its_two_frequencies(subject):
    spring = e.CentringSpring((400.0, 200.0), (0.0, 0.0), (0.5, 0.4))
    scene = rde.Scene(UNEQUAL, (spring,), tolerance=1e-12)
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


@hard_case("49")
def test_49_a_step_follows_a_damper_that_it_is_deep_in(subject):
    arm = rde.RPRP((0.2, 0.2, 0.2, 0.1), (0.3, 0.3))
    effects = (GRAVITY, e.LimitSpring("r2", -100.0, 0.0, 20.8, 375.0))
    near = 1.0 + 1e-2 * np.random.default_rng(0).normal(size=(2, 256, 4))
    q, qd = [-0.378, 0.157, 0.323, 0.0221] * near[0], [-0.603, 0.123, -0.00914, 0.189] * near[1]
    scene = rde.Scene(arm, effects, control_dt=0.05, tolerance=1e-6)
    off = tip_error(arm, subject.motion(scene, q, qd, 1).q[-1], fine_end(scene, q, qd, 2000).q)
    yield at_most("the tip of 256 starts after an interval", off, 1e-6, "m off")


@hard_case("33")
def test_33_stiction_waits_for_its_effect(subject):
    return waiting("CoulombFriction")


@hard_case("34")
def test_34_lugre_friction_waits_for_its_effect(subject):
    return waiting("LuGreFriction")


def waiting(effect):
    """The case must be written when its effect exists."""
    there = hasattr(e, effect)
    yield at_most(f"the number of effects {effect} (with one, this case must be written)", there, 0)
