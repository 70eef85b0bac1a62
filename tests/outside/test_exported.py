"""Arms from outside in MuJoCo."""

import numpy as np
import pytest
import rrp
import three_r
from foreign import NEEDS_MUJOCO, assert_same_tips, largest_difference, model_of

import redundant_envs as rde

pytestmark = NEEDS_MUJOCO
e = rde.effects
CASES = {
    "ThreeR": (three_r.ThreeR((0.5, 0.4, 0.3), (0.4, 0.35, 0.25)), "joint"),
    "RRP": (rrp.RRP((2.0, 1.5, 1.0), (0.3, 0.5)), "generalized"),
    "PRPPR": (rde.Chain("PRPPR", (1.0, 0.8, 0.6, 0.5, 0.4), (0.3, 0.2)), "joint"),
}


@pytest.mark.quick("ThreeR")
@pytest.mark.parametrize(("arm", "actuation"), CASES.values(), ids=CASES)
def test_other_arms_are_chains_of_links_too(arm, actuation):
    friction = e.ViscousFriction(tuple(np.linspace(0.1, 0.3, len(arm.joints))))
    scene = rde.Scene(arm, (e.Gravity.on_plane(9.81, tilt=0.4, roll=0.7), friction), actuation=actuation)
    model = model_of(scene, "mjcf")
    assert largest_difference(scene, model, True) < 1e-10
    assert_same_tips(scene, model)
