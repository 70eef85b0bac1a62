"""A differentiable control interval on torch tensors."""

from __future__ import annotations

import contextlib
import functools
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from redundant_envs.compiler.backends.torch import number, on_plain_numbers, torch
from redundant_envs.scenes.numbers import names_of
from redundant_envs.scenes.scene import Scene, check_scene
from redundant_envs.simulator.lane.common_step import lane_step
from redundant_envs.simulator.lane.direct import fields_of, steps_taken
from redundant_envs.simulator.lane.dynamics import Dynamics
from redundant_envs.simulator.lane.faults import Control
from redundant_envs.simulator.lane.interval import Interval
from redundant_envs.simulator.lane.memory import Lane
from redundant_envs.support.values import shown

Step = Callable[..., tuple[Any, ...]]


def torch_step(scene: Scene) -> Step:
    """A differentiable control interval of a scene.

    The steps are those of the compiled simulator, run on tensors of float64: motions differ by rounding,
    which some amplify. With a tolerance the steps of each lane, and where laws switch, are found first, on
    plain numbers, and then taken as given.

    Parameters
    ----------
    scene : Scene
        Without hard stops and not with ``dop853``: an impact, and a choice of step lengths, have no
        meaningful derivative; nor with dry friction. Use ``LimitSpring``, a tolerance and
        ``SmoothCoulombFriction`` instead.

    Returns
    -------
    callable
        ``step(q, qd, efforts, parameters=None) -> (q, qd)``: tensors (..., joints) of any batch shape,
        N m and N; ``parameters`` maps names such as "masses", "lengths" or "gravity.g" to tensors
        (..., entries), or (...) of a single number. If effects of the scene have states,
        ``step(q, qd, efforts, parameters=None, z=...) -> (q, qd, z)`` takes and returns these, too,
        (..., states) in the order of ``Scene.states()``. If some of them draw random numbers,
        ``step(q, qd, efforts, parameters=None, z=..., draws=...) -> (q, qd, z, draws)`` takes and returns
        what these follow from, too, (..., 5), as ``BatchSimulator.draws`` has it.

    Raises
    ------
    ValueError
        If the scene has stops or dry friction, or chooses its steps while it runs.
    """
    check_scene(scene)
    dynamics = Dynamics(scene)
    interval = Interval(dynamics)
    features = interval.features
    impacts = "impacts have no meaningful derivative; use a LimitSpring for its joints"
    sticking = "joints stick and slip without a meaningful derivative; use SmoothCoulombFriction"
    for boundaries, said in ((features.stops, impacts), (features.sticking, sticking)):
        for boundary in boundaries:
            raise ValueError(f"scene has the effect {boundary.owner}, whose {said}")
    if features.control is Control.ADAPTIVE:
        raise ValueError("scene.integrator is 'dop853', which chooses each step while it runs; use 'rk8'")
    count, layout = dynamics.count, interval.layout()
    of_effects, of_draws = tuple(dynamics.effect_states), dynamics.draw_fields

    def step(
        q: Any, qd: Any, efforts: Any, parameters: Mapping[str, Any] | None = None, z: Any = None,
        draws: Any = None,
    ) -> tuple[Any, ...]:  # fmt: skip
        inputs = {name: _checked(name, x, count) for name, x in (("q", q), ("qd", qd), ("efforts", efforts))}
        tensors = [*inputs.values()]
        effect_values: dict[str, Any] = {}  # states of effects, and what their draws follow from
        for name, value, columns in (("z", z, of_effects), ("draws", draws, of_draws)):
            if (value is not None) != bool(columns):
                raise ValueError(
                    f"{name} is {shown(value)}, and effects of the scene have {len(columns)} of its numbers; "
                    f"give at the start torch.tensor(BatchSimulator(scene, num_envs).{name}), and then what "
                    f"the step returns, or leave {name} out if there are none"
                )
            if columns:
                inputs[name] = _checked(name, value, len(columns))
                effect_values |= zip(columns, inputs[name].unbind(-1), strict=True)
        named = _named(scene, parameters)
        _check_batch({**inputs, **named})
        states = [*tensors[0].unbind(-1), *tensors[1].unbind(-1)]
        states += [effect_values[n] for n in dynamics.states[2 * count :]]
        replaced: dict[str, Any] = {}
        for name, tensor in named.items():
            names = map(dynamics.parameters.field_of, names_of(scene, name))
            replaced |= zip(names, tensor.unbind(-1), strict=True)
        fields = fields_of(dynamics, replaced)
        fields |= zip(dynamics.commands, tensors[2].unbind(-1), strict=True)
        fields |= {n: effect_values[n] for n in (*dynamics.effect_states.updated, *of_draws)}

        def lane_now() -> Lane:
            return Lane(layout, {**fields, **dict(zip(dynamics.states, states, strict=True))}.__getitem__)

        def run(procedure: Callable[[Lane], None]) -> None:
            nonlocal states
            procedure(lane := lane_now())
            states = list(lane.get(dynamics.states))
            fields.update(lane.written())

        pieces = _steps(interval, {**fields, **dict(zip(dynamics.states, states, strict=True))})
        fields |= dict.fromkeys(features.sides, tensors[0].new_zeros(()))
        run(interval.step.clear)
        for piece in pieces:
            for begin in interval.pieces.begins:
                run(begin)
            length = lane_now().h
            for share, *sides in piece.unbind(1):
                h = share * length
                taken = h > 0.0
                for name, side in zip(features.sides, sides, strict=True):
                    fields[name] = torch.where(taken, side, fields[name])
                new_step = lane_step(features, lane_now(), h)
                states = [torch.where(taken, x, y) for x, y in zip(new_step.state, states, strict=True)]
        lane = lane_now()
        interval.update_effect_states(lane)
        parts = dynamics.states[:count], dynamics.states[count : 2 * count], of_effects, of_draws
        wide = iter(torch.broadcast_tensors(*(number(lane[n]) for part in parts for n in part)))
        return tuple(torch.stack([next(wide) for _ in part], -1) for part in parts if part)

    plain = torch._disable_dynamo(step)

    @functools.wraps(step)
    def uncompiled(*args: Any, **more: Any) -> tuple[Any, ...]:
        """The same within torch.compile, whose module takes seconds to import: only if somebody has. Numbers
        are made on the processor, whatever the device of new tensors is: there they go with all devices."""
        with contextlib.nullcontext() if torch.get_default_device().type == "cpu" else torch.device("cpu"):
            return (plain if "torch._dynamo" in sys.modules else step)(*args, **more)  # type: ignore[no-any-return]

    return uncompiled


