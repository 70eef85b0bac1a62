"""Redefined functions and classes: copies continue as before, new simulators have the new equations."""

import copy
import pickle
import sys
import types

import numpy as np
import pytest

import redundant_envs as rde

MODULE = "effect_defined_again"
TEXT = """
from dataclasses import dataclass
import redundant_envs as rde
from redundant_envs.algebra import physics

@physics
def drag(phid1, k):
    return -{gain} * k * phid1

@physics
def unchanged():
    return 0.0

@dataclass(frozen=True)
class Drag(rde.effects.Effect):
    k: float = 1.0

    def hooks(self, arm):
        states = tuple(rde.effects.State(f"z[{{i}}]", "", derivative=unchanged) for i in range({states}))
        return (rde.effects.Force(0, drag, {{"k": ".k"}}, states=states),)
"""
ARM = rde.FourR((1.0,) * 4, (0.5,) * 4)


def define(gain, states=0):
    """Load the module again, like ``importlib.reload``."""
    module = sys.modules.setdefault(MODULE, types.ModuleType(MODULE))
    exec(TEXT.format(gain=gain, states=states), vars(module))
    return module.Drag


@pytest.fixture(autouse=True)
def forgotten():
    yield
    sys.modules.pop(MODULE, None)


def simulator(effect):
    batch = rde.BatchSimulator(rde.Scene(ARM, (effect(),), integrator="rk4"), 2)
    batch.set_state(np.zeros(4), np.ones(4))
    return batch


def test_a_copy_goes_on_as_it_was_when_its_effect_is_defined_again():
    batch = simulator(define(1.0))
    define(20.0)
    other = copy.deepcopy(batch)
    batch.advance()
    other.advance()
    np.testing.assert_array_equal(batch.qd, other.qd)
    other.restore(batch.save())
    new = simulator(sys.modules[MODULE].Drag)
    new.advance()
    assert (new.qd != batch.qd).any()
    with pytest.raises(ValueError, match="another scene"):
        new.restore(batch.save())


@pytest.mark.parametrize(("gain", "states"), [(20.0, 0), (1.0, 4)])
def test_a_pickle_of_other_equations_is_refused(gain, states):
    batch = simulator(define(1.0))
    data = pickle.dumps(batch)
    define(gain, states)
    with pytest.raises(ValueError, match=r"other equations: .* are not what they were"):
        pickle.loads(data)
    define(1.0)
    again = pickle.loads(data)
    batch.advance()
    again.advance()
    np.testing.assert_array_equal(batch.qd, again.qd)


def test_plain_data_of_a_class_that_another_one_has_the_name_of_is_refused():
    effect = type("Gravity", (rde.effects.Effect,), {"hooks": lambda self, arm: ()})()
    heavy = type("Heavy", (rde.FourR,), {})((1.0,) * 4, (1.0,) * 4)
    for scene, said in (
        (rde.Scene(ARM, (effect,)), r"effects\[0\] is a .*Gravity, and 'Gravity' in plain data is redundant"),
        (rde.Scene(heavy), r"robot is a .*Heavy, and 'FourR' in plain data is redundant"),
    ):
        with pytest.raises(ValueError, match=said):
            scene.to_dict()
