"""A policy as an ONNX file: single precision in and out, double precision inside."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from redundant_envs.extras import needs

from .layers import Exact

with needs("onnx"):
    import onnx
    import onnxruntime
    import torch

OPSET = 17
"""Old enough for every runtime since 2022."""


def write(policy: Any, inputs: dict[str, int], path: Path, about: dict[str, str]) -> None:
    """Write a checked ONNX model with one input for each part of an observation, and ``actions``.

    ``about``: metadata of the model.
    """
    with warnings.catch_warnings():
        # torch prefers its other exporter, which needs onnxscript and writes newer files
        warnings.simplefilter("ignore", DeprecationWarning)
        torch.onnx.export(
            Exact(policy, torch.float32), tuple(torch.zeros(1, width) for width in inputs.values()),
            str(path), input_names=list(inputs), output_names=["actions"], opset_version=OPSET,
            dynamic_axes={name: {0: "batch"} for name in (*inputs, "actions")}, dynamo=False,
        )  # fmt: skip
    model = onnx.load(path)
    onnx.helper.set_model_props(model, about)
    onnx.checker.check_model(model, full_check=True)
    onnx.save(model, path)


def actions_of(path: Path, inputs: dict[str, int]) -> Any:
    """A function from observations (n, ...) to the actions (n, actions) that ONNX Runtime computes."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])

    def act(observations: Any) -> NDArray[np.float32]:
        parts = observations if isinstance(observations, dict) else {next(iter(inputs)): observations}
        given = {name: np.asarray(parts[name], dtype=np.float32) for name in inputs}
        actions: NDArray[np.float32] = session.run(["actions"], given)[0]
        return actions

    return act
