"""Equal multilayer perceptrons in one vector of numbers, with their gradients written out, and averages.

A gradient step of these learners is a hundred small operations, and most of its time the bookkeeping of
modules, optimisers and the graph of derivatives. In one vector a step of Adam, a target or an average is one
operation, and equal networks are evaluated together.
"""

import contextlib
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from redundant_envs.support.extras import needs

with needs("train"):
    import torch
    from gymnasium import spaces
    from torch import Tensor, nn

NARROW = 8  # columns up to which a product is computed transposed: MKL takes a third of the time for it
ERROR_SCALE = 0.05  # distance from the goal that is the input 1 of the networks, in reaches
ONE = torch.ones(())
dtanh = torch.ops.aten.tanh_backward  # of derivatives by values of tanh, and these values


class Activation(NamedTuple):
    """An activation as torch's module, and as functions, which may overwrite first arguments; ``forward``
    gives values, and what ``backward`` needs beside them for derivatives by inputs from those by values."""

    module: type[nn.Module]
    in_place: Callable[[Tensor], Tensor]
    forward: Callable[[Tensor], tuple[Tensor, Tensor]]
    backward: Callable[[Tensor, Tensor, Tensor], Tensor]


def _silu(inputs: Tensor) -> tuple[Tensor, Tensor]:
    # The sigmoid is kept: torch's silu_backward computes it again, which takes longer than all other steps.
    sigmoid = torch.sigmoid(inputs)
    return inputs.mul_(sigmoid), sigmoid


ACTIVATIONS = {
    # the derivative of silu, s + z s (1 - s), is y + (1 - y) s
    "silu": Activation(nn.SiLU, torch.ops.aten.silu_, _silu, lambda d, y, s: d.mul_(torch.lerp(y, ONE, s))),
    "tanh": Activation(nn.Tanh, torch.tanh_, lambda z: (torch.tanh_(z),) * 2, lambda d, y, _: dtanh(d, y)),
    "relu": Activation(nn.ReLU, torch.relu_, lambda z: (torch.relu_(z),) * 2, lambda d, y, _: d.mul_(y > 0)),
}

Layers = Sequence[Sequence[nn.Linear]]
"""A network: its layers in order, each a list of the modules whose outputs are contiguous."""
Tape = list[tuple[Tensor, Tensor]]
"""Data of a forward pass: each layer's inputs, and what the backward function of its activation needs."""


