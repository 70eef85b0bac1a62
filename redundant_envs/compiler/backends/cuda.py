"""Kernels on a GPU, through NVIDIA's driver: it makes machine code of PTX, and keeps it. Needs no package."""

import ctypes
import functools
import sys
from collections.abc import Sequence
from typing import Any

THREADS = 128
"""Of a block: four warps."""
LOG_BYTES = 1 << 14
JIT_ERROR_LOG, JIT_ERROR_LOG_BYTES = 5, 6
"""Options of the driver's assembler."""
FP32_PER_FP64 = 87
"""Number of the attribute of a device: how many times as fast it computes with 32 bits as with 64."""
SLOW = 8
"""From so many times on a user is told."""


class CudaError(RuntimeError):
    """The driver has refused something; the message says what, and why."""


@functools.cache
def _driver() -> Any:
    name = "nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1"
    try:
        driver = ctypes.CDLL(name)
    except OSError as error:
        raise CudaError(f"NVIDIA's driver is not installed ({error}); use device='cpu'") from None
    if status := driver.cuInit(0):
        raise CudaError(f"NVIDIA's driver found no GPU that it can use (cuInit gave {status})")
    return driver


def _call(name: str, *arguments: Any) -> None:
    if status := getattr(_driver(), name)(*arguments):
        text = ctypes.c_char_p()
        _driver().cuGetErrorString(status, ctypes.byref(text))
        raise CudaError(f"{name}: {(text.value or b'unknown error').decode()} ({status})")


def slowness(device: int) -> int:
    """How many times as fast a GPU computes with 32 bits as with 64: 2 on those for computing centres."""
    value, handle = ctypes.c_int(), ctypes.c_int()
    _call("cuDeviceGet", ctypes.byref(handle), device)
    _call("cuDeviceGetAttribute", ctypes.byref(value), FP32_PER_FP64, handle)
    return value.value


class Module:
    """The kernels of a PTX text, in the context of a device that is current when this is made."""

    def __init__(self, text: str, names: Sequence[str]) -> None:
        self._context = ctypes.c_void_p()
        _call("cuCtxGetCurrent", ctypes.byref(self._context))
        log, self._module = ctypes.create_string_buffer(LOG_BYTES), ctypes.c_void_p()
        options = (ctypes.c_int * 2)(JIT_ERROR_LOG, JIT_ERROR_LOG_BYTES)
        values = (ctypes.c_void_p * 2)(ctypes.addressof(log), LOG_BYTES)
        try:
            _call("cuModuleLoadDataEx", ctypes.byref(self._module), text.encode(), 2, options, values)
        except CudaError as error:
            raise CudaError(f"{error}: {log.value.decode(errors='replace')}") from None
        self._kernels = {name: ctypes.c_void_p() for name in names}
        for name, kernel in self._kernels.items():
            _call("cuModuleGetFunction", ctypes.byref(kernel), self._module, name.encode())

    def launch(self, name: str, count: int, arguments: Sequence[int | bytes], stream: int) -> None:
        """Run a kernel with at least so many threads, after what the stream has to do before; arguments are
        whole numbers, addresses in the device's memory, and bytes that it gets by value."""
        values = [
            ctypes.create_string_buffer(x, len(x)) if isinstance(x, bytes) else ctypes.c_int64(x)
            for x in arguments
        ]
        places = (ctypes.c_void_p * len(values))(*map(ctypes.addressof, values))
        blocks = -(-count // THREADS)
        handle, kernel = ctypes.c_void_p(stream), self._kernels[name]
        _call("cuCtxSetCurrent", self._context)  # a new thread has none
        _call("cuLaunchKernel", kernel, blocks, 1, 1, THREADS, 1, 1, 0, handle, places, None)
