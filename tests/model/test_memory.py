"""The memory of lanes: parameters are shared until they differ, and copies."""

import os
import pickle
import subprocess
import sys

import cloudpickle
import numpy as np
import pytest
from catalogue import COPIES, RPRP, SCENES, assert_same_bits, e

import redundant_envs as rde
from redundant_envs.model.memory import Memory
from redundant_envs.model.programs import batch_simulator

STOPS = SCENES["stops 1e-6, inelastic"]
SIMULATOR = batch_simulator(STOPS, False)


def memory_of(count):
    return Memory(SIMULATOR.dynamics, SIMULATOR.blocks.layout, count, {})


@pytest.mark.parametrize("names", [("m1", "m2", "gravity.g"), ("theta1", "r1", "theta2", "r2")])
@pytest.mark.parametrize("count", [1, 3, 8, 9, 30])
def test_numbers_are_those_of_a_plain_table_whatever_lanes_share(count, names):
    """Numbers of some lanes or all, often what others have, zeros of either sign; snapshots in between."""
    rng, memory = np.random.default_rng(count), memory_of(count)
    table, snapshots = memory.read(names), []
    for _ in range(300):
        kind = rng.integers(10)
        if kind == 0:
            snapshots.append((memory.save(), table.copy()))
        elif kind == 1 and snapshots:
            saved, before = snapshots[rng.integers(len(snapshots))]
            memory.restore(saved["states"], saved["parameters"])
            table = before.copy()
        else:
            lanes = rng.permutation(count)[: rng.choice([0, 1, count])]
            columns = rng.permutation(len(names))[: rng.integers(1, 4)]
            rows = 1 if rng.integers(2) else len(lanes)
            values = rng.choice([-0.0, 0.0, 1.0, 2.0], (rows, len(columns)))
            memory.write([names[k] for k in columns], values, lanes)
            table[np.ix_(lanes, columns)] = values
        for found in (memory.read(names, np.arange(count)[::-1])[::-1], memory.read(names)):
            np.testing.assert_array_equal(np.ascontiguousarray(found).view(np.int64), table.view(np.int64))


def test_parameters_are_shared_until_they_differ():
    memory = memory_of(9)
    memory.write(("m1", "gravity.g"), (4.0, 1.6))
    memory.write(("m1",), 4.0, np.array([8]))
    assert memory.shared
    memory.write(("m1",), 5.0, np.array([8]))
    assert not memory.shared


def test_lanes_that_begin_to_differ_between_intervals_go_on_with_their_own():
    """The kernels, also of other threads, get the new addresses of the parameters."""
    batches = [rde.BatchSimulator(SCENES["4R all rk8"], 40, threads) for threads in (1, 3)]
    for batch in batches:
        batch.set_state(np.full(4, 0.1), np.ones(4))
        batch.advance()
        batch.set_parameters({"gravity.g": np.arange(40.0)})
        batch.advance()
        assert len(np.unique(batch.q[:, 0])) == 40
    np.testing.assert_array_equal(*(batch.q for batch in batches))


def test_sliders_begin_at_the_stop_that_is_nearest_where_0_is_outside():
    batch = rde.BatchSimulator(rde.Scene(RPRP, (e.PrismaticStop((0.1, -0.3), (0.3, -0.2)),)), 2)
    np.testing.assert_array_equal(batch.q, [[0.0, 0.1, 0.0, -0.2]] * 2)


def test_a_new_motion_forgets_stops_that_hold():
    memory = memory_of(10)
    memory.write(("active_stop_r1", "theta1"), 1.0)
    memory.forget(np.array([2, 9]))
    kept = ~np.isin(np.arange(10), (2, 9))
    np.testing.assert_array_equal(memory.read(("active_stop_r1",))[:, 0], kept * 1.0)
    assert (memory.read(("theta1",)) == 1.0).all()


def test_arrays_of_copies_begin_at_cache_lines_too():
    """Kernels read whole vectors."""
    memory = memory_of(9)
    for twin in (memory, *(way(memory) for way in COPIES.values())):
        assert all(array.ctypes.data % 64 == 0 for array in twin.arrays.values() if array.size)


NOTEBOOK = """
import dataclasses, sys
import cloudpickle
import redundant_envs as rde
from redundant_envs.language.algebra import physics
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


@pytest.mark.long
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


def test_a_pickle_is_not_much_larger_than_the_numbers():
    small, large = (rde.BatchSimulator(SCENES["4R all rk8"], n) for n in (8, 80_008))
    of_a_lane = (len(pickle.dumps(large)) - len(pickle.dumps(small))) / 80_000
    assert of_a_lane < 1.01 * 8 * (8 + 1)  # eight states and its number; the parameters are shared


@pytest.mark.parametrize("way", COPIES.values(), ids=COPIES)
def test_what_simulate_returns_is_copied(way):
    made = rde.simulate(STOPS, (0.1, 0.15, 0.2, 0.1), (1.0, 1.0, 0.0, -1.0), [0.1, 0.5])
    twin = way(made)
    assert made.events
    assert (twin.events, twin.scene, twin._repr_html_()) == (made.events, made.scene, made._repr_html_())
    assert_same_bits([twin.q, twin.tip, twin.work], [made.q, made.tip, made.work])
    assert way(rde.Numerics(5)) == rde.Numerics(5)
