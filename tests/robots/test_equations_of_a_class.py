"""The equations of an arm belong to its class, so none can hold the masses and lengths of one arm."""

import functools

import pytest

import redundant_envs as rde
from redundant_envs.algebra import physics


@physics(gives="x1 y1")
def points(l1, s1, c1):
    return l1 * c1, l1 * s1


def arm(**body):
    return type("Swing", (rde.Arm,), {"joint_types": "R", "functions": (points,), **body})


@pytest.mark.parametrize("name", ["functions", "prepared", "column_norms", "coordinates_of_joints", "sincos"])
@pytest.mark.parametrize("kind", [property, functools.cached_property])
def test_a_property_is_refused_with_the_class(name, kind):
    with pytest.raises(ValueError, match=rf"Swing\.{name} is a .*property; .* m1, l1 .* as arguments"):
        arm(**{name: kind(lambda self: (points,))})


def test_a_property_of_a_derived_class_is_refused():
    with pytest.raises(ValueError, match=r"Longer\.column_norms is a property"):
        type("Longer", (arm(),), {"column_norms": property(lambda self: points)})


@pytest.mark.parametrize("name", ["functions", "column_norms", "mobility_bounds", "sincos"])
def test_an_equation_of_one_arm_is_refused_with_the_scene(name):
    def made(self):
        rde.Arm.__post_init__(self)
        mass = self.masses[0]
        own = physics(gives="T")(lambda w1: 0.5 * mass * w1 * w1)
        object.__setattr__(self, name, (own, *type(self).functions))

    with pytest.raises(ValueError, match=rf"robot\.{name} is that of one Swing; .* m1, l1 .* as arguments"):
        rde.Scene(arm(__post_init__=made)((1.0,), (1.0,)))
    rde.Scene(arm()((1.0,), (1.0,)))
