"""Hard cases: numbers, actions and parameters; steps, batches and copies."""

from dataclasses import replace
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from held_command import HeldCommand
from refusals import refusal

import redundant_envs as rde
from redundant_envs import effects as e

from . import measured as m
from .hard_case import at_least, at_most, hard_case

RPRP, FOUR_R = "redundant_envs/RPRPReach-v0", "redundant_envs/FourRReach-v0"


@pytest.mark.long
@hard_case
def test_16_actions_of_any_size(subject):
    huge = np.array([1e6, -1e300, 0.5, -1.0])
    env, twin = (gym.make(FOUR_R) for _ in range(2))
    for each in (env, twin):
        each.reset(seed=0)
    obs, *_, info = env.step(huge)
    clipped, *_ = twin.step(np.array([1.0, -1.0, 0.5, -1.0], np.float32))
    yield at_least("the number of entries counted as saturated", info["saturated_actions"], 2)
    yield at_most("the number of observations that differ from clipped actions", (obs != clipped).sum(), 0)
    wrong = [np.array([0, 0, bad, 0], np.float32) for bad in (np.nan, np.inf, -np.inf)]
    refused = sum("non-finite" in str(refusal(env.step, action)) for action in wrong)
    yield at_least("the number of actions that are not finite, refused by name", refused, 3)

    bad_lanes, others = [3, 8, 17], np.setdiff1d(np.arange(24), [3, 8, 17])
    actions = np.random.default_rng(0).uniform(-1, 1, (10, 24, 4)).astype(np.float32)
    results = []
    for values in (actions[4, bad_lanes, 2], (np.nan, np.inf, -np.inf)):
        many = gym.make_vec(FOUR_R, num_envs=24, autoreset_mode="disabled")
        many.reset(seed=1)
        actions[4, bad_lanes, 2] = values
        for action in actions[:5]:
            obs, reward, over, _, infos = many.step(action)
        results.append(np.column_stack([obs, reward]))
    (clean, obs), flags = results, infos["numerics"]
    right = (flags[bad_lanes] == rde.Numerics.BAD_ACTION) & over[bad_lanes]
    yield at_least("the number of bad lanes that end with their flag", right.sum(), 3)
    yield at_most("the number of other lanes with a flag", np.count_nonzero(flags[others]), 0)
    differing = np.count_nonzero(obs[others] != clean[others])
    yield at_most("the count of their changed numbers", differing, 0)


@hard_case
def test_18_subnormal_rates_are_numbers(subject):
    scene = rde.Scene(m.LAB, (), tolerance=1e-6)
    motion = subject.motion(scene, np.zeros(4), 1e-310, 50)
    yield at_most("the rate after 1 s", np.abs(motion.qd[-1] - 1e-310).max(), 0, "rad/s off")
    yield at_most("the most evaluations of an interval", motion.evaluations.max(), 12)
    yield at_most("flags", motion.numerics[0], 0)


@hard_case
def test_19_large_angles_are_exact_or_refused(subject):
    turns = np.array([0.0, 1e3, 1e5, 159154.0, 1e6, 1e11])  # the last two are beyond 1e6 rad
    q = np.array([0.3, 1.2, -2.0, 0.8]) + 2.0 * np.pi * turns[:, None]
    # In a nanosecond from rest a rate becomes the acceleration times 1e-9, to the last digits.
    motion = subject.motion(rde.Scene(m.LAB, (m.GRAVITY,), integrator="rk4", control_dt=1e-9), q, 0.0, 1)
    worst = 0.0
    for angles, found in zip(q, motion.qd[-1] / 1e-9, strict=True):
        exact = m.exact_accelerations(m.LAB, angles.tolist(), [0.0] * 4, [0.0] * 4, 9.81)
        worst = max(worst, *(abs(float(a - b)) for a, b in zip(found.tolist(), exact, strict=True)))
    yield at_most("up to 6e11 rad the acceleration", worst / 9.81, 1e-14, "of g off")
    envs = (gym.make(FOUR_R), gym.make_vec(FOUR_R, num_envs=2))
    far = {"q": (1.1e6, 0.0, 0.0, 0.0)}
    refused = sum("1e+06" in str(refusal(partial(env.reset, options=far))) for env in envs)
    yield at_least("the number of starts beyond 1e6 rad that environments refuse", refused, 2)


