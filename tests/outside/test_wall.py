"""A boundary from outside the package, in one file: elastic, frictionless walls for the tip."""

from dataclasses import dataclass

import numpy as np
import pytest
from arms import ARMS

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.algebra import physics


@physics
def gap_right(tip_x, place):
    return place - tip_x


@physics
def gap_left(tip_x, place):
    return tip_x + place


@dataclass(frozen=True)
class Walls(e.Effect):
    """Two walls, ``place`` m to the right and to the left of the base, between which the tip moves."""

    place: float
    restitution: float = 1.0

    def hooks(self, arm):
        bind = {"place": ".place"}
        return e.Gap(gap_right, ".restitution", bind), e.Gap(gap_left, ".restitution", bind)


LANES, PLACE = 16, 0.15


def started(name):
    """Lanes whose tips begin between the walls; sliders have elastic stops."""
    arm = ARMS[name]
    stops = (e.PrismaticStop((-0.05, -0.05), (0.35, 0.35), 1.0),) if name == "RPRP" else ()
    scene = rde.Scene(arm, (*stops, Walls(PLACE)), integrator="dop853")
    rng = np.random.default_rng(3)
    q = rng.uniform(-np.pi, np.pi, (4000, len(arm.joints)))
    q[:, np.array(arm.prismatic)] = rng.uniform(0.0, 0.3, (4000, sum(arm.prismatic)))
    q = q[np.abs(arm.forward_kinematics(q)[:, 0]) < 0.8 * PLACE][:LANES]
    qd = 6.0 * rng.normal(size=q.shape)
    qd[:, np.array(arm.prismatic)] *= 0.1
    batch = rde.BatchSimulator(scene, LANES)
    batch.set_state(q, qd)
    return batch


def beyond(batch):
    return (np.abs(batch.scene.robot.forward_kinematics(batch.q)[:, 0]) - PLACE).max()


@pytest.mark.long
@pytest.mark.parametrize("name", ["3R", "RPRP"])
def test_a_hundred_impacts_at_walls_keep_the_energy_and_the_tip_between_them(name):
    batch = started(name)
    energy = batch.scene.robot.kinetic_energy(batch.q, batch.qd)
    impacts, farthest = np.zeros(LANES), 0.0
    while np.median(impacts) < 100:
        status = batch.advance(np.zeros_like(batch.q))
        assert not status.numerics.any()
        impacts += status.events
        farthest = max(farthest, beyond(batch))
    np.testing.assert_allclose(batch.scene.robot.kinetic_energy(batch.q, batch.qd), energy, rtol=1e-12)
    assert farthest <= 1e-12
