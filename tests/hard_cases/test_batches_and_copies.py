"""Hard cases: the length of steps, positions in a batch, snapshots."""

import dataclasses

import gymnasium as gym
import numpy as np
import places  # noqa: F401
from hard_case import Figure, hard_case
from held_command import HeldCommand
from measured import GRAVITY, LAB, orders, tip_error

import redundant_envs as rde
from redundant_envs import effects as e

ARM = rde.RPRP((2.0, 1.5, 1.0, 0.5), (0.3, 0.5))
STOP = e.PrismaticStop((0.0, 0.0), (0.3, 0.3), 0.5)


def random_states(count, seed):
    """States and efforts of sliders between their stops; every seventh begins at one."""
    rng = np.random.default_rng(seed)
    q = np.column_stack([rng.uniform(-3, 3, count), rng.uniform(0, 0.3, count)] * 2)
    q[::7, 1] = 0.3
    return q, rng.normal(0, 2, (count, 4)), rng.uniform(-20, 20, (count, 4))


@hard_case("36")
def test_36_steps_converge_within_the_interval(subject):
    elastic = e.PrismaticStop((0.0, 0.0), (0.3, 0.3), 1.0)
    smooth = (0.2, 1.0, -0.5, 2.0), (3.0, -2.0, 4.0, -5.0)
    impacts = (0.3, 0.1, -0.4, 0.2), (1.0, 0.8, -2.0, -0.6)
    for name, arm, effects, (q, qd), methods, seconds in (
        ("smooth", LAB, (GRAVITY,), smooth, {"rk4": 4, "rk8": 8}, 0.2),
        ("with impacts", rde.RPRP((1.0,) * 4, (0.5, 0.5)), (GRAVITY, elastic), impacts, {"rk4": 4}, 0.5),
    ):  # fmt: skip
        intervals = round(seconds / 0.02)
        table = np.random.default_rng(1).uniform(-2, 2, (intervals, 4)) * (name == "smooth")
        exact = rde.Scene(arm, effects, integrator="dop853")
        reference = rde.simulate(exact, q, qd, [seconds], lambda t, *_, u=table: u[round(t / 0.02)]).q[-1]
        for integrator, order in methods.items():
            errors = []
            counts = (2, 4, 8, 16) if order == 4 else (1, 2, 4)
            for substeps in counts:
                subject.longest = 0.02 / substeps
                scene = rde.Scene(arm, effects, integrator=integrator, substeps=substeps)
                motion = subject.motion(scene, q, qd, intervals, lambda k, u=table: u[k])
                errors.append(tip_error(arm, motion.q[-1, 0], reference))
            found = min(orders(errors, (2.0,) * 3))
            yield Figure(f"{name}, the order of {integrator}", found, at_least=order - 0.1)


@hard_case("37")
def test_37_two_substeps_are_two_intervals(subject):
    q, qd, efforts = random_states(64, 6)
    for name, arm, effects in (("stops", ARM, (GRAVITY, STOP)), ("a smooth scene", LAB, (GRAVITY,))):
        motions = [
            subject.motion(
                rde.Scene(arm, effects, integrator="rk4", substeps=s, control_dt=0.01 * s),
                q,
                qd,
                20 // s,
                efforts,
            )
            for s in (1, 2)
        ]
        one, two = (np.concatenate([m.q[-1], m.qd[-1]]) for m in motions)
        differing = np.count_nonzero(one != two)
        yield Figure(f"with {name} the count of differing numbers, of 512,", differing, at_most=0)


@hard_case("38")
def test_38_a_lane_does_not_know_its_neighbours(subject):
    for name, scene in (
        ("stops", rde.Scene(ARM, (GRAVITY, STOP), tolerance=1e-9)),
        ("a smooth scene", rde.Scene(LAB, (GRAVITY,), tolerance=1e-9)),
    ):
        count = 333
        q, qd, efforts = random_states(count, 2)

        def end(index, threads=1, broken=(), scene=scene, q=q, qd=qd, efforts=efforts):
            rates = qd[index].copy()
            rates[list(broken)] = np.nan
            subject.threads = threads
            motion = subject.motion(scene, q[index], rates, 5, efforts[index])
            return np.column_stack([motion.q[-1], motion.qd[-1]])

        whole = end(np.arange(count))
        order = np.random.default_rng(0).permutation(count)
        sound = np.setdiff1d(np.arange(count), (5, 40))

        def figure(what, one, other, name=name):
            label = f"with {name} the count of numbers changed by other {what}"
            return Figure(label, np.count_nonzero(one != other), at_most=0)

        some, all_lanes = [0, 7, 8, 332], np.arange(count)
        yield figure("sizes", np.concatenate([end(np.array([i])) for i in some]), whole[some])
        yield figure("threads", end(all_lanes, threads=3), whole)
        yield figure("positions", end(order), whole[order])
        yield figure("neighbours that are NaN", end(all_lanes, broken=(5, 40))[sound], whole[sound])


@hard_case("42")
def test_42_a_restored_state_continues_to_the_same_bits(subject):
    scene = rde.Scene(
        ARM, (GRAVITY, dataclasses.replace(STOP, restitution=0.0), HeldCommand()), tolerance=1e-6
    )
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
    yield Figure("the count of differing numbers after ten intervals", differing, at_most=0)

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
    yield Figure("the number of observations that differ within the next episodes", differing, at_most=0)
