"""Environments that would be on a GPU: their programs as scalar code of this machine, or their PTX as C,
through a driver that is ours."""

import contextlib
import ctypes
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np
import torch

from redundant_envs.compiler.backends import cache, cuda, llvm
from redundant_envs.compiler.backends.processors import Processor
from redundant_envs.compiler.tracing.flow import Program
from redundant_envs.envs import torch_env, torch_lanes
from redundant_envs.envs.torch_env import ArmTorchVectorEnv
from redundant_envs.envs.torch_lanes import DeviceLanes, Launch
from tests.gpu.ptx_in_c import library

_entries: dict[str, dict[str, llvm.Entry]] = {}


def scalar(program: Program, shared: int, device: torch.device, scene: Any) -> Launch:
    """The kernels of a program, each of which goes through all lanes."""
    host, identity = llvm.host(), cache.identity(program)
    if identity not in _entries:
        with llvm.target(Processor(host.name, host.features, host.triple, 1)):
            code = llvm.object_code(program)
            _entries[identity] = llvm.load(code, [kernel.name for kernel in program.kernels])
    entries = _entries[identity]

    def launch(name: str, count: int, arguments: Sequence[int | bytes]) -> None:
        kept = [np.frombuffer(x, np.float64).copy() if isinstance(x, bytes) else x for x in arguments]
        frame = np.array([x.ctypes.data if isinstance(x, np.ndarray) else x for x in kept], np.int64)
        entries[name](frame.ctypes.data)

    return launch


class Emulated(ArmTorchVectorEnv):
    """Tensors of the CPU take the place of those of a GPU."""

    load: Any = staticmethod(scalar)

    def _runs_on_cpu(self) -> bool:
        return False

    def _check_gpu(self) -> None:
        with mock.patch.object(torch_env, "check_gpu"):
            super()._check_gpu()

    def _placed(self) -> DeviceLanes:
        return DeviceLanes(self._env.core, self.num_envs, self.device, self.load)


class ByDriver(Emulated):
    """The way of a GPU as far as the driver; use within :func:`driver`."""

    load = staticmethod(torch_lanes.on_gpu)


class Driver:
    """The functions of NVIDIA's driver that we call: kernels are C, and a launch has run when it returns."""

    def __init__(self) -> None:
        self.libraries: list[ctypes.CDLL] = []
        self.launches: list[tuple[int, int, int]] = []  # blocks, threads of each, stream

    def cuCtxGetCurrent(self, context: Any) -> int:
        context._obj.value = 99
        return 0

    def cuCtxSetCurrent(self, context: Any) -> int:
        assert context.value == 99
        return 0

    def cuModuleLoadDataEx(self, module: Any, text: bytes, count: int, options: Any, values: Any) -> int:
        self.libraries.append(library(text.decode(), Path(tempfile.mkdtemp(dir=self.folder))))
        module._obj.value = len(self.libraries)
        return 0

    def cuModuleGetFunction(self, kernel: Any, module: Any, name: bytes) -> int:
        found = getattr(self.libraries[module.value - 1], f"all_{name.decode()}")
        kernel._obj.value = ctypes.cast(found, ctypes.c_void_p).value
        return 0

    def cuLaunchKernel(self, kernel: Any, *given: Any) -> int:
        *sizes, shared, stream, places, extra = given
        assert (sizes[1:3], sizes[4:], shared, extra) == ([1, 1], [1, 1], 0, None)
        self.launches.append((sizes[0], sizes[3], stream.value))
        ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_uint32)(kernel.value)(places, sizes[0] * sizes[3])
        return 0


@contextlib.contextmanager
def driver() -> Iterator[Driver]:
    """Within this context a driver of ours has the place of NVIDIA's, and the CPU that of its GPU."""
    made = Driver()
    stream = SimpleNamespace(cuda_stream=77, synchronize=lambda: None)
    with tempfile.TemporaryDirectory() as made.folder, contextlib.ExitStack() as patches:
        for place, name, value in (
            (cuda, "_driver", lambda: made),
            (torch.cuda, "device", lambda device: contextlib.nullcontext()),
            (torch.cuda, "current_stream", lambda *device: stream),
            (torch_lanes, "check_memory", lambda *arguments: None),
        ):
            patches.enter_context(mock.patch.object(place, name, value))
        yield made
