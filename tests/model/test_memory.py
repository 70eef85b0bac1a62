"""The memory of lanes: parameters are shared until they differ, invisibly to users."""

import numpy as np
import pytest
from catalogue import COPIES, RPRP, SCENES, e

import redundant_envs as rde
from redundant_envs.model.memory import Memory
from redundant_envs.model.programs import batch_simulator

SIMULATOR = batch_simulator(SCENES["stops 1e-6, inelastic"], False)


def memory_of(count):
    return Memory(SIMULATOR.dynamics, SIMULATOR.blocks.layout, count, {})


@pytest.mark.parametrize("count", [1, 3, 8, 9, 30])
def test_numbers_are_those_of_a_plain_table_whatever_lanes_share(count):
    """Numbers of some lanes or all, often what others have, zeros of either sign; snapshots in between."""
    rng, memory, names = np.random.default_rng(count), memory_of(count), ("m1", "m2", "gravity.g", "theta1")
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
        found = memory.read(names, np.arange(count)[::-1])[::-1]
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
