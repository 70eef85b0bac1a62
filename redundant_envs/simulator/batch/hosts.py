"""Kernels for hosts that have no NumPy, beside that of an environment: what follows from parameters, and the
arm as drawings and controllers need it."""

from collections.abc import Mapping
from typing import Any

from redundant_envs.compiler.tracing.flow import Kernel, LaneFunction
from redundant_envs.language.algebra import entries, numbered
from redundant_envs.robots.arm import Arm
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.simulator.lane.features import Features
from redundant_envs.simulator.lane.fields import LOG, PARAMETER, SCRATCH, STATE, Layout
from redundant_envs.simulator.lane.memory import Lane, traced

BLOCK = {str(lifetime): "f64" for lifetime in (STATE, PARAMETER, SCRATCH, LOG)}
"""Arguments: the addresses of the memories of a block."""


def prepare_kernel(dynamics: Dynamics, layout: Layout, lanes: int) -> Kernel:
    """A kernel that sets the fields of a block that follow from its parameters alone, to the bits of
    :meth:`~redundant_envs.model.memory.Memory.prepare`."""

    def prepare(lane: Lane) -> None:
        prepared = dynamics.parameters.prepare({name: lane[name] for name in dynamics.parameters.values})
        lane.set(prepared, prepared.values())

    return _of_a_block(traced("prepare", layout, prepare, joins=False), lanes)


def arm_quantities(arm: Arm) -> tuple[str, ...]:
    """What the kernel :func:`arm_kernel` tells: positions of point masses and tip, J, M, h, G."""
    n = len(arm.coordinates)
    points = (f"{axis}{k + 1}" for k in range(arm.num_masses) for axis in "xy")
    of_tip, forces = ("tip_x", "tip_y", *entries("J", 2, n)), (*numbered("h{}", n), *numbered("G{}", n))
    return (*points, *of_tip, *entries("M", n, n), *forces)


def arm_kernel(features: Features, layout: Layout, lanes: int) -> Kernel:
    """A kernel that fills ``out`` (lanes, quantities) with :func:`arm_quantities` in the present state, with
    the inertias and the fields of effects."""
    names = arm_quantities(features.arm)

    def tell(lane: Lane) -> Mapping[Any, Any]:
        x = features.quantities(lane)
        features.dynamics.set_field(x)
        return {("out", "f64", k, len(names)): x[name] for k, name in enumerate(names)}

    return _of_a_block(traced("arm", layout, tell), lanes, out="f64")


def _of_a_block(function: LaneFunction, lanes: int, **more: str) -> Kernel:
    """A kernel that calls a function on one block."""
    p = Kernel(function.name, {**BLOCK, **more}, lanes)
    p.call(function, **{name: p[name] for name in p.arguments})
    return p