@pytest.mark.long
@hard_case
def test_39_crossing_pi_is_continuous(subject):
    spring = e.LimitSpring("joint2", -2.0, 2.0, 500.0)
    scene = rde.Scene(m.LAB, (spring,), tolerance=1e-9)
    # All links turn together, so joints move little.
    motion = subject.motion(scene, [2.5, 2.7, 2.6, 2.8], 3.0, 300)
    joint = motion.q[..., 1] - motion.q[..., 0]
    yield at_most("the second joint angle within 9 turns", np.abs(joint).max(), 2.0, "rad")
    yield at_most("the energy", m.energy_error(scene, motion), 1e-6, "J off")

    ends = []
    for delta in (-1e-12, 1e-12):
        env = gym.make(FOUR_R)
        env.reset(seed=0, options={"q": (np.pi + delta, 1.0, 0.5, -0.3), "goal": (0.3, 0.2)})
        obs, reward, *_ = env.step(np.zeros(4, np.float32))
        ends.append(np.r_[obs, reward])
    jump = np.abs(ends[0] - ends[1]).max()
    yield at_most("the jump of observation and reward over 2e-12 rad", jump, 1e-6)


@hard_case
def test_40_energy_with_unequal_numbers(subject):
    four_r = rde.FourR(m.UNEQUAL.masses, (0.3, 0.5, 0.4, 0.6))
    for arm, q in ((four_r, (0.2, 1.0, -0.5, 2.0)), (m.UNEQUAL, (0.2, 0.1, -0.5, 0.2))):
        scene = rde.Scene(arm, (m.GRAVITY,), tolerance=1e-12)
        motion = subject.motion(scene, q, (1.0, -2.0, 1.5, -1.0), 50)
        yield at_most(f"{arm.kind}: the energy within 1 s", m.energy_error(scene, motion), 1e-10, "J off")


@pytest.mark.long
@hard_case
def test_41_numbers_at_the_ends_of_their_ranges(subject):
    q, qd = (0.3, 1.2, -2.0, 0.8), (1.0, -2.0, 3.0, -4.0)
    for name, field, dt, intervals in (
        ("in steps of 1e-9 s", e.Gravity(9.81), 1e-9, 100),
        ("without gravity", e.Gravity(0.0), 0.02, 50),
        ("under 1000 m/s^2", e.Gravity(1000.0), 0.02, 50),
        ("in a level plane", e.Gravity.on_plane(9.81, np.pi / 2), 0.02, 50),
    ):
        scene = rde.Scene(m.LAB, (field,), control_dt=dt, tolerance=1e-12)
        motion = subject.motion(scene, q, qd, intervals)
        scale = 5000.0 if "1000" in name else 50.0
        yield at_most(f"{name} the energy", m.energy_error(scene, motion) / scale, 1e-9, "of its scale off")
    yield from picked_up(q, qd)


def picked_up(q, qd):
    """The energy balance of an arm that picks up 100 kg after half a second; it starts again there."""
    scene = rde.Scene(m.LAB, (m.GRAVITY, e.ViscousFriction((0.5,) * 4), e.Payload(0.0)), tolerance=1e-12)
    batch = rde.BatchSimulator(scene, 1, track_work=True)
    batch.set_state(q, qd)
    heavy = rde.FourR((1.0, 1.0, 1.0, 101.0), m.LAB.lengths)
    for arm, load in ((m.LAB, 0.0), (heavy, 100.0)):
        batch.set_parameters({"payload.mass": load})
        before, work = book(arm, batch), batch.work[0]
        flags = 0
        for k in range(25):
            flags |= int(batch.advance([[2.0, 1.0, -1.0, 0.5 if k % 2 else -0.5]]).numerics[0])
        off = abs(book(arm, batch) - before - (batch.work[0] - work))
        yield at_most(f"with {load:g} kg energy less work", off, 1e-9, "J off")
        yield at_most(f"with {load:g} kg flags", flags, 0)


