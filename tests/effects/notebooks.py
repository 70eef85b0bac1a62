"""Notebooks of users: cells, and functions that become effects."""

import linecache
from dataclasses import dataclass

import numpy as np
from catalogue import advanced

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.effects.hooks import Effect, Force

ARM = rde.FourR((2.3, 0.7, 1.9, 0.4), (1.1, 0.6, 0.9, 0.35))
Q0 = np.array([-1.2, 0.4, -0.4, 0.9])
QD0 = np.array([0.5, -0.6, 0.9, 0.8])
KNOWN = {"__name__": "__main__", "physics": physics, "Effect": Effect, "Force": Force, "dataclass": dataclass}


def notebook():
    """The namespace of a notebook, and a function that runs a cell in it; linecache knows its text."""
    names = {**KNOWN}

    def run(number, text):
        name = f"<cell {number}>"
        linecache.cache[name] = (len(text), None, text.splitlines(keepends=True), name)
        exec(compile(text, name, "exec"), names)

    return names, run


def with_force(function, **bind):
    """A scene whose one effect has a force on joint 2."""
    hooks = (Force(1, function, bind or {"x": "phi2"}),)
    return rde.Scene(ARM, (type("Odd", (Effect,), {"hooks": lambda self, arm: hooks})(),))


def end_of(*effects):
    """Final state of a motion with some effects."""
    batch, _ = advanced(rde.Scene(ARM, effects), Q0, QD0, intervals=5)
    return np.concatenate([batch.q, batch.qd])


def acts_as(function, force_on_joint_2, **bind):
    """Whether a function, as the force on joint 2, begins a motion with the acceleration of a force."""
    effects = with_force(function, **bind).effects
    begun, _ = advanced(rde.Scene(ARM, effects, "euler", control_dt=1e-3), Q0, QD0)
    qdd = ARM.forward_dynamics(Q0, QD0, ARM.motor_map @ (0.0, force_on_joint_2, 0.0, 0.0), 0.0)
    return np.abs((begun.qd[0] - QD0) / 1e-3 - qdd).max() <= 1e-11 * np.abs(qdd).max()
