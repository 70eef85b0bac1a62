"""A boundary from outside the package, in one file: elastic, frictionless walls for the tip."""

from dataclasses import dataclass

import numpy as np
import pytest

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


ARMS = {
    "4R": rde.FourR(masses=(2.0, 1.5, 1.0, 0.5), lengths=(0.3, 0.5, 0.4, 0.6)),
    "RPRP": rde.RPRP(masses=(2.0, 1.5, 1.0, 0.5), lengths=(0.3, 0.5)),
    "RRR": rde.Chain("RRR", masses=(1.5, 1.0, 0.5), lengths=(0.5, 0.4, 0.3)),
}
LANES, PLACE = 16, 0.15


def started(arm, effects=(), seed=3, **steps):
    """Lanes whose tips begin between the walls."""
    scene = rde.Scene(arm, (*effects, Walls(PLACE)), control_dt=0.02, **steps)
    rng = np.random.default_rng(seed)
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


STOPS = e.PrismaticStop((-0.05, -0.05), (0.35, 0.35), 1.0)


@pytest.mark.parametrize(("arm", "effects"), [("4R", ()), ("RRR", ()), ("RPRP", (STOPS,))])
def test_a_hundred_impacts_at_walls_keep_the_energy_and_the_tip_between_them(arm, effects):
    batch = started(ARMS[arm], effects, integrator="dop853")
    energy = batch.scene.robot.kinetic_energy(batch.q, batch.qd)
    impacts, farthest = np.zeros(LANES), 0.0
    while np.median(impacts) < 100:
        status = batch.advance(np.zeros_like(batch.q))
        assert not status.numerics.any()
        impacts += status.events
        farthest = max(farthest, beyond(batch))
    np.testing.assert_allclose(batch.scene.robot.kinetic_energy(batch.q, batch.qd), energy, rtol=1e-12)
    assert farthest <= 1e-12


@pytest.mark.parametrize("steps", [{"tolerance": 1e-6}, {"tolerance": 1e-9}, {"integrator": "rk8"}])
@pytest.mark.parametrize("arm", ARMS)
def test_steps_of_other_kinds_find_the_impacts_that_dop853_finds(arm, steps):
    effects = (STOPS,) if arm == "RPRP" else ()
    exact, other = started(ARMS[arm], effects, integrator="dop853"), started(ARMS[arm], effects, **steps)
    for _ in range(5):
        found = other.advance(np.zeros_like(other.q))
        np.testing.assert_array_equal(found.events, exact.advance(np.zeros_like(exact.q)).events)
        assert not found.numerics.any()
    assert beyond(other) <= 1e-12
    tips = [b.scene.robot.forward_kinematics(b.q) for b in (exact, other)]
    allowed = 5.0 * steps["tolerance"] if "tolerance" in steps else 1e-4
    assert np.abs(tips[0] - tips[1]).max() <= 40.0 * allowed


def test_walls_work_on_single_numbers_as_compiled():
    from redundant_envs.lane.direct import cross_interval, fields_of
    from redundant_envs.lane.dynamics import Dynamics
    from redundant_envs.lane.interval import Interval

    batch = started(ARMS["RRR"], tolerance=1e-6)
    dynamics = Dynamics(batch.scene)
    rows = np.concatenate([batch.q, batch.qd], axis=1)
    batch.advance(np.zeros_like(batch.q))
    for row, q in zip(rows, batch.q, strict=True):
        known = dict(zip(dynamics.states, row, strict=True))
        lane = cross_interval(Interval(dynamics), {**fields_of(dynamics), **known})
        found = [lane[name] for name in dynamics.arm.coordinates]
        np.testing.assert_allclose(found, q, atol=1e-12)
