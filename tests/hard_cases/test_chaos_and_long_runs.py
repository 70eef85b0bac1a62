"""Hard cases: chaotic and unstable motions, speed without bound, a million steps, the clock.

Their longer forms are in tests/long_runs.
"""

import gymnasium as gym
import numpy as np
from hard_case import at_least, at_most, hard_case
from measured import GRAVITY, LAB, STATE_B, energy, energy_error, fine_end, tip_error

import redundant_envs as rde

WEIGHT = 9.81 * (0.5 + 1.0 + 1.5 + 2.0)
"""Energy scale of the lab arm, J: its masses lifted to their full height."""


@hard_case("11")
def test_11_chaos_keeps_its_energy(subject):
    for name, tolerance, bound in (("exact", 1e-12, 1e-9), ("standard", 1e-6, 1e-3)):
        scene = rde.Scene(LAB, (GRAVITY,), tolerance=tolerance)
        motion = subject.motion(scene, *STATE_B, 1000)
        error = energy_error(scene, motion)
        yield at_most(f"at {name} the energy within 20 s", error, bound, "J off")
        if name == "standard":
            rate = error / (WEIGHT * 20.0)
            yield at_most("at standard the energy rate", rate, 1e-6, "of 49 J per second")


@hard_case("12")
def test_12_chaos_at_twice_the_speed(subject):
    scene = rde.Scene(LAB, (GRAVITY,), tolerance=1e-12)
    q, qd = STATE_B
    motion = subject.motion(scene, q, 2.0 * np.array(qd), 250)
    error = energy_error(scene, motion) / energy(scene, motion.q[0], motion.qd[0])[0]
    yield at_most("the energy within 5 s", error, 1e-11, "of itself off")
    yield at_least("the most evaluations of an interval", motion.evaluations.max(), 24)


@hard_case("48")
def test_48_a_link_that_turns_once_between_looks(subject):
    arm = rde.FourR((1.0, 1.0, 1.0, 1e-9), (0.5,) * 4)
    q, qd = (-1.6, -1.5, -1.7, 0.0), (0.0, 0.0, 0.0, 2.0 * np.pi / 0.005)
    scene = rde.Scene(arm, (GRAVITY,), tolerance=1e-6)
    motion, fine = subject.motion(scene, q, qd, 1), fine_end(scene, q, qd, 1024)
    yield at_most("the tip after 20 ms", tip_error(arm, motion.q[-1], fine.q), 1e-6, "m off")
    yield at_least("the evaluations of the interval", motion.evaluations[0, 0], 12 * 64)


def growing_mode():
    """The fastest mode of the upright lab arm: its rate, 1/s, and its shape, largest entry 1."""
    mass, up = LAB.mass_matrix(np.full(4, np.pi / 2)), np.diag(9.81 * 0.5 * np.array([4.0, 3.0, 2.0, 1.0]))
    half = np.linalg.cholesky(mass)
    values, vectors = np.linalg.eigh(np.linalg.solve(half, np.linalg.solve(half, up).T))
    shape = np.linalg.solve(half.T, vectors[:, -1])
    return np.sqrt(values[-1]), shape / shape[np.argmax(np.abs(shape))]


@hard_case("13")
def test_13_the_upright_arm_falls_at_its_rate(subject):
    rate, shape = growing_mode()
    exact = np.sqrt(9.395070912301 * 9.81 / 0.5)  # the largest zero of the Laguerre polynomial L_4
    scene = rde.Scene(LAB, (GRAVITY,), tolerance=1e-6)
    motion = subject.motion(scene, np.pi / 2 + 1e-8 * shape, 1e-8 * rate * shape, 42)
    deviation = np.abs(motion.q[:, 0] - np.pi / 2).max(axis=1)
    grown = np.log(deviation[-1] / deviation[0]) / 0.84
    yield at_least("the deviation after 0.84 s", deviation[-1], 5e-4, "rad")
    yield at_most("the rate of growth", abs(grown / exact - 1.0), 1e-6, "of itself off")


@hard_case("14")
def test_14_the_upright_arm_stands(subject):
    motion = subject.motion(rde.Scene(LAB, (GRAVITY,), tolerance=1e-6), np.full((19, 4), np.pi / 2), 0.0, 25)
    off = np.abs(motion.q[-1] - np.pi / 2).max()
    yield at_most("the deviation after 0.5 s", off, 1e-12, "rad")
    differing = (motion.q[-1] != motion.q[-1, 0]).any(axis=1).sum()
    yield at_most("the number of lanes that differ from the first", differing, 0)


@hard_case("15")
def test_15_bang_bang_efforts_lose_no_lane(subject):
    lanes, intervals = 200, 200
    table = np.random.default_rng(5).choice((-60.0, 60.0), (intervals, lanes, 4))
    scene = rde.Scene(LAB, (GRAVITY,), tolerance=1e-6, actuation="generalized")
    motion = subject.motion(scene, np.zeros((lanes, 4)), 0.0, intervals, lambda k: table[k])
    yield at_most("the number of 200 lanes that are not finite", (~motion.finite).sum(), 0)
    yield at_most("the mean cost", motion.evaluations.mean() / 12, 20, "RK8 steps per interval")


@hard_case("17")
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


@hard_case("20")
def test_20_a_long_spin_keeps_its_angle(subject):
    scene = rde.Scene(LAB, (), integrator="rk4", control_dt=5.0, substeps=1000)
    motion = subject.motion(scene, np.zeros(4), 100.0, 1257)
    yield at_most("the angle after 6285 s", np.abs(motion.q[-1] - 628500.0).max(), 1e-9, "rad off")
    yield at_most("the rate", np.abs(motion.qd[-1] - 100.0).max(), 0, "rad/s off")
    # 0.5 rad per step is a float. Other sums are rounded, to the same side for as long as their exponent
    # stays: by 1.26e6 times half of 1.2e-10 rad at most.
    rate = 31.9 * np.pi
    motion = subject.motion(scene, np.zeros(4), rate, 1257)
    off = np.abs(motion.q[-1] / (1257 * 5 * rate) - 1.0).max()
    yield at_most("at 100.2 rad/s, whose sums are rounded, the angle", off, 1.2e-10, "of itself off")


@hard_case("21")
def test_21_energy_drifts_as_the_method_does(subject):
    q = np.random.default_rng(21).uniform(-np.pi, np.pi, (8, 4))
    for name, step, bound in (("rk4", 1e-3, 1e-3), ("rk8", 2.5e-3, 1e-7)):
        scene = rde.Scene(LAB, (GRAVITY,), name, control_dt=10.0, substeps=round(10.0 / step))
        motion = subject.motion(scene, q, 0.0, 100)
        off = np.abs(energy(scene, motion.q[-1], motion.qd[-1]) - energy(scene, motion.q[0], motion.qd[0]))
        what = f"with {name.upper()} of {1e3 * step:g} ms the median energy"
        yield at_most(what, np.median(off), bound, "J off")


@hard_case("22")
def test_22_the_time_is_a_product(subject):
    instants = subject.instants(10000, 1e-3)
    off = np.abs(instants - np.arange(10000) * 1e-3).max()
    yield at_most("the largest difference to n dt in 10 s", off, 0, "s")
