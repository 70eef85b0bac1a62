"""Hooks of a scene are bound once, to names of quantities, and are asked for by their kinds."""

import pickle
from dataclasses import dataclass

import pytest
from catalogue import FOUR_R, GRAVITY

import redundant_envs as rde
from redundant_envs import effects as e
from redundant_envs.algebra import physics
from redundant_envs.effects.attaching import RULES, roots_of

towards = physics(lambda command, effort, pace: pace * (command - effort))
same = physics(lambda x: x)


@dataclass(frozen=True)
class Slow(e.Effect):
    """A lag of one motor, and a command that is held."""

    pace: float = 3.0

    def hooks(self, arm):
        bind = {"command": "command2", "effort": ".effort", "pace": ".pace"}
        held = e.State("held[0]", "N m", update=same, bind={"x": "command2"}, initial=0.5)
        return (
            e.Actuation(
                1, same, {"x": ".effort"}, states=(e.State("effort", "N m", towards, bind=bind), held)
            ),
        )


SPRING = e.LimitSpring("joint2", -1.0, 1.0, 40.0, 2.0)
SCENE = rde.Scene(FOUR_R, (GRAVITY, Slow(), SPRING))


def test_functions_take_quantities_and_fields_of_lanes():
    bound = SCENE.attached
    (force,), (link,) = bound.of(e.Force), bound.of(e.Actuation)
    own = (f"limit_spring.joint2.{name}" for name in ("lower", "upper", "stiffness", "damping"))
    assert force.functions["function"].names == ("phi2", "phid2", *own, "side_switch1")
    assert link.functions["function"].names == ("slow.effort",)
    assert link.states["slow.effort"]["derivative"].names == ("command2", "slow.effort", "slow.pace")
    assert bound.of(e.Impact, e.PointMass) == ()
    assert bound.chains["command2"] == [link]


def test_states_are_integrated_or_updated():
    states = SCENE.attached.states
    assert list(states) == ["slow.effort", "slow.held[0]"]
    assert (states.integrated, states.updated) == (("slow.effort",), ("slow.held[0]",))
    assert states.initial == {"slow.effort": 0.0, "slow.held[0]": 0.5}


def test_hooks_are_bound_once_and_not_pickled():
    assert SCENE.attached is SCENE.attached
    assert "attached" not in SCENE.__getstate__()
    again = pickle.loads(pickle.dumps(SCENE))
    assert again == SCENE
    assert [a.key for a in again.attached] == [a.key for a in SCENE.attached]


def test_every_function_of_a_hook_has_a_rule():
    for kind, rules in RULES.items():
        assert {n for n, text in kind.__annotations__.items() if "Callable" in text} == rules.keys()


def test_what_a_quantity_depends_on():
    assert roots_of("phi2", FOUR_R) == {*FOUR_R.coordinates}
    assert [roots_of(name, FOUR_R) for name in ("m4", "command1", "s1")] == [{"m4"}, {"command1"}, {"theta1"}]
    with pytest.raises(ValueError, match="Q1"):
        roots_of("qdd1", FOUR_R)  # it follows from forces
