"""Hard cases: chaotic and unstable motions, speed without bound, a million steps, the clock.

Their longer forms are in tests/long_runs.
"""

import gymnasium as gym
import numpy as np
from hard_case import Figure, hard_case
from measured import GRAVITY, LAB, STATE_B, energy, energy_error, tip_error

import redundant_envs as rde

WEIGHT = 9.81 * (0.5 + 1.0 + 1.5 + 2.0)
"""Energy scale of the lab arm, J: its masses lifted to their full height."""


@hard_case("11")
def test_11_chaos_keeps_its_energy(subject):
    for name, tolerance, bound in (("exact", 1e-12, 1e-9), ("standard", 1e-6, 1e-3)):
        scene = rde.Scene(LAB, (GRAVITY,), tolerance=tolerance)
        motion = subject.motion(scene, *STATE_B, 1000)
        error = energy_error(scene, motion)
        yield Figure(f"at {name} the energy within 20 s", error, at_most=bound, unit="J off")
        if name == "standard":
            rate = error / (WEIGHT * 20.0)
            yield Figure("at standard the energy rate", rate, at_most=1e-6, unit="of 49 J per second")


@hard_case("12")
def test_12_chaos_at_twice_the_speed(subject):
    scene = rde.Scene(LAB, (GRAVITY,), tolerance=1e-12)
    q, qd = STATE_B
    motion = subject.motion(scene, q, 2.0 * np.array(qd), 250)
    error = energy_error(scene, motion) / energy(scene, motion.q[0], motion.qd[0])[0]
    yield Figure("the energy within 5 s", error, at_most=1e-11, unit="of itself off")
    yield Figure("the most evaluations of an interval", motion.evaluations.max(), at_least=24)


@hard_case("48")
def test_48_a_link_that_turns_once_between_looks(subject):
    arm = rde.FourR((1.0, 1.0, 1.0, 1e-9), (0.5,) * 4)
    q, qd = (-1.6, -1.5, -1.7, 0.0), (0.0, 0.0, 0.0, 2.0 * np.pi / 0.005)
    motion = subject.motion(rde.Scene(arm, (GRAVITY,), tolerance=1e-6), q, qd, 1)
    fine = rde.BatchSimulator(rde.Scene(arm, (GRAVITY,), substeps=1024))
    fine.set_state(q, qd)
    fine.advance()
    yield Figure("the tip after 20 ms", tip_error(arm, motion.q[-1], fine.q), at_most=1e-6, unit="m off")
    yield Figure("the evaluations of the interval", motion.evaluations[0, 0], at_least=12 * 64)


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
    yield Figure("the deviation after 0.84 s", deviation[-1], at_least=5e-4, unit="rad")
    yield Figure("the rate of growth", abs(grown / exact - 1.0), at_most=1e-6, unit="of itself off")


@hard_case("14")
def test_14_the_upright_arm_stands(subject):
    motion = subject.motion(rde.Scene(LAB, (GRAVITY,), tolerance=1e-6), np.full((19, 4), np.pi / 2), 0.0, 25)
    off = np.abs(motion.q[-1] - np.pi / 2).max()
    yield Figure("the deviation after 0.5 s", off, at_most=1e-12, unit="rad")
    differing = (motion.q[-1] != motion.q[-1, 0]).any(axis=1).sum()
    yield Figure("the number of lanes that differ from the first", differing, at_most=0)


@hard_case("15")
def test_15_bang_bang_efforts_lose_no_lane(subject):
    lanes, intervals = 200, 200
    table = np.random.default_rng(5).choice((-60.0, 60.0), (intervals, lanes, 4))
    scene = rde.Scene(LAB, (GRAVITY,), tolerance=1e-6, actuation="generalized")
    motion = subject.motion(scene, np.zeros((lanes, 4)), 0.0, intervals, lambda k: table[k])
    yield Figure("the number of 200 lanes that are not finite", (~motion.finite).sum(), at_most=0)
    yield Figure("the mean cost", motion.evaluations.mean() / 12, at_most=20, unit="RK8 steps per interval")


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
    yield Figure("the number of 10 episodes that end at the speed bound", flagged, at_least=10)
    yield Figure("the number of steps with numbers that are not finite", finite, at_most=0)
    yield Figure("the largest return of those ends", most, at_most=1e-9)


@hard_case("20")
def test_20_a_long_spin_keeps_its_angle(subject):
    scene = rde.Scene(LAB, (), integrator="rk4", control_dt=5.0, substeps=1000)
    motion = subject.motion(scene, np.zeros(4), 100.0, 1257)
    yield Figure(
        "the angle after 6285 s", np.abs(motion.q[-1] - 628500.0).max(), at_most=1e-9, unit="rad off"
    )
    yield Figure("the rate", np.abs(motion.qd[-1] - 100.0).max(), at_most=0, unit="rad/s off")
    # 0.5 rad per step is a float. Other sums are rounded, to the same side for as long as their exponent
    # stays: by 1.26e6 times half of 1.2e-10 rad at most.
    rate = 31.9 * np.pi
    motion = subject.motion(scene, np.zeros(4), rate, 1257)
    off = np.abs(motion.q[-1] / (1257 * 5 * rate) - 1.0).max()
    yield Figure(
        "at 100.2 rad/s, whose sums are rounded, the angle", off, at_most=1.2e-10, unit="of itself off"
    )


def releases(count):
    rng = np.random.default_rng(21)
    return rng.uniform(-np.pi, np.pi, (count, 4))


def drifts(subject, integrator, step, seconds, count):
    """Largest changes of energy up to two halves of a long motion, (2, lanes), J."""
    scene = rde.Scene(LAB, (GRAVITY,), integrator=integrator, control_dt=10.0, substeps=round(10.0 / step))
    motion = subject.motion(scene, releases(count), 0.0, round(seconds / 10.0))
    change = np.abs(energy(scene, motion.q, motion.qd) - energy(scene, motion.q[0], motion.qd[0]))
    return change[len(change) // 2], change[-1]


@hard_case("21")
def test_21_energy_drifts_as_the_method_does(subject):
    _, end = drifts(subject, "rk4", 1e-3, 1000.0, 8)
    yield Figure("with RK4 of 1 ms the median energy", np.median(end), at_most=1e-3, unit="J off")
    _, end = drifts(subject, "rk8", 2.5e-3, 1000.0, 8)
    yield Figure("with RK8 of 2.5 ms the median energy", np.median(end), at_most=1e-7, unit="J off")


@hard_case("22")
def test_22_the_time_is_a_product(subject):
    instants = subject.instants(10000, 1e-3)
    off = np.abs(instants - np.arange(10000) * 1e-3).max()
    yield Figure("the largest difference to n dt in 10 s", off, at_most=0, unit="s")
