"""A batch of lanes: parameters of their own and status. Bits of any scene: ``test_properties.py``."""

import copy
import dataclasses

import numpy as np
import pytest
from catalogue import FOUR_R, GRAVITY, RPRP, SCENES, advanced, assert_same_bits, e, on

import redundant_envs as rde
from redundant_envs.verify.checks import random_states


def run(scene, q, qd, u, steps=1, parameters=None, **kwargs):
    """States after some intervals, (lanes, 8), and the status of the last."""
    batch, status = advanced(scene, q, qd, u, parameters, steps, **kwargs)
    return np.concatenate([batch.q, batch.qd], axis=1), status


@pytest.mark.quick("4R free euler")
@on(
    "4R free euler", "RPRP generalized rk8", "4R all 1e-6", "stops 1e-6, inelastic", "*R* gravity dop853",
)  # fmt: skip
def test_a_lanes_own_parameters_equal_those_of_its_own_scene(scene):
    """Lanes with steps of their own go through slots, eight at a time, whose numbers are not those of their
    blocks."""
    states, arm = random_states(scene, 11, 1), scene.robot
    own = arm.masses * np.array([[1.0] * 4, [0.6, 0.8, 1.7, 1.1], [1.9, 0.5, 0.7, 1.3]])
    whole, status = run(scene, *states, parameters={"masses": own[np.arange(11) % 3]})
    for k, masses in enumerate(own):
        alone = dataclasses.replace(scene, robot=dataclasses.replace(arm, masses=tuple(masses)))
        assert_same_bits(run(alone, *states)[0][k::3], whole[k::3])
    if scene.tolerance or scene.integrator == "dop853":
        assert status.evaluations.max() > 12


@pytest.mark.parametrize("value", [2.0, (1, 2, 3, 4), np.arange(1, 13).reshape(3, 4)], ids=str)
def test_shapes_of_parameters(value):
    batch, expected = rde.BatchSimulator(SCENES["4R all rk8"], 3), np.broadcast_to(value, (3, 4))
    batch.set_parameters({"effort_limits.limits": value, "masses": value, "gravity.g": (1.0, 2.0, 3.0)})
    names = tuple(f"effort_limits.limits[{k}]" for k in range(4))
    for found in (batch._memory.read(names), batch._memory.read(("m1", "m2", "m3", "m4"))):
        np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(batch._memory.read(("gravity.g",))[:, 0], (1, 2, 3))


@pytest.mark.quick("4R limits, 3 substeps, rk4")
@on("4R limits, 3 substeps, rk4", "stops 1e-6, inelastic")
def test_few_lanes_have_the_bits_and_the_status_of_many(scene):
    """A program for at most four lanes computes half a block; the last lane of each batch is not finite."""
    q, qd, u = random_states(scene, 24, 3)
    qd[[0, 2, 3, 4, 16], 2] = np.nan
    whole, status = run(scene, q, qd, u, steps=2)
    for count, threads in ((1, 1), (3, 1), (4, 1), (5, 1), (17, 3)):
        states, part = run(scene, q[:count], qd[:count], u[:count], steps=2, threads=threads)
        assert_same_bits([states, *part], [whole[:count], *(column[:count] for column in status)])
        assert not part.finite[-1]
        assert part.numerics[-1] == rde.Numerics.NON_FINITE
    assert status.finite.sum() == 24 - 5


@pytest.mark.parametrize("integrator", ["rk8", "dop853"])
def test_an_effort_that_is_no_number_is_reported(integrator):
    """Of a slider that rests at its stop, too."""
    resting = rde.Scene(RPRP, (e.Gravity(), e.PrismaticStop((0.0, 0.0), (0.3, 0.3), 0.0)), tolerance=1e-6)
    for scene, q in ((rde.Scene(FOUR_R, (GRAVITY,), integrator), 0.0), (resting, (-1.5, 0.3, -1.5, 0.3))):
        batch, status = advanced(scene, np.full((9, 4), q), np.zeros(4))
        assert status.finite.all()
        efforts = np.zeros((9, 4))
        efforts[5, 0] = np.nan
        status = batch.advance(efforts)
        assert np.flatnonzero(~status.finite).tolist() == [5]
        assert status.numerics[5] == rde.Numerics.NON_FINITE


def test_what_is_the_same_in_every_interval_is_read_only_in_a_copy_too():
    """One array serves all calls: an in-place addition to it must not change later results."""
    made = rde.BatchSimulator(rde.Scene(FOUR_R, (), integrator="rk4"), 5)
    for batch in (made, copy.deepcopy(made)):
        status = batch.advance()
        for shared in (status.evaluations, status.events, status.error_estimate):
            with pytest.raises(ValueError, match="read-only"):
                shared += 1
        assert batch.advance().evaluations.tolist() == [4] * 5
        assert np.isnan(status.error_estimate).all()  # rk4 has none
