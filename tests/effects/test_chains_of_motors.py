"""From the command of a motor to its effort: the order of links, their units, and the unit of actions."""

import dataclasses
import itertools

import pytest
from catalogue import ARMS, FOUR_R

import redundant_envs as rde
from redundant_envs.control.computed_torque import ComputedTorque
from redundant_envs.effects import Actuation, Effect, EffortLimits, Link
from redundant_envs.effects.hooks import effort_unit
from redundant_envs.envs.named import action_table
from redundant_envs.envs.registration import check_motors
from redundant_envs.language.algebra import physics

TIMES = physics(lambda command, factor: factor * command)


@dataclasses.dataclass(frozen=True)
class Converter(Effect):
    """A link of every motor that multiplies its command; it names its units."""

    link: Link = Link.LAG
    takes: str = "V"
    gives: str = ""
    factor: float = 0.5
    named: str = "converter"
    size: float = 12.0
    asked: bool = True

    static = ("link", "takes", "gives", "named", "asked")

    @property
    def key(self):
        return self.named

    def hooks(self, arm):
        joints = range(len(arm.joints))
        binds = ({"command": f"command{k + 1}", "factor": ".factor"} for k in joints)
        how = {"takes": self.takes, "gives": self.gives}
        return tuple(Actuation(k, TIMES, bind, self.link, **how) for k, bind in enumerate(binds))

    def action_units(self, arm):
        return ("size",) * len(arm.joints) if self.asked else ()

    def units(self, arm):
        return {"size": self.takes}


SERVO, DELAY = Converter(Link.CONTROL, "rad/s", "V", named="servo"), rde.effects.CommandDelay(0.01, 0.1)
MOTOR, LIMITS = Converter(factor=0.25, named="motor"), EffortLimits(5.0)


@pytest.mark.parametrize("arm", [ARMS[kind] for kind in ("4R", "PPR")], ids=["4R", "PPR"])
def test_the_command_has_the_unit_that_the_first_link_with_a_unit_takes(arm):
    for effects, unit in (((MOTOR,), "V"), ((DELAY, SERVO, MOTOR, LIMITS), "rad/s")):
        for order in itertools.permutations(effects):
            assert rde.Scene(arm, order).command_units() == (unit,) * len(arm.joints)
    efforts = tuple(effort_unit(arm, k) for k in range(len(arm.joints)))
    for effects in ((), (DELAY,), (LIMITS, DELAY)):
        assert rde.Scene(arm, effects).command_units() == efforts


@pytest.mark.parametrize(
    ("effects", "said"),
    [
        ((SERVO,), "'servo' gives 'V', not 'N m'; add a motor"),
        ((MOTOR, Converter(named="other")), "'motor' gives 'N m', and 'other' behind it takes 'V'"),
        ((LIMITS, Converter(Link.LIMITS)), "'effort_limits' gives 'N m', and 'converter' behind"),
        ((SERVO, DELAY, LIMITS), "'servo' gives 'V', and 'effort_limits' behind it takes 'N m'"),
    ],
)
def test_a_chain_whose_units_do_not_meet_is_refused(effects, said):
    with pytest.raises(ValueError, match=said):
        rde.Scene(FOUR_R, effects)


def test_the_action_has_the_unit_of_the_earlier_link_in_any_order_of_the_effects():
    for effects, unit in (((SERVO, MOTOR, LIMITS), "servo.size"), ((MOTOR, LIMITS), "motor.size")):
        for order in itertools.permutations(effects):
            assert rde.Scene(FOUR_R, order).action_units() == (unit,) * 4


def test_an_environment_says_that_actions_are_shares_of_a_voltage():
    scene = rde.load_scene("four_r_reach")
    driven = dataclasses.replace(scene, effects=(*scene.effects, MOTOR))
    with pytest.raises(ValueError, match=r"shares of motor\.size; the expert knows efforts alone"):
        ComputedTorque(driven)
    check_motors(driven)
    table = action_table(driven)
    assert "command at joint1 / 12 V" in table
    assert "Unit of the command" in table
    silent = dataclasses.replace(MOTOR, asked=False)
    with pytest.raises(ValueError, match=r"effort_limits\.limits\[0\], which is in 'N m', and .* is in 'V'"):
        check_motors(dataclasses.replace(driven, effects=(silent, LIMITS)))
