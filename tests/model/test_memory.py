"""The memory of lanes: parameters are shared until they differ, invisibly to users; snapshots."""

import numpy as np
import pytest
from catalogue import COPIES, RPRP, SCENES, e

import redundant_envs as rde
from redundant_envs.compiler.tracing.flow import LANES
from redundant_envs.model.memory import Memory
from redundant_envs.model.programs import batch_simulator
from redundant_envs.simulator.lane.fields import LOG, PARAMETER, STATE

MASSES = ("m1", "m2", "m3", "m4")
every_count = pytest.mark.parametrize("count", [1, 3, 8, 9, 30])
SIMULATOR = batch_simulator(SCENES["stops 1e-6, inelastic"], False)
OWN = SIMULATOR.dynamics.arm.masses


def memory_of(count):
    return Memory(SIMULATOR.dynamics, SIMULATOR.blocks.layout, count, {})


def bits(array):
    return np.ascontiguousarray(array).view(np.int64)


@every_count
def test_parameters_are_shared_until_they_differ(count):
    memory = memory_of(count)
    assert memory.shared
    assert memory.parameter_stride == 0
    assert len(memory.arrays[str(PARAMETER)]) == 1
    assert memory.read(MASSES).tolist() == [list(OWN)] * count
    own = np.arange(1.0, 1.0 + 4 * count).reshape(count, 4)
    memory.write(MASSES, own)
    if count > 1:
        assert not memory.shared
        assert memory.parameter_stride == memory.layout.size(PARAMETER) * LANES
        assert len(memory.arrays[str(PARAMETER)]) == memory.blocks
    assert memory.read(MASSES).tolist() == own.tolist()
    assert memory.read(("gravity.g",)).tolist() == [[9.81]] * count


@every_count
def test_parameters_set_alike_for_all_stay_shared_and_so_do_lanes_given_what_they_have(count):
    memory = memory_of(count)
    memory.write(MASSES, OWN, np.array([count - 1]))
    assert memory.shared
    memory.write(MASSES, (4.0, 3.0, 2.0, 1.0))
    memory.write(("gravity.g",), np.full((count, 1), 1.6), np.arange(count)[::-1])
    assert memory.shared
    assert memory.read((*MASSES, "gravity.g")).tolist() == [[4.0, 3.0, 2.0, 1.0, 1.6]] * count


def test_zeros_of_different_signs_are_not_alike():
    memory, name = memory_of(9), ("prismatic_stop.lower[0]",)
    memory.write(name, 0.0)
    memory.write(name, -0.0, np.array([4]))
    assert not memory.shared
    np.testing.assert_array_equal(np.signbit(memory.read(name)[:, 0]), np.arange(9) == 4)


@pytest.mark.parametrize("count", [3, 8, 9])
def test_after_lanes_have_differed_one_or_all_are_set_to_what_another_has(count):
    memory = memory_of(count)
    expected = np.arange(1.0, count + 1.0)
    memory.write(("m1",), expected[:, None])
    for lane, other in ((2, 0), (0, 1), (1, 2)):
        expected[lane] = expected[other]
        memory.write(("m1",), expected[other], np.array([lane]))
        assert memory.read(("m1",))[:, 0].tolist() == expected.tolist()
    for value in (expected[0], OWN[0], 7.0):
        memory.write(("m1",), value)
        assert memory.read(("m1",)).tolist() == [[value]] * count


def test_lanes_that_begin_to_differ_between_intervals_go_on_with_their_own():
    """The kernels, also of other threads, get the new addresses of the parameters."""
    q, qd = np.full(4, 0.1), np.ones(4)
    batches = [rde.BatchSimulator(SCENES["4R all rk8"], 40, threads) for threads in (1, 3)]
    for batch in batches:
        batch.set_state(q, qd)
        batch.advance()
        batch.set_parameters({"gravity.g": np.arange(40.0)})
        batch.advance()
        assert len(np.unique(batch.q[:, 0])) == 40
    np.testing.assert_array_equal(*(batch.q for batch in batches))


def test_lanes_beyond_the_last_hold_the_scene_at_rest():
    memory = memory_of(3)
    memory.write(("theta1", "m1"), [[5.0, 6.0], [5.0, 7.0], [5.0, 8.0]])
    np.testing.assert_array_equal(memory.column("theta1")[0], [5.0] * 3 + [0.0] * 5)
    np.testing.assert_array_equal(memory.column("m1")[0], [6.0, 7.0, 8.0] + [OWN[0]] * 5)


def test_sliders_begin_at_the_stop_that_is_nearest_where_0_is_outside():
    stops = e.PrismaticStop((0.1, -0.3), (0.3, -0.2))
    simulator = batch_simulator(rde.Scene(RPRP, (stops,)), False)
    memory = Memory(simulator.dynamics, simulator.blocks.layout, 2, {})
    np.testing.assert_array_equal(memory.read(("r1", "r2")), [[0.1, -0.2]] * 2)


def test_lanes_are_read_and_written_in_any_order():
    memory = memory_of(20)
    lanes = np.array([17, 0, 8, 7])
    memory.write(("theta1", "w1", "m2"), np.arange(12.0).reshape(4, 3), lanes)
    np.testing.assert_array_equal(
        memory.read(("m2", "theta1"), lanes[::-1]), [[11, 9], [8, 6], [5, 3], [2, 0]]
    )
    rest = np.setdiff1d(np.arange(20), lanes)
    found = memory.read(("theta1", "m2"), rest)
    np.testing.assert_array_equal(found, [[0.0, OWN[1]]] * 16)
    found[:] = 99.0  # a copy
    memory.write(("theta1",), 3.0, np.array([], dtype=int))
    assert (memory.read(("theta1",), rest) == 0.0).all()


def test_memory_has_what_outlives_an_interval_and_names_what_it_has_not():
    memory = memory_of(1)
    assert "theta1" in memory
    assert "m1" in memory
    assert "reason" in memory.layout
    assert "reason" not in memory
    with pytest.raises(AttributeError, match="no field 'mass'; it has "):
        memory.read(("mass",))


def test_a_new_motion_forgets_stops_that_hold_and_steps_that_were_chosen():
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


# ---- snapshots --------------------------------------------------------------------------

NUMBERS = {
    "shared": lambda m: None,
    "own": lambda m: m.write(("m1",), np.arange(1.0, m.count + 1.0)[:, None]),
}


@pytest.mark.parametrize("later", NUMBERS.values(), ids=[f"then {n}" for n in NUMBERS])
@pytest.mark.parametrize("own", NUMBERS.values(), ids=NUMBERS)
@every_count
def test_a_snapshot_brings_back_every_number_and_whether_lanes_differ(count, own, later):
    memory = memory_of(count)
    own(memory)
    memory.write(("theta1", "active_stop_r1"), np.linspace(0.0, 1.0, 2 * count).reshape(count, 2))
    before = {name: array.copy() for name, array in memory.arrays.items()}
    shared = memory.shared
    saved = memory.save()
    later(memory)
    memory.write(("theta1", "w1", "m2"), 9.0)
    memory.restore(saved["states"], saved["parameters"])
    assert memory.shared == shared
    for name in map(str, (STATE, LOG, PARAMETER)):
        np.testing.assert_array_equal(bits(memory.arrays[name]), bits(before[name]))
    value = memory.read(("m1",))[0, 0]
    memory.write(("m1",), value)  # not taken for what all have
    assert memory.read(("m1",)).tolist() == [[value]] * count
    saved["states"][:] = saved["parameters"][:] = 77.0
    assert memory.read(("m2",)).tolist() == [[OWN[1]]] * count
