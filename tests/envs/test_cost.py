"""What scenes cost: the scenes that are compared, their motions, and the table. No speed is asserted."""

from dataclasses import dataclass, replace

from catalogue import FOUR_R, FRICTION, GRAVITY, LIMITS, e, springs

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


def test_motors_without_limits_take_the_commands_of_the_scene_beside_them():
    own, other = cost.limits_of(cost.alone(BARE, LIMITS))
    assert own.tolist() == other.tolist() == [5.0, 4.0, 3.0, 2.0]
    volts = rde.load_scene("slow_motors")
    for pair in (cost.Pair(rde.Scene(FOUR_R), rde.Scene(FOUR_R)), cost.Pair(volts, cost.bare(volts))):
        held = 2.0 * cost.weight(pair.without)  # N m, never another scene's volts
        assert (cost.limits_of(pair)[1] == held).all()
        assert (held > [8.0, 4.0, 2.0, 0.5]).all()


def test_both_scenes_of_a_row_get_the_same_commands_whatever_other_rows_do_to_the_same_scene(monkeypatch):
    @dataclass
    class Timed:
        limits: float
        evaluations = faults = 0.0
        price = 0, 0

        def sample(self):
            return 1.0

        def nanoseconds(self, times):
            return self.limits

        @classmethod
        def of(cls, scene, limits, lanes):
            return cls(limits.sum())

    monkeypatch.setattr(cost, "Timed", Timed)
    free = cost.bare(rde.load_scene("slow_motors"))
    strong, delay = e.EffortLimits((50.0,) * 4), e.CommandDelay(0.04, 0.1)
    rows = cost.costs({effect.key: cost.alone(free, effect) for effect in (delay, strong)}, turns=1)
    assert {row["times_bare"] for row in rows} == {1.0}
    assert {row["ns"] for row in rows if row["of"] == strong.key} == {200.0}
