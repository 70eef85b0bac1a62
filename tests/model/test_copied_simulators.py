"""Copies of simulators: the same bits, independent, in another process too."""

import copy
import io
import multiprocessing
import os
import pickle
import subprocess
import sys
import threading

import cloudpickle
import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.model.memory import Memory
from redundant_envs.model.programs import batch_simulator, environment_simulator
from redundant_envs.tasks.reach import ReachTask

e = rde.effects
WAYS = {
    "deepcopy": copy.deepcopy,
    "copy": copy.copy,
    "pickle": lambda x: pickle.loads(pickle.dumps(x)),
    "oldest pickle": lambda x: pickle.loads(pickle.dumps(x, protocol=2)),
    "cloudpickle": lambda x: cloudpickle.loads(cloudpickle.dumps(x)),
    "copy of a copy": lambda x: copy.deepcopy(pickle.loads(pickle.dumps(x))),
}
every_way = pytest.mark.parametrize("way", WAYS.values(), ids=WAYS)
SCENES = {
    "stops": rde.Scene(
        rde.RPRP((2.0, 1.5, 1.0, 0.5), (0.3, 0.5)),
        (e.Gravity(), e.PrismaticStop((0.0, 0.0), (0.3, 0.2), 0.4)),
        tolerance=1e-6,
    ),
    "fixed": rde.Scene(rde.FourR((1.0,) * 4, (0.3,) * 4), (e.Gravity(),), "rk4", substeps=2),
    "dop853": rde.Scene(rde.FourR((1.0,) * 4, (0.3,) * 4), (e.Gravity(),), "dop853"),
}
every_scene = pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)


def started(scene, count=21, **kwargs):
    """A simulator in the middle of a motion, with lanes of different masses."""
    rng = np.random.default_rng(0)
    batch = rde.BatchSimulator(scene, count, **kwargs)
    q = rng.uniform(-1.0, 1.0, (count, 4))
    if scene.robot.kind == "RPRP":
        q[:, [1, 3]] = rng.uniform(0.0, 0.2, (count, 2))
    batch.set_state(q, rng.normal(0.0, 1.0, (count, 4)))
    batch.set_parameters({"masses": rng.uniform(0.5, 2.0, (count, 4))})
    batch.advance(efforts(count))
    return batch


def efforts(count):
    return np.random.default_rng(1).uniform(-3.0, 3.0, (count, 4))


def motion(batch, steps=5):
    """States, and the whole status of some intervals."""
    rows = []
    for _ in range(steps):
        status = batch.advance(efforts(batch.num_envs))
        rows.append([batch.q, batch.qd, *(np.asarray(x, float) for x in status)])
    return rows


def same(a, b):
    for x, y in zip(a, b, strict=True):
        for one, other in zip(x, y, strict=True):
            np.testing.assert_array_equal(one, other)


@every_way
@every_scene
@pytest.mark.parametrize("kwargs", [{}, {"threads": 2}, {"track_work": True}], ids=str)
def test_a_copy_continues_to_the_same_bits(scene, way, kwargs):
    batch = started(scene, **kwargs)
    here = batch.q
    twin = way(batch)
    assert (twin.threads, twin.num_envs, twin.scene) == (batch.threads, batch.num_envs, scene)
    expected = motion(batch)
    np.testing.assert_array_equal(twin.q, here)  # the original's motion has not moved it
    same(motion(twin), expected)
    assert (batch.q != here).any()
    if kwargs.get("track_work"):
        np.testing.assert_array_equal(twin.work, batch.work)
        assert twin.events() == batch.events()


@every_way
def test_a_copy_is_independent(way):
    batch = started(SCENES["stops"])
    twin = way(batch)
    snapshot, before = batch.save(), batch.q
    twin.set_parameters({"masses": 3.0, "prismatic_stop.upper": (0.4, 0.4)})
    twin.set_state((0.1, 0.2, 0.3, 0.1), np.zeros(4))
    motion(twin)
    np.testing.assert_array_equal(batch.q, before)
    expected = motion(batch)
    batch.restore(snapshot)
    same(motion(batch), expected)
    twin.restore(snapshot)
    same(motion(twin), expected)


