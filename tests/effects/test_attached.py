"""Hooks of a scene are bound once, to names of quantities, and are asked for by their kinds."""

import pickle
from dataclasses import dataclass

import pytest

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.effects import Actuation, Force, Impact, PointMass, State
from redundant_envs.effects.attaching import RULES, roots_of

ARM = rde.FourR((2.3, 0.7, 1.9, 0.4), (1.1, 0.6, 0.9, 0.35))


@physics
def towards(command, effort, pace):
    return pace * (command - effort)


@physics
def same(x):
    return x


@dataclass(frozen=True)
class Slow(rde.effects.Effect):
    """A lag of one motor, and a command that is held."""

    pace: float = 3.0

    def hooks(self, arm):
        lag = State(
            "effort", "N m", towards, bind={"command": "command2", "effort": ".effort", "pace": ".pace"}
        )
        held = State("held[0]", "N m", update=same, bind={"x": "command2"}, initial=0.5)
        return (Actuation(1, same, {"x": ".effort"}, states=(lag, held)),)


def scene(*effects):
    return rde.Scene(ARM, (rde.effects.Gravity(), *effects))


def test_functions_take_quantities_and_fields_of_lanes():
    spring = rde.effects.LimitSpring("joint2", -1.0, 1.0, 40.0, 2.0)
    bound = scene(Slow(), spring).attached
    (force,), (link,) = bound.of(Force), bound.of(Actuation)
    own = (f"limit_spring_joint2_{name}" for name in ("lower", "upper", "stiffness", "damping"))
    assert force.functions["function"].names == ("phi2", "phid2", *own, "side_switch1")
    assert link.functions["function"].names == ("slow__effort",)
    assert link.states["slow__effort"]["derivative"].names == ("command2", "slow__effort", "slow__pace")
    assert bound.of(Impact, PointMass) == ()
    assert bound.chains["command2"] == [link]


def test_states_are_integrated_or_updated():
    states = scene(Slow()).attached.states
    assert list(states) == ["slow__effort", "slow__held__0"]
    assert (states.integrated, states.updated) == (("slow__effort",), ("slow__held__0",))
    assert states.initial == {"slow__effort": 0.0, "slow__held__0": 0.5}


def test_hooks_are_bound_once_and_not_pickled():
    built = scene(Slow())
    assert built.attached is built.attached
    assert "attached" not in built.__getstate__()
    again = pickle.loads(pickle.dumps(built))
    assert again == built
    assert [a.key for a in again.attached] == [a.key for a in built.attached]


def test_every_function_of_a_hook_has_a_rule():
    for kind, rules in RULES.items():
        given = {n for n, text in kind.__annotations__.items() if "Callable" in text}
        assert given == rules.keys()


@pytest.mark.parametrize(
    ("quantity", "roots"),
    [
        ("phi2", {*ARM.coordinates}),
        ("m4", {"m4"}),
        ("command1", {"command1"}),
        ("s1", {"theta1"}),
    ],
)
def test_what_a_quantity_depends_on(quantity, roots):
    assert {*roots_of(quantity, ARM)} == roots


def test_a_quantity_that_follows_from_forces_has_no_roots():
    with pytest.raises(ValueError, match="Q1"):
        roots_of("qdd1", ARM)