class Networks:
    """K networks of one shape, whose modules change only in :meth:`write`; ``extra`` are numbers beside the
    networks, last in the vector. With ``mixing``, (inputs, inputs), the input of the first layer is ``mixing
    @ inputs of the modules``; ``write`` multiplies it into the modules' first layers."""

    def __init__(
        self, networks: Sequence[Layers], activation: str, mixing: Tensor | None = None,
        extra: nn.Parameter | None = None,
    ) -> None:  # fmt: skip
        self.modules = networks
        self.mixing = mixing
        self._activation = ACTIVATIONS[activation]
        self._beside = extra
        self._sizes = [(sum(m.out_features for m in parts), parts[0].in_features) for parts in networks[0]]
        length = len(networks) * sum(rows * (columns + 1) for rows, columns in self._sizes)
        self.vector = torch.empty(length + (0 if extra is None else len(extra)))
        self.gradient = torch.zeros_like(self.vector)
        self.weights, self.biases, self.extra = self._parts(self.vector)
        self._transposed = [weight.mT for weight in self.weights]
        self._dweights, self._dbiases, self.dextra = self._parts(self.gradient)
        self.read(mixed=False)

    def _parts(self, vector: Tensor) -> tuple[list[Tensor], list[Tensor], Tensor]:
        """Views of a vector: weights (K, outputs, inputs) and biases (K, 1, outputs) by layer, the rest."""
        count, at = len(self.modules), 0
        weights, biases = [], []
        for rows, columns in self._sizes:
            weights.append(vector[at : at + count * rows * columns].view(count, rows, columns))
            at += count * rows * columns
        for rows, _ in self._sizes:
            biases.append(vector[at : at + count * rows].view(count, 1, rows))
            at += count * rows
        return weights, biases, vector[at:]

    @torch.no_grad()
    def read(self, mixed: bool = True) -> None:
        """Copy the modules' numbers: the reverse of :meth:`write`; as they are, unless ``mixed``."""
        for layer, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            for k, network in enumerate(self.modules):
                weight[k] = torch.cat([m.weight for m in network[layer]])
                bias[k, 0] = torch.cat([m.bias for m in network[layer]])
        if self._beside is not None:
            self.extra.copy_(self._beside)
        if mixed and self.mixing is not None:
            first = self.weights[0]
            first.copy_(torch.linalg.solve(self.mixing.T.double(), first.mT.double()).mT)

    @torch.no_grad()
    def write(self, vector: Tensor | None = None) -> None:
        """Write these numbers, or those of another vector of the same layout, into the modules."""
        weights, biases, extra = self._parts(self.vector if vector is None else vector)
        for layer, (weight, bias) in enumerate(zip(weights, biases, strict=True)):
            if layer == 0 and self.mixing is not None:
                weight = weight @ self.mixing
            for k, network in enumerate(self.modules):
                rows = [m.out_features for m in network[layer]]
                parts = zip(network[layer], weight[k].split(rows), bias[k, 0].split(rows), strict=True)
                for module, part, offset in parts:
                    module.weight.copy_(part)
                    module.bias.copy_(offset)
        if self._beside is not None:
            self._beside.copy_(extra)

    def forward(self, inputs: Tensor) -> tuple[Tensor, Tape]:
        """Outputs (K, rows, outputs) for inputs (rows, inputs), and the data that :meth:`backward` needs."""
        x = inputs.expand(len(self.modules), *inputs.shape)
        tape: Tape = []
        for layer in range(len(self.weights) - 1):
            y, saved = self._activation.forward(self._linear(layer, x))
            tape.append((x, saved))
            x = y
        outputs = self._linear(-1, x)
        return outputs, [*tape, (x, outputs)]

    def outputs(self, inputs: Tensor) -> Tensor:
        x = inputs.expand(len(self.modules), *inputs.shape)
        for layer in range(len(self.weights) - 1):
            x = self._activation.in_place(self._linear(layer, x))
        return self._linear(-1, x)

    def _linear(self, layer: int, x: Tensor) -> Tensor:
        weight, bias = self.weights[layer], self.biases[layer]
        if 1 < weight.shape[1] <= NARROW:
            return torch.baddbmm(bias.mT, weight, x.mT).mT
        return torch.baddbmm(bias, x, self._transposed[layer])

    def backward(self, tape: Tape, doutputs: Tensor) -> None:
        """Set ``gradient``."""
        d = doutputs
        for layer in range(len(tape) - 1, -1, -1):
            if layer < len(tape) - 1:
                d = self._before(layer + 1, d, tape)
            torch.bmm(d.mT, tape[layer][0], out=self._dweights[layer])
            torch.sum(d, 1, keepdim=True, out=self._dbiases[layer])

    def to_inputs(self, tape: Tape, doutputs: Tensor, columns: slice) -> Tensor:
        """Derivatives by some columns of the inputs, (rows, columns), summed over all networks."""
        d = doutputs
        for layer in range(len(tape) - 1, 0, -1):
            d = self._before(layer, d, tape)
        return torch.bmm(self._transposed[0][:, columns], d.mT).sum(0).T  # columns are few

    def _before(self, layer: int, d: Tensor, tape: Tape) -> Tensor:
        """Derivatives at the outputs of the layer before, without its activation, from those of a layer's."""
        weight = self.weights[layer]
        d = d * weight if weight.shape[1] == 1 else torch.bmm(d, weight)
        return self._activation.backward(d, tape[layer][0], tape[layer - 1][1])


class Adam:
    """Adam on a vector (Kingma and Ba 2015): torch's fused one, without its checks at every step."""

    FIRST, SECOND = 0.9, 0.999

    def __init__(self, networks: Networks, epsilon: float = 1e-8) -> None:
        self.vector, self.gradient, self.epsilon = networks.vector, networks.gradient, epsilon
        self.first, self.second = torch.zeros_like(self.vector), torch.zeros_like(self.vector)
        self.steps = 0
        self._count = torch.zeros(())  # the steps, for torch

    def step(self, rate: float) -> None:
        self.steps += 1
        torch._fused_adam_(
            [self.vector], [self.gradient], [self.first], [self.second], [], [self._count.fill_(self.steps)],
            lr=rate, beta1=self.FIRST, beta2=self.SECOND, weight_decay=0.0, eps=self.epsilon, amsgrad=False,
            maximize=False,
        )  # fmt: skip

    def state(self) -> dict[str, Any]:
        return {"first": self.first.clone(), "second": self.second.clone(), "steps": self.steps}

    def set_state(self, state: dict[str, Any]) -> None:
        self.first.copy_(state["first"])
        self.second.copy_(state["second"])
        self.steps = state["steps"]


