"""Environments in WebAssembly, in Node: the bits are those of the processor."""

import dataclasses
import json

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.envs.core import Core
from redundant_envs.model import parameters
from redundant_envs.scenes.scene import scene_at
from redundant_envs.simulator.batch.environment import Autoreset
from redundant_envs.simulator.batch.hosts import arm_quantities
from redundant_envs.tasks import ReachTask
from redundant_envs.tasks.reach_around import ReachAroundTask
from redundant_envs.tasks.reach_fault import ReachFaultTask
from redundant_envs.tasks.track import TrackTask
from redundant_envs.web import module

pytestmark = pytest.mark.long

ROOT = module.HOST.parents[2]
LARGEST = {"rprp_reach": 130_000, "four_r_reach": 85_000}
"""Bytes of a module."""
LANES, STEPS = 2, 100
LIMITS = e.EffortLimits((20.0, 30.0, 10.0, 10.0))
SPRINGS = rde.load_scene("rprp_limit_springs")
SCENES = {
    **{name: rde.load_scene(name) for name in (*LARGEST, "everything")},
    "springs": dataclasses.replace(SPRINGS, effects=(*SPRINGS.effects, LIMITS)),
    **{f"four_r_{name}": rde.load_scene(f"four_r_{name}") for name in ("around", "reach_fault")},
    "track": rde.load_scene("rprp_reach"),
    "chain": rde.Scene(
        rde.Chain("RPR", (1.0, 0.5, 0.5), (0.3, 0.2)),
        (
            e.EffortLimits((20.0, 30.0, 5.0)), e.Gravity(g=9.81, down=(0.6, -0.8)),
            e.ViscousFriction((0.2, 1.0, 0.1)), e.PrismaticStop((0.05,), (0.3,), restitution=0.4),
        ),
        tolerance=1e-6,
        randomize={"masses": {"scale": {"log_uniform": [0.5, 2.0]}}},
    ),
}  # fmt: skip
TASKS = {"four_r_around": ReachAroundTask(), "four_r_reach_fault": ReachFaultTask(), "track": TrackTask()}
"""Of scenes in which the task is not Reach."""


def here(core, keys, actions):
    """States and outputs of the processor's code, one row for each step and lane."""
    rows = []
    for k, steps in zip(keys, actions, strict=True):
        core.keys[:], core.waiting[:] = k, True
        core.begin(np.ones(LANES, bool), {})
        for action in steps:
            obs, out, *_ = core.step(action, Autoreset.DISABLED)
            states = core.memory.arrays["state"][0][:, :LANES].T
            rows.append(np.hstack([states, obs, *(table[:, :LANES].T.astype(float) for table in out)]))
    return np.concatenate(rows)


@pytest.fixture
def compared(node, written):
    """Compare episodes of some keys and actions, some of which saturate: rows of states and outputs must have
    the bits of the processor. Returns these rows, the other numbers that Node tells, and the core."""

    def compare(name, seed, episodes=2, steps=40, scene=None, changed=None):
        task = TASKS.get(name, ReachTask())
        core = Core(scene or SCENES[name], LANES, task, task.steps)
        if changed:
            values = parameters.lane_values(core.scene, core.memory, np.arange(LANES), {}, True, core.task)
            values |= {n: np.full(LANES, value) for n, value in changed.items()}
            parameters.write(core.scene, core.memory, np.arange(LANES), values)
        rng, folder = np.random.default_rng(seed), written(name)
        keys = rng.integers(0, 2**32, (episodes, LANES, 4), np.uint32)
        actions = rng.uniform(-1.2, 1.2, (episodes, steps, LANES, len(core.actions))).astype(np.float32)
        given = {"lanes": LANES, "parameters": changed or {}, "keys": keys.tolist()}
        (folder / "input.json").write_text(json.dumps({**given, "actions": actions.tolist()}))
        told = folder / "output.bin"
        node(ROOT / "tests" / "web" / "play.js", folder, name, folder / "input.json", told)
        ours, found = here(core, keys, actions), np.fromfile(told)
        theirs = found[: ours.size].reshape(ours.shape)
        different = np.flatnonzero((ours.view(np.int64) != theirs.view(np.int64)).any(axis=1))
        assert not len(different), f"first in step {different[:1] // LANES}"
        return ours, found[ours.size :], core

    return compare


@pytest.mark.parametrize("name", SCENES)
def test_every_state_reward_and_observation_has_the_bits_of_the_processor(name, compared, written):
    ours, _, core = compared(name, len(name), episodes=10, steps=STEPS)
    if name == "rprp_reach":  # with many impacts
        width, tables = core.memory.layout.size(module.STATE), core.episode.tables
        column = width + core.obs_size + len(tables["flags"]) + tables["counts"].index("events_sum")
        assert ours[STEPS * LANES - 1 :: STEPS * LANES, column].sum() > 50
    if name in LARGEST:
        assert (written(name) / f"{name}.wasm").stat().st_size <= LARGEST[name]


@pytest.mark.parametrize("tolerance", [1e-2, 1e-12])
def test_other_accuracies_have_the_bits_of_the_processor_too(tolerance, compared):
    scene = scene_at(SCENES["rprp_reach"], tolerance)
    compared("rprp_reach", 8, scene=scene, changed={"tip_tolerance": tolerance})


@pytest.mark.parametrize("name", LARGEST)
def test_parameters_that_are_set_change_what_follows_from_them(name, compared):
    """Masses, lengths, gravity, friction: to the bits of a scene with these numbers."""
    rng, numbers = np.random.default_rng(11), SCENES[name].parameters()
    names = [n for n in numbers if n.startswith(("m", "l", "gravity.g", "viscous"))]
    changed = {n: float(numbers[n] * rng.uniform(0.7, 1.4)) for n in names}
    _, rest, core = compared(name, 12, changed=changed)
    prepared = core.memory.arrays["parameter"][0][:, 0]
    assert prepared.tobytes() == rest[: len(prepared)].tobytes()


@pytest.mark.parametrize("name", ["rprp_reach", "chain"])
def test_the_arm_is_that_of_the_equations(name, compared):
    _, rest, core = compared(name, 13, episodes=1, steps=7)
    scene, names = SCENES[name], arm_quantities(SCENES[name].robot)

    def read(fields):
        return core.memory.read(fields, np.array([0]))[0]

    masses = read([f"m{k + 1}" for k in range(len(scene.robot.masses))])
    lengths = read([f"l{k + 1}" for k in range(len(scene.robot.lengths))])
    arm = dataclasses.replace(scene.robot, masses=masses, lengths=lengths)
    gravity = next(one for one in scene.effects if isinstance(one, e.Gravity))
    field, motion = -gravity.g * np.array(gravity.down), (*arm.coordinates, *arm.rates)
    known = {**arm.parameter_values(), "ax": field[0], "ay": field[1]}
    known |= zip(motion, read(motion), strict=True)
    expected = np.array(np.broadcast_arrays(*arm.evaluate(names, known)))
    np.testing.assert_allclose(rest[-len(names) :], expected, rtol=1e-12, atol=1e-12)


def test_the_example_of_the_manual_runs(node, written):
    example = ROOT / "docs" / "examples" / "reach_in_node.js"
    lines = node(example, written("four_r_reach") / "four_r_reach").splitlines()
    tolerances = ("0.01", "0.0001", "0.000001", "1e-9", "1e-12")
    assert [line.partition(":")[0] for line in lines[1:]] == [f"to {x} m" for x in tolerances]
