"""A batch of lanes: parameters of their own and status. Bits of any scene: ``test_properties.py``."""

import dataclasses

import numpy as np
import pytest
from catalogue import FOUR_R, SCENES, on

import redundant_envs as rde
from redundant_envs import algebra
from redundant_envs.algebra import sqrt, where
from redundant_envs.effects.hooks import Effect, Field
from redundant_envs.verify.states import random_states

e = rde.effects
every_scene = on("4R gravity rk4", "4R all rk8", "RPRP gravity euler", "RPRP generalized rk8")


def states(count, scene=SCENES["4R gravity rk4"]):
    return random_states(scene, count, seed=0)


def run(scene, q, qd, u, steps=5, **kwargs):
    """States after some intervals, and the status of the last."""
    batch = rde.BatchSimulator(scene, len(q), **kwargs)
    batch.set_state(q, qd)
    for _ in range(steps):
        status = batch.advance(u)
    return np.concatenate([batch.q, batch.qd], axis=1), status


# ---- separate parameters of a lane -----------------------------------------------------------------


@pytest.mark.parametrize("count", [3, 11])
@every_scene
def test_a_lanes_own_parameters_equal_those_of_its_own_scene(scene, count):
    q, qd, u = states(count, scene)
    batch = rde.BatchSimulator(scene, count)
    batch.set_state(q, qd)
    batch.set_parameters({"masses": (1.0, 0.7, 0.6, 0.9), "gravity.g": 3.7}, index=[1])
    batch.advance(u)
    robot = dataclasses.replace(scene.robot, masses=(1.0, 0.7, 0.6, 0.9))
    field, *others = scene.effects
    other = dataclasses.replace(scene, robot=robot, effects=(dataclasses.replace(field, g=3.7), *others))
    expected, _ = run(other, q, qd, u, steps=1)
    plain, _ = run(scene, q, qd, u, steps=1)
    lanes = np.arange(count) != 1
    np.testing.assert_array_equal(np.concatenate([batch.q, batch.qd], 1)[1], expected[1])
    np.testing.assert_array_equal(np.concatenate([batch.q, batch.qd], 1)[lanes], plain[lanes])


@pytest.mark.parametrize("count", [8, 19])
def test_lanes_with_steps_of_their_own_have_their_own_parameters(count):
    """They go through slots, eight at a time, whose numbers are not those of their blocks."""
    scene = rde.Scene(FOUR_R, (e.Gravity(),), tolerance=1e-10)
    q, qd, u = states(count)
    qd[::3] *= 0.001  # one step serves these
    g = np.linspace(1.0, 12.0, count)

    def final(lanes):
        batch = rde.BatchSimulator(scene, len(lanes))
        batch.set_state(q[lanes], 3.0 * qd[lanes])
        batch.set_parameters({"gravity.g": g[lanes]})
        evaluations = batch.advance(u[lanes]).evaluations
        return np.concatenate([batch.q, batch.qd], axis=1), evaluations

    whole, evaluations = final(np.arange(count))
    assert len(np.unique(evaluations)) > 1
    for lane in range(count):
        alone, _ = final(np.array([lane]))
        np.testing.assert_array_equal(alone[0], whole[lane])


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (2.0, [[2, 2, 2, 2]] * 3),
        ((1, 2, 3, 4), [[1, 2, 3, 4]] * 3),
        (np.arange(1, 13).reshape(3, 4), np.arange(1, 13).reshape(3, 4)),
    ],
)
def test_shapes_of_parameters(value, expected):
    batch = rde.BatchSimulator(SCENES["4R all rk8"], 3)
    batch.set_parameters({"effort_limits.limits": value, "masses": value})
    names = tuple(f"effort_limits.limits[{k}]" for k in range(4))
    np.testing.assert_array_equal(batch._memory.read(names), expected)
    np.testing.assert_array_equal(batch._memory.read(("m1", "m2", "m3", "m4")), expected)
    batch.set_parameters({"gravity.g": (1.0, 2.0, 3.0)})
    np.testing.assert_array_equal(batch._memory.read(("gravity.g",))[:, 0], (1, 2, 3))


@algebra.physics(gives="ax ay")
def choosing_field(g):
    return where(g > 0.0, sqrt(g), 0.0), where(g == 0.0, 0.0, 1.0 / g)


@dataclasses.dataclass(frozen=True)
class Weightless(Effect):
    """A field of a parameter alone, with a choice of which one side is NaN."""

    g: float = 1.0

    def hooks(self, arm):
        return (Field(choosing_field, {"g": ".g"}),)


def test_prepared_numbers_warn_no_more_than_compiled_ones(recwarn):
    arm = rde.FourR((1.0,) * 4, (0.5,) * 4)
    batch = rde.BatchSimulator(rde.Scene(arm, (Weightless(),), integrator="rk4"), 2)
    batch.set_parameters({"weightless.g": [0.0, -2.0]})
    assert batch.advance().finite.all()
    assert not recwarn.list


