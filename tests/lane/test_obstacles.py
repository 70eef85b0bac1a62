"""How near the arm comes to obstacles: clearances of links, and the closest approach within a step."""

import dataclasses
from dataclasses import dataclass

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.effects.obstacles import least_of
from redundant_envs.envs.core import Core
from redundant_envs.simulator.batch.environment import Autoreset
from redundant_envs.tasks.reach import ReachTask

DISCS = (((0.45, -0.25), 0.1), ((-0.3, -0.4), 0.12))
FLOOR = ((0.1, -0.55), (0.1, 1.0))
LIMITS = e.EffortLimits((20.0, 12.0, 8.0, 4.0))
LANES = 24


@dataclass(frozen=True)
class NearTask(ReachTask):
    name = "Near"
    metrics = (*ReachTask.metrics, "nearest1", "nearest2", "nearest3", "clearance1_2", "clearance3")
    held_outputs = (*ReachTask.held_outputs, "nearest1", "nearest2", "nearest3")

    def functions(self, scene):
        nearest = (least_of([f"closest{k}"], f"nearest{k}") for k in (1, 2, 3))
        return (*super().functions(scene), *nearest)


def scene_of(name, **stepping):
    obstacles = e.KeepOut(*DISCS[0], name="a"), e.HalfPlane(*FLOOR), e.KeepOut(*DISCS[1], name="b")
    scene = rde.load_scene(name)
    # No contact: the half-plane is far too soft to be felt.
    soft = dataclasses.replace(obstacles[1], stiffness=1e-9)
    return dataclasses.replace(scene, effects=(*scene.effects, obstacles[0], soft, obstacles[2]), **stepping)


def gaps(robot, q):
    """Gaps (obstacles, ..., links), computed here anew."""
    points = robot.points(q)
    points = np.concatenate([np.zeros((*points.shape[:-2], 1, 2)), points], axis=-2)
    a, b = points[..., :-1, :], points[..., 1:, :]
    rows = []
    for centre, radius in DISCS:
        share = ((np.array(centre) - a) * (b - a)).sum(-1) / np.maximum(((b - a) ** 2).sum(-1), 1e-300)
        nearest = a + np.clip(share, 0.0, 1.0)[..., None] * (b - a)
        rows.append(np.linalg.norm(nearest - centre, axis=-1) - radius)
    point, normal = np.array(FLOOR[0]), np.array(FLOOR[1]) / np.linalg.norm(FLOOR[1])
    floor = np.minimum((a - point) @ normal, (b - point) @ normal)
    return np.stack([rows[0], floor, rows[1]])


STEPPING = {
    "tolerance": {"tolerance": 1e-6},
    "dop853": {"integrator": "dop853", "tolerance": None},
    "one step": {"integrator": "rk8", "tolerance": None},
    "substeps": {"integrator": "rk4", "substeps": 3, "tolerance": None},
}


@pytest.mark.quick("four_r_reach-tolerance")
@pytest.mark.parametrize("stepping", STEPPING)
@pytest.mark.parametrize("name", ["four_r_reach", "rprp_reach"])
def test_the_closest_approach_within_a_step_is_that_of_a_fine_simulation(name, stepping):
    scene = scene_of(name, **STEPPING[stepping])
    core = Core(scene, LANES, NearTask(), autoreset=Autoreset.DISABLED)
    core.begin(np.ones(LANES, bool), {})
    generator = np.random.default_rng(5)
    start = generator.uniform(-2.0, 0.0, (LANES, 4))
    start[:, scene.robot.sliders()] = generator.uniform(0.05, 0.2, (LANES, len(scene.robot.sliders())))
    core.memory.write(scene.robot.coordinates, start, np.arange(LANES))
    limits = np.array([scene.parameters()[unit] for unit in scene.action_units()])
    exact = dataclasses.replace(scene, integrator="rk8", substeps=1, tolerance=1e-9)
    missed = 0
    for _ in range(12):
        q, qd = (core.memory.read(names) for names in (scene.robot.coordinates, scene.robot.rates))
        actions = (0.5 * np.sign(generator.uniform(-1, 1, (LANES, 4)))).astype(np.float32)
        times = np.linspace(0.0, scene.control_dt, 65)
        moved = rde.simulate(exact, q, qd, times, efforts=actions * limits)
        truth = gaps(scene.robot, moved.q).min(axis=(1, 3))
        out = core.step(actions, Autoreset.DISABLED)[1]
        measured = np.stack([core.columns.of(out, f"nearest{k}") for k in (1, 2, 3)])
        at_edge = np.abs(truth) < 0.06  # of links that are deep in a disc it is less exact
        assert np.abs(measured - truth)[at_edge].max(initial=0.0) < 5e-4
        now = gaps(scene.robot, core.memory.read(scene.robot.coordinates))
        np.testing.assert_allclose(core.columns.of(out, "clearance1_2"), now[0, :, 1], atol=1e-12)
        np.testing.assert_allclose(core.columns.of(out, "clearance3"), now[2].min(-1), atol=1e-12)
        ends = np.minimum(gaps(scene.robot, q).min(-1), now.min(-1))
        missed += (truth < ends - 1e-3).sum()
    assert missed > 0  # in some steps an arm comes nearer than at both ends


@pytest.mark.long
def test_a_small_disc_that_a_fast_link_passes_within_a_step_is_touched():
    scene, shares = rde.load_scene("four_r_reach"), np.linspace(0.05, 0.95, 3)
    places = [(0.6 * np.cos(angle), 0.6 * np.sin(angle)) for angle in -0.2 + 0.4 * shares]
    discs = [e.KeepOut(place, 0.01, name=f"d{k}") for k, place in enumerate(places)]
    scene = dataclasses.replace(scene, effects=(LIMITS, *discs), tolerance=1e-6)
    core = Core(scene, LANES, NearTask(), autoreset=Autoreset.DISABLED)
    core.begin(np.ones(LANES, bool), {})
    core.memory.write(scene.robot.coordinates, np.full((LANES, 4), -0.2), np.arange(LANES))
    core.memory.write(scene.robot.rates, np.full((LANES, 4), 20.0), np.arange(LANES))
    out = core.step(np.zeros((LANES, 4), np.float32), Autoreset.DISABLED)[1]
    for k in (1, 2, 3):
        assert core.columns.of(out, f"nearest{k}").max() < -0.005  # the way of the link is 0.24 m