def _steps(interval: Interval, fields: Mapping[str, Any]) -> Sequence[torch.Tensor]:
    """The steps of each piece, (1 + laws, steps, ...), as :func:`steps_taken` has them; fixed ones are 1."""
    device = next(x.device for x in fields.values() if isinstance(x, torch.Tensor))
    if interval.dynamics.scene.tolerance is None:
        steps = torch.ones(1, interval.dynamics.scene.substeps, dtype=torch.float64, device=device)
        return [steps] * interval.pieces.count
    if device.type == "meta":
        raise ValueError(
            "q is on the device meta, which has no numbers, and steps with a tolerance follow from them; "
            "leave out scene.tolerance"
        )

    def located(*values: Any) -> tuple[torch.Tensor, ...]:
        shape = torch.broadcast_shapes(*(x.shape for x in values if isinstance(x, torch.Tensor)))
        lanes = (
            x.resolve_neg().expand(shape).reshape(-1).cpu().numpy() if isinstance(x, torch.Tensor) else x
            for x in values
        )
        pieces = steps_taken(interval, dict(zip(fields, lanes, strict=True)))
        return tuple(torch.tensor(x, device=device).reshape(*x.shape[:2], *shape) for x in pieces)

    return on_plain_numbers(located, *fields.values())


def _checked(name: str, value: Any, width: int) -> torch.Tensor:
    tensor = _real(name, value)
    if tensor.ndim == 0 or tensor.shape[-1] != width:
        raise ValueError(f"{name} has shape {tuple(tensor.shape)}; the last axis must have {width} numbers")
    return tensor


def _real(name: str, value: Any) -> torch.Tensor:
    try:
        tensor = number(value)
    except (TypeError, ValueError, RuntimeError):
        tensor = None
    if tensor is None or tensor.dtype is torch.bool or tensor.layout is not torch.strided:
        raise ValueError(f"{name} is {shown(value)}; give a tensor of real numbers")
    return tensor


def _check_batch(tensors: Mapping[str, torch.Tensor]) -> None:
    """ValueError unless what comes before the last axis of each tensor broadcasts to one batch."""
    shapes = {name: tuple(tensor.shape[:-1]) for name, tensor in tensors.items()}
    try:
        torch.broadcast_shapes(*shapes.values())
    except RuntimeError:
        text = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
        raise ValueError(f"the shapes of batches, {text}, do not broadcast to one; give equal ones") from None


def _named(scene: Scene, parameters: Mapping[str, Any] | None) -> dict[str, torch.Tensor]:
    """Parameters by their names, (..., entries)."""
    if parameters is not None and not isinstance(parameters, Mapping):
        raise ValueError(f"parameters is {shown(parameters)}; give a mapping of names, such as masses")
    tensors: dict[str, torch.Tensor] = {}
    for name, value in (parameters or {}).items():
        names, tensor = names_of(scene, name), _real(name, value)
        if len(names) == 1 and (tensor.ndim == 0 or tensor.shape[-1] != 1):
            tensor = tensor.unsqueeze(-1)
        tensors[name] = _checked(name, tensor, len(names))
    return tensors
