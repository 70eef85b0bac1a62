"""Environments in WebAssembly, in Node: the bits are those of the processor."""

import dataclasses
import json
import subprocess

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
from redundant_envs.web import module

pytestmark = pytest.mark.long

REACH = ("rprp_reach", "four_r_reach")
LARGEST = {"rprp_reach": 130_000, "four_r_reach": 85_000}
"""Bytes of a module."""
LANES, EPISODES, STEPS = 2, 10, 100
SCENES = {
    **{name: rde.load_scene(name) for name in REACH},
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


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The folder of a module, written once."""
    folders = {}

    def write(name):
        if name not in folders:
            folders[name] = tmp_path_factory.mktemp(name)
            module.write(SCENES[name], ReachTask(), name, folders[name])
        return folders[name]

    return write


def draws(seed, joints, episodes=EPISODES, steps=STEPS):
    """Keys of episodes and actions, some of which saturate."""
    rng = np.random.default_rng(seed)
    keys = rng.integers(0, 2**32, (episodes, LANES, 4), np.uint32)
    return keys, rng.uniform(-1.2, 1.2, (episodes, steps, LANES, joints)).astype(np.float32)


def in_node(node, folder, name, keys, actions, changed=None):
    """States and outputs of Node, the rest of what it tells, and what it prints."""
    given, told = folder / "input.json", folder / "output.bin"
    given.write_text(json.dumps({
        "lanes": LANES, "parameters": changed or {}, "keys": keys.tolist(), "actions": actions.tolist(),
    }))  # fmt: skip
    command = [node, str(module.HOST.parents[2] / "tests" / "web" / "play.js"), folder, name, given, told]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return np.fromfile(told), json.loads(done.stdout)


def here(core, keys, actions):
    """The same of the processor's code, one row for each step and lane."""
    rows = []
    for k, steps in zip(keys, actions, strict=True):
        core.keys[:], core.waiting[:] = k, True
        core.begin(np.ones(LANES, bool), {})
        for action in steps:
            obs, out, *_ = core.step(action, Autoreset.DISABLED)
            states = core.memory.arrays["state"][0][:, :LANES].T
            rows.append(np.hstack([states, obs, *(table[:, :LANES].T.astype(float) for table in out)]))
    return np.concatenate(rows)


def compared(node, folder, name, seed, scene=None, changed=None, **size):
    """Rows of both, the rest of Node's numbers, what it prints, and the core."""
    core = Core(scene or SCENES[name], LANES, ReachTask(), STEPS)
    keys, actions = draws(seed, len(core.actions), **size)
    theirs, printed = in_node(node, folder, name, keys, actions, changed)
    ours = here(core, keys, actions)
    return ours, theirs[: ours.size].reshape(ours.shape), theirs[ours.size :], printed, core


@pytest.mark.parametrize("name", SCENES)
def test_every_state_reward_and_observation_has_the_bits_of_the_processor(name, node, written):
    ours, theirs, *_, core = compared(node, written(name), name, seed=len(name))
    different = np.flatnonzero((ours.view(np.int64) != theirs.view(np.int64)).any(axis=1))
    assert not len(different), f"first in step {different[:1] // LANES}"
    if "rprp" in name:  # with many impacts
        width, events = (
            core.memory.layout.size(module.STATE),
            core.episode.tables["counts"].index("events_sum"),
        )
        column = width + core.obs_size + len(core.episode.tables["flags"]) + events
        assert ours[STEPS * LANES - 1 :: STEPS * LANES, column].sum() > 50


@pytest.mark.parametrize("name", REACH)
def test_a_module_is_small(name, written):
    folder = written(name)
    assert (folder / f"{name}.wasm").stat().st_size <= LARGEST[name]


@pytest.mark.parametrize("name", REACH)
def test_other_accuracies_have_the_bits_of_the_processor_too(name, node, written):
    for tolerance in (1e-2, 1e-12):
        scene, changed = scene_at(SCENES[name], tolerance), {"tip_tolerance": tolerance}
        ours, theirs, *_ = compared(node, written(name), name, 8, scene, changed, episodes=2, steps=40)
        assert ours.tobytes() == theirs.tobytes()


@pytest.mark.parametrize("name", REACH)
def test_parameters_that_are_set_change_what_follows_from_them(name, node, written):
    """Masses, lengths, gravity, friction: to the bits of a scene with these numbers."""
    rng, scene = np.random.default_rng(11), SCENES[name]
    names = [n for n in scene.parameters() if n.startswith(("m", "l", "gravity.g", "viscous"))]
    changed = {n: float(scene.parameters()[n] * rng.uniform(0.7, 1.4)) for n in names}
    keys, actions = draws(12, 4, episodes=2, steps=40)
    theirs, _ = in_node(node, written(name), name, keys, actions, changed)
    core = Core(scene, LANES, ReachTask(), STEPS)
    values = parameters.lane_values(scene, core.memory, np.arange(LANES), {}, True, core.task)
    values |= {n: np.full(LANES, value) for n, value in changed.items()}
    parameters.write(scene, core.memory, np.arange(LANES), values)
    ours = here(core, keys, actions)
    assert ours.tobytes() == theirs[: ours.size].tobytes()
    prepared = core.memory.arrays["parameter"][0][:, 0]
    assert prepared.tobytes() == theirs[ours.size :][: len(prepared)].tobytes()


@pytest.mark.long
@pytest.mark.parametrize("name", ["everything", "rprp_limit_springs"])
def test_scenes_with_other_effects_have_the_bits_of_the_processor(name, node, tmp_path):
    scene = rde.load_scene(name)
    if not any(isinstance(one, e.EffortLimits) for one in scene.effects):
        scene = dataclasses.replace(scene, effects=(*scene.effects, e.EffortLimits((20.0, 30.0, 10.0, 10.0))))
    module.write(scene, ReachTask(), name, tmp_path)
    ours, theirs, *_ = compared(node, tmp_path, name, 14, scene, episodes=2)
    assert ours.tobytes() == theirs.tobytes()


@pytest.mark.parametrize("name", SCENES)
def test_the_arm_is_that_of_the_equations(name, node, written):
    _, _, rest, _, core = compared(node, written(name), name, 13, episodes=1, steps=7)
    scene, names = SCENES[name], arm_quantities(SCENES[name].robot)
    masses, lengths = (
        core.memory.read([f"{letter}{k + 1}" for k in range(len(getattr(scene.robot, of)))], np.array([0]))[0]
        for letter, of in (("m", "masses"), ("l", "lengths"))
    )
    arm = dataclasses.replace(scene.robot, masses=masses, lengths=lengths)
    motion = core.memory.read((*arm.coordinates, *arm.rates), np.array([0]))[0]
    gravity = next(one for one in scene.effects if isinstance(one, e.Gravity))
    field = -gravity.g * np.array(gravity.down)
    known = {**arm.parameter_values(), "ax": field[0], "ay": field[1]}
    known |= zip((*arm.coordinates, *arm.rates), motion, strict=True)
    expected = np.array(np.broadcast_arrays(*arm.evaluate(names, known)))
    np.testing.assert_allclose(rest[-len(names) :], expected, rtol=1e-12, atol=1e-12)


def test_the_example_of_the_manual_runs(node, written):
    example = module.HOST.parents[2] / "docs" / "examples" / "reach_in_node.js"
    command = [node, example, str(written("four_r_reach") / "four_r_reach")]
    lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    assert [line.partition(":")[0] for line in lines[1:]] == [
        f"to {x} m" for x in ("0.01", "0.0001", "0.000001", "1e-9", "1e-12")
    ]


def test_equal_scenes_give_equal_bytes():
    one, other = (module.environment_module(SCENES["chain"], ReachTask()) for _ in range(2))
    assert one.code == other.code
    assert module.as_json(one.description) == module.as_json(other.description)


def test_the_description_is_json_without_infinities(written):
    text = (written("chain") / "chain.json").read_text()
    description = json.loads(text, parse_constant=pytest.fail)
    unlimited = module.environment_module(SCENES["chain"], ReachTask(), None).description
    row = description["rows"]["parameter"]["limit"]
    assert description["initial"]["parameter"][row] == STEPS
    assert json.loads(module.as_json(unlimited))["initial"]["parameter"][row] == "Infinity"


def test_scenes_and_tasks_that_no_environment_has_are_refused(tmp_path):
    with pytest.raises(ValueError, match="scene has no EffortLimits"):
        module.write(rde.load_scene("four_r_free"), ReachTask(), "free", tmp_path / "free")
    unlimited = tuple(one for one in SCENES["rprp_reach"].effects if not isinstance(one, e.PrismaticStop))
    scene = dataclasses.replace(SCENES["rprp_reach"], effects=unlimited)
    with pytest.raises(ValueError, match="limit"):
        module.write(scene, ReachTask(), "endless", tmp_path / "endless")
    assert not [*tmp_path.iterdir()]
