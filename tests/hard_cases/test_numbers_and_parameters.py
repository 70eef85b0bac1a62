"""Hard cases: actions, angles and rates of every size, starts at limits, parameters at their bounds."""

import gymnasium as gym
import numpy as np
import places  # noqa: F401
from hard_case import Figure, hard_case
from measured import GRAVITY, LAB, energy_error, exact_accelerations
from payload import Payload

import redundant_envs as rde
from redundant_envs import effects as e

RPRP, FOUR_R = "redundant_envs/RPRPReach-v0", "redundant_envs/FourRReach-v0"


@hard_case("16")
def test_16_actions_of_any_size(subject):
    huge = np.array([1e6, -1e300, 0.5, -1.0])
    env, twin = (gym.make(FOUR_R) for _ in range(2))
    for each in (env, twin):
        each.reset(seed=0)
    obs, *_, info = env.step(huge)
    clipped, *_ = twin.step(np.array([1.0, -1.0, 0.5, -1.0], np.float32))
    yield Figure("the number of entries counted as saturated", info["saturated_actions"], at_least=2)
    yield Figure(
        "the number of observations that differ from clipped actions", (obs != clipped).sum(), at_most=0
    )
    refused = 0
    for bad in (np.nan, np.inf, -np.inf):
        try:
            env.step(np.array([0, 0, bad, 0], np.float32))
        except ValueError as error:
            refused += "non-finite" in str(error)
    yield Figure("the number of actions that are not finite, refused by name", refused, at_least=3)

    lanes, bad_lanes = 24, (3, 8, 17)
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1, 1, (10, lanes, 4)).astype(np.float32)
    results = []
    for values in ((np.nan, np.inf, -np.inf), None):
        many = gym.make_vec(FOUR_R, num_envs=lanes, autoreset_mode="disabled")
        many.reset(seed=1)
        seen = []
        for k in range(10):
            given = actions[k].copy()
            if k == 4 and values is not None:
                given[bad_lanes, 2] = values
            obs, reward, ended, _, infos = many.step(given)
            seen.append(np.column_stack([obs, reward]))
            if k == 4:
                flags, over = infos["numerics"].copy(), ended.copy()
                break
        results.append((seen[-1], flags, over))
    (obs, flags, over), (clean, *_) = results
    others = np.setdiff1d(np.arange(lanes), bad_lanes)
    right = (flags[list(bad_lanes)] == rde.Numerics.BAD_ACTION) & over[list(bad_lanes)]
    yield Figure("the number of bad lanes that end with their flag", right.sum(), at_least=3)
    yield Figure("the number of other lanes with a flag", np.count_nonzero(flags[others]), at_most=0)
    differing = np.count_nonzero(obs[others] != clean[others])
    yield Figure("the count of their changed numbers", differing, at_most=0)


@hard_case("18")
def test_18_subnormal_rates_are_numbers(subject):
    scene = rde.Scene(LAB, (), tolerance=1e-6)
    motion = subject.motion(scene, np.zeros(4), 1e-310, 50)
    yield Figure("the rate after 1 s", np.abs(motion.qd[-1] - 1e-310).max(), at_most=0, unit="rad/s off")
    yield Figure("the most evaluations of an interval", motion.evaluations.max(), at_most=12)
    yield Figure("flags", motion.numerics[0], at_most=0)


@hard_case("19")
def test_19_large_angles_are_exact_or_refused(subject):
    turns = np.array([0.0, 1e3, 1e5, 159154.0, 1e6, 1e11])  # the last two are beyond 1e6 rad
    q = np.array([0.3, 1.2, -2.0, 0.8]) + 2.0 * np.pi * turns[:, None]
    # In a nanosecond from rest a rate becomes the acceleration times 1e-9, to the last digits.
    motion = subject.motion(rde.Scene(LAB, (GRAVITY,), integrator="rk4", control_dt=1e-9), q, 0.0, 1)
    worst = 0.0
    for angles, found in zip(q, motion.qd[-1] / 1e-9, strict=True):
        exact = exact_accelerations(LAB, angles.tolist(), [0.0] * 4, [0.0] * 4, 9.81)
        worst = max(worst, *(abs(float(a - b)) for a, b in zip(found.tolist(), exact, strict=True)))
    yield Figure("up to 6e11 rad the acceleration", worst / 9.81, at_most=1e-14, unit="of g off")
    refused = 0
    for make in (lambda: gym.make(FOUR_R), lambda: gym.make_vec(FOUR_R, num_envs=2)):
        try:
            make().reset(options={"q": (1.1e6, 0.0, 0.0, 0.0)})
        except ValueError as error:
            refused += "1e+06" in str(error)
    yield Figure("the number of starts beyond 1e6 rad that environments refuse", refused, at_least=2)


@hard_case("39")
def test_39_crossing_pi_is_continuous(subject):
    spring = e.LimitSpring("joint2", -2.0, 2.0, 500.0)
    scene = rde.Scene(LAB, (spring,), tolerance=1e-9)
    # All links turn together, so joints move little.
    motion = subject.motion(scene, [2.5, 2.7, 2.6, 2.8], 3.0, 300)
    joint = motion.q[..., 1] - motion.q[..., 0]
    yield Figure("the second joint angle within 9 turns", np.abs(joint).max(), at_most=2.0, unit="rad")
    yield Figure("the energy", energy_error(scene, motion), at_most=1e-6, unit="J off")

    ends = []
    for delta in (-1e-12, 1e-12):
        env = gym.make(FOUR_R)
        env.reset(seed=0, options={"q": (np.pi + delta, 1.0, 0.5, -0.3), "goal": (0.3, 0.2)})
        obs, reward, *_ = env.step(np.zeros(4, np.float32))
        ends.append(np.r_[obs, reward])
    jump = np.abs(ends[0] - ends[1]).max()
    yield Figure("the jump of observation and reward over 2e-12 rad", jump, at_most=1e-6)


