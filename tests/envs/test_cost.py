"""What scenes cost: the scenes that are compared, their motions, and the table. No speed is asserted."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from catalogue import ARMS, FOUR_R, FRICTION, GRAVITY, LIMITS, RPRP, e, every_effect, springs, stops

import redundant_envs as rde
from redundant_envs.effects import Effect, Sensing
from redundant_envs.envs import cost
from redundant_envs.language.algebra import physics
from redundant_envs.support.timing import Times
from redundant_envs.tasks.base import hard_stops

BARE = rde.Scene(FOUR_R, (GRAVITY, FRICTION, LIMITS))
FIRST, LAST = springs(FOUR_R)


@physics
def shifted(reading, bias):
    return reading + bias


@dataclass(frozen=True)
class Shifted(Effect):
    """A sensor with an offset, rad."""

    bias: float = 0.1

    def hooks(self, arm):
        return (Sensing(0, shifted, {"reading": "phi1", "bias": ".bias"}),)


def test_an_effect_is_compared_with_the_bare_arm_and_one_of_the_bare_arm_with_the_arm_without_it():
    scene = rde.Scene(FOUR_R, (FIRST, GRAVITY, LAST, FRICTION, LIMITS), tolerance=1e-9)
    bare = replace(scene, effects=(GRAVITY, FRICTION, LIMITS))
    assert cost.bare(scene) == bare
    found = cost.parts(scene)
    assert found.pop("bare") == (bare, bare)
    assert found.pop("whole scene") == (scene, bare)
    assert found == {
        FIRST.key: (replace(bare, effects=(GRAVITY, FRICTION, LIMITS, FIRST)), bare),
        LAST.key: (replace(bare, effects=(GRAVITY, FRICTION, LIMITS, LAST)), bare),
        "gravity": (bare, replace(bare, effects=(FRICTION, LIMITS))),
        "viscous_friction": (bare, replace(bare, effects=(GRAVITY, LIMITS))),
        "effort_limits": (bare, replace(bare, effects=(GRAVITY, FRICTION))),
    }
    moon = e.Gravity(1.62)
    assert cost.alone(bare, moon)[0].effects == (moon, *bare.effects[1:])


@pytest.mark.long
def test_scenes_are_compared_without_their_ranges_some_of_which_are_of_effects_that_are_left_out():
    ranges = {"payload.mass": {"uniform": [0, 1]}, "gravity.g": {"uniform": [9, 10]}}
    ranges["sensor_bias.position"] = {"uniform": [0, 0.1]}
    effects = (*BARE.effects, e.Payload(0.5), e.SensorBias(position=0.1))
    scene = replace(BARE, effects=effects, randomize=ranges)
    assert cost.bare(scene) == BARE
    assert cost.parts(scene)["gravity"] == (BARE, replace(BARE, effects=(FRICTION, LIMITS)))
    assert [core.scene.effects for core in cost.observers(scene, 8)] == [scene.effects, scene.effects[:-1]]


@pytest.mark.parametrize("arm", ARMS.values(), ids=ARMS)
def test_motions_start_inside_the_limits(arm):
    scene, count = rde.Scene(arm, every_effect(arm)), len(arm.joints)
    values, free = (
        scene.parameters(),
        cost.starts(rde.Scene(arm), np.random.default_rng(0).random((64, count))),
    )
    low, high = np.where(arm.prismatic, 0.0, -1.5), np.where(arm.prismatic, 0.25, 1.5)
    assert ((free @ arm.motor_map >= low - 1e-12) & (free @ arm.motor_map <= high + 1e-12)).all()
    for k, ends in scene.travel().items():
        low[k], high[k] = max(low[k], values[ends[0]]), min(high[k], values[ends[1]])
    limited = cost.starts(scene, np.random.default_rng(0).random((64, count)))
    for k, lower, upper in hard_stops(scene):  # to the last bit: a simulator refuses what is beyond
        assert ((limited[:, k] >= values[lower]) & (limited[:, k] <= values[upper])).all()
    joints = limited @ arm.motor_map
    assert ((joints >= low - 1e-12) & (joints <= high + 1e-12)).all()
    assert (np.ptp(joints, axis=0) > 0.8 * (high - low)).all()
    assert set(scene.travel()) >= {0, count - 1}


def test_motors_without_limits_take_the_commands_of_the_scene_beside_them():
    unlimited = cost.alone(BARE, LIMITS)
    own, other = cost.limits_of(unlimited)
    assert own.tolist() == other.tolist() == [5.0, 4.0, 3.0, 2.0]
    volts = rde.load_scene("slow_motors")
    assert np.ptp(cost.limits_of(cost.Pair(volts, volts))[0]) == 0.0  # 24 V each
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
        sample = lambda self: 1.0  # noqa: E731
        nanoseconds = lambda self, times: self.limits  # noqa: E731

        @classmethod
        def of(cls, scene, limits, lanes, most):
            return cls(limits.sum())

    monkeypatch.setattr(cost, "Timed", Timed)
    free = cost.bare(rde.load_scene("slow_motors"))
    strong, delay = e.EffortLimits((50.0,) * 4), e.CommandDelay(0.04, 0.1)
    rows = cost.costs({effect.key: cost.alone(free, effect) for effect in (delay, strong)}, turns=1)
    assert {row["times_bare"] for row in rows} == {1.0}
    assert {row["ns"] for row in rows if row["of"] == strong.key} == {200.0}


@pytest.mark.long
def test_the_table_has_every_scene_at_both_accuracies(capsys):
    scene = rde.Scene(FOUR_R, (*BARE.effects, FIRST))
    rows = cost.costs(cost.parts(scene), lanes=8, turns=2, most=1e-9)
    assert [tuple(row) for row in rows] == [cost.COLUMNS] * len(rows)
    names = ["bare", "gravity", "viscous_friction", "effort_limits", FIRST.key, "whole scene"]
    assert [(row["at"], row["of"]) for row in rows] == [(at, of) for at in cost.TOLERANCES for of in names]
    of = {(row["at"], row["of"]): row for row in rows}
    for at in cost.TOLERANCES:
        bare, sprung = of[at, "bare"], of[at, FIRST.key]
        assert bare["times_bare"] == 1.0
        assert sprung["ns_without"] == bare["ns"]
        assert sprung["times_bare"] == pytest.approx(sprung["ns"] / bare["ns"], rel=1e-2)
        assert (sprung["operations"] > bare["operations"], sprung["bytes"] > bare["bytes"]) == (True, True)
        assert {**sprung, "of": "whole scene"} == of[at, "whole scene"]
    assert {row["evaluations"] for row in rows if row["at"] == "one rk8 step"} == {12.0}
    assert of["1e-6 m", FIRST.key]["evaluations"] > 12.0
    assert "cost 1/" in capsys.readouterr().err


@pytest.mark.long
def test_the_table_counts_what_the_motion_needs_and_no_task():
    bill = rde.bill(rde.Scene(RPRP, (GRAVITY, stops(RPRP), LIMITS), "rk8"))
    total = [
        sum(column) for column in zip(*(bill[k] for k in bill if k not in cost.OF_ENVIRONMENT), strict=True)
    ]
    assert cost.price(rde.Scene(RPRP, (GRAVITY, stops(RPRP), LIMITS), "rk8")) == (sum(total[:-1]), total[-1])


@pytest.mark.long
def test_readings_of_sensors_are_timed_where_an_environment_can_have_them():
    scene = rde.Scene(FOUR_R, (*BARE.effects, Shifted()))
    timed = cost.Timed.of(scene, np.ones(4), 8, 1e-9)
    assert [len(core.scene.effects) for core in timed.cores] == [4, 3]
    assert [core.num_envs for core in timed.cores] == [timed.batch.num_envs] * 2
    assert np.shape(timed.sample()) == (cost.WARM + cost.TIMED + 2,)
    warm, intervals = [1.0] * cost.WARM, [64e-6] * cost.TIMED
    each = 1e9 / timed.batch.num_envs
    found = timed.nanoseconds(Times(np.array([[*warm, *intervals, 7e-6, 3e-6]])))
    assert found == pytest.approx(each * (64e-6 + 4e-6))
    for scene in (
        BARE,
        rde.Scene(FOUR_R, (Shifted(),)),  # no motors
        rde.Scene(RPRP, (LIMITS, Shifted())),  # no ends of travel
    ):
        assert cost.observers(scene, 8) == ()


def test_a_motion_is_the_same_in_every_turn_and_a_slow_one_has_fewer_lanes():
    made = cost.Timed.of(BARE, np.array([20.0, 12.0, 8.0, 4.0]), 5000, 1e9)
    assert made.batch.num_envs == 5000
    few = cost.Timed.of(BARE, np.array([20.0, 12.0, 8.0, 4.0]), 128, 1e9)
    assert (few.batch.q == made.batch.q[:128]).all()
    assert (few.efforts == made.efforts[:, :128]).all()
    made.sample()
    ends, evaluations = made.batch.q, made.evaluations
    assert np.abs(made.batch.qd).max() > 1.0
    made.sample()
    assert (made.batch.q == ends).all()
    assert made.evaluations == evaluations
    assert cost.Timed.of(BARE, np.ones(4), cost.LANES, 1e-9).batch.num_envs == cost.FEWEST_LANES
