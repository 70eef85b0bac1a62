"""Projectors and the basis of the null space: their identities, smoothness, and the poses that are
refused."""

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.control.null_space import (
    generalised_inverse,
    kinematic_mobility,
    null_basis,
    null_projector,
    posture_row,
)

FOUR_R = rde.FourR((0.7, 0.2, 0.4, 0.9), (0.3, 0.5, 0.1, 0.25))
RPRP = rde.RPRP((0.7, 0.2, 0.4, 0.9), (0.3, 0.15))
RPR = rde.Chain("RPR", masses=(1.0, 2.0, 3.0), lengths=(0.3, 0.4))
ARMS = {arm.kind: arm for arm in (FOUR_R, RPRP, RPR)}
every_arm = pytest.mark.parametrize("arm", ARMS.values(), ids=ARMS)
METRICS = {
    "kinematic": lambda arm, q: kinematic_mobility(arm),
    "mass": lambda arm, q: np.linalg.inv(arm.mass_matrix(q)),
}
every_metric = pytest.mark.parametrize("metric", METRICS.values(), ids=METRICS)


def drawn(arm, count=40, seed=0):
    q = np.random.default_rng(seed).uniform(-3.0, 3.0, (count, len(arm.joints)))
    for k in arm.sliders():
        q[:, k] = 0.1 * np.abs(q[:, k])
    return q


@every_metric
@every_arm
def test_projectors_leave_the_tip_and_forces_through_them_do_not_accelerate_it(arm, metric):
    q = drawn(arm)
    jacobian, mobility = arm.jacobian(q), metric(arm, q)
    projector = null_projector(jacobian, mobility)
    np.testing.assert_allclose(jacobian @ projector, 0.0, atol=1e-12)
    np.testing.assert_allclose(projector @ projector, projector, atol=1e-11)
    scale = np.abs(mobility).max()
    np.testing.assert_allclose(jacobian @ mobility @ projector.swapaxes(-1, -2) / scale, 0.0, atol=1e-12)
    inverse = generalised_inverse(jacobian, mobility)
    np.testing.assert_allclose(jacobian @ inverse, np.broadcast_to(np.eye(2), (40, 2, 2)), atol=1e-12)


def test_the_rates_of_the_consistent_inverse_have_the_least_kinetic_energy():
    q = drawn(FOUR_R)
    jacobian, mass = FOUR_R.jacobian(q), FOUR_R.mass_matrix(q)
    rates = generalised_inverse(jacobian, np.linalg.inv(mass)) @ np.array([0.3, -0.2])
    other = generalised_inverse(jacobian, kinematic_mobility(FOUR_R)) @ np.array([0.3, -0.2])
    energy, more = (FOUR_R.kinetic_energy(q, qd) for qd in (rates, other))
    assert (energy < more).all()


def test_rates_of_joints_with_sliders_do_not_depend_on_the_unit_of_length():
    in_mm = rde.RPRP(RPRP.masses, tuple(1000.0 * length for length in RPRP.lengths))
    q, unit = drawn(RPRP), np.array([1.0, 1000.0, 1.0, 1000.0])
    rates = generalised_inverse(RPRP.jacobian(q), kinematic_mobility(RPRP)) @ np.array([0.1, 0.2])
    again = generalised_inverse(in_mm.jacobian(unit * q), kinematic_mobility(in_mm)) @ np.array(
        [100.0, 200.0]
    )
    np.testing.assert_allclose(again, unit * rates, rtol=1e-9)


@every_metric
@every_arm
def test_the_basis_spans_the_null_space_orthonormally_and_is_smooth(arm, metric):
    def basis(q):
        return null_basis(arm.jacobian(q), metric(arm, q), posture_row(arm))

    q = drawn(arm)
    vectors, mass = basis(q), np.linalg.inv(metric(arm, q))
    np.testing.assert_allclose(arm.jacobian(q) @ vectors, 0.0, atol=1e-11)
    square = vectors.swapaxes(-1, -2) @ mass @ vectors
    np.testing.assert_allclose(square, np.broadcast_to(np.eye(len(arm.joints) - 2), square.shape), atol=1e-11)
    share = np.linspace(0.0, 1.0, 4001)[:, None]
    way = basis(q[0] + share * (q[1] - q[0]))  # a jump or a change of sign would not shrink with the step
    fine, coarse = (np.abs(np.diff(way[::step], axis=0)).max() / np.abs(way).max() for step in (1, 4))
    assert fine < 0.02
    assert fine == pytest.approx(coarse / 4.0, rel=0.2)


def test_the_basis_of_rprp_is_smooth_where_the_links_align():
    q = np.array([[0.4, 0.1, 0.4 + bend, 0.2] for bend in (-1e-7, 0.0, 1e-7, np.pi)])
    vectors = null_basis(RPRP.jacobian(q), kinematic_mobility(RPRP), posture_row(RPRP))
    np.testing.assert_allclose(vectors[:2], vectors[1:3], atol=1e-5)
    assert np.isfinite(vectors).all()


ZIGZAG = 0.2 + np.array([0.3, np.pi - 0.3, -0.3, np.pi + 0.3])


@pytest.mark.parametrize(
    ("q", "words"),
    [
        (np.full(4, 0.3), "less than full rank in 1 of 1"),
        ([drawn(FOUR_R, 1)[0], [0.3, 0.3 + np.pi, 0.3, 0.3]], "in 1 of 2 poses, the first of them 1"),
        (ZIGZAG, "row is a combination .* in 1 of 1"),
    ],
)
def test_singular_poses_and_zigzags_are_refused(q, words):
    with pytest.raises(ValueError, match=words):
        null_basis(FOUR_R.jacobian(q), kinematic_mobility(FOUR_R), posture_row(FOUR_R))


def test_a_basis_is_known_of_three_and_four_joints():
    arm = rde.Chain("RRRRR", masses=(1.0,) * 5, lengths=(1.0,) * 5)
    with pytest.raises(ValueError, match=r"\(2, 5\).* give"):
        null_basis(arm.jacobian(np.arange(5.0)), np.eye(5), np.ones(5))
