"""A policy as plain layers in double precision, in which all libraries agree far below 1e-6: in single, sums
depend on their order, and actions for one observation differ by some 1e-6 from those in a batch."""

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from redundant_envs.support.bounded import read_arrays
from redundant_envs.support.extras import needs

from ..learners.networks import ACTIVATIONS

with needs("train"):
    import torch
    from sb3_contrib.common.torch_layers import BatchRenorm1d
    from stable_baselines3.common.policies import ActorCriticPolicy
    from torch import Tensor, nn

HIDDEN = {activation.module: name for name, activation in ACTIVATIONS.items()}


@dataclass(frozen=True, eq=False)
class Layers:
    """A deterministic policy: hidden layers, and a last one that is squashed into [-1, 1]. ``inputs`` has the
    width of each part of an observation in their order; the one part of an array is "observation"."""

    inputs: dict[str, int]
    weights: tuple[NDArray[np.float64], ...]  # (outputs, inputs)
    biases: tuple[NDArray[np.float64], ...]  # (outputs,)
    activation: str  # after all layers but the last: silu, tanh or relu
    output: str  # after the last layer: tanh or clip

    def __call__(self, observations: Any) -> NDArray[np.float64]:
        """Actions (n, actions) of observations (n, ...)."""
        x = joined(self.inputs, observations)
        for k, (weights, biases) in enumerate(zip(self.weights, self.biases, strict=True)):
            x = x @ weights.T + biases
            if k < len(self.weights) - 1:
                x = activated(self.activation, x)
        return np.tanh(x) if self.output == "tanh" else np.clip(x, -1.0, 1.0)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read what :meth:`save` wrote; without the widths of the parts of an observation."""
        arrays = read_arrays(path, "policy")
        layers = range(sum(name.startswith("weights_") for name in arrays))
        weights, biases = (tuple(arrays[f"{kind}_{k}"] for k in layers) for kind in ("weights", "biases"))
        inputs = dict.fromkeys(arrays["inputs"].tolist(), 0)
        return cls(inputs, weights, biases, str(arrays["activation"]), str(arrays["output"]))

    def save(self, path: Path) -> None:
        """Write arrays that ``np.load`` reads: weights_0, biases_0, ..., activation, output, inputs."""
        arrays: dict[str, Any] = {}
        for k, (weights, biases) in enumerate(zip(self.weights, self.biases, strict=True)):
            arrays |= {f"weights_{k}": weights, f"biases_{k}": biases}
        np.savez(path, activation=self.activation, output=self.output, inputs=list(self.inputs), **arrays)


def joined(inputs: Mapping[str, int], observations: Any) -> NDArray[np.float64]:
    """Observations as one array, (n, inputs): rounded to single precision, as the learners see them."""
    parts = [observations[name] for name in inputs] if isinstance(observations, Mapping) else [observations]
    return np.concatenate(parts, axis=1, dtype=np.float32, casting="unsafe").astype(np.float64)


def activated(name: str, x: NDArray[np.float64]) -> NDArray[np.float64]:
    if name == "silu":
        return x * (0.5 + 0.5 * np.tanh(0.5 * x))  # avoids an exponential that overflows
    return np.tanh(x) if name == "tanh" else np.maximum(x, 0.0)


def modules_of(policy: Any) -> nn.Sequential:
    """The modules with which a policy of stable-baselines3 or sb3-contrib computes its mean actions."""
    if isinstance(policy, ActorCriticPolicy):
        return nn.Sequential(*policy.mlp_extractor.policy_net, policy.action_net)
    if isinstance(policy.actor.mu, nn.Sequential):  # TD3's, with its last tanh
        return policy.actor.mu
    return nn.Sequential(*policy.actor.latent_pi, policy.actor.mu, nn.Tanh())


def layers_of(policy: Any, space: spaces.Space[Any]) -> Layers:
    """The layers of a policy; normalisations are multiplied into the layers after them."""
    weights, biases, activations = [], [], []
    scale: Any = 1.0
    shift: Any = 0.0
    for module in modules_of(policy):
        if isinstance(module, nn.Linear):
            matrix = _double(module.weight)
            weights.append(matrix * scale)
            biases.append(_double(module.bias) + matrix @ np.broadcast_to(shift, matrix.shape[1]))
            scale, shift = 1.0, 0.0
        elif isinstance(module, BatchRenorm1d):
            by = _double(module.scale) / np.sqrt(_double(module.ra_var) + module.eps)
            scale, shift = scale * by, (shift - _double(module.ra_mean)) * by + _double(module.bias)
        elif type(module) in HIDDEN:
            activations.append(HIDDEN[type(module)])
        else:
            raise ValueError(f"the policy has a layer {type(module).__name__}; layers of MLPs are exported")
    output = activations.pop() if len(activations) == len(weights) else "clip"
    if output not in ("tanh", "clip") or len(set(activations)) > 1:
        raise ValueError(f"the policy has the activations {', '.join(activations)}, {output}")
    parts = space.spaces if isinstance(space, spaces.Dict) else {"observation": space}
    inputs = {name: spaces.flatdim(part) for name, part in parts.items()}
    return Layers(inputs, tuple(weights), tuple(biases), activations[0] if activations else "relu", output)


def _double(tensor: Any) -> NDArray[np.float64]:
    return tensor.detach().numpy().astype(np.float64)


class Exact(nn.Module):
    """A policy's own modules in double precision: from the parts of observations to deterministic actions."""

    def __init__(self, policy: Any, dtype: torch.dtype = torch.float64) -> None:
        super().__init__()
        self.layers, self.dtype = copy.deepcopy(modules_of(policy)).double().eval(), dtype

    def forward(self, *parts: Tensor) -> Tensor:
        return self.layers(torch.cat(parts, 1).double()).clamp(-1.0, 1.0).to(self.dtype)


@torch.no_grad()
def exact_actions(policy: Any, inputs: Mapping[str, int], observations: Any) -> NDArray[np.float64]:
    """Actions of a policy's own modules in double precision, (n, actions)."""
    return Exact(policy)(torch.from_numpy(joined(inputs, observations))).numpy()
