"""Bodies: links with inertia, loads, tendons and springs move as their equations say."""

import math

import numpy as np
import pytest
from catalogue import advanced

import redundant_envs as rde
from redundant_envs import effects as e

# ---- tendons -------------------------------------------------------------------------------------------

TWO_SLIDERS = rde.Chain("PP", masses=(1.0, 0.5))
"""Masses at r1 and at r1 + r2: a tendon with the arms 1 and 1 is fixed to the base and the second mass."""
STRETCH, STIFFNESS = 0.1, 80.0
OMEGA = math.sqrt(STIFFNESS / 0.5)


def pulled(t, slack):
    """Position of a mass that a slack tendon of ``slack`` m pulls from a stretch, and that then flies on."""
    t_slack = 0.5 * math.pi / OMEGA
    stretched = STRETCH * np.cos(OMEGA * np.minimum(t, t_slack))
    return slack + stretched - STRETCH * OMEGA * np.maximum(t - t_slack, 0.0)


@pytest.mark.parametrize(("steps", "bound"), [({"tolerance": 1e-9}, 2e-8), ({"integrator": "dop853"}, 1e-12)])
def test_a_tendon_pulls_a_mass_and_lets_it_fly(steps, bound):
    slack = 0.02
    tendon = e.Tendon(("r1", "r2"), (1.0, 1.0), STIFFNESS, -STIFFNESS * slack)
    scene = rde.Scene(TWO_SLIDERS, (tendon,), control_dt=0.01, **steps)
    times = np.linspace(0.0, 0.3, 31)
    motion = rde.simulate(scene, (0.0, STRETCH + slack), (0.0, 0.0), times)
    assert np.abs(motion.tip[:, 0] - pulled(times, slack)).max() <= bound
    assert np.abs(motion.q[:, 0]).max() <= bound  # the first mass is not pulled
    assert np.abs(motion.balance - motion.balance[0]).max() <= 20.0 * bound
    assert motion.potential_energy[0] == pytest.approx(0.5 * STIFFNESS * STRETCH**2, rel=1e-14)
    assert (motion.potential_energy[-5:] == 0.0).all()


# ---- links ---------------------------------------------------------------------------------------------


def test_a_link_with_inertia_is_a_compound_pendulum():
    """It falls by m g l cos / (m l^2 + J)."""
    inertias = np.array([0.0, 0.02, 0.3, 5.0])
    scene = rde.Scene(rde.Chain("R", (2.0,), (0.5,)), (e.Gravity(), e.LinkInertia(0.1)), "euler", 1e-3)
    angle = np.full((4, 1), 0.4)
    found, _ = advanced(scene, angle, 0.0 * angle, None, {"link_inertia.inertias": inertias[:, None]})
    expected = -2.0 * 9.81 * 0.5 * math.cos(0.4) / (2.0 * 0.25 + inertias)
    np.testing.assert_allclose(found.qd[:, 0] / 1e-3, expected, rtol=1e-13)


# ---- fields that move, and several of them -------------------------------------------------------------


TIMES = np.linspace(0.0, 0.5, 26)


def test_a_free_mass_stays_where_it_is_while_bases_move_together():
    """Seen from them it moves as x0 + A w t - A sin w t, and there is no other force."""
    bases = (
        e.MovingBase((0.02, -0.01), 11.0), e.MovingBase((0.0, 0.03), 5.0, "second"),
        e.MovingBase((0.04, 0.0), 11.0, "third"),
    )  # fmt: skip
    motion = rde.simulate(rde.Scene(rde.Chain("P", (2.0,)), bases, "dop853"), (0.1,), (0.0,), TIMES)
    expected = 0.1 + 0.06 * (11.0 * TIMES - np.sin(11.0 * TIMES))
    assert np.abs(motion.q[:, 0] - expected).max() <= 1e-13
    assert np.abs(motion.work - motion.kinetic_energy).max() <= 1e-12
    assert motion.work.max() > 0.1
