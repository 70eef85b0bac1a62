"""An arm with a load moves, to the bit, like an arm with that much more mass."""

import dataclasses

import numpy as np
import pytest
from arms import ARMS
from payload import Payload
from tether import Tether

import redundant_envs as rde
from redundant_envs.backends.torch import torch
from redundant_envs.control.computed_torque import ComputedTorque
from redundant_envs.control.statics import static_efforts
from redundant_envs.effects import Effect, Point, PointMass
from redundant_envs.model.energy import kinetic_energy, potential_energy
from redundant_envs.verify import Mode, verify

e = rde.effects
LOAD = 0.7
STEPS = {"rk4": {"integrator": "rk4"}, "1e-6": {"tolerance": 1e-6}}


def heavier(arm, load=LOAD):
    return dataclasses.replace(arm, masses=(*arm.masses[:-1], arm.masses[-1] + load))


def scenes(name, load=LOAD, **more):
    """The arm with the load, and the arm that is heavier by it."""
    arm, effects = ARMS[name], [e.Gravity(), Tether(2, 0.3, 0.1, 200.0, 2.0)]
    if arm.sliders():
        count = len(arm.sliders())
        effects.append(e.PrismaticStop((-0.1,) * count, (0.15,) * count, 0.5))
        effects.append(e.LimitSpring(arm.joints[arm.sliders()[0]], -0.05, 0.05, 500.0, 5.0))
    loaded = rde.Scene(arm, (*effects, Payload(load)), **more)
    return loaded, rde.Scene(heavier(arm, load), tuple(effects), **more)


def motion(scene, change=lambda batch: None):
    rng = np.random.default_rng(2)
    shape = (16, len(scene.robot.joints))
    q = rng.uniform(-1.0, 1.0, shape)
    q[:, np.array(scene.robot.prismatic)] *= 0.1
    batch = rde.BatchSimulator(scene, 16, track_work=True)
    change(batch)
    batch.set_state(q, rng.normal(size=shape))
    for _ in range(5):
        batch.advance(rng.normal(size=shape))
    return np.concatenate([batch.q, batch.qd, batch.work[:, None]], axis=1)


@pytest.mark.parametrize(
    "steps",
    [pytest.param(STEPS["rk4"], id="rk4", marks=pytest.mark.long), pytest.param(STEPS["1e-6"], id="1e-6")],
)
@pytest.mark.parametrize(
    "name", [pytest.param(x, marks=pytest.mark.long if x == "RPRP" else ()) for x in ARMS]
)
def test_a_load_moves_as_a_heavier_arm(name, steps):
    loaded, heavy = scenes(name, **steps)
    np.testing.assert_array_equal(motion(loaded), motion(heavy))


@pytest.mark.parametrize("name", ["4R", pytest.param("RRP", marks=pytest.mark.long)])
def test_lanes_have_loads_of_their_own(name):
    loaded, _ = scenes(name, load=0.0, integrator="rk4")
    loads = np.linspace(0.0, 2.0, 16)
    found = motion(loaded, lambda batch: batch.set_parameters({"payload.mass": loads}))
    for lane in (0, 3, 15):
        _, heavy = scenes(name, load=loads[lane], integrator="rk4")
        np.testing.assert_array_equal(found[lane], motion(heavy)[lane])
    masses = [*ARMS[name].masses[:-1], 0.2]
    found = motion(scenes(name, load=0.3)[0], lambda batch: batch.set_parameters({"masses": masses}))
    light = dataclasses.replace(ARMS[name], masses=tuple(masses))
    again = dataclasses.replace(scenes(name, load=0.3)[1], robot=heavier(light, 0.3))
    np.testing.assert_array_equal(found, motion(again))


@pytest.mark.parametrize(
    "name", ["RRP", *(pytest.param(n, marks=pytest.mark.long) for n in ("4R", "RPRP", "3R"))]
)
def test_energies_statics_and_verification_know_the_load(name):
    loaded, heavy = scenes(name)
    rng = np.random.default_rng(1)
    q, qd = rng.normal(size=(2, 20, len(loaded.robot.joints)))
    np.testing.assert_array_equal(kinetic_energy(loaded, q, qd), kinetic_energy(heavy, q, qd))
    np.testing.assert_array_equal(potential_energy(loaded, q), potential_energy(heavy, q))
    np.testing.assert_array_equal(static_efforts(loaded, q), static_efforts(heavy, q))
    assert verify(loaded, 64, Mode.QUICK).misses == ()