def book(arm, batch):
    return float(arm.kinetic_energy(batch.q, batch.qd)[0] + arm.potential_energy(batch.q)[0])


@pytest.mark.long
@hard_case
def test_46_starts_at_and_beyond_limits(subject):
    ends, rates, forces = [(0.0, 0.3)] * 2, [(-1.0, -1e-15, 0.0, 1e-12)] * 2, [(-30.0, 0.0, 30.0)] * 2
    a, b, va, vb, fa, fb = np.array(np.meshgrid(*ends, *rates, *forces)).reshape(6, -1)
    zero = np.zeros_like(a)
    q, qd = np.column_stack([zero + 0.7, a, zero - 0.4, b]), np.column_stack([zero, va, zero, vb])
    scene = m.stopped(restitution=0.5, tolerance=1e-6)
    motion = subject.motion(scene, q, qd, 3, np.column_stack([zero, fa, zero, fb]))
    yield at_most("the number of flagged starts at both stops", np.count_nonzero(motion.numerics), 0)
    beyond = np.abs(motion.q[..., [1, 3]] - 0.15).max() - 0.15
    yield at_most("the largest distance beyond a stop", beyond, 0, "m")

    envs = (gym.make(RPRP), gym.make_vec(RPRP, num_envs=3))
    starts = ((0.0, 0.25 + 1e-9, 0.0, 0.0), (0.0, 0.1, 0.0, -1e-9))
    attempts = (partial(env.reset, options={"q": q}) for q in starts for env in envs)
    refused = sum("its stops are at 0 and 0.25 m" in str(refusal(attempt)) for attempt in attempts)
    yield at_least("the number of starts 1e-9 m beyond a stop that are refused", refused, 4)

    data = rde.load_scene("four_r_reach").to_dict()
    data["effects"].append({"type": "LimitSpring", "coordinate": "joint1", "lower": -1.0, "upper": 1.0})
    _, info = gym.make(FOUR_R, scene=data).reset(seed=0, options={"q": (1.25, 1.0, 1.0, 1.0)})
    off = abs(info["beyond_limit"] - 0.25)
    yield at_most("the depth that a start beyond a spring shows", off, 1e-12, "rad off")


def scenes(**kwargs):
    yield "stops", m.stopped(m.UNEQUAL, 0.5, **kwargs)
    yield "a smooth scene", rde.Scene(m.LAB, (m.GRAVITY,), **kwargs)


def random_states(count, seed):
    """States and efforts of sliders between their stops; every seventh begins at one."""
    rng = np.random.default_rng(seed)
    q = np.column_stack([rng.uniform(-3, 3, count), rng.uniform(0, 0.3, count)] * 2)
    q[::7, 1] = 0.3
    return q, rng.normal(0, 2, (count, 4)), rng.uniform(-20, 20, (count, 4))


@pytest.mark.long
@hard_case
def test_36_steps_converge_within_the_interval(subject):
    smooth = (0.2, 1.0, -0.5, 2.0), (3.0, -2.0, 4.0, -5.0)
    for name, exact, start, methods, intervals in (
        ("smooth", rde.Scene(m.LAB, (m.GRAVITY,), "dop853"), smooth, {"rk4": 4, "rk8": 8}, 10),
        ("with impacts", m.stopped(m.SLIDING, integrator="dop853"), m.FIVE_IMPACTS, {"rk4": 4}, 25),
    ):
        table = np.random.default_rng(1).uniform(-2, 2, (intervals, 4)) * (name == "smooth")
        at = [0.02 * intervals]
        reference = rde.simulate(exact, *start, at, lambda t, *_, u=table: u[round(t / 0.02)]).q[-1]
        for integrator, order in methods.items():
            errors = []
            for substeps in (2, 4, 8, 16) if order == 4 else (1, 2, 4):
                subject.longest = 0.02 / substeps
                scene = replace(exact, integrator=integrator, substeps=substeps)
                motion = subject.motion(scene, *start, intervals, lambda k, u=table: u[k])
                errors.append(m.tip_error(scene.robot, motion.q[-1, 0], reference))
            found = min(m.orders(errors, (2.0,) * 3))
            yield at_least(f"{name}, the order of {integrator}", found, order - 0.1)