@pytest.mark.parametrize("task", [None, ReachTask()])
@pytest.mark.parametrize("apart", [False, True], ids=["shared parameters", "own parameters"])
@every_way
def test_a_copy_of_a_memory_has_aligned_arrays_of_its_own(way, apart, task):
    scene = rde.load_scene("rprp_reach")
    simulator = environment_simulator(scene, task) if task else batch_simulator(scene, True)
    more = {**task.parameters(), "limit": 9.0} if task else {}
    for _ in range(5):
        memory = Memory(simulator.dynamics, simulator.blocks.layout, 11, more)
        memory.write(("m1", "v1"), 3.0)
        if apart:
            memory.write(("m2",), 5.0, [10])
        twin = way(memory)
        assert twin.shared is memory.shared is not apart
        np.testing.assert_array_equal(twin.read(("m1", "m2", "v1")), memory.read(("m1", "m2", "v1")))
        for name, array in twin.arrays.items():
            assert array.ctypes.data % 64 == 0 or not array.size
            assert array.shape == memory.arrays[name].shape
            assert not np.shares_memory(array, memory.arrays[name])
        twin.write(("m1", "v1"), 7.0, [10])
        assert (memory.read(("m1", "v1")) == 3.0).all()
        assert (twin.read(("m1", "v1"))[10] == 7.0).all()


def test_shown_numbers_of_a_copy_are_read_only_too():
    twin = copy.deepcopy(started(SCENES["fixed"]))
    with pytest.raises(ValueError, match="read-only"):
        twin.advance().evaluations[0] = 1


def test_attributes_that_a_user_adds_are_copied():
    batch = started(SCENES["fixed"])
    batch.remark = ["a"]
    twin = copy.deepcopy(batch)
    twin.remark.append("b")
    assert batch.remark == ["a"]


def test_records_are_copied_and_pickled():
    scene = SCENES["stops"]
    trajectory = rde.simulate(scene, (0.1, 0.25, 0.2, 0.1), (1.0, 1.0, 0.0, -1.0), [0.1, 0.5])
    assert trajectory.events
    for way in WAYS.values():
        twin = way(trajectory)
        np.testing.assert_array_equal(twin.q, trajectory.q)
        assert twin.events == trajectory.events
        for value in (scene, scene.robot, *scene.effects, rde.Numerics(5), trajectory.events[0]):
            assert way(value) == value
        assert way(scene).parameters() == scene.parameters()


def child(connection, data):
    batch = pickle.loads(data)
    rows = motion(batch)
    try:
        batch.set_state(np.zeros(3), np.zeros(4))
    except ValueError as error:
        connection.send((rows, error))


@pytest.mark.parametrize("threads", [1, 2])
def test_a_copy_in_a_spawned_process_continues_to_the_same_bits(threads):
    batch = started(SCENES["stops"], threads=threads)
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=child, args=(sender, pickle.dumps(batch)))
    process.start()
    sender.close()
    assert receiver.poll(120)
    rows, error = receiver.recv()
    process.join(60)
    same(rows, motion(batch))
    assert "q has shape (3,)" in str(error)


NOTEBOOK = """
import dataclasses, sys
import cloudpickle
import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.effects.hooks import Effect, Force

@physics
def damping(rate, level):
    return -level * rate

@dataclasses.dataclass(frozen=True)
class Damping(Effect):
    level: float = 0.5
    def hooks(self, arm):
        return (Force(1, damping, bind={"rate": arm.rates[1], "level": ".level"}),)

scene = rde.Scene(rde.FourR((1,) * 4, (0.5,) * 4), (Damping(),))
batch = rde.BatchSimulator(scene, 3)
batch.set_state((0.1, 0.2, 0.3, 0.4), (1, 2, 3, 4))
batch.advance()
data = cloudpickle.dumps(batch)
batch.advance()
print(data.hex(), *(float(x).hex() for x in batch.q.ravel()))
"""


def test_a_simulator_with_an_effect_of_a_users_program_is_taken_elsewhere_by_cloudpickle(tmp_path):
    program = tmp_path / "program.py"
    program.write_text(NOTEBOOK)
    path = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run([sys.executable, program], env=path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    data, *numbers = done.stdout.split()
    program.unlink()  # nothing is read from its source again
    batch = cloudpickle.loads(bytes.fromhex(data))
    batch.advance()
    assert [float(x).hex() for x in batch.q.ravel()] == numbers


def test_threads_of_simulators_end_with_them():
    before = threading.active_count()
    for _ in range(20):
        batch = rde.BatchSimulator(SCENES["fixed"], 64, threads=3)
        batch.advance()
        copy.deepcopy(batch).advance()
    del batch
    for _ in range(100):
        if threading.active_count() <= before:
            break
        threading.Event().wait(0.05)
    assert threading.active_count() <= before


def test_a_pickle_is_not_much_larger_than_the_numbers():
    small, large = (rde.BatchSimulator(SCENES["fixed"], n) for n in (8, 80_008))
    of_a_lane = (len(pickle.dumps(large)) - len(pickle.dumps(small))) / 80_000
    assert of_a_lane < 1.01 * 8 * (8 + 1)  # eight states and its number; the parameters are shared
    assert io.BytesIO(pickle.dumps(SCENES["fixed"])).getbuffer().nbytes < 4000