def test_computed_torque_carries_the_load():
    scene = rde.load_scene("four_r_reach")
    loaded = dataclasses.replace(scene, effects=(*scene.effects, Payload(0.1)))
    heavy = dataclasses.replace(scene, robot=heavier(scene.robot, 0.1))
    q, actions = np.array([[0.1, 0.4, 0.9, 1.2]]), []
    for one in (loaded, heavy):
        expert = ComputedTorque(one)
        expert.begin(q, np.array([[0.8, 0.6]]))
        actions.append(expert.action(0.3, q, 0.0 * q))
    np.testing.assert_array_equal(*actions)


def test_gradients_by_the_load_are_those_of_differences():
    scene = rde.Scene(ARMS["4R"], (e.Gravity(), Payload(0.4)), "rk8")
    step = rde.torch_step(scene)
    q, qd = torch.tensor([[0.1, 0.5, 1.0, 1.3]], dtype=torch.float64), torch.ones((1, 4), dtype=torch.float64)

    def tip(mass):
        return step(q, qd, 0.0 * q, {"payload.mass": mass})[0].sum()

    mass = torch.tensor(0.4, dtype=torch.float64, requires_grad=True)
    tip(mass).backward()
    with torch.no_grad():
        slope = (tip(mass + 1e-5) - tip(mass - 1e-5)) / 2e-5
    assert abs(float(mass.grad - slope)) < 1e-6 * abs(float(slope))


def test_a_load_of_an_environment_is_a_parameter_of_an_episode():
    scene = rde.load_scene("rprp_reach")
    loaded = dataclasses.replace(scene, effects=(*scene.effects, Payload(0.0)))
    envs = [rde.make_sb3("RPRPReach-v0", num_envs=2, scene=s.to_dict()) for s in (scene, loaded)]
    seen = []
    for env in envs:
        env.seed(3)
        seen.append(env.reset())
        seen.append(env.step(np.full((2, 4), 0.4, np.float32))[0])
    np.testing.assert_array_equal(seen[0], seen[2])
    np.testing.assert_array_equal(seen[1], seen[3])
    envs[1].set_options({"parameters": {"payload.mass": 1.0}})
    envs[1].seed(3)
    np.testing.assert_array_equal(envs[1].reset(), seen[0])
    assert (envs[1].step(np.full((2, 4), 0.4, np.float32))[0] != seen[1]).any()
    state = envs[1].get_state()
    with pytest.raises(ValueError, match="another scene"):
        envs[0].set_state(state)


@dataclasses.dataclass(frozen=True)
class Lightening(Effect):
    mass: float

    def hooks(self, arm):
        return (PointMass(Point(1), ".mass"),)


def test_masses_that_no_arm_may_have_are_refused():
    with pytest.raises(ValueError, match=r"masses with what effects add.*-0.5"):
        rde.Scene(ARMS["4R"], (Lightening(-2.0),))
    batch = rde.BatchSimulator(rde.Scene(ARMS["4R"], (Lightening(-1.0),)), 3)
    with pytest.raises(ValueError, match=r"m2 with lightening.mass has the entry -0.5"):
        batch.set_parameters({"lightening.mass": [-1.0, -2.0, 0.0]})
    with pytest.raises(ValueError, match=r"m2 with lightening.mass has the entry -0.9"):
        batch.set_parameters({"masses": (2.0, 0.1, 1.0, 0.5)}, 1)


@pytest.mark.parametrize(
    ("hook", "said"),
    [
        (PointMass(Point(4), ".mass"), r"Point is 4; give Point\(0\) to Point\(3\), the tip"),
        (PointMass(3, ".mass"), "Point is 3"),
        (PointMass(Point(0), ".weight"), "'.weight' is not a number of this effect; it has .mass"),
    ],
)
def test_masses_at_no_point_are_refused(hook, said):
    @dataclasses.dataclass(frozen=True)
    class Odd(Effect):
        mass: float = 1.0

        def hooks(self, arm):
            return (hook,)

    with pytest.raises(ValueError, match=said):
        rde.Scene(ARMS["4R"], (Odd(),))
