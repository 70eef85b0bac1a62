"""Numbers as torch tensors of float64, with gradients (needs torch)."""

from __future__ import annotations

from typing import Any

from redundant_envs.algebra import Primitives, register_numbers
from redundant_envs.backends import numpy
from redundant_envs.extras import needs

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


def _philox(*numbers: Any) -> tuple[torch.Tensor, ...]:
    """Random words, see :func:`algebra.philox`; they have no gradient."""
    device = next(x.device for x in numbers if isinstance(x, torch.Tensor))
    plain: Any = (x.detach().cpu().numpy() if isinstance(x, torch.Tensor) else x for x in numbers)
    return tuple(torch.as_tensor(words, device=device) for words in numpy.philox(*plain))


register_numbers(
    Primitives(
        torch.sqrt, torch.exp, torch.log, torch.floor, lambda x: (torch.sin(x), torch.cos(x)), _where,
        torch.logical_not, _philox, torch.expm1,
    ),
    torch.Tensor,
)  # fmt: skip
