"""Programs with blocks of 2 lanes have the bits of those with 8."""

import numpy as np
import pytest
from catalogue import SCENES

from redundant_envs import load_scene
from redundant_envs.compiler.backends import llvm
from redundant_envs.compiler.tracing.flow import Program
from redundant_envs.envs.core import first_memory, start_ranges
from redundant_envs.model.memory import Memory
from redundant_envs.model.programs import Call
from redundant_envs.simulator.batch.advance import COLUMNS, advance_kernel
from redundant_envs.simulator.batch.environment import EPISODE_KEY, EnvironmentKernel, KernelCall
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.simulator.lane.episode import TABLES, Episode
from redundant_envs.simulator.lane.fields import LOG, PARAMETER, STATE
from redundant_envs.simulator.lane.interval import Interval
from redundant_envs.tasks import ReachTask
from redundant_envs.verify.checks import random_states

pytestmark = pytest.mark.long

COUNT = 29  # more blocks than one of either width, the last of them not full
TYPES = {"f64": np.float64, "f32": np.float32, "i64": np.int64, "i8": np.int8, "u32": np.uint32}


class Lanes:
    """The lanes of a kernel in memories of its width, filled from those of this machine."""

    def __init__(self, kernel, blocks, memory, **arrays):
        """``arrays`` are those of the kernel beside its memories."""
        self.width = width = kernel.lanes
        count = -(-memory.count // width)
        self.layout = blocks.layout
        assert [self.layout.rows[kept] for kept in (STATE, PARAMETER)] == [
            memory.layout.rows[kept] for kept in (STATE, PARAMETER)
        ]
        self.arrays = {str(kept): self.divided(memory.arrays[str(kept)], count) for kept in (STATE, LOG)}
        parameters = memory.arrays[str(PARAMETER)]
        self.arrays[str(PARAMETER)] = parameters = (
            np.ascontiguousarray(parameters[:, :, :width])
            if memory.shared
            else self.divided(parameters, count)
        )
        self.arrays |= {
            "scratch": np.zeros(blocks.scratch_size),
            "queue": np.zeros(blocks.queue_size, np.int64),
            **arrays,
        }
        with llvm.target(llvm.host()._replace(lanes=width)):
            code = llvm.object_code(Program([kernel]))
        self.call = Call(kernel.arguments, llvm.load(code, [kernel.name])[kernel.name])
        stride = 0 if memory.shared else self.layout.size(PARAMETER) * width
        self.call.set(**self.arrays, count=memory.count, parameter_stride=stride)

    def divided(self, blocks, count):
        """Blocks of another width with the same lanes."""
        rows = blocks.swapaxes(0, 1).reshape(blocks.shape[1], len(blocks) * blocks.shape[2])
        rows = rows[:, : count * self.width].reshape(len(rows), count, self.width)
        return np.ascontiguousarray(rows.swapaxes(0, 1))

    def run(self, **arguments):
        self.call.set(**arguments)
        self.call()

    def rows(self, space):
        """Rows of a memory, (rows, lanes)."""
        array = self.arrays[str(space)]
        return array.swapaxes(0, 1).reshape(array.shape[1], len(array) * self.width)[:, :COUNT].copy()


def equal(some, others):
    """Whether tables are equal to the last bit."""
    return [table.tobytes() for table in some] == [table.tobytes() for table in others]


def advanced(scene, width, varied):
    """States, events and outputs of each of some control intervals."""
    dynamics = Dynamics(scene, track_work=True)
    kernel, blocks = advance_kernel(dynamics, width)
    memory = Memory(dynamics, Interval(dynamics).layout(), COUNT, {})
    q, qd, efforts = random_states(scene, COUNT, 7)
    memory.write((*scene.robot.coordinates, *scene.robot.rates), np.hstack([q, qd]))
    if varied:
        memory.write(("m1",), np.linspace(0.5, 2.0, COUNT)[:, None])
        memory.prepare()
    told = {name: np.zeros(COUNT + 8, TYPES[kind]) for name, kind in COLUMNS.items()}
    lanes = Lanes(kernel, blocks, memory, efforts=np.ascontiguousarray(efforts), **told)
    found = []
    for _ in range(6):
        lanes.run(substeps=scene.substeps)
        found += [lanes.rows(STATE), lanes.rows(LOG), *(column[:COUNT].copy() for column in told.values())]
    return found


@pytest.mark.parametrize(
    ("name", "varied"),
    [("stops 1e-6, elastic", False), ("stops 1e-6, elastic", True), ("RPRP gravity dop853", False),
     ("4R friction rk8", True)],
)  # fmt: skip
def test_motions_of_2_lanes_have_the_bits_of_8(name, varied):
    some, others = (advanced(SCENES[name], width, varied) for width in (2, 8))
    assert equal(some, others)
    happened = sum(column.sum() for column in others[5::7])
    assert (happened > 10) == ("stops" in name)


def played(scene, width, steps=25):
    """Observations and outputs of an environment from reset to reset."""
    task = ReachTask()
    episode = Episode(Interval(Dynamics(scene)), task)
    made = EnvironmentKernel(episode, width)
    memory = first_memory(episode, episode.layout(), start_ranges(scene, task), COUNT, 10)
    stride, rng = COUNT + 8, np.random.default_rng(3)
    outputs = {"obs": np.zeros((stride, len(episode.observed)), np.float32)}
    outputs |= {
        name: np.zeros((len(rows), stride), TYPES[TABLES[name]]) for name, rows in episode.tables.items()
    }
    keys = np.zeros((COUNT, EPISODE_KEY), np.uint32)
    actions = np.zeros((COUNT, len(episode.actions)), np.float32)
    last = {f"last_{name}": array.copy() for name, array in outputs.items()}
    lanes = Lanes(made.p, made.blocks, memory, episode_keys=keys, actions=actions, **outputs, **last)
    found = []
    for step in range(steps):
        keys[:] = rng.integers(0, 2**32, keys.shape, np.uint32)
        keys[:, -1] = 1
        actions[:] = rng.uniform(-1.2, 1.2, actions.shape)
        how = KernelCall.STEP if step else KernelCall.RESET
        lanes.run(operation=int(how), autoreset=2, any_due=0, stride=stride, substeps=scene.substeps)
        tables = (array[:, :COUNT].copy() for name, array in outputs.items() if name != "obs")
        found += [lanes.rows(STATE), outputs["obs"][:COUNT].copy(), *tables]
    return found


@pytest.mark.parametrize("name", ["rprp_reach", "four_r_reach"])
def test_environments_of_2_lanes_have_the_bits_of_8(name):
    some, others = (played(load_scene(name), width) for width in (2, 8))
    assert equal(some, others)
    ends = [others[k + 2][1] for k in range(0, len(others), 5)]  # of the table of flags: truncated
    assert sum(map(np.sum, ends)) == 2 * COUNT