@pytest.mark.long
@hard_case
def test_37_two_substeps_are_two_intervals(subject):
    q, qd, efforts = random_states(64, 6)
    for name, scene in scenes(integrator="rk4", control_dt=0.01):
        twice = replace(scene, substeps=2, control_dt=0.02)
        motions = [subject.motion(x, q, qd, n, efforts) for x, n in ((scene, 20), (twice, 10))]
        one, two = (np.concatenate([x.q[-1], x.qd[-1]]) for x in motions)
        differing = np.count_nonzero(one != two)
        yield at_most(f"with {name} the count of differing numbers, of 512,", differing, 0)


@pytest.mark.long
@hard_case
def test_38_a_lane_does_not_know_its_neighbours(subject):
    count = 83
    q, qd, efforts = random_states(count, 2)
    lanes, order = np.arange(count), np.random.default_rng(0).permutation(count)

    def end(scene, index, threads=1, broken=()):
        rates = qd[index].copy()
        rates[list(broken)] = np.nan
        subject.threads = threads
        motion = subject.motion(scene, q[index], rates, 5, efforts[index])
        return np.column_stack([motion.q[-1], motion.qd[-1]])

    for name, scene in scenes(tolerance=1e-9):
        whole = end(scene, lanes)
        for what, parts, more in (
            ("sizes", [[0], [7], [8], [82]], {}),
            ("threads", [lanes], {"threads": 3}),
            ("positions", [order], {}),
            ("neighbours that are NaN", [lanes], {"broken": (5, 40)}),
        ):
            found = np.concatenate([end(scene, part, **more) for part in parts])
            index = np.concatenate(parts)
            differing = (found != whole[index])[~np.isin(index, more.get("broken", ()))].sum()
            yield at_most(f"with {name} the count of numbers changed by other {what}", differing, 0)


@pytest.mark.long
@hard_case
def test_42_a_restored_state_continues_to_the_same_bits(subject):
    plastic = m.stopped(m.UNEQUAL, 0.0, tolerance=1e-6)
    scene = replace(plastic, effects=(*plastic.effects, HeldCommand()))
    q, qd, efforts = random_states(40, 7)
    batch = rde.BatchSimulator(scene, 40)
    batch.set_state(q, qd)
    ends = []
    for k in range(60):
        if k in (13, 31):
            snapshot = subject.save(batch)
        if k in (23, 41):
            ends.append(np.column_stack([batch.q, batch.qd, batch.z]))
            subject.restore(batch, snapshot)
            for i in range(k - 10, k):
                batch.advance(efforts * (-1) ** (i // 6))
            ends.append(np.column_stack([batch.q, batch.qd, batch.z]))
        batch.advance(efforts * (-1) ** (k // 6))
    differing = np.count_nonzero(ends[0] != ends[1]) + np.count_nonzero(ends[2] != ends[3])
    yield at_most("the count of differing numbers after ten intervals", differing, 0)

    env = gym.make_vec("redundant_envs/RPRPReach-v0", num_envs=16, max_episode_steps=15)
    env.reset(seed=3)
    actions = np.random.default_rng(9).uniform(-1, 1, (60, 16, 4)).astype(np.float32)
    for k in range(20):
        env.step(actions[k])
    state, rows = env.unwrapped.get_state(), []
    for _ in range(2):
        env.unwrapped.set_state(state)
        rows.append(np.concatenate([env.step(actions[20 + k])[0] for k in range(40)]))
    differing = np.count_nonzero(rows[0] != rows[1])
    yield at_most("the number of observations that differ within the next episodes", differing, 0)
