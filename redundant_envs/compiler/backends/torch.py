"""Numbers as torch tensors of float64, with gradients (needs torch)."""

from collections.abc import Callable
from typing import Any

from redundant_envs.compiler.backends import numpy
from redundant_envs.language.algebra import Primitives, register_numbers
from redundant_envs.support.extras import needs

with needs("train"):
    import torch


def number(x: Any) -> torch.Tensor:
    """A number or tensor as a tensor of float64; conditions stay conditions."""
    if isinstance(x, torch.Tensor):
        if x.is_complex():
            raise ValueError(f"a tensor is of {x.dtype}; give real numbers")
        return x if x.dtype in (torch.bool, torch.float64) else x.to(torch.float64)
    return torch.tensor(x, dtype=torch.bool if isinstance(x, bool) else torch.float64)


def _where(condition: Any, a: Any, b: Any) -> torch.Tensor:
    return torch.where(torch.as_tensor(condition), number(a), number(b))


class _Plain(torch.autograd.Function):
    """See :func:`on_plain_numbers`."""

    @staticmethod
    def forward(function: Callable[..., Any], *values: Any) -> Any:
        return function(*values)

    @staticmethod
    def setup_context(ctx: Any, inputs: Any, output: tuple[torch.Tensor, ...]) -> None:
        ctx.mark_non_differentiable(*output)

    @staticmethod
    def vmap(info: Any, axes: tuple[Any, ...], function: Callable[..., Any], *values: Any) -> Any:
        """All lanes at once: the axis of vmap comes first, and other axes are aligned at the last one."""
        pairs = list(zip(values, axes[1:], strict=True))
        rank = max(x.ndim - (axis is not None) for x, axis in pairs if isinstance(x, torch.Tensor))

        def moved(x: torch.Tensor, axis: int) -> torch.Tensor:
            x = x.movedim(axis, 0)
            return x.reshape(len(x), *[1] * (rank + 1 - x.ndim), *x.shape[1:])

        outputs = _Plain.apply(function, *(x if axis is None else moved(x, axis) for x, axis in pairs))
        return outputs, tuple(x.ndim - rank - 1 for x in outputs)


def on_plain_numbers(function: Callable[..., Any], *values: Any) -> tuple[torch.Tensor, ...]:
    """Results of a function as data, without gradients. It gets tensors with numbers that may be read, within
    torch.func, too, and returns some whose last axes are those that its arguments broadcast to."""
    detached = (x.detach() if isinstance(x, torch.Tensor) else x for x in values)
    outputs: tuple[torch.Tensor, ...] = _Plain.apply(function, *detached)
    return outputs


def _philox(*numbers: Any) -> tuple[torch.Tensor, ...]:
    """Random words, see :func:`algebra.philox`; they have no gradient."""

    def words(*numbers: Any) -> tuple[torch.Tensor, ...]:
        device = next(x.device for x in numbers if isinstance(x, torch.Tensor))
        plain: Any = (x.cpu().numpy() if isinstance(x, torch.Tensor) else x for x in numbers)
        return tuple(torch.as_tensor(word, device=device) for word in numpy.philox(*plain))

    return on_plain_numbers(words, *numbers)


register_numbers(
    Primitives(
        torch.sqrt, torch.exp, torch.log, torch.floor, lambda x: (torch.sin(x), torch.cos(x)), _where,
        torch.logical_not, _philox, torch.expm1,
    ),
    torch.Tensor,
)  # fmt: skip
