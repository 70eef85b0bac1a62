"""Notebooks and files of users: cells, modules, and functions that become effects."""

import importlib.util
import linecache
import textwrap
from dataclasses import dataclass

import numpy as np

import redundant_envs as rde
from redundant_envs.algebra import physics
from redundant_envs.effects.hooks import Effect, Force

ARM = rde.FourR((2.3, 0.7, 1.9, 0.4), (1.1, 0.6, 0.9, 0.35))
Q0 = np.array([-1.2, 0.4, -0.4, 0.9])
QD0 = np.array([0.5, -0.6, 0.9, 0.8])
KNOWN = {"__name__": "__main__", "physics": physics, "Effect": Effect, "Force": Force, "dataclass": dataclass}

HELPER = "@physics\ndef {helper}(x, k):\n    return {factor} * k * x\n"
SPRING = """
@physics
def {force}(position, k):
    return -{helper}(position, k)

@physics
def {energy}(position, k):
    return 0.5 * {helper}(position, k) * position

@dataclass(frozen=True)
class {kind}(Effect):
    k: float = 1.5

    def hooks(self, arm):
        bind = {{"position": "phi{joint}", "k": ".k"}}
        return (Force({joint} - 1, {force}, bind, potential={energy}),)
"""


def run_cell(name, text, names):
    """Run a cell in a namespace; its text is known to linecache."""
    text = textwrap.dedent(text)
    linecache.cache[name] = (len(text), None, text.splitlines(keepends=True), name)
    exec(compile(text, name, "exec"), names)
    return names


def cell(number, kind, joint, factor, apart=""):
    """A spring of a user: functions of equal names in every cell, or with a difference between them."""
    names = {n: f"{n}{apart}" for n in ("helper", "force", "energy")}
    text = (HELPER + SPRING).format(kind=kind, joint=joint, factor=factor, **names)
    return run_cell(f"<cell {number}>", text, {**KNOWN})[kind]()


def notebook():
    """Cells of a notebook, which share a namespace; returns it and a function that runs a cell."""
    names = {**KNOWN}
    return names, lambda number, text: run_cell(f"<redefined {number}>", text, names)


def user_module(folder, name, text):
    """A file of a user, imported."""
    path = folder / f"{name}.py"
    path.write_text(textwrap.dedent(text))
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return vars(module)


def with_force(function, **bind):
    """A scene whose one effect has a force on joint 2."""
    hooks = (Force(1, function, bind or {"x": "phi2"}),)
    return rde.Scene(ARM, (type("Odd", (Effect,), {"hooks": lambda self, arm: hooks})(),))


def advanced(scene, count):
    batch = rde.BatchSimulator(scene, 1)
    batch.set_state(Q0, QD0)
    for _ in range(count):
        batch.advance()
    return batch


def end_of(*effects):
    """Final state of a motion with some effects."""
    batch = advanced(rde.Scene(ARM, effects), 5)
    return np.concatenate([batch.q, batch.qd])


def acts_as(function, force_on_joint_2, **bind):
    """Whether a function, as the force on joint 2, begins a motion with the acceleration of a force."""
    effects = with_force(function, **bind).effects
    begun = advanced(rde.Scene(ARM, effects, "euler", control_dt=1e-3), 1)
    qdd = ARM.forward_dynamics(Q0, QD0, ARM.motor_map @ (0.0, force_on_joint_2, 0.0, 0.0), 0.0)
    return np.abs((begun.qd[0] - QD0) / 1e-3 - qdd).max() <= 1e-11 * np.abs(qdd).max()
