"""Bodies: links with inertia, loads, tendons and springs move as their equations say."""

import math
import re

import numpy as np
import pytest
from catalogue import FOUR_R, RPRP, advanced
from refusals import short

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.lane.dynamics import Dynamics

NAN = math.nan

# ---- tendons -------------------------------------------------------------------------------------------

TWO_SLIDERS = rde.Chain("PP", masses=(1.0, 0.5))
"""Masses at r1 and at r1 + r2: a tendon with the arms 1 and 1 is fixed to the base and the second mass."""
STRETCH, STIFFNESS = 0.1, 80.0
OMEGA = math.sqrt(STIFFNESS / 0.5)


def pulled(t, slack=0.0):
    """Position of a mass that a slack tendon of ``slack`` m pulls from a stretch, and that then flies on."""
    t_slack = 0.5 * math.pi / OMEGA
    stretched = STRETCH * np.cos(OMEGA * np.minimum(t, t_slack))
    return slack + stretched - STRETCH * OMEGA * np.maximum(t - t_slack, 0.0)


@pytest.mark.parametrize("slack", [0.0, 0.02])
@pytest.mark.parametrize(("steps", "bound"), [({"tolerance": 1e-9}, 2e-8), ({"integrator": "dop853"}, 1e-12)])
def test_a_tendon_pulls_a_mass_and_lets_it_fly(slack, steps, bound):
    tendon = e.Tendon(("r1", "r2"), (1.0, 1.0), STIFFNESS, -STIFFNESS * slack)
    scene = rde.Scene(TWO_SLIDERS, (tendon,), control_dt=0.01, **steps)
    times = np.linspace(0.0, 0.3, 31)
    motion = rde.simulate(scene, (0.0, STRETCH + slack), (0.0, 0.0), times)
    assert np.abs(motion.tip[:, 0] - pulled(times, slack)).max() <= bound
    assert np.abs(motion.q[:, 0]).max() <= bound  # the first mass is not pulled
    assert np.abs(motion.balance - motion.balance[0]).max() <= 20.0 * bound
    assert motion.potential_energy[0] == pytest.approx(0.5 * STIFFNESS * STRETCH**2, rel=1e-14)
    assert (motion.potential_energy[-5:] == 0.0).all()


@pytest.mark.parametrize("arm", [FOUR_R, RPRP], ids=["4R", "RPRP"])
def test_antagonists_are_a_spring_between_their_joints(arm):
    """Twice the stiffness, while neither is slack; three joints share it by their moment arms."""
    joints, arms = arm.joints[1:], np.array((0.05, -0.02, 0.03))
    pair = [
        e.Tendon(joints, tuple(side * arms), 400.0, 50.0, name) for name, side in (("a", 1.0), ("b", -1.0))
    ]
    rng = np.random.default_rng(0)
    q, qd = 0.3 * rng.normal(size=(32, 4)), rng.normal(size=(32, 4))
    found, _ = advanced(rde.Scene(arm, pair, "euler", 1e-3), q, qd)
    longer = (q @ arm.motor_map)[:, 1:] @ arms
    torques = np.concatenate([np.zeros((32, 1)), -2.0 * 400.0 * longer[:, None] * arms], axis=1)
    expected = arm.forward_dynamics(q, qd, torques @ arm.motor_map.T, g=0.0)
    assert np.abs((found.qd - qd) / 1e-3 - expected).max() <= 1e-10 * np.abs(expected).max()


def test_error_control_knows_how_stiff_a_tendon_makes_joints_together():
    """Opposite arms of two joints pull the mass between them; no step is longer than 2 rad of its phase."""
    arm = rde.Chain("PP", masses=(0.5, 1e6))
    pair = [e.Tendon(("r1", "r2"), (side, -side), 2e6, 1e5, name) for name, side in (("a", 1.0), ("b", -1.0))]
    dynamics = Dynamics(rde.Scene(arm, pair, tolerance=1e-6))
    omega = math.sqrt(4e6 * 4.0 / 0.5)  # r1 - r2 = 2 x while the far mass stays
    least = dynamics.prepare(dynamics.parameters)["least_step_rate"]
    assert 0.5 * omega <= math.sqrt(2.0) * least <= 1.01 * 0.5 * omega


