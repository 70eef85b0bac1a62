"""What scenes cost: the scenes that are compared, their motions, and the table. No speed is asserted."""

from dataclasses import replace

from catalogue import FOUR_R, FRICTION, GRAVITY, LIMITS, springs

import redundant_envs as rde
from redundant_envs.envs import cost

BARE = rde.Scene(FOUR_R, (GRAVITY, FRICTION, LIMITS))
FIRST, LAST = springs(FOUR_R)


def test_an_effect_is_compared_with_the_bare_arm_and_one_of_the_bare_arm_with_the_arm_without_it():
    numbers = {"gravity.g": {"uniform": [9, 10]}, FIRST.key + ".stiffness": {"uniform": [700, 900]}}
    scene = rde.Scene(FOUR_R, (FIRST, GRAVITY, LAST, FRICTION, LIMITS), tolerance=1e-9, randomize=numbers)
    bare = replace(scene, effects=(GRAVITY, FRICTION, LIMITS), randomize=None)
    assert cost.bare(scene) == bare
    assert cost.parts(scene) == {
        "bare": (bare, bare),
        FIRST.key: (replace(bare, effects=(GRAVITY, FRICTION, LIMITS, FIRST)), bare),
        LAST.key: (replace(bare, effects=(GRAVITY, FRICTION, LIMITS, LAST)), bare),
        "gravity": (bare, replace(bare, effects=(FRICTION, LIMITS))),
        "viscous_friction": (bare, replace(bare, effects=(GRAVITY, LIMITS))),
        "effort_limits": (bare, replace(bare, effects=(GRAVITY, FRICTION))),
        "whole scene": (scene, bare),
    }


def test_commands_are_shares_of_the_limits_or_of_what_holds_the_arm():
    assert cost.commands(BARE).tolist() == [5.0, 4.0, 3.0, 2.0]
    held = cost.commands(rde.Scene(FOUR_R, (GRAVITY,)))  # N m, whatever the units of other motors
    assert (held > [16.0, 8.0, 4.0, 1.0]).all()
