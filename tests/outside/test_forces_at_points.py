"""Forces at points of an arm are those of the principle of virtual work, on every arm and back end."""

import dataclasses

import numpy as np
import pytest
import three_r
from arms import ARMS
from tether import Tether

import redundant_envs as rde
from redundant_envs.backends.torch import torch
from redundant_envs.control.statics import static_efforts
from redundant_envs.effects import Effect, Force, Point
from redundant_envs.lane.direct import cross_interval, fields_of
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.lane.interval import Interval
from redundant_envs.verify import Mode, verify

e = rde.effects
AT_POINTS = [(name, k + 1) for name, arm in ARMS.items() for k in range(arm.num_masses)]


def states(arm, count=30):
    rng = np.random.default_rng(8)
    shape = (count, len(arm.joints))
    q = rng.uniform(-2.0, 2.0, shape)
    q[:, np.array(arm.prismatic)] *= 0.1
    return q, rng.normal(size=shape), rng.normal(size=shape)


def slopes(arm, q, step=1e-5):
    """Derivatives of the points' positions by the coordinates, (lanes, points, 2, joints), by differences."""
    moves = step * np.eye(q.shape[1])

    def difference(move):
        return (arm.points(q + move) - arm.points(q - move)) / (2.0 * step)

    return np.stack([(8.0 * difference(m) - difference(2.0 * m)) / 6.0 for m in moves], axis=-1)


@pytest.mark.parametrize(("name", "k"), AT_POINTS)
def test_velocities_and_derivatives_of_points_are_those_of_their_positions(name, k):
    arm = ARMS[name]
    q, qd, _ = states(arm)
    known = {**arm.parameter_values(), **dict(zip(arm.coordinates, q.T, strict=True))}
    known |= dict(zip(arm.rates, qd.T, strict=True))
    n = len(arm.joints)
    found = [arm.evaluate([f"{axis}{k}{j + 1}" for j in range(n)], known) for axis in "XY"]
    found = np.array([[np.broadcast_to(x, len(q)) for x in row] for row in found])
    np.testing.assert_allclose(np.moveaxis(found, -1, 0), slopes(arm, q)[:, k - 1], atol=1e-9)
    velocity = np.array([np.broadcast_to(v, len(q)) for v in arm.evaluate((f"vx{k}", f"vy{k}"), known)])
    np.testing.assert_allclose(velocity.T, np.einsum("nij,nj->ni", slopes(arm, q)[:, k - 1], qd), atol=1e-9)


@pytest.mark.parametrize("actuation", ["joint", "generalized"])
@pytest.mark.parametrize(("name", "k"), AT_POINTS)
def test_a_force_at_a_point_accelerates_as_virtual_work_says(name, k, actuation):
    arm, tether = ARMS[name], Tether(k, 0.3, -0.2, 50.0, 2.0)
    q, qd, efforts = states(arm)
    dynamics = Dynamics(rde.Scene(arm, (e.Gravity(9.81), tether), "rk4", actuation=actuation))
    numbers = {**fields_of(dynamics), **dict(zip(dynamics.commands, efforts.T, strict=True))}
    x = dynamics.quantities([*q.T, *qd.T], numbers)
    found = np.array([np.broadcast_to(a, len(q)) for a in dynamics.accelerations(x)]).T
    at_point = slopes(arm, q)[:, k - 1]
    force = 50.0 * (np.array([0.3, -0.2]) - arm.points(q)[:, k - 1])
    force -= 2.0 * np.einsum("nij,nj->ni", at_point, qd)
    driven = efforts @ arm.motor_map.T if actuation == "joint" else efforts
    total = driven + np.einsum("nij,ni->nj", at_point, force)
    expected = arm.forward_dynamics(q, qd, total)
    assert np.abs(found - expected).max() < 1e-7 * np.abs(expected).max()


@pytest.mark.parametrize(
    "name", ["RPRP", *(pytest.param(n, marks=pytest.mark.long) for n in ("3R", "4R", "RRP"))]
)
def test_the_energy_book_closes_and_a_wrong_potential_is_found(name, monkeypatch):
    arm = ARMS[name]
    scene = rde.Scene(arm, (e.Gravity(), Tether(2, 0.1, -0.4, 80.0, 3.0)), "rk8", 0.01)
    assert verify(scene, 64, Mode.QUICK).misses == ()

    class Wrong(Tether):
        def hooks(self, arm):
            (hook,) = super().hooks(arm)
            turned = e.hooks.Force(hook.joint, hook.function, hook.bind, hook.potential, hook.function)
            return (dataclasses.replace(turned, conservative=_backwards),)

    wrong = dataclasses.replace(scene, effects=(e.Gravity(), Wrong(2, 0.1, -0.4, 80.0, 0.0)))
    misses = verify(wrong, 64, Mode.QUICK).misses
    assert any("wrong: at" in miss and "derivative of the potential" in miss for miss in misses)


@rde.algebra.physics
def _backwards(x, y, post_x, post_y, stiffness):
    return stiffness * (x - post_x), stiffness * (y - post_y)


