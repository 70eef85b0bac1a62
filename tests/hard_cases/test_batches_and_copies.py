"""Hard cases: the length of steps, positions in a batch, snapshots."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import places  # noqa: F401
from hard_case import at_least, at_most, hard_case
from held_command import HeldCommand
from measured import FIVE_IMPACTS, GRAVITY, LAB, SLIDING, UNEQUAL, orders, stopped, tip_error

import redundant_envs as rde


def scenes(**kwargs):
    yield "stops", stopped(UNEQUAL, 0.5, **kwargs)
    yield "a smooth scene", rde.Scene(LAB, (GRAVITY,), **kwargs)


def random_states(count, seed):
    """States and efforts of sliders between their stops; every seventh begins at one."""
    rng = np.random.default_rng(seed)
    q = np.column_stack([rng.uniform(-3, 3, count), rng.uniform(0, 0.3, count)] * 2)
    q[::7, 1] = 0.3
    return q, rng.normal(0, 2, (count, 4)), rng.uniform(-20, 20, (count, 4))


@hard_case("36")
def test_36_steps_converge_within_the_interval(subject):
    smooth = (0.2, 1.0, -0.5, 2.0), (3.0, -2.0, 4.0, -5.0)
    for name, exact, start, methods, intervals in (
        ("smooth", rde.Scene(LAB, (GRAVITY,), "dop853"), smooth, {"rk4": 4, "rk8": 8}, 10),
        ("with impacts", stopped(SLIDING, integrator="dop853"), FIVE_IMPACTS, {"rk4": 4}, 25),
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
                errors.append(tip_error(scene.robot, motion.q[-1, 0], reference))
            found = min(orders(errors, (2.0,) * 3))
            yield at_least(f"{name}, the order of {integrator}", found, order - 0.1)


@hard_case("37")
def test_37_two_substeps_are_two_intervals(subject):
    q, qd, efforts = random_states(64, 6)
    for name, scene in scenes(integrator="rk4", control_dt=0.01):
        twice = replace(scene, substeps=2, control_dt=0.02)
        motions = [subject.motion(x, q, qd, n, efforts) for x, n in ((scene, 20), (twice, 10))]
        one, two = (np.concatenate([m.q[-1], m.qd[-1]]) for m in motions)
        differing = np.count_nonzero(one != two)
        yield at_most(f"with {name} the count of differing numbers, of 512,", differing, 0)


@hard_case("38")
def test_38_a_lane_does_not_know_its_neighbours(subject):
    q, qd, efforts = random_states(333, 2)
    lanes, some = np.arange(333), [0, 7, 8, 332]
    order, sound = np.random.default_rng(0).permutation(333), np.setdiff1d(lanes, (5, 40))

    def end(scene, index, threads=1, broken=()):
        rates = qd[index].copy()
        rates[list(broken)] = np.nan
        subject.threads = threads
        motion = subject.motion(scene, q[index], rates, 5, efforts[index])
        return np.column_stack([motion.q[-1], motion.qd[-1]])

    for name, scene in scenes(tolerance=1e-9):
        whole = end(scene, lanes)
        for what, found, chosen in (
            ("sizes", np.concatenate([end(scene, [i]) for i in some]), some),
            ("threads", end(scene, lanes, threads=3), lanes),
            ("positions", end(scene, order), order),
            ("neighbours that are NaN", end(scene, lanes, broken=(5, 40))[sound], sound),
        ):
            label = f"with {name} the count of numbers changed by other {what}"
            yield at_most(label, np.count_nonzero(found != whole[chosen]), 0)


@hard_case("42")
def test_42_a_restored_state_continues_to_the_same_bits(subject):
    plastic = stopped(UNEQUAL, 0.0, tolerance=1e-6)
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