# ---- status ----------------------------------------------------------------------------------------


@every_scene
@pytest.mark.parametrize(("count", "threads"), [(1, 1), (7, 1), (9, 2), (17, 3)])
def test_status_of_a_partly_filled_block(scene, count, threads):
    q, qd, u = states(24, scene)
    qd[count - 1, 2] = np.nan
    _, whole = run(scene, q, qd, u, steps=1)
    _, part = run(scene, q[:count], qd[:count], u[:count], steps=1, threads=threads)
    for name in ("finite", "numerics", "error_estimate", "evaluations"):
        assert getattr(part, name).shape == (count,)
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[:count])
    assert part.finite.tolist() == [True] * (count - 1) + [False]
    assert part.numerics[-1] == rde.Numerics.NON_FINITE


@every_scene
def test_status_of_each_method(scene):
    _, status = run(scene, *states(4, scene), steps=1)
    evaluations = scene.substeps * {"euler": 1, "rk4": 4, "rk8": 12}[scene.integrator]
    assert (status.evaluations == evaluations).all()
    assert np.isnan(status.error_estimate).all() == (scene.integrator != "rk8")
    assert (status.events == 0).all()


def test_error_estimate_follows_the_error():
    scene = rde.Scene(FOUR_R, (e.Gravity(),), control_dt=0.05)
    q, qd, u = states(200)
    one, status = run(scene, q, 2 * qd, 0 * u, steps=1)
    fine = rde.Scene(FOUR_R, (e.Gravity(),), control_dt=0.05, substeps=16)
    exact, _ = run(fine, q, 2 * qd, 0 * u, steps=1)
    error = np.linalg.norm(
        FOUR_R.forward_kinematics(one[:, :4]) - FOUR_R.forward_kinematics(exact[:, :4]), axis=1
    )
    assert (status.error_estimate > error).mean() > 0.95
    assert np.corrcoef(np.log(error + 1e-16), np.log(status.error_estimate))[0, 1] > 0.7


def test_one_rk8_step_of_a_control_interval_is_far_below_a_micrometre():
    """The README's claim about calm, smooth motion: rates of 4 rad/s, 20 ms, one step."""
    arm = rde.FourR((0.5,) * 4, (0.25,) * 4)
    rng = np.random.default_rng(0)
    q, qd = rng.uniform(-np.pi, np.pi, (4096, 4)), rng.normal(0, 4, (4096, 4))
    ends = []
    for substeps in (1, 16):
        scene = rde.Scene(arm, (e.Gravity(),), "rk8", 0.02, substeps)
        ends.append(arm.forward_kinematics(run(scene, q, qd, np.zeros((4096, 4)), steps=1)[0][:, :4]))
    error = np.linalg.norm(ends[0] - ends[1], axis=1)
    assert np.quantile(error, 0.99) < 1e-7


@pytest.mark.parametrize("integrator", ["euler", "rk4", "rk8", "dop853"])
def test_an_effort_that_is_no_number_is_reported(integrator):
    batch = rde.BatchSimulator(rde.Scene(FOUR_R, (e.Gravity(),), integrator=integrator), 9)
    efforts = np.zeros((9, 4))
    efforts[5, 1] = np.nan
    status = batch.advance(efforts)
    assert np.flatnonzero(~status.finite).tolist() == [5]
    assert status.numerics[5] == rde.Numerics.NON_FINITE


def test_an_effort_that_is_no_number_is_reported_of_a_slider_at_rest_too():
    arm = rde.RPRP((1.0, 0.8, 0.6, 0.4), (0.5, 0.4))
    stops = e.PrismaticStop((0.0, 0.0), (0.3, 0.3), restitution=0.0)
    batch = rde.BatchSimulator(rde.Scene(arm, (e.Gravity(), stops), tolerance=1e-6), 1)
    batch.set_state([[-1.5, 0.3, -1.5, 0.3]], np.zeros((1, 4)))
    batch.advance()
    assert batch._memory.read(("active_stop_r1",))[0, 0] == 1.0
    assert not batch.advance([[np.nan, 0.0, 0.0, 0.0]]).finite[0]


def test_what_is_the_same_in_every_interval_is_read_only():
    """One array serves all calls: an in-place addition to it must not change later results."""
    batch = rde.BatchSimulator(rde.Scene(FOUR_R, (), integrator="rk4"), 5)
    status = batch.advance()
    for shared in (status.evaluations, status.events, status.error_estimate):
        with pytest.raises(ValueError, match="read-only"):
            shared += 1
    assert batch.advance().evaluations.tolist() == [4] * 5
