"""A differentiable control interval on torch tensors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from redundant_envs.backends.torch import number, torch
from redundant_envs.lane import jumps
from redundant_envs.lane.common_step import lane_step
from redundant_envs.lane.direct import cross_interval, fields_of
from redundant_envs.lane.dynamics import Dynamics
from redundant_envs.lane.features import Control
from redundant_envs.lane.interval import Interval
from redundant_envs.lane.memory import Lane
from redundant_envs.model.parameters import names_of
from redundant_envs.scene import Scene, check_scene

Step = Callable[..., tuple[Any, ...]]


def torch_step(scene: Scene) -> Step:
    """A differentiable control interval of a scene.

    The steps are those of the compiled simulator, run on tensors of float64; motions agree to rounding.
    With a tolerance the number of steps of each lane is found first, without gradients, and then taken as
    given.

    Parameters
    ----------
    scene : Scene
        Without hard stops and not with ``dop853``: an impact, and a choice of step lengths, have no
        meaningful derivative. Use ``LimitSpring`` and a tolerance instead.

    Returns
    -------
    callable
        ``step(q, qd, efforts, parameters=None) -> (q, qd)``: tensors (..., joints) of any batch shape,
        N m and N; ``parameters`` maps names such as "masses", "lengths" or "gravity.g" to tensors
        (..., entries), or (...) of a single number. If effects of the scene have states,
        ``step(q, qd, efforts, parameters=None, z=...) -> (q, qd, z)`` takes and returns these, too,
        (..., states) in the order of ``Scene.states()``.

    Raises
    ------
    ValueError
        If the scene has stops or chooses its steps while it runs.
    """
    check_scene(scene)
    dynamics = Dynamics(scene, located=False)  # equal steps have gradients, and a step may have two laws
    interval = Interval(dynamics)
    if dynamics.stops:
        raise ValueError(
            "scene has a PrismaticStop, whose impacts have no meaningful derivative; use a "
            "LimitSpring for its joints"
        )
    if dynamics.control is Control.ADAPTIVE:
        raise ValueError(
            "scene.integrator is 'dop853', which chooses each step while it runs; use 'rk8', with a "
            "tolerance if errors are to be controlled"
        )
    count, layout, of_effects = dynamics.count, interval.layout(), tuple(dynamics.effect_states)

    def step(
        q: Any, qd: Any, efforts: Any, parameters: Mapping[str, Any] | None = None, z: Any = None
    ) -> tuple[Any, ...]:
        tensors = [_checked(name, x, count) for name, x in (("q", q), ("qd", qd), ("efforts", efforts))]
        effects: dict[str, Any] = {}
        if of_effects:
            effects = dict(zip(of_effects, _checked("z", z, len(of_effects)).unbind(-1), strict=True))
        elif z is not None:
            raise ValueError("z is given, and no effect of the scene has a state; leave it out")
        states = [*tensors[0].unbind(-1), *tensors[1].unbind(-1)]
        states += [effects[n] for n in dynamics.effect_states.integrated]
        fields = {
            **fields_of(dynamics, _named(dynamics, parameters or {})),
            **dict(zip(dynamics.commands, tensors[2].unbind(-1), strict=True)),
            **{n: effects[n] for n in dynamics.effect_states.updated},
        }
        start = Lane(layout, {**fields, **dict(zip(dynamics.states, states, strict=True))}.__getitem__)
        jumps.strike(dynamics, start)
        steps = number(float(scene.substeps))
        if scene.tolerance is not None:
            with torch.no_grad():
                now = dict(zip(dynamics.states, states, strict=True))
                crossed = cross_interval(interval, {**fields, **now})
                steps = number(crossed["divisions"]).clamp(min=1.0)
        states = start.get(dynamics.states)
        h = fields["interval"] / steps
        for k in range(int(steps.max())):
            now = dict(zip(dynamics.states, states, strict=True))
            made = lane_step(dynamics, Lane(layout, {**fields, **now}.__getitem__), h)
            new = (*made.positions, *made.velocities, *made.others)
            states = [torch.where(k < steps, x, y) for x, y in zip(new, states, strict=True)]
        lane = Lane(layout, {**fields, **dict(zip(dynamics.states, states, strict=True))}.__getitem__)
        interval.update_effect_states(lane)
        states = [number(lane[n]) for n in (*dynamics.states[: 2 * count], *of_effects)]
        wide = torch.broadcast_tensors(*states)
        moved = torch.stack(wide[:count], -1), torch.stack(wide[count : 2 * count], -1)
        return (*moved, torch.stack(wide[-len(of_effects) :], -1)) if of_effects else moved

    return step


def _checked(name: str, value: Any, width: int) -> torch.Tensor:
    if value is None:
        raise ValueError(f"{name} is missing; give a tensor whose last axis has {width} numbers")
    tensor = number(value)
    if tensor.dtype is torch.bool or tensor.ndim == 0 or tensor.shape[-1] != width:
        raise ValueError(f"{name} has shape {tuple(tensor.shape)}; the last axis must have {width} numbers")
    return tensor


def _named(dynamics: Dynamics, parameters: Mapping[str, Any]) -> dict[str, torch.Tensor]:
    """Parameters by the names of their fields."""
    values: dict[str, torch.Tensor] = {}
    for name, given in parameters.items():
        names, tensor = names_of(dynamics.scene, name), number(given)
        if len(names) == 1 and (tensor.ndim == 0 or tensor.shape[-1] != 1):
            tensor = tensor.unsqueeze(-1)
        entries = _checked(name, tensor, len(names)).unbind(-1)
        values.update({dynamics.field_of(n): x for n, x in zip(names, entries, strict=True)})
    return values
