"""A function of a user as the force on a joint."""

import redundant_envs as rde
from redundant_envs.effects.hooks import Effect, Force

ARM = rde.FourR((2.3, 0.7, 1.9, 0.4), (1.1, 0.6, 0.9, 0.35))


def with_force(function, bind=None, **parts):
    """A scene whose one effect has a force on joint 2."""
    hooks = (Force(1, function, bind or {"x": "phi2"}, **parts),)
    return rde.Scene(ARM, (type("Odd", (Effect,), {"hooks": lambda self, arm: hooks})(),))