# ---- links ---------------------------------------------------------------------------------------------


def test_a_link_with_inertia_is_a_compound_pendulum():
    """It falls by m g l cos / (m l^2 + J)."""
    inertias = np.array([0.0, 0.02, 0.3, 5.0])
    scene = rde.Scene(rde.Chain("R", (2.0,), (0.5,)), (e.Gravity(), e.LinkInertia(0.1)), "euler", 1e-3)
    angle = np.full((4, 1), 0.4)
    found, _ = advanced(scene, angle, 0.0 * angle, None, {"link_inertia.inertias": inertias[:, None]})
    expected = -2.0 * 9.81 * 0.5 * math.cos(0.4) / (2.0 * 0.25 + inertias)
    np.testing.assert_allclose(found.qd[:, 0] / 1e-3, expected, rtol=1e-13)


def test_one_inertia_serves_all_links_and_sliders_have_none():
    assert rde.Scene(RPRP, (e.LinkInertia(0.1),)).effects == (e.LinkInertia((0.1, 0.1)),)
    assert [*rde.Scene(FOUR_R, (e.LinkInertia(0.1),)).parameters()][-1] == "link_inertia.inertias[3]"


# ---- what cannot be ------------------------------------------------------------------------------------

REFUSED = {
    "Payload.mass is -1": lambda: e.Payload(-1.0),
    "Payload.mass is nan": lambda: e.Payload(NAN),
    "LinkInertia.inertias is -0.1": lambda: e.LinkInertia(-0.1),
    "LinkInertia.inertias[1] is nan": lambda: e.LinkInertia((0.1, NAN)),
    "LinkInertia.inertias has 4 entries; RPRP has 2 revolute joints: give 2": (
        lambda: rde.Scene(RPRP, (e.LinkInertia((0.1,) * 4),))
    ),
    "Tendon.joints is 'joint2'; give the names of two or more": lambda: e.Tendon("joint2", (1.0,), 1.0),
    "each once": lambda: e.Tendon(("r1", "r1"), (1.0, 1.0), 1.0),
    "Tendon.moment_arms has 3 entries; give 2": lambda: e.Tendon(("r1", "r2"), (1.0, 1.0, 1.0), 1.0),
    "Tendon.moment_arms[1] is 1e+200": lambda: e.Tendon(("r1", "r2"), (1.0, 1e200), 1.0),
    "Tendon.stiffness is 0.0; it must be positive": lambda: e.Tendon(("r1", "r2"), (1.0, 1.0), 0.0),
    "Tendon.pretension is nan": lambda: e.Tendon(("r1", "r2"), (1.0, 1.0), 1.0, NAN),
    "Tendon.name is 'a b'": lambda: e.Tendon(("r1", "r2"), (1.0, 1.0), 1.0, 0.0, "a b"),
    "coordinate is 'r1'; FourR has joint1": (
        lambda: rde.Scene(FOUR_R, (e.Tendon(("r1", "joint2"), (1.0, 1.0), 1.0),))
    ),
    "Tether.point is 0": lambda: e.Tether(0, (0.0, 0.0), 1.0),
    "Tether.point is 5; RPRP has the point masses 1 to 4": (
        lambda: rde.Scene(RPRP, (e.Tether(5, (0.0, 0.0), 1.0),))
    ),
    "Tether.post has 3 entries; give 2": lambda: e.Tether(4, (0.0, 0.0, 0.0), 1.0),
    "Tether.damping is -1": lambda: e.Tether(4, (0.0, 0.0), 1.0, -1.0),
    "TwoStageSpring.lower is 0.3, upper is 0.1": lambda: e.TwoStageSpring("r1", 0.3, 0.1, 1.0, 1.0),
    "TwoStageSpring.harder is -1": lambda: e.TwoStageSpring("r1", 0.1, 0.3, 1.0, -1.0),
}


@pytest.mark.parametrize("words", REFUSED)
def test_numbers_that_mean_nothing_are_refused(words):
    with pytest.raises(ValueError, match=re.escape(words)) as error:
        REFUSED[words]()
    assert short(str(error.value))