def linear_layers(*modules: nn.Module) -> list[tuple[nn.Linear]]:
    """The linear modules inside, in order, as layers."""
    return [(m,) for module in modules for m in module.modules() if isinstance(m, nn.Linear)]


def goal_mixing(space: spaces.Space[Any], error_scale: float = ERROR_SCALE) -> Tensor | None:
    """The matrix that maps observations to inputs of the first layers of a goal environment's networks.

    The achieved goal becomes the error in units of ``error_scale`` reaches: otherwise a network first has to
    learn the small difference of two large numbers. It is multiplied into the first layers that are saved.
    """
    if not isinstance(space, spaces.Dict):
        return None
    goal: Any = space["desired_goal"]
    width, reach = goal.shape[0], float(goal.high.max()) / 2.0
    # in the order of the space: achieved_goal, desired_goal, observation
    rest = spaces.flatdim(space) - 2 * width
    scaled = torch.eye(width) / (error_scale * reach)
    mixing = torch.block_diag(-scaled, torch.eye(width) / reach, torch.eye(rest))
    mixing[:width, width : 2 * width] = scaled
    return mixing


class Averaging:
    """Mixin for an algorithm of stable-baselines3 whose networks, unless it is plain, are trained as vectors:
    modules that act hold the present weights, and inside :meth:`averaged` all do, or their averages."""

    networks: dict[str, Networks] = {}  # all trained vectors, and targets
    adams: dict[str, Adam] = {}
    means: dict[str, Tensor] = {}  # averages of the vectors of some networks

    def inputs(self, observations: Any) -> Tensor:
        """Inputs of the networks from observations, (rows, inputs)."""
        mixing = self.networks["actor"].mixing
        if mixing is None:
            return observations
        # In the order of stable-baselines3's CombinedExtractor; goals in double precision, because the tip
        # and its goal are close together. The rest stays as it is.
        goals = torch.cat([observations["achieved_goal"], observations["desired_goal"]], 1).double()
        width = goals.shape[1]
        mixed = goals @ mixing[:width, :width].T.double()
        return torch.cat([mixed.float(), observations["observation"]], 1)

    def keep_means(self, *names: str) -> None:
        """Begin averages of these networks at their present weights."""
        self.means = {name: self.networks[name].vector.clone() for name in names}

    def take_means(self, decay: float, weight: float) -> None:
        """Move the averages towards the present weights by 1 - kept, or by ``weight`` if that is larger."""
        for name, mean in self.means.items():
            mean.lerp_(self.networks[name].vector, max(1.0 - decay, weight))

    def write_networks(self) -> None:
        """Copy the present weights into the modules."""
        for networks in self.networks.values():
            networks.write()

    def read_networks(self) -> None:
        """Continue from the modules' weights, those of a loaded policy; averages begin there."""
        for networks in self.networks.values():
            networks.read()
        for name, mean in self.means.items():
            mean.copy_(self.networks[name].vector)
        self.write_networks()

    @contextlib.contextmanager
    def averaged(self) -> Iterator[None]:
        """Within this context all modules hold the present weights, or their averages."""
        self.write_networks()
        for name, mean in self.means.items():
            self.networks[name].write(mean)
        try:
            yield
        finally:
            for name in self.means:
                self.networks[name].write()

    def learner_state(self) -> dict[str, Any]:
        """Everything beside the modules that an update changes; plain data and tensors."""
        return {
            "networks": {name: n.vector.clone() for name, n in self.networks.items()},
            "adams": {name: adam.state() for name, adam in self.adams.items()},
            "means": {name: mean.clone() for name, mean in self.means.items()},
        }

    def set_learner_state(self, state: dict[str, Any]) -> None:
        """Return to a state of :meth:`learner_state`."""
        for name, vector in state["networks"].items():
            self.networks[name].vector.copy_(vector)
        for name, adam in state["adams"].items():
            self.adams[name].set_state(adam)
        for name, mean in state["means"].items():
            self.means[name].copy_(mean)
        self.write_networks()

    def _excluded_save_params(self) -> list[str]:
        """Attributes excluded from policy.zip, which plain stable-baselines3 loads."""
        return [*super()._excluded_save_params(), "networks", "adams", "means"]  # type: ignore[misc]

    def _update_info_buffer(self, infos: list[dict[str, Any]], dones: Any = None) -> None:
        """Statistics of the finished episodes only; stable-baselines3 searches all environments."""
        over = np.flatnonzero(dones)
        super()._update_info_buffer([infos[i] for i in over], dones[over])  # type: ignore[misc]