@hard_case("40")
def test_40_energy_with_unequal_numbers(subject):
    masses = (2.0, 1.5, 1.0, 0.5)
    for arm, q in (
        (rde.FourR(masses, (0.3, 0.5, 0.4, 0.6)), (0.2, 1.0, -0.5, 2.0)),
        (rde.RPRP(masses, (0.3, 0.5)), (0.2, 0.1, -0.5, 0.2)),
    ):
        scene = rde.Scene(arm, (GRAVITY,), tolerance=1e-12)
        motion = subject.motion(scene, q, (1.0, -2.0, 1.5, -1.0), 50)
        yield Figure(
            f"{arm.kind}: the energy within 1 s", energy_error(scene, motion), at_most=1e-10, unit="J off"
        )


@hard_case("41")
def test_41_numbers_at_the_ends_of_their_ranges(subject):
    q, qd = (0.3, 1.2, -2.0, 0.8), (1.0, -2.0, 3.0, -4.0)
    for name, field, dt, intervals in (
        ("in steps of 1e-9 s", e.Gravity(9.81), 1e-9, 100),
        ("without gravity", e.Gravity(0.0), 0.02, 50),
        ("under 1000 m/s^2", e.Gravity(1000.0), 0.02, 50),
        ("in a level plane", e.Gravity.on_plane(9.81, np.pi / 2), 0.02, 50),
    ):
        scene = rde.Scene(LAB, (field,), control_dt=dt, tolerance=1e-12)
        motion = subject.motion(scene, q, qd, intervals)
        scale = 5000.0 if "1000" in name else 50.0
        yield Figure(
            f"{name} the energy", energy_error(scene, motion) / scale, at_most=1e-9, unit="of its scale off"
        )
    yield from picked_up(q, qd)


def picked_up(q, qd):
    """The energy balance of an arm that picks up 100 kg after half a second; it starts again there."""
    scene = rde.Scene(LAB, (GRAVITY, e.ViscousFriction((0.5,) * 4), Payload(0.0)), tolerance=1e-12)
    batch = rde.BatchSimulator(scene, 1, track_work=True)
    batch.set_state(q, qd)
    heavy = rde.FourR((1.0, 1.0, 1.0, 101.0), LAB.lengths)
    for arm, load in ((LAB, 0.0), (heavy, 100.0)):
        batch.set_parameters({"payload.mass": load})
        before, work = book(arm, batch), batch.work[0]
        flags = 0
        for k in range(25):
            flags |= int(batch.advance([[2.0, 1.0, -1.0, 0.5 if k % 2 else -0.5]]).numerics[0])
        off = abs(book(arm, batch) - before - (batch.work[0] - work))
        yield Figure(f"with {load:g} kg energy less work", off, at_most=1e-9, unit="J off")
        yield Figure(f"with {load:g} kg flags", flags, at_most=0)


def book(arm, batch):
    return float(arm.kinetic_energy(batch.q, batch.qd)[0] + arm.potential_energy(batch.q)[0])


@hard_case("46")
def test_46_starts_at_and_beyond_limits(subject):
    stop = e.PrismaticStop((0.0, 0.0), (0.3, 0.3), 0.5)
    arm = rde.RPRP((1.0,) * 4, (0.5, 0.5))
    signs = np.array(
        np.meshgrid((0.0, 0.3), (0.0, 0.3), *[(-1.0, -1e-15, 0.0, 1e-12)] * 2, *[(-30.0, 0.0, 30.0)] * 2)
    )
    a, b, va, vb, fa, fb = signs.reshape(6, -1)
    zero = np.zeros_like(a)
    efforts = np.column_stack([zero, fa, zero, fb])
    scene = rde.Scene(arm, (GRAVITY, stop), tolerance=1e-6)
    motion = subject.motion(
        scene,
        np.column_stack([zero + 0.7, a, zero - 0.4, b]),
        np.column_stack([zero, va, zero, vb]),
        3,
        efforts,
    )
    yield Figure("the number of flagged starts at both stops", np.count_nonzero(motion.numerics), at_most=0)
    beyond = np.abs(motion.q[..., [1, 3]] - 0.15).max() - 0.15
    yield Figure("the largest distance beyond a stop", beyond, at_most=0, unit="m")

    refused = 0
    for q in ((0.0, 0.25 + 1e-9, 0.0, 0.0), (0.0, 0.1, 0.0, -1e-9)):
        for make in (lambda: gym.make(RPRP), lambda: gym.make_vec(RPRP, num_envs=3)):
            try:
                make().reset(options={"q": q})
            except ValueError as error:
                refused += "its stops are at 0 and 0.25 m" in str(error)
    yield Figure("the number of starts 1e-9 m beyond a stop that are refused", refused, at_least=4)

    data = rde.load_scene("four_r_reach").to_dict()
    data["effects"].append({"type": "LimitSpring", "coordinate": "joint1", "lower": -1.0, "upper": 1.0})
    _, info = gym.make(FOUR_R, scene=data).reset(seed=0, options={"q": (1.25, 1.0, 1.0, 1.0)})
    off = abs(info["beyond_limit"] - 0.25)
    yield Figure("the depth that a start beyond a spring shows", off, at_most=1e-12, unit="rad off")