@pytest.mark.parametrize("steps", [{"integrator": "rk4"}, {"tolerance": 1e-8}, {"integrator": "dop853"}])
@pytest.mark.parametrize("name", [pytest.param("RPRP", marks=pytest.mark.long), "3R"])
def test_evaluators_agree_on_forces_at_points(name, steps):
    arm = ARMS[name]
    stops = (e.PrismaticStop((-0.1, -0.1), (0.1, 0.15), 0.5),) if name == "RPRP" else ()
    scene = rde.Scene(arm, (e.Gravity(), Tether(3, 0.3, 0.1, 40.0, 1.0), *stops), **steps)
    q, qd, efforts = states(arm, 16)
    q[:, np.array(arm.prismatic)] *= 0.4
    batch = rde.BatchSimulator(scene, 16)
    batch.set_state(q, qd)
    batch.advance(efforts)
    compiled = np.concatenate([batch.q, batch.qd], axis=1)
    dynamics = Dynamics(scene)
    names = (*dynamics.states, *dynamics.commands)
    for convert in (np.array, torch.tensor):
        columns = [convert(x) for x in np.concatenate([q, qd, efforts], axis=1).T]
        with np.errstate(all="ignore"):
            fields = {**fields_of(dynamics), **dict(zip(names, columns, strict=True))}
            lane = cross_interval(Interval(dynamics), fields)
        direct = np.stack([np.asarray(lane[s]) for s in dynamics.states], axis=1)
        assert np.abs(direct - compiled).max() < 1e-12 * max(1.0, np.abs(compiled).max())


def test_a_stiff_tether_makes_error_control_take_steps_that_are_short_enough():
    arm = ARMS["4R"]
    scene = rde.Scene(arm, (Tether(4, 0.5, 0.5, 4e4),), tolerance=1e-6)
    assert Dynamics(scene).prepare(Dynamics(scene).parameters)["least_step_rate"] == 0.5 * np.sqrt(4e4 / 0.5)
    batch = rde.BatchSimulator(scene, 8)
    reference = rde.BatchSimulator(dataclasses.replace(scene, tolerance=None, substeps=400), 8)
    for b in (batch, reference):
        b.set_state(*states(arm, 8)[:2])
        status = b.advance(np.zeros((8, 4)))
    tips = [arm.forward_kinematics(b.q) for b in (batch, reference)]
    assert np.abs(tips[0] - tips[1]).max() < 1e-6
    assert (status.numerics == 0).all()


@pytest.mark.parametrize("name", ARMS)
def test_static_efforts_balance_forces_at_points(name):
    arm = ARMS[name]
    scene = rde.Scene(arm, (e.Gravity(), Tether(2, 0.3, -0.2, 60.0)), "rk8", 1e-3)
    q = states(arm)[0]
    batch = rde.BatchSimulator(scene, len(q))
    batch.set_state(q, np.zeros_like(q))
    batch.advance(static_efforts(scene, q))
    assert np.abs(batch.qd).max() < 1e-10


def test_an_environment_with_a_force_at_a_point_lists_it_and_counts_its_operations():
    scene = rde.load_scene("rprp_reach")
    tethered = dataclasses.replace(scene, effects=(*scene.effects, Tether(4, 1.0, 1.0, 10.0)))
    assert "tether" not in rde.bill(scene)
    assert "tether" not in rde.listing(scene)
    assert rde.bill(tethered)["tether"].products > 0
    assert "pull_and_damping" in rde.listing(tethered)
    env = rde.make_sb3("RPRPReach-v0", num_envs=3, scene=tethered.to_dict())
    env.seed(0)
    assert np.isfinite(env.reset()).all()


@rde.algebra.physics
def _one(x4):
    return x4


@pytest.mark.parametrize(
    ("hook", "said"),
    [
        (Force(Point(4), Tether.hooks, {}), r"Point is 4; give Point\(0\) to Point\(3\), the tip"),
        (Force(Point(True), Tether.hooks, {}), "number of the Point is True"),
        (Force(Point(3), _one, {}), "returns 1 values; a Force at a point needs 2"),
        (Force(1, _backwards, dict.fromkeys(("x", "y", "post_x", "post_y", "stiffness"), "x1")),
         "returns 2 values; a Force needs 1"),
        (Force("tip", _one, {}), "joint is 'tip'; give 0 to 3"),
    ],
)  # fmt: skip
def test_forces_at_no_point_are_refused(hook, said):
    @dataclasses.dataclass(frozen=True)
    class Odd(Effect):
        def hooks(self, arm):
            return (hook,)

    with pytest.raises(ValueError, match=said):
        rde.Scene(ARMS["4R"], (Odd(),))


def test_an_arm_with_other_points_has_their_velocities():
    @rde.algebra.physics(gives="x1 y1 x2 y2 x3 y3")
    def other_points(l1, l2, l3, s1, c1, s2, c2, s3, c3):
        return 2.0 * l1 * c1, 0.0 * s1, l2 * c2, l2 * s2, l3 * c3, l3 * s3

    functions = tuple(other_points if f is three_r.points else f for f in three_r.ThreeR.functions)
    turned = type("OtherPoints", (three_r.ThreeR,), {"functions": functions})((1.0,) * 3, (1.0,) * 3)
    q = states(turned, 5)[0]
    known = {**turned.parameter_values(), **dict(zip(turned.coordinates, q.T, strict=True))}
    found = turned.evaluate(["X11"], known)[0]
    np.testing.assert_allclose(found, slopes(turned, q)[:, 0, 0, 0], atol=1e-9)
